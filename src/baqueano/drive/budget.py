"""Limit the time of blocks that run as Python code. A block that hangs raises an error that names its line.

A compiled block consists of arithmetic without loops and cannot hang, but Python code can. An alarm of the operating
system interrupts it between two instructions of Python. A block that is stuck inside C (a call of a library, a huge
matrix) is therefore named only when that call returns. Until then no command is sent, and the firmware's dead man stops
the motors.
"""

import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any, ClassVar, TypeVar

from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.errors import ExternalError
from baqueano.messages.language import translate as _
from baqueano.symbolic.function import CompiledBlock

BUDGET_S = 0.1  # ten ticks: a third of the firmware's dead-man time
ALARM_PERIOD_S = 0.02  # between further alarms, for a block that swallows the first alarm
PREPARE_S = 60.0  # to trace, compile and try the blocks before the vehicle moves
Value = TypeVar("Value")


class BudgetExceeded(ExternalError):
    """The exception that the alarm raises. An `except Exception` in a block does not catch it."""


@dataclass(frozen=True, slots=True, eq=False)
class BudgetedBlock:
    """A wrapper of a block: its `init` and `step` raise TimeoutError if they take longer than `budget_s`."""

    inner_blocks: ClassVar[tuple[str, ...]] = ("block",)

    block: Any
    budget_s: float = BUDGET_S

    def init(self, *start: object) -> Any:
        """Return the initial state of the wrapped block, within the budget."""
        return within(self.budget_s, self.block.init, *start)

    def step(self, state: Tree, *inputs: object) -> Any:
        """Return the result of the wrapped block's step, within the budget."""
        return within(self.budget_s, self.block.step, state, *inputs)


def may_hang(block: Tree) -> bool:
    """Return True for a block that runs as Python code and contains code that can be the user's."""
    if isinstance(block, CompiledBlock):
        return False
    parts = [getattr(block, name, None) for name in optional.attribute(block, "inner_blocks")]
    return not optional.attribute(block, "is_interpreted") or any(map(may_hang, parts))


def within(seconds: float, call: Callable[..., Value], *inputs: object) -> Value:
    """Return the result of `call`. Raise TimeoutError, at the line that runs, if the call takes longer than `seconds`.

    The time is not limited on a system without alarms, or outside the main thread.
    """
    if not (hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()):
        return call(*inputs)
    running = True

    def ring(number: int, frame: FrameType | None) -> None:
        if running:
            raise BudgetExceeded

    previous_handler = signal.signal(signal.SIGALRM, ring)
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, seconds, ALARM_PERIOD_S)
            return call(*inputs)
        finally:
            running = False  # a later alarm has no effect; an earlier one is handled below
    except BudgetExceeded as alarm:
        text = _("it took longer than {ms:.0f} ms", ms=1e3 * seconds)
        raise TimeoutError(text).with_traceback(alarm.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous_handler)
