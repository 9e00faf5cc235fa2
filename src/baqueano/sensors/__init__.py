"""Sensors turn a motion into a measurement. To add one, write a frozen dataclass with the methods of `Sensor`.

Some sensors need one more method. A sensor of an angle has `difference(z, expected)` (m,): z − expected with the angle
wrapped (see `Pose`); the default does not wrap. A sensor that is sometimes silent has `detects(motion)` (see
`Rangefinder`). A sensor that can mistake one object for another has `mistakes(z)` (k, m): the corrections of z for each
possible mistake (see `Tags`).
"""

from baqueano.contracts.blocks import Sensor
from baqueano.on_demand import unknown_names
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

__getattr__ = unknown_names(__name__)
