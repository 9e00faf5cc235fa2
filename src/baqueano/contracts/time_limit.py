"""Limit the time of a call. A call that hangs raises an error that names its line.

An alarm of the operating system interrupts Python code between two instructions. A call that is stuck inside C (a
call of a library, a huge matrix) is therefore named only when it returns. The time is not limited outside the main
thread, nor on a system without alarms, such as Windows. Another thread cannot raise the exception instead: Python 3.11
hangs in the next function that a debugger traces, if such an exception was withdrawn.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any, TypeVar

from baqueano.errors import ExternalError
from baqueano.messages.language import translate as _

HANG_S = 10.0  # of a call of a block for which no vehicle waits; a first step can compile or load a library
PREPARE_S = 60.0  # to import libraries, and to trace or compile blocks
ALARM_PERIOD_S = 0.02  # between further alarms, for a block that catches the first one
DEBUGGERS = ("bdb", "pydevd")
IMPORTERS = ("importlib._bootstrap", "_frozen_importlib")
Value = TypeVar("Value")


class BudgetExceeded(ExternalError):
    """The exception that the alarm raises. An `except Exception` in a block does not catch it."""


def within(seconds: float, call: Callable[..., Value], *inputs: object, import_s: float = 0.0) -> Value:
    """Return the result of `call`. Raise TimeoutError, at the line that runs, if the call takes longer than `seconds`.

    The time of a limited call inside does not count. The time starts again while a debugger waits for its user, and,
    up to `import_s` after the start, while the call imports a module.
    """
    if not (hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()):
        return call(*inputs)
    is_running, outer_timer = True, (0.0, 0.0)
    tracers: list[Any] = []  # one for each alarm
    import_end_s = time.monotonic() + import_s

    def ring(number: int, frame: FrameType | None) -> None:
        is_importing = time.monotonic() < import_end_s and _runs_module(frame, IMPORTERS, within.__code__)
        if is_running and (is_importing or _runs_module(frame, DEBUGGERS)):
            signal.setitimer(signal.ITIMER_REAL, seconds, ALARM_PERIOD_S)
        elif is_running:
            tracers.append(sys.gettrace())
            if len(tracers) > 1:  # the block catches them: raise also inside its `except`
                _trace_lines(frame)
            raise BudgetExceeded

    outer_handler = signal.signal(signal.SIGALRM, ring)
    try:
        try:
            outer_timer = signal.setitimer(signal.ITIMER_REAL, seconds, ALARM_PERIOD_S)
            return call(*inputs)
        finally:
            is_running = False  # a later alarm has no effect; an earlier one is handled below
            if len(tracers) > 1:
                sys.settrace(tracers[0])
    except BudgetExceeded as alarm:
        text = _("it took longer than {s:g} s", s=seconds)
        raise TimeoutError(text).with_traceback(alarm.__traceback__) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, outer_handler)
        if outer_timer[0] > 0.0:
            signal.setitimer(signal.ITIMER_REAL, *outer_timer)


def _trace_lines(frame: FrameType | None) -> None:
    """Raise BudgetExceeded at the next line of the limited call."""
    sys.settrace(_raise_at_line)
    while frame is not None and frame.f_code is not within.__code__:
        frame.f_trace = _raise_at_line
        frame = frame.f_back


def _raise_at_line(frame: FrameType, event: str, value: object) -> Any:
    if event == "line":
        raise BudgetExceeded
    return _raise_at_line


def _runs_module(frame: FrameType | None, names: tuple[str, ...], outer_code: CodeType | None = None) -> bool:
    """Return True if a module with one of the `names` runs, inside a call of `outer_code` if this is given."""
    while frame is not None and frame.f_code is not outer_code:
        if frame.f_globals.get("__name__") in names:
            return True
        frame = frame.f_back
    return False
