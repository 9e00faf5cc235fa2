"""Turns among the processes of one run of pytest: a test runs beside tests of other processes, or exclusively.

`turn` yields a function: from its call on, this process runs exclusively.

    room    shared by tests that run beside each other, or held by one exclusive test                          (1)
    queue   held while entering the room; a waiting exclusive test keeps it, so no other test enters           (2)

The locks belong to processes, so a killed process releases them. On Windows, and without pytest-xdist, no test waits.
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
    exclusive: bool, run: str = os.environ.get("PYTEST_XDIST_TESTRUNUID", "")
) -> Iterator[Callable[[], None]]:
    """Run a block in its turn among the processes of this test run."""
    if not run or os.name == "nt":
        yield lambda: None
        return
    places = lock_files(run)
    with places[0].open("a+") as queue, places[1].open("a+") as room:

        def enter(lock: int) -> None:
            fcntl.lockf(room, fcntl.LOCK_UN)  # two processes that wait for each other would never continue
            fcntl.lockf(queue, fcntl.LOCK_EX)
            fcntl.lockf(room, lock)
            fcntl.lockf(queue, fcntl.LOCK_UN)

        enter(fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH)
        yield lambda: enter(fcntl.LOCK_EX)


def lock_files(run: str) -> list[Path]:
    """Return the files of the locks of a test run; the last process of the run removes them."""
    return [Path(tempfile.gettempdir()) / f"baqueano-{run}-{name}" for name in ("queue", "room")]
