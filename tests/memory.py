"""Measure the memory of Python's objects."""

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def memory_trace() -> Iterator[None]:
    """Let tracemalloc count the memory that is allocated within the context."""
    tracemalloc.start()
    try:
        yield
    finally:
        tracemalloc.stop()
