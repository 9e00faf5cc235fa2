"""Other processes as the system sees them, and what several measurements come to."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

SESSION = Path("/proc/self/autogroup")


def resident_mb(process: int, most: bool = False) -> float:
    """Return the resident memory of a process [MB], or the most that it had since `forget_most`."""
    text = Path(f"/proc/{process}/status").read_text()
    match = re.search(rf"{'VmHWM' if most else 'VmRSS'}:\s+(\d+)", text)
    assert match is not None
    return 1024e-6 * float(match[1])


def forget_most(process: int) -> None:
    """Let the most of `resident_mb` begin at what it is now."""
    Path(f"/proc/{process}/clear_refs").write_text("5")


def first_of_all(process: int) -> bool:
    """Let the main thread of a process run before all others, and all that this process starts after it; False where
    that is not allowed."""
    try:
        os.sched_setscheduler(process, os.SCHED_FIFO, os.sched_param(50))
    except (OSError, AttributeError):
        return False
    return True


@contextmanager
def before_others() -> Iterator[str]:
    """Let this process and those that it starts come before what else the machine does; whether that is allowed, in
    words. Linux shares first between sessions, then in each."""
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
    """Return what one of a hundred exceeds."""
    return quantile(values, 0.99)


def quantile(values: Sequence[float], q: float) -> float:
    """Return the value below which the share `q` of all lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(q * len(ordered)))]


def spread(values: Sequence[float]) -> str:
    """Return the least and the largest in words."""
    return f"{min(values):.3g} to {max(values):.3g}"
