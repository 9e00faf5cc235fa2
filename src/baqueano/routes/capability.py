"""The share of its command that a vehicle needs for a given motion.

    ε: the model at ν = (v, 0, r) accelerates with (v̇, ṙ)      NEWTON_STEPS steps from ε = 0                   (1)
    share = max |u_i| / limit_i,   u = drivetrain⁻¹(ε),   of commands and of wheels                      (2)

    rank ∂(ν̇_x, ν̇_y, ν̇_ψ)/∂ε > rank ∂(ν̇_x, ν̇_ψ)/∂ε      for a vehicle that can move sideways at will       (3)

v is the speed, r the yaw rate, ε the effort, u the command. A share above 1 exceeds the limits of the motors. A vehicle
that cannot turn at rest, such as a car, steers before its path requires this; so ṙ is not required. Friction, dead
zones, unequal motors and the battery are included, as in the identified model. If no command with a limit above 0
affects v or r, the share of such a motion is infinite.
"""

from collections.abc import Callable

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.symbolic import jacobian, scan
from baqueano.vehicle_file import VehicleFile

NEWTON_STEPS = 4
# of the Newton step, for an effort without effect, such as the steering of a car at rest
NEWTON_DAMPING = 1e-9
MIN_EFFECT = 1e-9  # a smaller derivative by the effort is treated as 0
MIN_MOTION = 0.01  # a slower motion [m/s, rad/s] is not required from a command without an effect
HALVING_COUNT = 24
MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S, MAX_TURN_CHANGE_RAD_S2 = 100.0, 100.0, 1e3  # upper ends of the searches
SLOW_M_S = 0.05  # a vehicle that cannot drive a curve at this speed, such as a car, cannot drive it slower


