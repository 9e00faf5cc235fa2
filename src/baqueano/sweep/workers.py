"""Many jobs that take long, spread over processes; what is done when a person presses Ctrl-C is kept.

A fit spends half of its time in Python, whose threads wait for each other: jobs go to processes. Ctrl-C is for
the one that gives out the work; the others finish the job they have, a second or so.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from typing import Any, TypeVar

J = TypeVar("J")
R = TypeVar("R")


def processors() -> int:
    """Return the count of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def spread_over(
    work: Callable[[J], R],
    jobs: Sequence[J],
    processes: int = 1,
    each: Callable[[int], None] | None = None,
) -> list[R]:
    """`work` of each job, in the order in which they end; `each` is called with 1 after each of them.

    `work`, a function of a module, jobs and results are pickled where there is more than one process. After
    Ctrl-C: what is done.
    """
    tell, results = each or (lambda n: None), []
    if processes < 2 or len(jobs) < 2:
        try:
            for job in jobs:
                results.append(work(job))
                tell(1)
        except KeyboardInterrupt:
            pass
        return results
    pool = ProcessPoolExecutor(
        min(processes, len(jobs)), mp_context=get_context("spawn"), initializer=_end_with_parent
    )
    with _deaf():  # who is begun now never hears Ctrl-C
        waiting = [pool.submit(work, job) for job in jobs]
    try:
        for future in as_completed(waiting):
            results.append(future.result())
            tell(1)
    except KeyboardInterrupt:
        pool.shutdown(cancel_futures=True)
        return [future.result() for future in waiting if future.done() and not future.cancelled()]
    finally:
        pool.shutdown(cancel_futures=True)
    return results


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _deaf() -> Iterator[None]:
    """Ctrl-C is not heard, where it can be (in the first thread of the program)."""
    try:
        before: Any = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
