"""A line on the floor that the vehicle drives over: tape under a light sensor, a light barrier, a lap counter.

    h = (x − p_x) cos χ + (y − p_y) sin χ                                                                 (1)

the distance beyond the line through p that is driven over in the direction χ, both in the map. It says
something only while the line is passed, from h < 0 to h ≥ 0 and no further than `half_width_m` to the side
of p; what it then says is how far beyond the line the body is already, 0 where the passing itself was timed.
A run begins at the origin of the map unless something tells its pose, so a mark at the start has p = 0, χ = 0.
In a fit `noise_std` is believed as it stands: on a floor that disturbs the vehicle, write how far a simulation is
off by then, not how sharp the line is.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.parameter import INF, documented, parameter
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds


class MarkState(NamedTuple):
    """State of a mark."""

    before: float  # h at the tick before [m]


@documented
@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """z = (h,) [m], the distance beyond a line on the floor, at the moments when the line is passed.

    Notes
    -----
    Equation (1) of the module.

    Examples
    --------
    >>> line = Mark(point_m=np.array([1.0, 0.0]))
    >>> print(line.h(Motion(np.array([1.02, 0.3, 0.0]), np.zeros(3), np.zeros(3), np.zeros(2))).round(2))
    [0.02]
    """

    reads: ClassVar[str] = "mark"

    rate_hz: ClassVar[float] = INF  # it answers whenever the line is passed
    delay_s: ClassVar[float] = 0.0

    point_m: np.ndarray = parameter(
        "m", "a point of the line, in the map, p", low=-1e4, high=1e4, default=(0.0, 0.0), shape=(2,)
    )
    heading_rad: float = parameter(
        "rad", "direction in which the line is passed, χ", low=-7.0, high=7.0, default=0.0
    )
    half_width_m: float = parameter("m", "how far the line reaches to each side", low=0.0, default=INF)
    noise_std: float = parameter("m", "where exactly it is seen", low=0.0, high=100.0, default=0.005)
    measurement_noise_cov: np.ndarray | None = parameter(
        "m²", "covariance Q to believe in; left out: from the noise", default=None, shape=(1, 1)
    )

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def size(self) -> int:
        """m."""
        return 1

    @property
    def noise_size(self) -> int:
        """Unit normals a tick."""
        return 1

    @property
    def cov(self) -> np.ndarray:
        """Q (1, 1): the covariance of one measurement."""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        return np.eye(1) * self.noise_std**2

    def h(self, motion: Motion) -> np.ndarray:
        """Return the distance beyond the line [m] (1,).  (1)"""
        x, y = motion.eta[0] - self.point_m[0], motion.eta[1] - self.point_m[1]
        return np.array([x * np.cos(self.heading_rad) + y * np.sin(self.heading_rad)])

    def init(self) -> MarkState:
        """Return a state before any passage; a vehicle that starts on the line does not pass it by leaving."""
        return MarkState(0.0)

    def step(
        self, state: MarkState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[MarkState, Slot]:
        """Return the distance of the body beyond the line, if it passed in this tick; `noise` (1,)."""
        h = self.h(motion)
        x, y = motion.eta[0] - self.point_m[0], motion.eta[1] - self.point_m[1]
        aside = np.abs(y * np.cos(self.heading_rad) - x * np.sin(self.heading_rad))
        passed = (state.before < 0.0) & (h[0] >= 0.0) & (aside <= self.half_width_m)
        has: Value = np.where(passed, 1.0, 0.0)
        return MarkState(h[0]), Slot(has, np.where(has > 0.0, h + self.noise_std * noise, 0.0))
