"""Vehicles: command → motion. Swap one by writing a frozen dataclass with the methods of `Vehicle`."""

from typing import Protocol

import numpy as np

from baqueano.signals import Motion
from baqueano.vehicles.car import Car
from baqueano.vehicles.drivetrain import Drivetrain, DrivetrainState
from baqueano.vehicles.effort import Effort, steady
from baqueano.vehicles.friction import Friction
from baqueano.vehicles.from_acceleration import FromAcceleration
from baqueano.vehicles.kinematic import Kinematic
from baqueano.vehicles.planar import Planar
from baqueano.vehicles.state import VehicleState

__all__ = [
    "Car",
    "Drivetrain",
    "DrivetrainState",
    "Effort",
    "Friction",
    "FromAcceleration",
    "Kinematic",
    "Planar",
    "Vehicle",
    "VehicleState",
    "steady",
]


class Vehicle(Protocol):
    """What the loop, the estimators and the fit ask of a vehicle. n = `commands`."""

    @property
    def commands(self) -> int:
        """n, the length of the command."""
        ...

    @property
    def drivetrain(self) -> Drivetrain:
        """What lies between the command and the body."""
        ...

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """A vehicle at `eta` (3,) that moves with `nu` (3,)."""
        ...

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(η, ν, ν̇) (3,) each, after `dt_s` under an effort that changes in a straight line, without noise."""
        ...

    def gravity(self, psi: float) -> np.ndarray:
        """Gravity along body x and y (2,) [m/s²]."""
        ...

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """One tick under the command `u` (n,); `noise` (3,) are unit normals."""
        ...
