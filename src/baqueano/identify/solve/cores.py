"""The same work on each run of a fit, on all cores where that pays.

Kernels and NumPy's long loops let go of the interpreter's lock, so threads do. Work that is given to them must
not give work to them again: all might wait for each other.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, TypeVar

R = TypeVar("R")
ENOUGH = 4_000  # rows in all, from which on threads pay


def each(what: Callable[..., R], *lists: Sequence[Any], rows: int) -> list[R]:
    """`what` of the first of each list, of the second, …; there are so many `rows` of data in all."""
    if len(lists[0]) < 2 or rows < ENOUGH:
        return list(map(what, *lists))
    return list(_pool().map(what, *lists))


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="fit")
