"""Estimate when a chip took its samples, from readings of its sample count. Sample k is taken at T(k) = a + P k.

    T(k) ≤ after        for a reading from `before` to `after` that found k as the newest   (1)
    T(k + 1) > before                                                                       (2)
    P · (k_i − k_j − 1) ≤ after_i − before_j    for two readings i and j                    (3)

The pairs (a, P) that the readings of the last 10 s allow form a convex polygon. The estimate is its centre of area,
weighted by the prior density of P. The extent of the polygon bounds the error. Of each interval of 0.4 s (0.1 s at
first) only the two readings with the tightest bounds are kept. Readings that contradict each other mean that a sample
was lost or that the clock drifted. Then the older half of the readings is dropped; if that is not enough, only the last
reading is kept. Derivation: docs/derivations/firmware_link.md.
"""

from collections import deque

import numpy as np

PERIOD_TOLERANCE = 0.06  # Linux allows these chips 4 %; clones can be worse
PERIOD_STD = 0.02  # relative prior standard deviation of P; after some readings it has little weight
BUCKET_NS, FIRST_BUCKETS_NS = 400_000_000, 100_000_000
# during this first time the buckets are short, because the estimate improves fastest
SHORT_BUCKETS_UNTIL_NS = 2_000_000_000
MAX_BUCKETS = 25
# during this first time each reading updates the estimate, later each bucket
EVERY_READING_UNTIL_NS = 1_000_000_000
MAX_SLEW = 0.1  # largest correction of an interval, in periods
GRID_POINTS = 17  # number of periods at which the polygon is evaluated
PERIOD_DRIFT = 0.001  # relative drift of the period between two counts of samples


