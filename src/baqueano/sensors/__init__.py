"""Sensors: motion → measurement. Swap one by writing a frozen dataclass with the methods of `Sensor`.

A sensor that measures an angle has, beside these, `difference(z, expected)` (m,): z − expected with the angle
wrapped (see `Pose`); where it is missing the difference is plain. One that is silent where there is nothing to measure
has `detects(motion)` (see `Rangefinder`). One that may take one thing for another has `mistakes(z)` (k, m): what z
lacks then (see `Tags`).
"""

from baqueano.contracts.blocks import Sensor
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
    "Tags",
    "Truth",
    "Wheels",
]
