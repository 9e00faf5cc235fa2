"""A time budget for blocks that run as they are written: one that hangs ends with the name of its line.

A compiled block is straight arithmetic and cannot hang; Python text can. An alarm of the system interrupts it
between two instructions of Python. So a block that is stuck inside C is named only when it comes back (a call of a
library, a huge matrix): until then nothing is sent, and the dead man of the firmware has long stopped the motors.
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

BUDGET_S = 0.1  # ten ticks: a third of the dead man's patience
AGAIN_S = 0.02  # for a block that swallows the first alarm
PREPARE_S = 60.0  # to trace, compile and try the blocks, before anything moves
Value = TypeVar("Value")


class TooLong(FromOutside):
    """The alarm; no `except Exception` of a block holds it."""


@dataclass(frozen=True, slots=True, eq=False)
class BudgetedBlock:
    """A block whose step ends within `budget_s`, by TimeoutError if need be."""

    goes_around: ClassVar[tuple[str, ...]] = ("block",)

    block: Any
    budget_s: float = BUDGET_S

    def init(self, *start: object) -> Any:
        """The block's own start."""
        return within(self.budget_s, self.block.init, *start)

    def step(self, state: Tree, *inputs: object) -> Any:
        """The block's own step."""
        return within(self.budget_s, self.block.step, state, *inputs)


def within(seconds: float, call: Callable[..., Value], *inputs: object) -> Value:
    """Return the result of `call`; TimeoutError, raised at the running line, if it takes longer. Without an alarm,
    or in a thread, the time is not limited."""
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
