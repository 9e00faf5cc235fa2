"""Provide clocks: for a simulation or for real time. Each yields strictly increasing integers t_ns.

A missed tick is skipped and not executed later: the next tick is again on the grid. `missed_ticks` counts
the skipped ticks.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from baqueano.signals import NANOSECONDS


def simulated_ticks(rate_hz: float, duration_s: float | None = None) -> Iterator[int]:
    """Yield the ends of the ticks [ns] up to `duration_s`, without waiting; endlessly if it is None or infinite."""
    k = 1
    while _is_tick_within(k, rate_hz, duration_s):
        yield round(k * NANOSECONDS / rate_hz)
        k += 1


@dataclass
class Wall:
    """A clock of real time on a regular grid [ns]. It is monotonic, so it does not jump when the date is set."""

    rate_hz: float
    duration_s: float | None = None
    now_ns: Callable[[], int] = time.monotonic_ns
    sleep: Callable[[float], object] = time.sleep
    missed_ticks: int = field(default=0, init=False)  # ticks that were skipped because the loop was late

    def __iter__(self) -> Iterator[int]:
        start_ns = self.now_ns()
        k = 1
        while _is_tick_within(k, self.rate_hz, self.duration_s):
            due_ns = start_ns + round(k * NANOSECONDS / self.rate_hz)
            wait_ns = due_ns - self.now_ns()
            if wait_ns > 0:
                self.sleep(wait_ns / NANOSECONDS)
            yield due_ns
            late_ns = self.now_ns() - due_ns
            step_count = max(1, -int(-late_ns * self.rate_hz // NANOSECONDS))
            self.missed_ticks += step_count - 1
            k += step_count


def wall(rate_hz: float, duration_s: float | None = None) -> Wall:
    """Return a clock of real time, for a vehicle; endless if `duration_s` is None or infinite."""
    return Wall(rate_hz, duration_s)


def _is_tick_within(k: int, rate_hz: float, duration_s: float | None) -> bool:
    return duration_s is None or duration_s == math.inf or k <= round(duration_s * rate_hz)
