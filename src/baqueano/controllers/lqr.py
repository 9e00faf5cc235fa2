"""Linear quadratic regulator of the error, time-varying: the gain follows the speed of the reference.

    e⁺ = g(e, δν) = error after a tick, of a vehicle with (v_f, 0) + δν and a reference with (v_f, 0)     (1)
    A = ∂g/∂e,    B = ∂g/∂δν    at 0, by the engine                                                        (2)
    K = (R + Bᵀ P B)⁻¹ Bᵀ P A,    P⁺ = Q + Aᵀ P (A − B K)                                                 (3)
    (v, ω) = ν_f − K e,    Q = diag(1/e_max²),    R = diag(1/δν_max²)                                     (4)

e: error; ν_f = (v_f, ω_f): velocity of the reference without jumps; δν: its correction. The errors are those beside
the vehicle, so (1) does not contain the curvature. P: cost matrix; K: gain. (3) propagates the Riccati equation
forward, one step per tick. P begins with the solution of its continuous form for a slow vehicle. An error of e_max has
the same cost as a change of velocity of δν_max (Bryson's rule). (6) of model_following.py limits the gains for V =
max(|v_f|, |v|), with |v| limited by (4). MAX_APPROACH_RAD limits the angle to a far path. At rest e_y cannot be
corrected. So (2) is evaluated at MIN_SPEED_M_S or more. Below it, the turn to the path is proportional to the speed.
Source: Anderson and Moore, Optimal Control, 1990; forward propagation: Prach, Tekinalp and Bernstein, IEEE Control
Systems, 2015.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.controllers.following.tracking import MAX_APPROACH_RAD, Tracking
from baqueano.controllers.model_following import ModelFollower
from baqueano.geometry import compose, map_from_body, pose_error
from baqueano.parameter import document, parameter
from baqueano.symbolic import jacobian

MIN_SPEED_M_S = 0.05


@document
@dataclass(frozen=True, slots=True, eq=False)
class Lqr(ModelFollower):
    """Controller with the optimal linear feedback for five weights (`e_max` and `change_max`) that you choose.

    References
    ----------
    Anderson and Moore, Optimal Control, 1990; forward propagation: Prach, Tekinalp and Bernstein, IEEE Control Systems,
    2015. Equations (1)-(4) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> law = Lqr(robot.vehicle, limit=robot.command.limit, e_max=np.array([0.1, 0.02, 0.3]))
    >>> path_on_the_left = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> _, (v, omega) = law.velocity_law(law.memory(), path_on_the_left)
    >>> print(f"{v:.2f} m/s, {omega:.2f} rad/s")
    0.20 m/s, 3.61 rad/s
    """

    e_max: np.ndarray = parameter(
        "m, m, rad",
        "along-track, cross-track and course errors with the same weight",
        low=1e-4,
        shape=(3,),
        default=(0.1, 0.025, 0.32),
    )
    change_max: np.ndarray = parameter(
        "m/s, rad/s",
        "changes of speed and turn with the same weight as those errors",
        low=1e-4,
        shape=(2,),
        default=(0.1, 1.0),
    )

    def memory(self) -> np.ndarray:
        """Return P (3, 3) before the first tick: the solution of (3) for MIN_SPEED_M_S, if a tick is short.

        It is the solution of 0 = AᵀP + PA − P B R⁻¹ Bᵀ P + Q for ė_x = −δv, ė_y = v e_χ, ė_χ = −δω.
        """
        v, (q_x, q_y, q_chi), (r_v, r_omega) = MIN_SPEED_M_S, self.e_max**-2, self.change_max**-2
        P_yc = np.sqrt(q_y * r_omega)
        P_cc = np.sqrt(r_omega * (q_chi + 2.0 * v * P_yc))
        P_yy = P_yc * P_cc / (r_omega * v)
        return np.array([[np.sqrt(q_x * r_v), 0.0, 0.0], [0.0, P_yy, P_yc], [0.0, P_yc, P_cc]]) * self.rate_hz

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return P (3, 3) one tick later, and the requested velocity (v, ω) [m/s, rad/s].  (4)"""
        v_f, _, omega_f = tracking.nu_f
        min_speed = np.where(tracking.forward_sign < 0.0, -MIN_SPEED_M_S, MIN_SPEED_M_S)
        v = np.where(np.abs(v_f) < MIN_SPEED_M_S, min_speed, v_f)
        P, K = self.riccati(memory, *_linear(v, tracking.dt_s))
        requested_v = v_f - K[0] @ np.array([tracking.e[0], tracking.e[1], tracking.e_chi])
        V = np.maximum(tracking.max_speed(requested_v), MIN_SPEED_M_S)
        k_chi, k_y = self.limited_gains(-K[1, 2], np.abs(K[1, 1]), V, tracking.far_gain)
        max_correction = k_chi * MAX_APPROACH_RAD
        lateral_term = np.abs(v_f) / v * np.clip(k_y * tracking.e[1], -max_correction, max_correction)
        omega = omega_f + lateral_term + k_chi * tracking.e_chi
        return P, (requested_v, omega)

    def riccati(self, P: np.ndarray, A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return P (3, 3) one step later, and K (2, 3), for A (3, 3) and B (3, 2).  (3)"""
        R = np.diag(1.0 / self.change_max**2)
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = np.diag(1.0 / self.e_max**2) + A.T @ P @ (A - B @ K)
        return 0.5 * (P + P.T), K


def _linear(v: Value, dt_s: Value) -> tuple[np.ndarray, np.ndarray]:
    """Return A (3, 3) and B (3, 2) of the error over a tick, for a reference with the speed `v` [m/s].  (2)"""
    nu_f = np.array([v, 0.0, 0.0])
    A = jacobian(lambda e: _next_error(e, np.zeros(2), nu_f, dt_s))(np.zeros(3))
    return A, jacobian(lambda change: _next_error(np.zeros(3), change, nu_f, dt_s))(np.zeros(2))


def _next_error(e: np.ndarray, change: np.ndarray, nu_f: np.ndarray, dt_s: Value) -> np.ndarray:
    """Return the error of the pose (3,) one tick later, after the change of velocity δν (2,).  (1)"""
    nu = nu_f + np.array([change[0], 0.0, change[1]])
    return pose_error(compose(e, _motion(nu_f, dt_s)), _motion(nu, dt_s))


def _motion(nu: np.ndarray, dt_s: Value) -> np.ndarray:
    """Return the pose (3,) after a tick with the velocity ν (3,), from the origin."""
    displacement = nu * dt_s
    return map_from_body(0.5 * displacement[2]) @ displacement
