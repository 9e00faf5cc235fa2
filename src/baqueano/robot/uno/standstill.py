"""Detect a standstill of the computer during a drive, after which the motors must stay off.

    gap = now − last command > dead-man time, on the clock of the host                                    (1)

A process can be stopped and continued, a virtual machine paused, a laptop closed. If (1) is true, the firmware's
dead-man timer has stopped the motors. Telemetry of that time can be lost or delayed, so the host uses only its clock.
CLOCK_BOOTTIME includes the time of a suspended computer, CLOCK_MONOTONIC does not.
"""

import time
from collections.abc import Callable

from baqueano.diagnostics import Diagnostic, StopReason, stop


def boot_ns() -> int:
    """Return the time [ns] since the computer was started, including suspended time if the system has such a clock."""
    return (
        time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic_ns()
    )


class Standstill:
    """A monitor of the time of the last command, on the clock `now_ns` of the host.

    `reason` states why a further command must not be sent; None if it is allowed.
    """

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = boot_ns if now_ns is time.monotonic_ns else now_ns
        self._last_ns = -1
        self.reason: Diagnostic | None = None

    def reset(self) -> None:
        """Clear the reason and the time of the last command, because no drive is in progress."""
        self._last_ns, self.reason = -1, None

    def record_command(self) -> None:
        """Record that a command is sent now."""
        self._last_ns = self._now_ns()

    def check(self, dead_man_ms: int) -> Diagnostic | None:
        """Return `reason`, after setting it if the last command is too old.  (1)"""
        gap_ns = self._now_ns() - self._last_ns
        if self.reason is None and self._last_ns >= 0 and gap_ns > 1_000_000 * dead_man_ms:
            self.reason = stop(
                StopReason.STANDSTILL, silent_s=round(gap_ns * 1e-9, 2), dead_man_s=1e-3 * dead_man_ms
            )
        return self.reason
