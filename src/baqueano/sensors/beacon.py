"""The distance to a beacon at a known position, measured by ultra-wideband or ultrasound.

    h = √((b − s)² + z²) + d,   s = p + R(ψ) l                                                            (1)

b is the position of the beacon in the map, z its height above the sensor, d the offset of the range. s is the position
of the sensor. p is the body's origin, l the lever arm forward and to the left, R(ψ) the rotation by the heading.

h depends only on the pose, so an estimator corrects all states that are correlated with the pose. One range corrects
the position only along the beam; the other direction needs a second range after some motion.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Value
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import SampledSensor, noise_cov_parameter, sensor_position
from baqueano.signals import Motion

MIN_DISTANCE_M = 1e-3  # keeps (1) differentiable directly under the beacon


@document
@dataclass(frozen=True, slots=True, eq=False)
class Beacon(SampledSensor):
    """Sensor of z = (r,) [m], the distance to one beacon: ultra-wideband, ultrasound. A position needs three beacons.

    Examples
    --------
    >>> beacon = Beacon(point_m=np.array([3.0, 4.0]))
    >>> print(beacon.h(Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))).round(3))
    [5.]
    """

    size: ClassVar[int] = 1

    point_m: np.ndarray = parameter(
        "m", "position of the beacon in the map, b", low=-1e4, high=1e4, shape=(2,)
    )
    height_m: float = parameter(
        "m", "height of the beacon above the sensor, z", low=0.0, high=100.0, default=0.0
    )
    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=10.0)
    noise_std: float = parameter("m", "white noise of the range", low=0.0, high=100.0, default=0.1)
    offset_m: float = parameter(
        "m", "offset of the reading from the distance, d", low=-10.0, high=10.0, default=0.0
    )
    max_range_m: float = parameter("m", "largest distance that is measured", low=1e-3, default=INF)
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the sensor in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,),
        measured_by="the tape",
    )  # fmt: skip
    delay_s: float = parameter("s", "age of the range that is read", low=0.0, high=2.0, default=0.0)
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²", 1)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the range (1,) [m] without noise.  (1)"""
        x, y = self.point_m - sensor_position(self.lever_arm_m, motion)
        return np.array([np.sqrt(x * x + y * y + self.height_m**2 + MIN_DISTANCE_M**2) + self.offset_m])

    def detects(self, motion: Motion) -> Value:
        """Return True if the beacon is within `max_range_m`."""
        return self.h(motion)[0] <= self.max_range_m
