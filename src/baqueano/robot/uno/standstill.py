"""A computer that stood still while it drove must not drive on by itself: the dead man has stopped the motors.

    gap = now − last command > dead man's time, on the clock of the host                                  (1)

A process can be stopped and continued, a virtual machine paused, a laptop closed. Telemetry of that time may be lost,
late or old, so the host judges by its own clock. CLOCK_BOOTTIME counts a suspended computer, CLOCK_MONOTONIC does not.
"""

import time
from collections.abc import Callable


def boot_ns() -> int:
    """Return the time since the computer was started, suspended or not, where the system has such a clock [ns]."""
    return (
        time.clock_gettime_ns(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic_ns()
    )


class Standstill:
    """The time of the last command. `now_ns` is the clock of the host, `why` says in words why no other may leave."""

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = boot_ns if now_ns is time.monotonic_ns else now_ns
        self._last_ns, self.why = -1, ""

    def forget(self) -> None:
        """Nothing drives."""
        self._last_ns, self.why = -1, ""

    def driven(self) -> None:
        """A command leaves now."""
        self._last_ns = self._now_ns()

    def look(self, dead_man_ms: int) -> str:
        """Return `why`, which is "" where the last command is recent enough.  (1)"""
        gap_ns = self._now_ns() - self._last_ns
        if not self.why and self._last_ns >= 0 and gap_ns > 1_000_000 * dead_man_ms:
            self.why = (
                f"the computer stood still for {round(gap_ns * 1e-9, 2):g} s; the motors were off from "
                f"{1e-3 * dead_man_ms:g} s on"
            )
        return self.why
