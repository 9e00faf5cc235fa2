"""The state that every vehicle of this folder has, and how a tick ends for those with a ν̇ of their own."""

from typing import Any, NamedTuple

import numpy as np

from baqueano.signals import Motion
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort


class VehicleState(NamedTuple):
    """Where a vehicle is and how it moves, at the end of a tick."""

    eta: np.ndarray  # (3,) x, y [m], ψ [rad] wrapped, map frame
    nu: np.ndarray  # (3,) velocity, body frame [m/s, m/s, rad/s]
    nu_dot: np.ndarray  # (3,) its rate of change [m/s², m/s², rad/s²]
    drivetrain: DrivetrainState


def arrived(
    model: Any,
    before: VehicleState,
    eta: np.ndarray,
    nu: np.ndarray,
    drivetrain: DrivetrainState,
    effort: Effort,
    dt_s: Any,
) -> tuple[VehicleState, Motion]:
    """Return the state at the end of a tick under `effort`, and what sensors see of it: ν̇ of that instant, and for
    those with a low-pass the tick, ν as a curve of third degree and the effort as a line."""

    def seen(eta: np.ndarray, nu: np.ndarray, effort: np.ndarray) -> Motion:
        return Motion(eta, nu, model.nu_dot(nu, effort, eta[2]), model.gravity(eta[2]))

    now = seen(eta, nu, effort.last)
    begin, end = seen(before.eta, before.nu, effort.start), seen(eta, nu, effort.end)
    halfway = 0.5 * (before.nu + nu) + 0.125 * dt_s * (begin.nu_dot - end.nu_dot)
    tick = begin, seen(eta, halfway, effort.mean), end
    return VehicleState(eta, nu, now.nu_dot, drivetrain), now._replace(tick=tick)