class Capability:
    """The share of its command that a vehicle needs, compiled for arrays of motions.

    `moves_sideways` is True for a vehicle with a command that moves it sideways without turning it.  (3)
    """

    def __init__(self, vehicle_file: VehicleFile, backend: str = "auto") -> None:
        is_active = vehicle_file.command.limit > 0.0
        B = _rest_effort_gain(vehicle_file.vehicle)[:, is_active]
        self.moves_sideways = bool(np.linalg.matrix_rank(B) > np.linalg.matrix_rank(B[::2]))
        self._can_turn = _can_turn(vehicle_file.vehicle)
        self._share = scan(
            _share_step(vehicle_file.vehicle, vehicle_file.command.limit), 0.0, np.zeros(4), backend=backend
        )

    def share(self, v: Value, r: Value, v_dot: Value = 0.0, r_dot: Value = 0.0) -> np.ndarray:
        """Return the share (…,) of the command for each motion: v [m/s], r [rad/s], v̇ [m/s²], ṙ [rad/s²]."""
        return self._turning_share(v, r, v_dot, r_dot if self._can_turn else 0.0)

    def _turning_share(self, v: Value, r: Value, v_dot: Value, r_dot: Value) -> np.ndarray:
        """Return the share (…,) of the command, which includes that of ṙ even if the vehicle cannot turn at rest."""
        rows = np.stack(np.broadcast_arrays(v, r, v_dot, r_dot), axis=-1).astype(float)
        _, share = self._share.run(rows.reshape(-1, 4))
        return np.where(np.isfinite(share), share, np.inf).reshape(rows.shape[:-1])

    def fastest_turn(self, v: np.ndarray) -> np.ndarray:
        """Return the largest constant yaw rate (m,) [rad/s], at most MAX_YAW_RATE_RAD_S, at the speeds `v` (m,)
        [m/s]."""
        return largest_allowed(lambda r: self.share(v, r) <= 1.0, np.full(np.shape(v), MAX_YAW_RATE_RAD_S))

    def fastest_turn_change(self, v: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Return the largest ṙ (m,) [rad/s²], at most MAX_TURN_CHANGE_RAD_S2, at the motions `v`, `r` (m,)."""
        high = np.full(np.shape(v), MAX_TURN_CHANGE_RAD_S2)
        return largest_allowed(lambda r_dot: self._turning_share(v, r, 0.0, r_dot) <= 1.0, high)

    def largest_curvature(self, high: np.ndarray) -> np.ndarray:
        """Return the largest curvature (m,) [1/m], at most `high` (m,), that the vehicle can drive at SLOW_M_S.

        It is 0 for a vehicle that cannot turn, which is allowed a yaw rate of MIN_MOTION.
        """
        kappa = largest_allowed(lambda kappa: self.share(SLOW_M_S, kappa * SLOW_M_S) <= 1.0, high)
        return np.where(kappa * SLOW_M_S > 1.01 * MIN_MOTION, kappa, 0.0)

    def fastest_speed(self, kappa: np.ndarray, high: np.ndarray, share: float = 1.0) -> np.ndarray:
        """Return the largest constant speed (m,) [m/s], at most `high` (m,), on the curvatures `kappa` (m,) [1/m]."""
        return largest_allowed(lambda v: self.share(v, kappa * v) <= share, high)


def largest_allowed(is_allowed: Callable[[np.ndarray], np.ndarray], high: np.ndarray) -> np.ndarray:
    """Return the largest x (m,) from 0 to `high` (m,) for which `is_allowed(x)` is True, by bisection; 0 without one.

    `is_allowed` must be True below a limit and False above this limit.
    """
    low, top = np.zeros_like(high, dtype=float), np.array(high, dtype=float)
    is_high_allowed = is_allowed(top)
    for _ in range(HALVING_COUNT):
        middle = 0.5 * (low + top)
        is_middle_allowed = is_allowed(middle)
        low, top = np.where(is_middle_allowed, middle, low), np.where(is_middle_allowed, top, middle)
    return np.where(is_high_allowed, high, low)


def _motion(vehicle: Tree, nu: np.ndarray, effort: np.ndarray) -> np.ndarray:
    """Return the acceleration (3,) of a dynamic model, or the velocity (3,) of a kinematic model."""
    motion: np.ndarray = (
        vehicle.nu_dot(nu, effort, 0.0) if optional.is_dynamic(vehicle) else vehicle.velocity(effort)
    )
    return motion


def _rest_effort_gain(vehicle: Tree) -> np.ndarray:
    """Return the derivatives (3, n) of the motion by the effort, for a vehicle at rest without effort."""
    return jacobian(lambda effort: _motion(vehicle, np.zeros(3), effort))(np.zeros(vehicle.commands))


def _can_turn(vehicle: Tree) -> bool:
    """Return True for a vehicle that can turn at rest."""
    return bool(np.any(np.abs(_rest_effort_gain(vehicle)[2]) > MIN_EFFECT))


def _share_step(vehicle: Tree, limit: np.ndarray) -> Callable[[float, np.ndarray], tuple[float, Value]]:
    """Return the step of a scan that computes the share of one motion (v, r, v̇, ṙ).  (1), (2)"""
    commands, drivetrain = vehicle.commands, vehicle.drivetrain
    is_dynamic = optional.is_dynamic(vehicle)

    def acceleration(nu: np.ndarray, effort: np.ndarray) -> np.ndarray:
        return _motion(vehicle, nu, effort)[::2]

    is_active, wheels = limit > 0.0, np.broadcast_to(drivetrain.limit, (drivetrain.channels,))

    def step(carry: float, motion: np.ndarray) -> tuple[float, Value]:
        v, r, v_dot, r_dot = motion
        nu = np.array([v, 0.0, r])
        target = np.array([v_dot, r_dot]) if is_dynamic else np.array([v, r])
        effort, B = np.zeros(commands), np.zeros((2, commands))
        for _ in range(NEWTON_STEPS):
            B = jacobian(lambda effort: acceleration(nu, effort))(effort) * is_active
            remainder = target - acceleration(nu, effort)
            effort = effort + B.T @ np.linalg.solve(B @ B.T + NEWTON_DAMPING * np.eye(2), remainder)
        u = drivetrain.inverse(effort)
        share = np.max(np.abs(u[is_active]) / limit[is_active]) if np.any(is_active) else 0.0
        share = np.maximum(share, np.max(np.abs(drivetrain.mix(u)) / wheels))
        is_unaffected = np.max(np.abs(B), axis=1) < MIN_EFFECT
        is_required = (np.abs(motion[:2]) > MIN_MOTION) & (np.abs(v) > MIN_MOTION)
        return carry, np.where(np.any(is_unaffected & is_required), np.inf, share)

    return step
