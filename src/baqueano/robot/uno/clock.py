"""Convert the clock of the Uno to the time of the host.

    ping at h₁, answered at device time d, answer received at h₂:   h(d) ≈ (h₁ + h₂)/2,  error ≤ (h₂ − h₁)/2       (1)
    h(d) = h₀ + (1 + ε)(d − d₀)     least squares over the quickest answer of each SECTION_S of a window,
                                    each weighted by the reciprocal of its error (1)                       (2)

A ceramic resonator is wrong by up to 0.5 %, 3 s in ten minutes. A delay over USB affects only one direction, so the
quickest answers are the most accurate (as in NTP). Until three sections have an answer, ε is 0, and h₀ is the middle
time of the quickest answer.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

WINDOW_S = 20.0
SECTION_S = 1.0
MAX_SKEW = 0.02  # four times the error of a resonator
FRAME_NS = 1_000_000  # period of the USB frames: a shorter trip is not more accurate
WRAP_US = 1 << 32
NS_PER_US = 1000


class PongTimes(NamedTuple):
    """The times of a ping and of its answer."""

    device_us: int
    middle_ns: int  # half-way between ping and answer, by the host's clock
    trip_ns: int


class UnoClock:
    """A converter of device times to host times, refined with every answer."""

    def __init__(self) -> None:
        self.skew = 0.0  # ε: one second of the device lasts 1 + ε seconds of the host
        self._answers: deque[PongTimes] = deque()
        self._reference = (0, 0)  # (d₀ [µs], h₀ [ns])
        self._last_us = -1
        self.is_synchronised = False

    def unwrap(self, t_us: int) -> int:
        """Return the device time [µs] continued over its overflow, which occurs every 71 minutes.

        The time must differ from the newest time by less than half of this period.
        """
        if self._last_us < 0:
            self._last_us = t_us
        step = (t_us - self._last_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        now_us = self._last_us + step
        self._last_us = max(self._last_us, now_us)
        return now_us

    def add_ping(self, sent_ns: int, device_us: int, received_ns: int) -> None:
        """Add an answered ping, and estimate offset and skew again.  (1), (2)

        `device_us` is a time that `unwrap` returned.
        """
        answer = PongTimes(device_us, (sent_ns + received_ns) // 2, received_ns - sent_ns)
        if self._answers and _has_stood_still(self._answers[-1], answer):
            self._answers.clear()
        self._answers.append(answer)
        while received_ns - self._answers[0].middle_ns > WINDOW_S * 1e9:
            self._answers.popleft()
        best_pong: dict[int, PongTimes] = {}
        for answer in self._answers:
            section = answer.middle_ns // round(SECTION_S * 1e9)
            if section not in best_pong or answer.trip_ns < best_pong[section].trip_ns:
                best_pong[section] = answer
        quick_pongs = sorted(best_pong.values(), key=lambda a: a.trip_ns)
        self._reference, self.is_synchronised = (quick_pongs[0].device_us, quick_pongs[0].middle_ns), True
        if len(quick_pongs) > 2:
            device_ns = (
                np.array([a.device_us - self._reference[0] for a in quick_pongs], dtype=float) * NS_PER_US
            )
            host_ns = np.array([a.middle_ns - self._reference[1] for a in quick_pongs], dtype=float)
            weights = [1.0 / (FRAME_NS + a.trip_ns) for a in quick_pongs]  # (1)
            slope, offset = np.polyfit(device_ns, host_ns, 1, w=weights)
            self.skew, self._reference = (
                float(slope) - 1.0,
                (self._reference[0], self._reference[1] + round(offset)),
            )

    def host_ns(self, device_us: int) -> int:
        """Return the host time [ns] at a device time [µs] that `unwrap` returned.  (2)"""
        since_ns = (device_us - self._reference[0]) * NS_PER_US
        return self._reference[1] + since_ns + round(self.skew * since_ns)


def _has_stood_still(previous: PongTimes, answer: PongTimes) -> bool:
    """Return True if one of the clocks stopped between two answers, as the host's in a suspended computer.  (1)"""
    host_ns = answer.middle_ns - previous.middle_ns
    error_ns = (answer.device_us - previous.device_us) * NS_PER_US - host_ns
    return abs(error_ns) > (previous.trip_ns + answer.trip_ns) / 2 + MAX_SKEW * host_ns
