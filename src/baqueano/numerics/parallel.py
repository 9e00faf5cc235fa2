"""Do the same work on each run of a fit, on all cores if that is faster.

Kernels and long NumPy calls release the GIL, so threads speed them up. Many short NumPy calls do not: two threads
exchange the lock all the time, and take longer than one. So within one run only a single long call runs `prefetch` in a
thread. Work inside a thread must not start other work in the threads: all could wait for each other.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from threading import Event
from typing import Any, TypeVar

import numpy as np

R = TypeVar("R")
MIN_ROWS = 4_000  # total number of rows above which threads are faster
CACHED_OPERATIONS = 200_000  # operations of a product that runs on one core


def parallel_map(work: Callable[..., R], *lists: Sequence[Any], rows: int) -> list[R]:
    """Return the results of `work` for the first entries of the lists, for the second entries, and so on. `rows` is
    the total number of data rows."""
    if len(lists[0]) < 2 or rows < MIN_ROWS:
        return list(map(work, *lists))
    return list(_pool().map(work, *lists))


def prefetch(work: Callable[[], R], *, rows: int) -> Callable[[], R]:
    """Start `work`, one long call, on another core if that is faster. Return a function that waits for its result."""
    if rows < MIN_ROWS:
        return work
    run_event = Event()

    def begin() -> R:
        run_event.set()
        return work()

    end = _pool().submit(begin).result
    run_event.wait()  # otherwise short calls here might delay it by holding the lock
    return end


def cache_slices(n: int, operations: int) -> Iterator[slice]:
    """Return slices of n rows that fit in the processor's cache, for a product of `operations` per row. NumPy's library
    uses its own threads for larger products; these wait for each other and keep a core busy."""
    step = max(1, CACHED_OPERATIONS // max(operations, 1))
    return (slice(first, min(first + step, n)) for first in range(0, n, step))


def gram(x: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Return Σ w x xᵀ (p, p) over the rows of x (n, p), with the weights w (n,), or 1.

    Without weights NumPy computes only half of the product, because both factors are the same array.
    """
    return inner(x, x, weight)


def inner(x: np.ndarray, y: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Return Σ w x yᵀ (p, q) over the rows of x (n, p) and of y (n, q), with the weights w (n,), or 1."""
    if len(x) * x.shape[1] * y.shape[1] <= CACHED_OPERATIONS:
        return (x if weight is None else x * weight[:, None]).T @ y
    product = np.zeros((x.shape[1], y.shape[1]))
    for rows in cache_slices(len(x), product.size):
        product += (x[rows] if weight is None else x[rows] * weight[rows, None]).T @ y[rows]
    return product


def dot(x: np.ndarray, y: np.ndarray) -> float:
    """Return Σ x y of two rows (n,) on one core. For more than 10,000 entries `@` starts the threads of NumPy's
    library, which then wait for each other. The same is true for a matrix times a row."""
    return float(np.einsum("i,i->", x, y))


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=os.cpu_count() or 1, thread_name_prefix="fit")
