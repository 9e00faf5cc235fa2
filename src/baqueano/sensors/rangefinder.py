"""The distance along a beam to a wall at a known position, measured by ultrasound, infrared or laser.

    h = (w − s)·n / cos α,   n = (cos χ, sin χ),   α = ψ + ζ − χ,   s = p + R(ψ) l                        (1)

w is a point of the wall, n its normal, which points away from the vehicle: a vehicle with the heading χ faces the wall
at a right angle. ψ is the heading of the vehicle, ζ the angle of the beam on it, to the left; α is the angle of
incidence. s is the position of the sensor. p is the body's origin, l the lever arm forward and to the left, R(ψ) the
rotation by the heading.

The sensor is silent beyond `max_range_m`, beyond the ends of the wall, and if |α| is above `incidence_rad`: a smooth
wall then reflects the sound away. If a chair is in front of the wall, the gate of an estimator rejects the reading.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import wrap
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import SampledSensor, noise_cov_parameter, sensor_position
from baqueano.signals import Motion

MIN_COS = 0.1  # keeps (1) finite for an estimated pose that faces away from the wall


@document
@dataclass(frozen=True, slots=True, eq=False)
class Rangefinder(SampledSensor):
    """Sensor of z = (r,) [m], the distance along a beam to one wall: ultrasound, infrared, laser.

    Examples
    --------
    >>> sonar = Rangefinder(wall_point_m=np.array([2.0, 0.0]), wall_heading_rad=0.0)
    >>> print(sonar.h(Motion(np.array([0.5, 0.2, 0.0]), np.zeros(3), np.zeros(3), np.zeros(2))))
    [1.5]
    """

    size: ClassVar[int] = 1

    wall_point_m: np.ndarray = parameter(
        "m", "the middle of the wall, in the map, w", low=-1e4, high=1e4, shape=(2,)
    )
    wall_heading_rad: float = parameter(
        "rad", "heading of a vehicle that faces the wall at a right angle, χ", low=-7.0, high=7.0
    )
    half_width_m: float = parameter("m", "extent of the wall to each side", low=0.0, default=INF)
    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=20.0)
    noise_std: float = parameter("m", "white noise of the range", low=0.0, high=100.0, default=0.01)
    max_range_m: float = parameter("m", "largest distance that is measured", low=1e-3, default=4.0)
    incidence_rad: float = parameter(
        "rad", "largest angle between beam and normal of the wall", low=0.0, high=1.5, default=0.35
    )
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the sensor in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,),
        measured_by="the tape",
    )  # fmt: skip
    heading_rad: float = parameter(
        "rad", "turn of the beam on the vehicle, to the left, ζ", low=-7.0, high=7.0, default=0.0
    )
    delay_s: float = parameter("s", "age of the range that is read", low=0.0, high=2.0, default=0.0)
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²", 1)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the range (1,) [m] without noise.  (1)"""
        perpendicular, alpha = self._wall_angles(motion)
        return np.array([perpendicular / np.maximum(np.cos(alpha), MIN_COS)])

    def detects(self, motion: Motion) -> Value:
        """Return True if the beam hits the wall within `max_range_m`, at an angle of at most `incidence_rad`."""
        (perpendicular, alpha), r = self._wall_angles(motion), self.h(motion)[0]
        beam_heading, normal_heading = motion.eta[2] + self.heading_rad, self.wall_heading_rad
        x, y = (
            sensor_position(self.lever_arm_m, motion)
            + r * np.array([np.cos(beam_heading), np.sin(beam_heading)])
            - self.wall_point_m
        )
        lateral_m = np.abs(y * np.cos(normal_heading) - x * np.sin(normal_heading))
        is_within_reach = (perpendicular > 0.0) & (r <= self.max_range_m) & (lateral_m <= self.half_width_m)
        return is_within_reach & (np.abs(alpha) <= self.incidence_rad)

    def _wall_angles(self, motion: Motion) -> tuple[Value, Value]:
        """Return the perpendicular distance to the wall [m], and the angle of incidence α [rad]."""
        x, y = self.wall_point_m - sensor_position(self.lever_arm_m, motion)
        n = self.wall_heading_rad
        return x * np.cos(n) + y * np.sin(n), wrap(motion.eta[2] + self.heading_rad - n)
