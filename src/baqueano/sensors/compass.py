"""A compass: a horizontal magnetometer measures the heading in the map.

    h = atan2(sin φ − b_y, cos φ + b_x),   φ = ψ + χ                                                      (1)

φ is the heading from magnetic north, ψ the heading of the vehicle in the map. χ is the angle of the magnetometer on the
vehicle, plus the heading of the map's x axis from magnetic north. b is the field of the vehicle's own iron and currents
along the axes of the magnetometer, in units of the earth's horizontal field. b turns with the vehicle; half a unit
causes an error of up to 30°.

Indoors the direction of the field changes by tens of degrees within a metre; at one place it is constant. Set the noise
of an indoor compass accordingly.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.geometry import wrap
from baqueano.parameter import document, parameter
from baqueano.sensors.sampling import SampledSensor, noise_cov_parameter
from baqueano.signals import Motion


@document
@dataclass(frozen=True, slots=True, eq=False)
class Compass(SampledSensor):
    """Sensor of z = (ψ,) [rad], the heading in the map, wrapped.

    Examples
    --------
    >>> compass = Compass(heading_rad=0.1)
    >>> print(compass.h(Motion(np.array([0.0, 0.0, 0.5]), np.zeros(3), np.zeros(3), np.zeros(2))).round(2))
    [0.6]
    """

    size: ClassVar[int] = 1

    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=10.0)
    noise_std: float = parameter("rad", "white noise of the heading", low=0.0, high=10.0, default=0.1)
    heading_rad: float = parameter(
        "rad", "reading when the vehicle points along x of the map, χ", low=-7.0, high=7.0, default=0.0,
        measured_by="pointing the vehicle along the map's x",
    )  # fmt: skip
    iron: np.ndarray = parameter(
        "1", (
            "magnetic field of the vehicle's iron, forward and left, as a fraction of the earth's "
            "horizontal field"
        ), low=-10.0, high=10.0,
        default=(0.0, 0.0), shape=(2,), shown_by="a whole turn on the spot",
    )  # fmt: skip
    delay_s: float = parameter("s", "age of the heading that is read", low=0.0, high=2.0, default=0.0)
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("rad²", 1)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the heading (1,) [rad] without noise.  (1)"""
        phi = motion.eta[2] + self.heading_rad
        return np.array([np.arctan2(np.sin(phi) - self.iron[1], np.cos(phi) + self.iron[0])])

    def difference(self, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Return z − expected (1,), wrapped."""
        return np.array([wrap(z[0] - expected[0])])
