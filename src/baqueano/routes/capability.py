"""The share of its command that a vehicle needs for a given motion.

    ε: the model at ν = (v, 0, r) accelerates with (v̇, ṙ)      NEWTON steps from ε = 0                   (1)
    share = max |u_i| / limit_i,   u = drivetrain⁻¹(ε),   of commands and of wheels                      (2)

v is the speed, r the yaw rate, ε the effort, u the command. A share above 1 exceeds the limits of the motors. A vehicle
that cannot turn at rest, such as a car, steers ahead of its path; then ṙ is not required. Friction, dead zones, unequal
motors and the battery are included, as in the identified model.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.symbolic import jacobian, scan

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

NEWTON = 4
DAMPING = 1e-9  # of the Newton step if an effort has no effect, as the steering of a car at rest
HALVINGS = 24
FASTEST_M_S, FASTEST_RAD_S, FASTEST_M_S2 = 100.0, 100.0, 100.0  # upper ends of the searches


class Capability:
    """The share of its command that a vehicle needs, compiled for arrays of motions."""

    def __init__(self, vehicle_file: "VehicleFile", backend: str = "auto") -> None:
        self._share = scan(
            _share_of(vehicle_file.vehicle, vehicle_file.command.limit), 0.0, np.zeros(4), backend=backend
        )

    def share(self, v: Value, r: Value, v_dot: Value = 0.0, r_dot: Value = 0.0) -> np.ndarray:
        """Return the share (…,) of the command for each motion: v [m/s], r [rad/s], v̇ [m/s²], ṙ [rad/s²]."""
        rows = np.stack(np.broadcast_arrays(v, r, v_dot, r_dot), axis=-1).astype(float)
        _, share = self._share.run(rows.reshape(-1, 4))
        return np.where(np.isfinite(share), share, np.inf).reshape(rows.shape[:-1])

    def fastest_turn(self, v: np.ndarray) -> np.ndarray:
        """Return the largest steady yaw rate (m,) [rad/s], at most FASTEST_RAD_S, at the speeds `v` (m,) [m/s]."""
        return most(lambda r: self.share(v, r) <= 1.0, np.full(np.shape(v), FASTEST_RAD_S))

    def fastest_speed(self, kappa: np.ndarray, high: np.ndarray, share: float = 1.0) -> np.ndarray:
        """Return the largest steady speed (m,) [m/s], at most `high`, on curvatures (m,) [1/m]."""
        return most(lambda v: self.share(v, kappa * v) <= share, high)


def most(holds: Callable[[np.ndarray], np.ndarray], high: np.ndarray) -> np.ndarray:
    """Return the largest x (m,) from 0 to `high` (m,) for which `holds(x)` is True, by bisection; 0 if it is never
    True.
    `holds` must be True below a limit and False above it.
    """
    low, top = np.zeros_like(high, dtype=float), np.array(high, dtype=float)
    whole = holds(top)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + top)
        good = holds(middle)
        low, top = np.where(good, middle, low), np.where(good, top, middle)
    return np.where(whole, high, low)


def _share_of(vehicle: Tree, limit: np.ndarray) -> Callable[[float, np.ndarray], tuple[float, Value]]:
    """Return the step of a scan that computes the share of one motion (v, r, v̇, ṙ).  (1), (2)"""
    commands, drivetrain = vehicle.commands, vehicle.drivetrain
    dynamic = optional.is_dynamic(vehicle)

    def answer(nu: np.ndarray, effort: np.ndarray) -> np.ndarray:
        return (vehicle.nu_dot(nu, effort) if dynamic else vehicle.velocity(effort))[::2]

    at_rest = np.abs(jacobian(lambda effort: answer(np.zeros(3), effort))(np.zeros(commands)))
    turns = bool(np.any(at_rest[1] > 1e-9))
    alive, wheels = limit > 0.0, np.broadcast_to(drivetrain.limit, (drivetrain.channels,))

    def step(carry: float, motion: np.ndarray) -> tuple[float, Value]:
        v, r, v_dot, r_dot = motion
        nu = np.array([v, 0.0, r])
        target = np.array([v_dot, r_dot if turns else 0.0 * r_dot]) if dynamic else np.array([v, r])
        effort = np.zeros(commands)
        for _ in range(NEWTON):
            B = jacobian(lambda effort: answer(nu, effort))(effort)
            missing = target - answer(nu, effort)
            effort = effort + B.T @ np.linalg.solve(B @ B.T + DAMPING * np.eye(2), missing)
        u = drivetrain.inverse(effort)
        share = np.max(np.abs(u[alive]) / limit[alive]) if np.any(alive) else 0.0
        return carry, np.maximum(share, np.max(np.abs(drivetrain.mix(u)) / wheels))

    return step
