"""Distribute long jobs over processes; after Ctrl-C the finished results are kept.

A fit spends half of its time in Python, whose threads wait for each other, so jobs run in processes. Only the parent
process handles Ctrl-C. The workers finish their present job, which needs about a second. They do not run the script of
the user again, as Python does by default: a script without `if __name__ == "__main__"` would begin once per worker.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from types import ModuleType
from typing import Any, TypeVar

from baqueano.messages.language import choose_language, chosen_language

Job = TypeVar("Job")
JobResult = TypeVar("JobResult")


def processor_count() -> int:
    """Return the number of processors that this process is allowed to use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def run_in_processes(
    work: Callable[[Job], JobResult],
    jobs: Sequence[Job],
    processes: int = 1,
    advance: Callable[[int], None] | None = None,
) -> list[JobResult]:
    """Return `work` of each job, in the order in which they end; `advance` is called with 1 after each job.

    With more than one process, `work`, the jobs and the results are pickled, so `work` must be a function of a
    module. After Ctrl-C, return the finished results.
    """
    report, results = advance or (lambda n: None), []
    if processes < 2 or len(jobs) < 2:
        try:
            for job in jobs:
                results.append(work(job))
                report(1)
        except KeyboardInterrupt:
            pass
        return results
    pool = ProcessPoolExecutor(
        min(processes, len(jobs)), get_context("spawn"), _prepare_worker, (chosen_language(),)
    )
    with _ignore_interrupt(), _without_script():  # for the workers that start here
        waiting = [pool.submit(work, job) for job in jobs]
    try:
        for future in as_completed(waiting):
            results.append(future.result())
            report(1)
    except KeyboardInterrupt:
        pool.shutdown(cancel_futures=True)
        return [future.result() for future in waiting if future.done() and not future.cancelled()]
    finally:
        pool.shutdown(cancel_futures=True)
    return results


def run_in_batches(
    work: Callable[[range], JobResult],
    seeds: range,
    size: int,
    processes: int = 1,
    advance: Callable[[int], None] | None = None,
) -> list[JobResult]:
    """Return `work` of each batch of `size` seeds, as `run_in_processes`; `advance` is called with `size`."""
    report = advance or (lambda n: None)
    batches = [seeds[k : k + size] for k in range(0, len(seeds), size)]
    return run_in_processes(work, batches, processes, lambda n: report(n * size))


def _prepare_worker(language: str) -> None:
    """Choose the language of this worker process, for the texts in its results. End the process when its parent ends,
    because it would otherwise wait for jobs forever.
    """
    choose_language(language)
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _without_script() -> Iterator[None]:
    """Hide the module of the user's script, which multiprocessing would run in each worker that starts."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


@contextmanager
def _ignore_interrupt() -> Iterator[None]:
    """Ignore Ctrl-C in the main thread.
    In other threads do nothing, because Python allows this only in the main thread.
    """
    try:
        previous_handler: Any = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_handler)
