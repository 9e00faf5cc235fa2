"""A time budget for blocks that run as they are written: one that hangs ends with the name of its line.

A compiled block is straight arithmetic and cannot hang; Python text can. An alarm of the system interrupts it
between two instructions of Python, so a block that is stuck inside C (a call of a library, a huge matrix) is named
only when it comes back: until then nothing is sent, and the dead man of the firmware has long stopped the motors.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

BUDGET_S = 0.1  # ten ticks: a third of the dead man's patience
AGAIN_S = 0.02  # for a block that swallows the first alarm
PREPARE_S = 60.0  # to trace, compile and try the blocks, before anything moves


class TooLong(BaseException):
    """The alarm; no `except Exception` of a block holds it."""


@dataclass(frozen=True, slots=True, eq=False)
class Budgeted:
    """A block whose step ends within `budget_s`, by TimeoutError if need be."""

    block: Any
    budget_s: float = BUDGET_S

    def init(self, *start: Any) -> Any:
        """The block's own start."""
        with within(self.budget_s):
            return self.block.init(*start)

    def step(self, state: Any, *inputs: Any) -> Any:
        """The block's own step."""
        with within(self.budget_s):
            return self.block.step(state, *inputs)


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """TimeoutError, raised at the line that runs then, if the body takes longer. Where the system has no such alarm,
    or in a thread, there is no limit."""
    if not (hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()):
        yield
        return
    before = signal.signal(signal.SIGALRM, _ring)
    signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
    try:
        yield
    except TooLong as alarm:
        text = f"it took longer than {1e3 * seconds:.0f} ms"
        raise TimeoutError(text).with_traceback(alarm.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _ring(number: int, frame: Any) -> None:
    raise TooLong
