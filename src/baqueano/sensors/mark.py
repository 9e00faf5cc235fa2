"""A line on the floor that the vehicle crosses: tape under a light sensor, a light barrier, a lap counter.

    h = (x − p_x) cos χ + (y − p_y) sin χ                                                                 (1)

h is the distance of the body, at (x, y), beyond the line through p. The line is crossed in the direction χ. All
positions and angles are in the map. The sensor measures only in the tick of a crossing, from h < 0 to h ≥ 0, at most
`half_width_m` to the side of p. The reading is the distance beyond the line at the end of the tick, or 0 if the
timestamp states the crossing. Without a sensor of the pose, a run begins at the origin of the map, so a mark at the
start has p = 0, χ = 0.

A fit uses `noise_std` unchanged. On a floor that disturbs the vehicle, set it to the error of a simulation at the mark,
not to the precision of the line.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import noise_cov_parameter
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds


class MarkState(NamedTuple):
    """State of a mark between two ticks."""

    previous_h: float  # h at the previous tick [m]


@document
@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """Sensor of z = (h,) [m], the distance beyond a line on the floor, when the vehicle crosses the line.

    Examples
    --------
    >>> line = Mark(point_m=np.array([1.0, 0.0]))
    >>> print(line.h(Motion(np.array([1.02, 0.3, 0.0]), np.zeros(3), np.zeros(3), np.zeros(2))).round(2))
    [0.02]
    """

    reads: ClassVar[str] = "mark"
    size: ClassVar[int] = 1
    noise_size: ClassVar[int] = 1  # standard normals per tick
    rate_hz: ClassVar[float] = INF  # the sensor measures whenever the line is crossed
    delay_s: ClassVar[float] = 0.0

    point_m: np.ndarray = parameter(
        "m", "a point of the line, in the map, p", low=-1e4, high=1e4, default=(0.0, 0.0), shape=(2,)
    )
    heading_rad: float = parameter(
        "rad", "direction in which the vehicle crosses the line, χ", low=-7.0, high=7.0, default=0.0
    )
    half_width_m: float = parameter("m", "extent of the line to each side", low=0.0, default=INF)
    noise_std: float = parameter(
        "m", ("standard deviation of the position of a crossing"), low=0.0, high=100.0, default=0.005
    )
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²", 1)

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def cov(self) -> np.ndarray:
        """Return Q (1, 1), the covariance of one measurement."""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        return np.eye(1) * self.noise_std**2

    def h(self, motion: Motion) -> np.ndarray:
        """Return the distance (1,) [m] beyond the line; negative before the line.  (1)"""
        x, y = motion.eta[0] - self.point_m[0], motion.eta[1] - self.point_m[1]
        return np.array([x * np.cos(self.heading_rad) + y * np.sin(self.heading_rad)])

    def init(self) -> MarkState:
        """Return the state before the first tick; a start on the line is not a crossing."""
        return MarkState(0.0)

    def step(
        self, state: MarkState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[MarkState, Slot]:
        """Return the state, and the distance beyond the line if the body crossed the line within `half_width_m`.

        `noise` (1,) is standard normal.
        """
        h = self.h(motion)
        x, y = motion.eta[0] - self.point_m[0], motion.eta[1] - self.point_m[1]
        lateral_m = np.abs(y * np.cos(self.heading_rad) - x * np.sin(self.heading_rad))
        is_passed = (state.previous_h < 0.0) & (h[0] >= 0.0) & (lateral_m <= self.half_width_m)
        is_new: Value = np.where(is_passed, 1.0, 0.0)
        return MarkState(h[0]), Slot(is_new, np.where(is_new > 0.0, h + self.noise_std * noise, 0.0))
