"""The MCAP file of a run: what is written while the vehicle drives, and read back even where it was cut or damaged.

run_file, messages, packing    topics of a run and the bytes of their messages
writer                         signals → file, in a thread of its own
records, reader                file → run, every checksum verified
memory_limit                   how much a file of somebody else may unpack to
"""
