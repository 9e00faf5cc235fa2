"""Whether a command moves any motor: one below the dead zone of all of them moves nothing, and nothing else tells.

    motor j turns where  w_j > forward_j  or  −w_j > backward_j,   w = the mixed command                   (1)

vehicles/drivetrain.py (2), (5), at the nominal voltage.
"""

from typing import NamedTuple

import numpy as np

from baqueano.vehicles.drivetrain import Drivetrain


class Short(NamedTuple):
    """A command that moves nothing, of the motor that is nearest to moving. In the unit of the command."""

    channel: float
    dead_zone: float


def short_of_motion(drivetrain: Drivetrain | None, u: np.ndarray) -> Short | None:
    """What a command u (n,) lacks where it asks for motion and no motor turns; None where one turns, where it asks for
    none, and where the file knows no dead zone. `drivetrain` may be None: a vehicle without one.

    >>> from baqueano.vehicle_file import load
    >>> short_of_motion(load("small").vehicle.drivetrain, np.array([0.2, 0.0, 0.0]))
    Short(channel=0.2, dead_zone=0.27)
    """
    if drivetrain is None:
        return None
    w = drivetrain.mix(u)
    zone = np.where(w > 0.0, drivetrain.dead_zone_forward, drivetrain.dead_zone_backward)
    asked = w != 0.0
    if not np.any(asked) or np.any(np.abs(w)[asked] > zone[asked]):  # (1)
        return None
    nearest = np.flatnonzero(asked)[np.argmin((zone - np.abs(w))[asked])]
    return Short(float(np.abs(w)[nearest]), float(zone[nearest]))
