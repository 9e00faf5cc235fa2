"""The memory of a controller that looks ahead."""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.drivetrain import DrivetrainState


class Plan(NamedTuple):
    """Memory of a controller that looks ahead.

    Attributes
    ----------
    t_ns : int
        Time of the last tick; −1 before the first.
    E : ndarray (N, k) [unit of u]
        Efforts of the next steps, of the commands that the vehicle has.
    effort : ndarray (k,) [unit of u]
        Of the last command.
    drivetrain : DrivetrainState
        Delay and lag, under the commands that were given.
    failures : int
        Ticks in a row in which the solver failed.
    """

    t_ns: int
    E: np.ndarray
    effort: np.ndarray
    drivetrain: DrivetrainState
    failures: int
