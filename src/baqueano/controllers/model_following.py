"""Base of the controllers with a model: a law requests a velocity, and the model computes the command for it.

    η_p = η + J(ψ + ½ Δ_ψ) Δ,    Δ = D (½ (ν_1 + ν_2) + d) + λ ν_f     the pose when a present command acts (1)
    ν̇_m: the model at ε,    ½ D ν̇_1 = ν_m − ν_1,    ½ D ν̇_2 = ν_1 − ν_2,    8 T ḋ = ν − ν_2 − d           (1a)
    e = J(ψ_p)⁻¹ (η_r − η_p) + b (1 − cos e_χ, − sin e_χ, 0),    e_χ = ψ_r + β_r − ψ_p − β_f              (2)
    e ← e + c(s) − (s, 0, 0),    e_χ ← e_χ + κ s                        errors at the point beside the vehicle (2a)
    λ ν̇_f = ν_r − ν_f                                       a reference without jumps                     (3)
    v_w = v + v_i,   |v| ≤ |v_f| + v_c,   v̇_i = k_i e_x,   ω_w = ω + ω_i,   4 T ω̇_i = −(d_ψ + ω_i)        (4)
    u = drivetrain⁻¹(ε),    ε: the model at ν_w accelerates with ν̇_f; within the limits of u              (5)
    k_χ ← f k_χ,   f = min(1, 1/(1.35 T k_χ)),   k_y ← min(k_y, g max(f² k_y, k_χ²/(4 ζ² v)))             (6)

η, ν: pose and velocity; r: reference; v, ω: the law at e, e_χ and ν_f; β = atan(ν_y / ν_x); ν_w = (v_w, ω_w). A vehicle
is D = delay + lag behind its command, T = D + λ behind its reference; d: model error; b: from the centre of turning to
the origin; c(s): along a circle of curvature κ. (5) inverts friction, actuator matrix and dead zone in one Newton step
per tick; v_i and ω_i remove steady errors. (6): ζ = 0.65, g: `far_gain`. docs/derivations/pd_feedforward.md
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.errors import Invalid, MissingMethod
from baqueano.geometry import map_from_body, pose_error, wrap
from baqueano.parameter import INF, document, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.symbolic import jacobian
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.effort import constant_effort
from baqueano.vehicles.rk4 import row_counts
from baqueano.vehicles.state import DynamicVehicle

SMOOTHING_S = 0.08  # λ: a corner of 1.5 rad/s costs a tenth of full command
MAX_ACCELERATION = np.array([1.0, 1.0, 20.0])  # of ν_f: a start does not need the whole command
MODEL_ERROR_RATIO, INTEGRAL_RATIO = 8.0, 4.0  # time constants of d and ω_i, as multiples of T
MAX_INTEGRAL_SHARE = 0.5  # largest integrals v_i and ω_i, as a share of ν_f
MAX_CURVATURE_ERROR_1_M = 1.0  # of a straight drive, for ω_i
MAX_ALONG_ERROR_M = 0.3  # limit of e_x: a larger error does not increase the requested speed
MAX_CATCH_UP_M_S = 0.3  # v_c, however large the gains are
MAX_ARC_M = 0.5  # of (2a): farther away, the path has another curvature
MIN_RADIUS_RATIO = 0.5  # of (2a): of the vehicle, relative to that of the circle
MAX_APPROACH_RAD = 0.9  # largest angle between course and path when a law approaches from far
NEAR_M = 0.03  # of (6): a vehicle within this distance has joined its path
NEAR_S = 1.0  # of (6): time near the path before another approach; an oscillation crosses the path sooner
DELAY_RATIO = 1.35  # smallest further delay that a loop of the course tolerates, as a share of T
MIN_DAMPING = 0.65  # of a loop of position and course whose gains are limited by T
MIN_COURSE_SPEED_M_S = 0.02  # below this speed the course is the heading
MIN_EFFECT = np.array([0.1, 1.0])  # m/s², rad/s²; a command with less effect, as a servo at rest, stays
TINY = 1e-12  # keeps a model without throttle finite


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


class Tracking(NamedTuple):
    """Inputs of a law of `ModelFollower`.

    Attributes
    ----------
    e : ndarray (3,) [m, m, rad]
        Error of the pose of the centre of turning, in the body frame: e_x along the path to the reference, at most
        MAX_ALONG_ERROR_M; e_y and e_ψ at the point of the path beside the vehicle.
    e_chi : float [rad]
        Error of the course, at the point of the path beside the vehicle.
    nu_f : ndarray (3,) [m/s, m/s, rad/s]
        Velocity of the reference without jumps, in the body frame; ν_y is that of the vehicle at this yaw rate.
    kappa : float [1/m]
        Curvature of the reference.
    forward_sign : float
        Direction of the reference [no unit]: 1 forward, −1 backward, 0 at rest, with a smooth transition.
    dt_s : float
        Time since the last tick.
    far_gain : float
        g of (6) [no unit]: 1 near the path, and up to 2 during an approach from far.

    Examples
    --------
    >>> now = Tracking(np.array([0.0, 0.1, 0.0]), 0.0, np.array([0.2, 0.0, 0.0]), 0.0, 1.0, 0.01)
    >>> print(now.e[1])
    0.1
    """

    e: np.ndarray
    e_chi: float
    nu_f: np.ndarray
    kappa: float
    forward_sign: float
    dt_s: Value
    far_gain: Value = 1.0

    def max_speed(self, v: Value) -> Value:
        """Return the larger speed [m/s] of the reference and of a request `v`, limited as in (4), for the gains."""
        return np.abs(self.nu_f[0]) + np.clip(np.abs(v) - np.abs(self.nu_f[0]), 0.0, MAX_CATCH_UP_M_S)


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
        if self.limit.shape != (self.vehicle.commands,):
            shape, commands = str(self.limit.shape), self.vehicle.commands
            raise Invalid.of("field.limit", block=type(self).__name__, value=shape, commands=commands)

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
        nu = estimate.nu
        dt_s = np.where(state.t_ns >= 0, seconds(estimate.t_ns, state.t_ns), 1.0 / self.rate_hz)
        nu_b = np.where(state.t_ns >= 0, state.nu, nu)  # ν_f starts at the velocity of the vehicle
        nu_f_dot = np.clip((reference.nu - nu_b) / SMOOTHING_S, -MAX_ACCELERATION, MAX_ACCELERATION)
        nu_f = nu_b + nu_f_dot * np.minimum(dt_s, SMOOTHING_S)  # (3)
        pipeline = self._pipeline(state, nu, dt_s)
        _, smooth_y, smooth_r = pipeline[2] + pipeline[3]  # ν without most of its noise
        b = optional.turning_arm_m(self.vehicle)
        nu_f = np.array([nu_f[0], smooth_y + b * (nu_f[2] - smooth_r), nu_f[2]])
        tracking = self._tracking(reference, self._predicted_pose(estimate.eta, pipeline, nu_f), nu_f, dt_s)
        near_s = approach_clock(state.near_s, tracking.e[1], dt_s)
        tracking = tracking._replace(far_gain=far_gain(tracking.e[1], near_s))
        integral = self._integral(state.integral, tracking.e[0], pipeline[3][2], nu_f, dt_s)
        law, v_w, omega_w = self._checked_law(state.law, tracking)
        nu_w = np.array([v_w + integral[0], nu[1], omega_w + integral[1]])  # (4)
        effort = self._effort(state.effort, nu_w, nu_f_dot[::2])
        drivetrain = self.vehicle.drivetrain
        u = drivetrain.prioritise_turn(np.clip(drivetrain.inverse(effort), -self.limit, self.limit))
        # that u causes within the limits: otherwise the integrals would wind up
        effort = drivetrain.unmix(drivetrain.static_response(drivetrain.mix(u)))
        return FollowerState(estimate.t_ns, nu_f, integral, effort, law, pipeline, near_s), Command(
            estimate.t_ns, u
        )

    def _predicted_pose(self, eta: np.ndarray, pipeline: np.ndarray, nu_f: np.ndarray) -> np.ndarray:
        """Return η_p (3,), the pose when a present command acts, of a vehicle at η (3,).  (1)"""
        _, nu_1, nu_2, d = pipeline
        displacement = self._delay_s * (0.5 * (nu_1 + nu_2) + d) + SMOOTHING_S * nu_f
        return eta + map_from_body(eta[2] + 0.5 * displacement[2]) @ displacement

    def _tracking(self, reference: Reference, eta_p: np.ndarray, nu_f: np.ndarray, dt_s: Value) -> Tracking:
        """Return the errors of a vehicle at η_p (3,) with the velocity ν_f (3,), as the laws use them.  (2), (2a)"""
        eta_r, nu_r = reference.eta, reference.nu
        e_chi = wrap(eta_r[2] + slip(nu_r) - eta_p[2] - slip(nu_f))
        e = pose_error(eta_r, eta_p)
        e = e + optional.turning_arm_m(self.vehicle) * np.array([1.0 - np.cos(e_chi), -np.sin(e_chi), 0.0])
        kappa = nu_r[2] * nu_r[0] / (nu_r[0] ** 2 + MIN_COURSE_SPEED_M_S**2)
        s = arc_to_vehicle(e, e_chi, kappa)
        x, y = point_ahead(e, e_chi, kappa, s)
        e_x = np.clip(x - s, -MAX_ALONG_ERROR_M, MAX_ALONG_ERROR_M)
        forward_sign = nu_f[0] / np.hypot(nu_f[0], MIN_COURSE_SPEED_M_S)
        e = np.array([e_x, y, e[2] + kappa * s])
        return Tracking(e, e_chi + kappa * s, nu_f, kappa, forward_sign, dt_s)

    @property
    def response_delay_s(self) -> float:
        """Return T [s], the delay of the vehicle behind its reference."""
        return self._delay_s + SMOOTHING_S

    @property
    def _delay_s(self) -> float:
        """Return D [s], the delay of the vehicle behind its command."""
        return self.vehicle.drivetrain.delay_s + self.vehicle.drivetrain.longest_lag_s

    def _pipeline(self, state: FollowerState, nu: np.ndarray, dt_s: Value) -> np.ndarray:
        """Return ν_m, ν_1, ν_2 and d (4, 3) at this tick, for a vehicle with the velocity ν (3,).  (1a)"""
        nu_m, nu_1, nu_2, d = state.pipeline
        nu_m = self._advance(nu_m, state.effort)
        share = dt_s / np.maximum(np.maximum(0.5 * self._delay_s, dt_s), TINY)
        nu_1 = nu_1 + share * (nu_m - nu_1)
        nu_2 = nu_2 + share * (nu_1 - nu_2)
        d = low_pass(d, nu - nu_2, MODEL_ERROR_RATIO * self.response_delay_s, dt_s)
        at_start = np.array([nu, nu, nu, np.zeros(3)])
        return np.where(state.t_ns >= 0, np.array([nu_m, nu_1, nu_2, d]), at_start)

    def _integral(
        self, integral: np.ndarray, e_x: Value, d_psi: Value, nu_f: np.ndarray, dt_s: Value
    ) -> np.ndarray:
        """Return v_i and ω_i (2,) at this tick, within their limits, which prevent wind-up.  (4)"""
        v_i = integral[0] + self.k_i * e_x * dt_s
        omega_i = low_pass(integral[1], -d_psi, INTEGRAL_RATIO * self.response_delay_s, dt_s)
        limit = np.array([MAX_INTEGRAL_SHARE * np.abs(nu_f[0]), max_turn_error(nu_f)])
        return np.clip(np.array([v_i, omega_i]), -limit, limit)

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

    def _effort(self, effort: np.ndarray, nu: np.ndarray, nu_dot: np.ndarray) -> np.ndarray:
        """Return ε (n,): the model at (v_w, ν_y, ω_w) then has the acceleration `nu_dot` (2,) over one tick.  (5)"""
        dt_s = 1.0 / self.rate_hz

        def next_velocity(effort: np.ndarray) -> np.ndarray:
            return self._advance(nu, effort)[::2]

        max_command = np.where(np.isfinite(self.limit), self.limit, 1.0)
        b_v, b_r = jacobian(next_velocity)(effort) * max_command
        remainder_v, remainder_r = nu[::2] + nu_dot * dt_s - next_velocity(effort)
        min_v, min_r = (MIN_EFFECT * dt_s) ** 2
        step = b_v * remainder_v / (b_v @ b_v + min_v)
        b_turn = b_r - b_v * (b_r @ b_v) / (b_v @ b_v + TINY)  # a turn must not change the speed
        step = step + b_turn * (remainder_r - b_r @ step) / (b_turn @ b_turn + min_r)
        return np.clip(effort + max_command * step, -self.limit, self.limit)

    def _advance(self, nu: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Return the velocity (3,) of the model after a tick of usual length, with a constant effort (n,)."""
        dt_s = 1.0 / self.rate_hz
        rows = int(row_counts(np.array(dt_s)))
        for _ in range(rows):
            _, nu, _ = self.vehicle.advance(np.zeros(3), nu, constant_effort(effort), dt_s / rows)
        return nu


