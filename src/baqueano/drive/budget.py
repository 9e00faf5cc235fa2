"""Limit the time of blocks that run as Python code: a block that hangs ends with an error that names its line.

A compiled block is straight arithmetic and cannot hang; Python code can. An alarm of the operating system interrupts it
between two instructions of Python. A block that is stuck inside C (a call of a library, a huge matrix) is therefore
named only when that call returns. Until then no command is sent, and the dead-man timer of the firmware has long
stopped the motors.
"""

import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any, ClassVar, TypeVar

from baqueano.contracts.values import Tree
from baqueano.errors import FromOutside
from baqueano.language import translated as _

BUDGET_S = 0.1  # ten ticks: a third of the firmware's dead-man time
AGAIN_S = 0.02  # for a block that swallows the first alarm
PREPARE_S = 60.0  # to trace, compile and try the blocks, before anything moves
Value = TypeVar("Value")


class TooLong(FromOutside):
    """The alarm. It is raised so that an `except Exception` in a block does not catch it."""


@dataclass(frozen=True, slots=True, eq=False)
class BudgetedBlock:
    """A block whose step ends within `budget_s`, with TimeoutError if it takes longer."""

    goes_around: ClassVar[tuple[str, ...]] = ("block",)

    block: Any
    budget_s: float = BUDGET_S

    def init(self, *start: object) -> Any:
        """Return the block's own initial state."""
        return within(self.budget_s, self.block.init, *start)

    def step(self, state: Tree, *inputs: object) -> Any:
        """Return the result of the block's own step."""
        return within(self.budget_s, self.block.step, state, *inputs)


def within(seconds: float, call: Callable[..., Value], *inputs: object) -> Value:
    """Return the result of `call`. Raise TimeoutError, at the line that is running, if it takes longer than `seconds`.

    The time is not limited in a system without alarms, nor in a thread.
    """
    if not (hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()):
        return call(*inputs)
    running = True

    def ring(number: int, frame: FrameType | None) -> None:
        if running:
            raise TooLong

    before = signal.signal(signal.SIGALRM, ring)
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN_S)
            return call(*inputs)
        finally:
            running = False  # an alarm from here on is too late; one before this line is held below
    except TooLong as alarm:
        text = _("it took longer than {ms:.0f} ms", ms=1e3 * seconds)
        raise TimeoutError(text).with_traceback(alarm.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
