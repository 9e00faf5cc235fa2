"""The state that every vehicle of this folder has."""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.drivetrain import DrivetrainState


class VehicleState(NamedTuple):
    """Where a vehicle is and how it moves, at the end of a tick."""

    eta: np.ndarray  # (3,) x, y [m], ψ [rad] wrapped, map frame
    nu: np.ndarray  # (3,) velocity, body frame [m/s, m/s, rad/s]
    nu_dot: np.ndarray  # (3,) its rate of change [m/s², m/s², rad/s²]
    drivetrain: DrivetrainState
