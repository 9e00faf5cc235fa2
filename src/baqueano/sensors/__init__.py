"""Sensors: motion → measurement. Swap one by writing a frozen dataclass with the methods of `Sensor`.

A sensor that measures an angle has, beside these, `difference(z, expected)` (m,): z − expected with the angle
wrapped (see `Pose`); where it is missing the difference is plain. One that is silent where there is nothing to measure
has `sees(motion)` (see `Rangefinder`). One that may take one thing for another has `mistakes(z)` (k, m): what z lacks
then (see `Tags`).
"""

from typing import Any, Protocol

import numpy as np

from baqueano.sensors.beacon import Beacon
from baqueano.sensors.compass import Compass
from baqueano.sensors.encoders import Encoders
from baqueano.sensors.imu import Imu
from baqueano.sensors.mark import Mark
from baqueano.sensors.pose import Pose
from baqueano.sensors.rangefinder import Rangefinder
from baqueano.sensors.sampling import SensorState
from baqueano.sensors.tags import Tags
from baqueano.sensors.truth import Truth
from baqueano.sensors.wheels import Odometer, Wheels
from baqueano.signals import Motion, Slot

__all__ = [
    "Beacon",
    "Compass",
    "Encoders",
    "Imu",
    "Mark",
    "Odometer",
    "Pose",
    "Rangefinder",
    "Sensor",
    "SensorState",
    "Tags",
    "Truth",
    "Wheels",
]


class Sensor(Protocol):
    """What the world, the estimators and the fit ask of a sensor. m = `size`."""

    @property
    def size(self) -> int:
        """m, the length of a measurement."""
        ...

    @property
    def noise_size(self) -> int:
        """Unit normals that `step` takes."""
        ...

    @property
    def rate_hz(self) -> float:
        """Measurements a second."""
        ...

    @property
    def delay_s(self) -> float:
        """Age of the signal when it is read."""
        ...

    @property
    def cov(self) -> np.ndarray:
        """Q (m, m): the covariance of one measurement."""
        ...

    def h(self, motion: Motion) -> np.ndarray:
        """The measurement (m,) without noise: what estimators and the fit believe."""
        ...

    def init(self) -> Any:
        """A sensor just switched on."""
        ...

    def step(self, state: Any, motion: Motion, dt_s: float, noise: np.ndarray) -> tuple[Any, Slot]:
        """What the sensor says at the end of a tick; `noise` (noise_size,) are unit normals."""
        ...
