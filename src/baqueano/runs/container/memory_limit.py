"""Limit the memory for an external file to 20 times its size, at least 64 MiB, at most 1 GiB.

A run at rest unpacks to about ten times its file. A file made to fill the memory unpacks to a thousand times its size.
"""

from baqueano.messages.language import number

MIN_BYTES, BYTES_PER_FILE_BYTE, MAX_EXTRA_BYTES = 64 * 2**20, 20, 2**30


def limit_bytes(size: int) -> int:
    """Return the largest number of bytes of memory for a file of `size` bytes."""
    return min(max(MIN_BYTES, BYTES_PER_FILE_BYTE * size), MAX_EXTRA_BYTES)


def format_size(size: int) -> str:
    """Return a number of bytes as text for a message: 135 kB, 2.1 GB."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= scale:
            return f"{number(size / scale):.3g} {unit}"
    return f"{size} bytes"
