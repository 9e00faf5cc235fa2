"""Write and read the MCAP file of a run. It is written during the drive, and readable even if it was cut or damaged.

run_file, messages, packing    topics of a run and the bytes of their messages
writer                         signals → file, in a separate thread
records, reader                file → run, every checksum verified
memory_limit                   the largest memory for the unpacked content of an external file
"""
