"""Base of the controllers with a model: a law requests a velocity, and the model computes the command for it.

    λ ν̇_f = ν_r − ν_f                                       a reference without jumps                     (3)
    v_w = v + v_i,   |v| ≤ |v_f| + v_c,   v̇_i = k_i e_x,   ω_w = ω + ω_i,   4 T ω̇_i = −(d_ψ + ω_i)        (4)
    k_χ ← f k_χ,   f = min(1, 1/(1.35 T k_χ)),   k_y ← min(k_y, g max(f² k_y, k_χ²/(4 ζ² v)))             (6)

η, ν: pose and velocity; r: reference; v, ω: the law at e, e_χ and ν_f, (2) and (2a) of following/tracking.py. The pose
is that of (1), and the command for ν_w = (v_w, ω_w) that of (5), in following/response.py. T is the delay behind the
reference, d the model error. v_i and ω_i remove steady errors. (6): ζ = 0.65, g: `far_gain`.
docs/derivations/pd_feedforward.md
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.controllers.following.response import SMOOTHING_S, TINY, ModelResponse, low_pass
from baqueano.controllers.following.tracking import MAX_CATCH_UP_M_S, NEAR_S, Tracking, tracking_errors
from baqueano.errors import MissingMethod
from baqueano.parameter import INF, document, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds, check_limit
from baqueano.vehicles.state import DynamicVehicle

MAX_ACCELERATION = np.array([1.0, 1.0, 20.0])  # of ν_f: a start does not need the whole command
INTEGRAL_RATIO = 4.0  # time constant of ω_i, as a multiple of T
MAX_INTEGRAL_SHARE = 0.5  # largest integrals v_i and ω_i, as a share of ν_f
MAX_CURVATURE_ERROR_1_M = 1.0  # of a straight drive, for ω_i
DELAY_RATIO = 1.35  # smallest further delay that a loop of the course tolerates, as a share of T
MIN_DAMPING = 0.65  # of a loop of position and course whose gains are limited by T


class FollowerState(NamedTuple):
    """The reference without jumps, the effort that follows it, and the memory of the law.

    Attributes
    ----------
    t_ns : int
        Time of the last tick; -1 before the first.
    nu : ndarray (3,) [m/s, m/s, rad/s]
        ν_f, the reference without jumps, in the body frame.
    integral : ndarray (2,) [m/s, rad/s]
        v_i and ω_i of (4), the parts of the requested velocity that compensate steady errors of the model.
    effort : ndarray (n,) [unit of u]
        ε of (5), from which the command is computed.
    law : ndarray
        Memory of the law, of any shape (…,).
    pipeline : ndarray (4, 3) [m/s, m/s, rad/s]
        ν_m, ν_1, ν_2 and d of (1a).
    near_s : float [s]
        Time near the path since the last approach, at most NEAR_S; twice NEAR_S during an approach.
    """

    t_ns: int
    nu: np.ndarray
    integral: np.ndarray
    effort: np.ndarray
    law: np.ndarray
    pipeline: np.ndarray
    near_s: float = NEAR_S


@document
@dataclass(frozen=True, slots=True, eq=False)
class ModelFollower:
    """Base of a controller that only defines its law: `velocity_law(memory, tracking) → memory, (v, ω)`.

    Parameters
    ----------
    vehicle : DynamicVehicle
        The model that computes the command for a velocity: a block of vehicles/.
    rate_hz : float
        Ticks per second.

    Notes
    -----
    Equations (1)-(6) of the module; computed torque, Slotine and Li, Applied Nonlinear Control, 1991, ch. 9.
    docs/derivations/pd_feedforward.md derives them.

    Examples
    --------
    >>> class Slow(ModelFollower):
    ...     def velocity_law(self, memory, now):
    ...         return memory, (0.5 * now.nu_f[0] + now.e[0], 2.0 * now.e_chi)
    >>> robot = bq.load("small")
    >>> print(f"{Slow(robot.vehicle, limit=robot.command.limit).response_delay_s:.2f} s behind its reference")
    0.15 s behind its reference
    """

    vehicle: DynamicVehicle
    k_i: float = parameter("1/s²", "speed per integral of e_x", low=0.0, high=10.0, default=0.5)
    rate_hz: float = 100.0
    limit: np.ndarray = parameter(
        "unit of u", "largest command, (n,)", low=0.0, default=(INF, INF, INF), shape=None
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        check_limit(self)

    def memory(self) -> np.ndarray:
        """Return the memory (…,) of the law before the first tick; it is empty, (0,), for most laws."""
        return np.zeros(0)

    def velocity_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Tree]:
        """Return the memory of the law, and the requested velocity (v, ω) [m/s, rad/s].  (4)

        A subclass defines this method; the base class raises MissingMethod.
        """
        raise MissingMethod.of("follower.no-law", block=type(self).__name__)

    def init(self) -> FollowerState:
        """Return the state of a vehicle at rest."""
        return FollowerState(
            -1, np.zeros(3), np.zeros(2), np.zeros(self.vehicle.commands), self.memory(), np.zeros((4, 3))
        )

    def step(
        self, state: FollowerState, reference: Reference, estimate: Estimate
    ) -> tuple[FollowerState, Command]:
        """Return the state and the command (n,) with which the model follows the reference."""
        nu, response, is_running = estimate.nu, self._response, state.t_ns >= 0
        arm_m = optional.turning_arm_m(self.vehicle)
        dt_s = np.where(is_running, seconds(estimate.t_ns, state.t_ns), 1.0 / self.rate_hz)
        nu_b = np.where(is_running, state.nu, nu)  # ν_f starts at the velocity of the vehicle
        nu_f_dot = np.clip((reference.nu - nu_b) / SMOOTHING_S, -MAX_ACCELERATION, MAX_ACCELERATION)
        nu_f = nu_b + nu_f_dot * np.minimum(dt_s, SMOOTHING_S)  # (3)
        pipeline = response.next_pipeline(state.pipeline, state.effort, nu, dt_s)
        pipeline = np.where(is_running, pipeline, np.array([nu, nu, nu, np.zeros(3)]))
        _, smooth_y, smooth_r = pipeline[2] + pipeline[3]  # ν without most of its noise
        nu_f = np.array([nu_f[0], smooth_y + arm_m * (nu_f[2] - smooth_r), nu_f[2]])
        eta_p = response.predicted_pose(estimate.eta, pipeline, nu_f)
        tracking, near_s = tracking_errors(reference, eta_p, nu_f, arm_m, dt_s, state.near_s)
        v_i = state.integral[0] + self.k_i * tracking.e[0] * dt_s
        omega_i = low_pass(state.integral[1], -pipeline[3][2], INTEGRAL_RATIO * self.response_delay_s, dt_s)
        max_integral = np.array([MAX_INTEGRAL_SHARE * np.abs(nu_f[0]), max_turn_error(nu_f)])
        integral = np.clip(np.array([v_i, omega_i]), -max_integral, max_integral)  # without wind-up
        law, v_w, omega_w = self._checked_law(state.law, tracking)
        nu_w = np.array([v_w + integral[0], nu[1], omega_w + integral[1]])  # (4)
        # the effort within the limits: otherwise the integrals would wind up
        u, effort = response.limited_command(response.next_effort(state.effort, nu_w, nu_f_dot[::2]))
        next_state = FollowerState(estimate.t_ns, nu_f, integral, effort, law, pipeline, near_s)
        return next_state, Command(estimate.t_ns, u)

    @property
    def response_delay_s(self) -> float:
        """Return T [s], the delay of the vehicle behind its reference."""
        return self._response.reference_delay_s

    @property
    def _response(self) -> ModelResponse:
        return ModelResponse(self.vehicle, self.rate_hz, self.limit)

    @property
    def max_course_gain(self) -> float:
        """Return k_T [1/s], the largest yaw rate per course error.  (6)

        A loop of the predicted course with this gain tolerates a further delay of 1.35 T, by the small-gain theorem.
        """
        return 1.0 / (DELAY_RATIO * self.response_delay_s)

    def limited_gains(
        self, k_chi: Value, k_y: Value, speed_m_s: Value, far_gain: Value = 1.0
    ) -> tuple[Value, Value]:
        """Return yaw rates per course error k_χ [1/s] and per cross-track error k_y [rad/(m s)], limited by T.  (6)

        If f limits k_χ, the damping ratio k_χ / (2 √(k_y v)) falls to MIN_DAMPING, if it was larger. The limit
        of k_y is `far_gain` times as large.
        """
        share = 1.0 / np.maximum(k_chi / self.max_course_gain, 1.0)
        k_chi = share * k_chi
        damped_k_y = k_chi**2 / np.maximum(4.0 * MIN_DAMPING**2 * speed_m_s, TINY)
        return k_chi, np.minimum(k_y, far_gain * np.maximum(share**2 * k_y, damped_k_y))

    def _checked_law(self, memory: np.ndarray, tracking: Tracking) -> tuple[np.ndarray, Value, Value]:
        result = self.velocity_law(memory, tracking)
        try:
            memory, (v, omega) = result
        except (TypeError, ValueError) as error:
            raise MissingMethod.of("follower.law-result", block=type(self).__name__) from error
        max_speed = np.abs(tracking.nu_f[0]) + MAX_CATCH_UP_M_S
        return memory, np.clip(v, -max_speed, max_speed), omega


def max_turn_error(nu: np.ndarray) -> Value:
    """Return the largest error of the yaw rate [rad/s] that is compensated at the reference velocity ν (3,).  (4)"""
    return MAX_INTEGRAL_SHARE * np.abs(nu[2]) + MAX_CURVATURE_ERROR_1_M * np.abs(nu[0])