def low_pass(value: Value, target: Value, constant_s: Value, dt_s: Value) -> Value:
    """Return `value` after a tick in which it follows `target` with the time constant `constant_s`.  (1a), (4)"""
    return value + dt_s / np.maximum(constant_s, dt_s) * (target - value)


def max_turn_error(nu: np.ndarray) -> Value:
    """Return the largest error of the yaw rate [rad/s] that is compensated at the reference velocity ν (3,).  (4)"""
    return MAX_INTEGRAL_SHARE * np.abs(nu[2]) + MAX_CURVATURE_ERROR_1_M * np.abs(nu[0])


def slip(nu: np.ndarray) -> Value:
    """Return β [rad], the angle from the heading to the course for ν (3,); positive to the left, even backward.

    β is 0 at rest.  (2)
    """
    return np.arctan(nu[1] * nu[0] / (nu[0] * nu[0] + MIN_COURSE_SPEED_M_S**2))


def approach_clock(near_s: Value, e_y: Value, dt_s: Value) -> Value:
    """Return `near_s` of FollowerState one tick later, at the cross-track error `e_y` [m]."""
    is_far = np.abs(e_y) >= NEAR_M
    far_s = np.where(near_s >= NEAR_S, 2.0 * NEAR_S, near_s)
    return np.where(is_far, far_s, np.where(near_s > NEAR_S, 0.0, np.minimum(near_s + dt_s, NEAR_S)))


