"""Generate the ticks of a simulated drive, which follow wall time at a pace that can be changed and paused.

  due_{k+1} = due_k + 1/(f · pace)                                                                       (1)

No tick is skipped: if the computer is more than MAX_DELAY_S behind the pace, simulated time slows down.
"""

import time
from collections.abc import Callable, Iterator

from baqueano.errors import Invalid
from baqueano.signals import NANOSECONDS

MAX_DELAY_S = 0.1
PAUSE_POLL_S = 0.01  # between two checks during a pause
MIN_PACE, MAX_PACE = 0.05, 50.0


class PacedClock:
    """The pace, common to all drives of a service.

    `ticks` is the clock of one drive; any thread can call the other methods.
    """

    def __init__(
        self,
        factor: float = 1.0,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._now_s, self._sleep = now_s, sleep
        self.paused, self.late_ms = False, 0.0
        self._ticks_until_pause = 0  # ticks until the next pause
        self.set_pace(factor)

    def set_pace(self, factor: float) -> None:
        """Let simulated time pass `factor` times as fast. Raise Invalid if it is outside [MIN_PACE, MAX_PACE]."""
        if not MIN_PACE <= factor <= MAX_PACE:
            raise Invalid.of("door.pace", value=factor, min_factor=MIN_PACE, max_factor=MAX_PACE)
        self.factor = float(factor)

    def pause(self) -> None:
        """Pause simulated time."""
        self.paused, self._ticks_until_pause = True, 0

    def resume(self, ticks: int = 0) -> None:
        """Let simulated time pass again. If `ticks` > 0, pause after this number of ticks."""
        self._ticks_until_pause, self.paused = max(0, ticks), ticks > 0

    def ticks(
        self, rate_hz: float, is_interrupted: Callable[[], bool], fast_until_s: float = 0.0
    ) -> Iterator[int]:
        """Yield the times of the ticks [ns]; until the drive time `fast_until_s`, do not wait.  (1)

        Once `is_interrupted` returns True, time passes even in a pause, so that a stop can finish.
        """
        k, next_tick_s = 0, self._now_s()
        while True:
            if k < fast_until_s * rate_hz:
                k, next_tick_s = k + 1, self._now_s()
                yield round(k * NANOSECONDS / rate_hz)
                continue
            while self.paused and not self._ticks_until_pause and not is_interrupted():
                self._sleep(PAUSE_POLL_S)
                next_tick_s = self._now_s()
            self._ticks_until_pause = max(0, self._ticks_until_pause - 1)
            next_tick_s += 1.0 / (rate_hz * self.factor)
            early_s = next_tick_s - self._now_s()
            if early_s > 0.0:
                self._sleep(early_s)
            self.late_ms = 1e3 * max(0.0, self._now_s() - next_tick_s)
            if early_s < -MAX_DELAY_S:
                next_tick_s = self._now_s()
            k += 1
            yield round(k * NANOSECONDS / rate_hz)
