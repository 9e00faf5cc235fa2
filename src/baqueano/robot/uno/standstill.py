"""Detect a standstill of the computer during a drive: the dead man has stopped the motors, and they must stay off.

    gap = now − last command > dead man's time, on the clock of the host                                  (1)

A process can be stopped and continued, a virtual machine paused, a laptop closed. Telemetry of that time may be lost,
late or old, so the host judges by its own clock. CLOCK_BOOTTIME counts a suspended computer, CLOCK_MONOTONIC does not.
"""

import time
from collections.abc import Callable

from baqueano.diagnostics import Diagnostic, StopReason, stop


def boot_ns() -> int:
    """Return the time since the computer was started [ns], with its suspended time if the system has such a clock."""
    return (
        time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic_ns()
    )


class Standstill:
    """The monitor of the last command's time, on the clock `now_ns` of the host.

    `reason` states why no further command may be sent, None if it may.
    """

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = boot_ns if now_ns is time.monotonic_ns else now_ns
        self._last_ns = -1
        self.reason: Diagnostic | None = None

    def forget(self) -> None:
        """Clear the reason and the time of the last command: nothing drives."""
        self._last_ns, self.reason = -1, None

    def driven(self) -> None:
        """Note that a command is sent now."""
        self._last_ns = self._now_ns()

    def look(self, dead_man_ms: int) -> Diagnostic | None:
        """Return `reason`, which is None if the last command is recent enough.  (1)"""
        gap_ns = self._now_ns() - self._last_ns
        if self.reason is None and self._last_ns >= 0 and gap_ns > 1_000_000 * dead_man_ms:
            self.reason = stop(
                StopReason.STANDSTILL, still_s=round(gap_ns * 1e-9, 2), dead_man_s=1e-3 * dead_man_ms
            )
        return self.reason