def far_gain(e_y: Value, near_s: Value) -> Value:
    """Return g, from 1 near the path to 2 far from it: the factor by which T limits k_y less.  (6)"""
    return np.where(near_s > NEAR_S, 2.0 - NEAR_M / np.maximum(np.abs(e_y), NEAR_M), 1.0)


def arc_to_vehicle(e: np.ndarray, e_chi: Value, kappa: Value) -> Value:
    """Return s [m], the distance along the path from the reference to the point beside the vehicle.  (2a)

    The path has the curvature `kappa` of the reference. It bends by at most 1 rad over s, and |s| is at most MAX_ARC_M.
    """
    along_m = np.cos(e_chi) * e[0] + np.sin(e_chi) * e[1]  # of the reference, from the vehicle
    across_m = np.cos(e_chi) * e[1] - np.sin(e_chi) * e[0]
    slope_m = -along_m / np.maximum(1.0 + kappa * across_m, MIN_RADIUS_RATIO)
    s = slope_m / (1.0 + (kappa * slope_m) ** 2 / 3.0)  # atan(κ slope_m) / κ, finite for κ = 0
    max_m = np.minimum(MAX_ARC_M, 1.0 / np.maximum(np.abs(kappa), TINY))
    return np.clip(s, -max_m, max_m)


def point_ahead(e: np.ndarray, e_chi: Value, kappa: Value, distance_m: Value) -> tuple[Value, Value]:
    """Return x and y [m], in the body frame, of the point of the path `distance_m` after the point with the error e.

    The path has the curvature `kappa`, and bends by at most 1 rad over `distance_m`.
    """
    angle = np.clip(kappa * distance_m, -1.0, 1.0)
    chord_m, chord = distance_m * (1.0 - angle**2 / 24.0), e_chi + 0.5 * angle
    return e[0] + chord_m * np.cos(chord), e[1] + chord_m * np.sin(chord)
