"""The memory of the predictive controller."""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.drivetrain import DrivetrainState


class MpcState(NamedTuple):
    """Memory of a predictive controller between two ticks.

    Attributes
    ----------
    t_ns : int
        Time of the last tick; −1 before the first.
    E : ndarray (N, k) [no unit]
        Plan of the next steps, for the k commands with a limit above 0; its unit is in horizon.py.
    effort : ndarray (k,) [unit of u]
        Effort of the last command.
    drivetrain : DrivetrainState
        State of delay and lag after the commands that were sent.
    model_nu : ndarray (3,) [m/s, m/s, rad/s]
        Velocity of the model after these commands.
    turn_error : float [rad/s]
        Steady error of the model's yaw rate, d of (6) of mpc.py.
    failures : int
        Number of consecutive ticks in which the solver failed.
    multipliers : ndarray (c + w,)
        Lagrange multipliers of the last solution, with which the solver starts.
    """

    t_ns: int
    E: np.ndarray
    effort: np.ndarray
    drivetrain: DrivetrainState
    model_nu: np.ndarray
    turn_error: float
    failures: int
    multipliers: np.ndarray