class SampleClock:
    """The clock of a chip that samples every `nominal_ns`. Times are integers in ns of the host's clock."""

    def __init__(self, nominal_ns: float) -> None:
        self.nominal_ns = nominal_ns
        self.contradiction_count = 0  # times when readings contradicted each other
        self._min_period_ns = nominal_ns * (1.0 - PERIOD_TOLERANCE)
        self._max_period_ns = nominal_ns * (1.0 + PERIOD_TOLERANCE)
        self.period_ns = nominal_ns
        self._last_stamp = -1.0
        self.restart()

    @property
    def rate_hz(self) -> float:
        """Return the measured sampling rate [Hz]."""
        return 1e9 / self.period_ns

    @property
    def rate_error_hz(self) -> float:
        """Return half the width [Hz] of the interval of rates that the readings allow."""
        return self.rate_hz * (self._max_period_ns - self._min_period_ns) / 2.0 / self.period_ns

    def restart(self) -> None:
        """Begin a new count of samples, and keep the interval of possible periods, widened by PERIOD_DRIFT."""
        self._min_period_ns = self._min_period_ns * (1.0 - PERIOD_DRIFT)
        self._max_period_ns = self._max_period_ns * (1.0 + PERIOD_DRIFT)
        self._prior = (
            max(self._min_period_ns, self.nominal_ns * (1 - PERIOD_TOLERANCE)),
            min(self._max_period_ns, self.nominal_ns * (1 + PERIOD_TOLERANCE)),
        )
        self._buckets: deque[list[int]] = deque(maxlen=MAX_BUCKETS)
        self._bucket_ns = self._bucket_start_ns = -1
        self._last_reading: list[int] = []  # the last reading, as a bucket
        self._last_index: int | None = None  # index of the last stamp
        self._newest = 0  # index of the sample to which `_phase` belongs
        self._phase = 0.0
        self.phase_error_ns = self.period_ns / 2.0

    def add_reading(self, newest: int, start_ns: int, end_ns: int) -> None:
        """Process a reading, made between the two times: sample `newest` was present, and the next sample was not."""
        self._last_reading = [newest, end_ns, newest, start_ns]
        if self._bucket_start_ns < 0:
            self._bucket_start_ns = self._bucket_ns = start_ns
            self._buckets.append(self._last_reading.copy())
            self._newest, self._phase = newest, (start_ns + end_ns - self.period_ns) / 2.0
            return
        self._shift_bounds(newest, start_ns, end_ns)
        length = FIRST_BUCKETS_NS if start_ns - self._bucket_start_ns < SHORT_BUCKETS_UNTIL_NS else BUCKET_NS
        closes = start_ns - self._bucket_ns > length
        if closes:
            self._bucket_ns = start_ns
            self._buckets.append(self._last_reading.copy())
        else:
            self._store_bounds(newest, start_ns, end_ns)
        if closes or start_ns - self._bucket_start_ns < EVERY_READING_UNTIL_NS:
            self._solve()

    def stamps(self, first: int, count: int) -> list[int]:
        """Return the times [ns] of `count` samples from index `first` on, strictly increasing.

        A correction of the phase changes each interval by at most a tenth of a period, because a jump would look like
        an acceleration.
        """
        times = []
        for index in range(first, first + count):
            time = self._phase + self.period_ns * (index - self._newest)
            if self._last_index is not None:
                steps = index - self._last_index
                due = self._last_stamp + self.period_ns * steps
                time = min(
                    max(time, due - MAX_SLEW * self.period_ns * steps),
                    due + MAX_SLEW * self.period_ns * steps,
                )
            time = max(time, self._last_stamp + 1.0)
            self._last_index, self._last_stamp = index, time
            times.append(round(time))
        return times

    def _shift_bounds(self, newest: int, begin_ns: int, end_ns: int) -> None:
        """Extrapolate the phase to the new index, within the bounds (1) and (2)."""
        self._phase += self.period_ns * (newest - self._newest)
        self._newest = newest
        self._phase = min(max(self._phase, begin_ns - self.period_ns), float(end_ns))

    def _store_bounds(self, newest: int, begin_ns: int, end_ns: int) -> None:
        """Store each bound of this reading in the newest bucket if the bound is tighter than the stored one."""
        bounds, period = self._buckets[-1], self.period_ns
        if end_ns - period * newest < bounds[1] - period * bounds[0]:
            bounds[0], bounds[1] = newest, end_ns
        if begin_ns - period * newest > bounds[3] - period * bounds[2]:
            bounds[2], bounds[3] = newest, begin_ns

    def _solve(self) -> None:
        """Estimate period and phase from the stored readings.  (1)-(3)"""
        while True:
            looks = np.array(self._buckets)
            upper_k, upper_t = looks[:, 0] - self._newest, looks[:, 1] - self._bucket_ns
            lower_k, lower_t = looks[:, 2] + 1 - self._newest, looks[:, 3] - self._bucket_ns
            low, high = period_bounds(upper_k, upper_t, lower_k, lower_t, self._prior)
            if low <= high:
                break
            self.contradiction_count += 1
            self._prior = (self.nominal_ns * (1 - PERIOD_TOLERANCE), self.nominal_ns * (1 + PERIOD_TOLERANCE))
            for _ in range((len(self._buckets) + 1) // 2):
                self._buckets.popleft()
            if not self._buckets:
                self._buckets.append(self._last_reading.copy())
        self._min_period_ns, self._max_period_ns = low, high
        periods = np.linspace(low, high, GRID_POINTS)[:, None]
        latest_ns = np.min(upper_t - periods * upper_k, axis=1)
        earliest = np.max(lower_t - periods * lower_k, axis=1)
        weight = np.maximum(latest_ns - earliest, 0.0) + 1e-9
        deviation = (periods[:, 0] / self.nominal_ns - 1.0) / PERIOD_STD
        weight *= np.exp(-deviation * deviation / 2.0)
        weight /= weight.sum()
        self.period_ns = float(weight @ periods[:, 0])
        self._phase = self._bucket_ns + float(weight @ (latest_ns + earliest)) / 2.0
        self.phase_error_ns = float(np.max(latest_ns) - np.min(earliest)) / 2.0


def period_bounds(
    upper_k: np.ndarray,
    upper_t: np.ndarray,
    lower_k: np.ndarray,
    lower_t: np.ndarray,
    prior: tuple[float, float],
) -> tuple[float, float]:
    """Return the least and the greatest period (low, high) that all pairs of readings allow.  (3)

    low > high means that the readings contradict each other.
    """
    steps = upper_k[:, None] - lower_k[None, :]
    spans = (upper_t[:, None] - lower_t[None, :]).astype(float)
    if np.any((steps == 0) & (spans < 0.0)):
        return 1.0, 0.0
    is_later, is_earlier = steps > 0, steps < 0
    high = np.min(spans[is_later] / steps[is_later], initial=prior[1])
    low = np.max(spans[is_earlier] / steps[is_earlier], initial=prior[0])
    return float(low), float(high)
