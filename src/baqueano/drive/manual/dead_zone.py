"""Test if a command turns any motor. Below the dead zones of all motors the vehicle stays at rest.

  motor j turns if  w_j > forward_j  or  −w_j > backward_j,   w = the mixed command                     (1)

Source: Source: vehicles/drivetrain.py (2), (5), at the nominal voltage.
"""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.drivetrain import Drivetrain


class BelowDeadZone(NamedTuple):
    """The command of the motor nearest to motion, and its dead zone, both as magnitudes in the unit of u."""

    channel: float
    dead_zone: float


def dead_zone_violation(drivetrain: Drivetrain | None, u: np.ndarray) -> BelowDeadZone | None:
    """Return the motor command nearest to motion if the command u (n,) does not turn any motor, None otherwise.

    Return None if u is zero, or if `drivetrain` is None.

    >>> from baqueano.vehicle_file import load
    >>> dead_zone_violation(load("small").vehicle.drivetrain, np.array([0.2, 0.0, 0.0]))
    BelowDeadZone(channel=0.2, dead_zone=0.27)
    """
    if drivetrain is None:
        return None
    w = drivetrain.mix(u)
    zone = np.where(w > 0.0, drivetrain.dead_zone_forward, drivetrain.dead_zone_backward)
    is_commanded = w != 0.0
    if not np.any(is_commanded) or np.any(np.abs(w)[is_commanded] > zone[is_commanded]):  # (1)
        return None
    nearest_level = np.flatnonzero(is_commanded)[np.argmin((zone - np.abs(w))[is_commanded])]
    return BelowDeadZone(float(np.abs(w)[nearest_level]), float(zone[nearest_level]))
