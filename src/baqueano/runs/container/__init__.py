"""The MCAP file of a run: written while the vehicle drives, and readable even if it was cut or damaged.

run_file, messages, packing    topics of a run and the bytes of their messages
writer                         signals → file, in a separate thread
records, reader                file → run, every checksum verified
memory_limit                   the memory that an external file may unpack to
"""
