"""Encoders that count: the mean speed of each wheel between two readings of its counter.

    n = ⌊s/c⌋ mod N,   z = c ((n − n₋ + N/2) mod N − N/2) / δ,   s the distance that the wheel has rolled  (1)
    h = (v_l, v_r) as in wheels.py: s_l (ν_x − ν_ψ b/2),  s_r (ν_x + ν_ψ b/2),   ½ δ ago                  (2)
    Q = (σ² + c²/(6 δ²)) I                                                                                (3)

n is the counter, n₋ its previous reading, c the distance of one count. The counter restarts at 0 after N counts. δ =
1/rate_hz is the time between two readings, or a tick if that is longer; σ = noise_std. wheels.py defines ν_x, ν_ψ, s_l,
s_r and b.

A mean speed belongs to the middle of δ, so the slot of a reading has the age ½ δ. A fit compares it with the mean of h
over δ (identify/data/averaging.py), a filter with h in the middle of δ. Behind a lag of 45 ms, a step to 0.6 m/s
separates them by 0.4, 1.4 and 20 mm/s at 100, 50 and 10 Hz; counts of 0.5 mm have a noise of 20, 10 and 2 mm/s. Counts
are rounded at both ends of δ, each time with the variance c²/12. The errors of successive readings cancel: the error of
their sum is at most c. If a wheel rolls more than N/2 counts between two readings, the reading is wrong.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import PHASE_TOLERANCE
from baqueano.sensors.wheels import (
    radii_parameter,
    rolling_speeds,
    scale_std_parameter,
    slip_fade_parameter,
    slip_parameter,
    track_parameter,
)
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.delay import MIN_TICK_S

COUNT_TOLERANCE = 1e-6  # fraction of a count: tolerance for the rounding of the distance


class EncodersState(NamedTuple):
    """State of the encoders between two ticks."""

    phase: Value  # time since the last reading, in periods
    distance: np.ndarray  # (2,) distance that the wheels have rolled, s [m]
    counts: np.ndarray  # (2,) counters at the last reading
    since_s: Value  # time since the last reading


@document
@dataclass(frozen=True, slots=True, eq=False)
class Encoders:
    """Sensor of z = (v_l, v_r) [m/s], the mean speeds of the left and the right wheel since the previous reading.

    Parameters
    ----------
    tick_rate_hz : float
        Rate of the loop; the readings cannot be more frequent.

    Examples
    --------
    >>> wheels = Encoders(track_m=0.12, count_m=0.5e-3)
    >>> print(wheels.h(Motion(np.zeros(3), np.array([0.2, 0.0, 1.0]), np.zeros(3), np.zeros(2))))
    [0.14 0.26]
    """

    reads: ClassVar[str] = "encoders"

    averages: ClassVar[bool] = True
    size: ClassVar[int] = 2
    noise_size: ClassVar[int] = 2  # standard normals per tick
    delay_s: ClassVar[float] = 0.0  # in addition to the age in a slot

    track_m: float = track_parameter()
    count_m: float = parameter(
        "m", "distance per count, c: 2π times the radius, divided by the counts of a turn", low=1e-7, high=1.0,
        role="fixed", measured_by="rolling it over one metre",
    )  # fmt: skip
    counter: float = parameter(
        "1",
        "counts after which the counter begins again, N",
        low=4.0,
        high=2.0**32,
        default=65536.0,
        role="fixed",
    )
    tick_rate_hz: float = INF
    rate_hz: float = parameter("Hz", "readings per second", low=1e-3, high=1e5, default=50.0)
    radius_scale: np.ndarray = radii_parameter()
    noise_std: float = parameter(
        "m/s", "white noise in addition to the counts", low=0.0, high=100.0, default=0.0
    )
    radius_scale_std: float = scale_std_parameter()
    slip_std: float = slip_parameter()
    slip_fade_s: float = slip_fade_parameter()
    measurement_noise_cov: np.ndarray | None = parameter(
        "m²/s²",
        "covariance Q that the filter assumes; if missing: from noise and counts",
        default=None,
        shape=(2, 2),
    )

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def cov(self) -> np.ndarray:
        """Return Q (2, 2), the covariance of one measurement.  (3)"""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        rate_hz = np.minimum(self.rate_hz, self.tick_rate_hz)
        return np.eye(2) * (self.noise_std**2 + (self.count_m * rate_hz) ** 2 / 6.0)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the speeds of the wheels (2,) [m/s] without noise.  (2)"""
        return rolling_speeds(self, motion)

    def init(self) -> EncodersState:
        """Return the state with both counters at 0."""
        return EncodersState(0.0, np.zeros(2), np.zeros(2), 0.0)

    def step(
        self, state: EncodersState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[EncodersState, Slot]:
        """Return the state and the mean speeds since the last reading; `noise` (2,) is standard normal.  (1)"""
        begin, middle, end = motion.tick or (motion, motion, motion)
        distance = state.distance + dt_s / 6.0 * (self.h(begin) + 4.0 * self.h(middle) + self.h(end))
        phase, since_s = state.phase + self.rate_hz * dt_s + PHASE_TOLERANCE, state.since_s + dt_s
        is_new: Value = np.minimum(np.floor(phase), 1.0)
        read = np.remainder(np.floor(distance / self.count_m + COUNT_TOLERANCE), self.counter)
        half_counter = 0.5 * self.counter
        count_step = np.remainder(read - state.counts + half_counter, self.counter) - half_counter
        z = self.count_m * count_step / np.maximum(since_s, MIN_TICK_S) + self.noise_std * noise
        next_state = EncodersState(
            phase - np.floor(phase) - PHASE_TOLERANCE,
            distance,
            np.where(is_new > 0.0, read, state.counts),
            np.where(is_new > 0.0, 0.0, since_s),
        )
        return next_state, Slot(is_new, np.where(is_new > 0.0, z, 0.0), 0.5 * is_new * since_s)
