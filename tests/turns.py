"""Turns among the processes of one run of pytest: a test runs beside those of the others, or alone.

`turn` yields a function: from its call on, this process runs alone.

    room    shared by the tests that run beside each other; of one alone                                      (1)
    queue   of whoever enters the room: one alone who waits in it lets nobody pass                            (2)

The locks belong to processes, so that one that dies leaves them. On Windows, and without pytest-xdist, nobody waits.
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

with suppress(ImportError):
    import fcntl


@contextmanager
def turn(
    alone: bool, run: str = os.environ.get("PYTEST_XDIST_TESTRUNUID", "")
) -> Iterator[Callable[[], None]]:
    """Run something in its turn among the processes of this run."""
    if not run or os.name == "nt":
        yield lambda: None
        return
    places = [Path(tempfile.gettempdir()) / f"baqueano-{run}-{name}" for name in ("queue", "room")]
    with places[0].open("a+") as queue, places[1].open("a+") as room:

        def enter(lock: int) -> None:
            fcntl.lockf(room, fcntl.LOCK_UN)  # two who wait for each other to leave would wait for ever
            fcntl.lockf(queue, fcntl.LOCK_EX)
            fcntl.lockf(room, lock)
            fcntl.lockf(queue, fcntl.LOCK_UN)

        enter(fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        yield lambda: enter(fcntl.LOCK_EX)
