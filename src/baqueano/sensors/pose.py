"""A sensor of the pose in the map: a camera above the floor, a marker, or placement by hand on a mark.

    h = (x + l_x cos ψ − l_y sin ψ,  y + l_x sin ψ + l_y cos ψ,  ψ + χ)                                    (1)

(x, y, ψ) is the pose of the body. The sensor measures a mark, an antenna or a laser, which is turned by χ to the left.
Its position on the body is l, forward and to the left of the origin. ψ is wrapped before and after the noise. The
delay interpolates headings across ±π along the shorter arc.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import wrap
from baqueano.parameter import document, parameter
from baqueano.sensors.sampling import SampledSensor, noise_cov_parameter
from baqueano.signals import Motion


@document
@dataclass(frozen=True, slots=True, eq=False)
class Pose(SampledSensor):
    """Sensor of z = (x, y, ψ) [m, m, rad], the pose in the map.

    Examples
    --------
    >>> camera = Pose(lever_arm_m=np.array([0.1, 0.0]))
    >>> print(camera.h(Motion(np.array([1.0, 0.0, np.pi / 2]), np.zeros(3), np.zeros(3), np.zeros(2))).round(2))
    [1.   0.1  1.57]
    """

    size: ClassVar[int] = 3
    usual_std: ClassVar[tuple[float, ...]] = (0.005, 0.005, 0.01)  # of a camera above the floor

    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=10.0)
    noise_std: np.ndarray = parameter(
        "m, m, rad",
        "white noise of the pose in the map",
        low=0.0,
        high=100.0,
        default=(0.0, 0.0, 0.0),
        shape=(3,),
    )
    delay_s: float = parameter("s", "age of the pose that is read", low=0.0, high=2.0, default=0.0)
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the mark in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,)
    )
    heading_rad: float = parameter(
        "rad", "angle to the left by which the mark is turned, χ", low=-7.0, high=7.0, default=0.0
    )
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m², rad²", 3)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the measured pose (x, y, ψ) (3,) without noise.  (1)"""
        x, y, psi = motion.eta
        offset_x, offset_y = rotate_vector(self.lever_arm_m, psi)
        return np.array([x + offset_x, y + offset_y, psi + self.heading_rad])

    def difference(self, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Return z − expected (3,) with its heading wrapped."""
        x, y, psi = z - expected
        return np.array([x, y, wrap(psi)])


def rotate_vector(vector: np.ndarray, psi: Value) -> tuple[Value, Value]:
    """Return the x and y of `vector` (2,) after a rotation by `psi` [rad] to the left."""
    c, s = np.cos(psi), np.sin(psi)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
