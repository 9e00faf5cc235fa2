"""Read figures of other processes from the system, and summarise repeated measurements."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

SESSION = Path("/proc/self/autogroup")


def resident_mb(process: int, peak: bool = False) -> float:
    """Return the resident memory [MB] of a process, or, if `peak`, its maximum since `forget_most`."""
    text = Path(f"/proc/{process}/status").read_text()
    match = re.search(rf"{'VmHWM' if peak else 'VmRSS'}:\s+(\d+)", text)
    assert match is not None
    return 1024e-6 * float(match[1])


def forget_most(process: int) -> None:
    """Reset the maximum of `resident_mb` to the present value."""
    Path(f"/proc/{process}/clear_refs").write_text("5")


def first_of_all(process: int) -> bool:
    """Set real-time priority for a process and all that it starts later; return False if this is not allowed."""
    try:
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(50))
    except (OSError, AttributeError):
        return False
    return True


@contextmanager
def before_others() -> Iterator[str]:
    """Run this process, and those that it starts, with the highest priority; yield a text with the success.

    Linux divides its time first between sessions, then within each session, so the priority is set for both.
    """
    try:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        os.setpriority(os.PRIO_PROCESS, 0, -20)
        SESSION.write_text("-20")
    except (OSError, AttributeError):
        yield "among the other work of this machine"
        return
    try:
        yield "before the other work of this machine"
    finally:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, nice)
            SESSION.write_text("0")


def p99(values: Sequence[float]) -> float:
    """Return the 99 % quantile: one value of a hundred exceeds it."""
    return quantile(values, 0.99)


def quantile(values: Sequence[float], q: float) -> float:
    """Return the `q` quantile: the share `q` of all values is below it."""
    ordered_values = sorted(values)
    return ordered_values[min(len(ordered_values) - 1, int(q * len(ordered_values)))]


def spread(values: Sequence[float]) -> str:
    """Return the least and the largest value as text."""
    return f"{min(values):.3g} to {max(values):.3g}"
