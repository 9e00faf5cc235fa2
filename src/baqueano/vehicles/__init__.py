"""Vehicles turn a command into a motion. To add one, write a frozen dataclass with the methods of `Vehicle`."""

from baqueano.on_demand import unknown_names
from baqueano.vehicles.car import Car
from baqueano.vehicles.drivetrain import Drivetrain, DrivetrainState
from baqueano.vehicles.effort import Effort, constant_effort
from baqueano.vehicles.friction import Friction
from baqueano.vehicles.from_acceleration import AccelerationModel
from baqueano.vehicles.kinematic import Kinematic
from baqueano.vehicles.planar import Planar
from baqueano.vehicles.state import Vehicle, VehicleState

__all__ = [
    "AccelerationModel",
    "Car",
    "Drivetrain",
    "Effort",
    "Friction",
    "Kinematic",
    "Planar",
    "Vehicle",
    "VehicleState",
]

__getattr__ = unknown_names(__name__)
