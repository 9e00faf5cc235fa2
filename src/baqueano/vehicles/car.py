"""A car: throttle and servo, front wheels that steer, a rear axle that does not slip sideways.

    v̇ = k_t u_t − d_l v − d_m w v − d_c |v| v − d_k(t) t − k |ν_ψ| v,   t = tanh(v / v_k)                  (1)
    d_k(t) = d_k + d_f (1 + t)/2 + d_b (1 − t)/2           d_f, d_b: extra friction forward, backward
    δ = k_s u_s + δ₀,   κ = ν_ψ/v,   κ̇ = (tan δ / (L + U v²) − κ) / λ                                     (2)
    ν̇_ψ = (v tan δ / (L + U v²) − ν_ψ) / λ + ν_ψ v v̇ / (v² + ε²)     the same for ν_ψ, regular at v = 0   (2')
    ν = (v, b ν_ψ, ν_ψ)                                                                                   (3)
    η̇ = J(ψ) ν                                                                                            (4)
    w = |u_t| / g + z min(|u_t| / 0.01, 1),   z the dead zone of its direction, g the gain of the channel (5)

η, ν: pose and velocity of the body's origin, b ahead of the rear axle; v: speed, ν_ψ: yaw rate, κ: curvature, λ: its
lag, u_t, u_s: effort of throttle and servo, δ: steering angle, L: wheelbase, U: understeer, d_m: damping of a driven
motor, w: its duty. A steered car that brakes stays on its circle, so the lag is in κ. Terms are per kilogram, because
the mass cannot be identified from commands and IMU (errata 9). Keep k_s · limit well below π/2.
Derivation: docs/derivations/vehicles.md.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import wrap
from baqueano.parameter import document, parameter
from baqueano.signals import Motion
from baqueano.vehicles.bounds import check_bounds, check_commands
from baqueano.vehicles.delay import MIN_TICK_S
from baqueano.vehicles.drivetrain import Drivetrain
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.friction import NO_FRICTION
from baqueano.vehicles.rk4 import lagged_rk4
from baqueano.vehicles.state import VehicleState, tick_effort

MIN_DRIVEN_EFFORT = 0.01  # effort above which a motor is driven during the whole tick
MIN_STEERED_SPEED_M_S = 0.1  # ε of (2'): slower, ν_ψ does not determine κ
MIN_LAG_S = 0.01  # of ν̇ at a given ν: a shorter lag would amplify every error of a filter's ν_ψ


@document
@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A car with throttle and steering servo: u = (u_t, u_s).

    Parameters
    ----------
    drivetrain : Drivetrain
        The block between the command and the effort: delay, lag, dead zone, battery.

    Notes
    -----
    Equations (1)-(5) of the module: a bicycle with a lag of its steering.
    docs/derivations/vehicles.md derives the terms.

    Examples
    --------
    >>> car = Car(wheelbase_m=0.26, throttle_gain=4.0, steering_gain=0.4)
    >>> state, motion = car.step(car.init(), np.array([0.5, 0.2]), 0.1, np.zeros(3))
    >>> print(f"{motion.nu[0]:.2f} m/s")
    0.20 m/s
    """

    commands: ClassVar[int] = 2

    wheelbase_m: float = parameter(
        "m",
        "distance from the rear to the front axle, L",
        low=1e-3,
        high=100.0,
        role="fixed",
        measured_by="the tape",
    )
    throttle_gain: float = parameter(
        "m/s² per unit of u", "acceleration of a throttle", low=0.0, high=1e4, role="gain",
        shown_by="changes of the throttle", symbol="k_t",
    )  # fmt: skip
    steering_gain: float = parameter(
        "rad per unit of u", "steering angle of a servo command; left is positive", low=-1.5, high=1.5,
        role="gain", shown_by="steering to both sides while driving", symbol="k_s",
    )  # fmt: skip
    rear_axle_m: float = parameter(
        "m",
        "distance from the rear axle forward to the origin of the body, b",
        low=-100.0,
        high=100.0,
        default=0.0,
        role="fixed",
    )
    steering_offset_rad: float = parameter(
        "rad", "steering angle without a command", low=-1.5, high=1.5, default=0.0, role="offset",
        shown_by="driving straight for a while", symbol=r"\delta_0",
    )  # fmt: skip
    linear_drag: float = parameter(
        "1/s", "viscous drag d_l", low=0.0, high=1e4, default=0.0, shown_by="driving and coasting",
        symbol="d_l",
    )  # fmt: skip
    coulomb_m_s2: float = parameter(
        "m/s²", "dry friction d_k", low=0.0, high=1e4, default=0.0, neutral=0.0, term="dry friction",
        shown_by="driving slowly and stopping, many times", symbol="d_k", sign_speed="coulomb_speed_m_s",
    )  # fmt: skip
    quadratic_drag: float = parameter(
        "1/m", "quadratic drag d_c", low=0.0, high=1e4, default=0.0, role="term", term="quadratic drag",
        shown_by="driving both slowly and at full speed", symbol="d_c",
    )  # fmt: skip
    motor_drag: float = parameter(
        "1/s per unit of u", "drag of the motor while it is driven, d_m", low=0.0, high=1e4, default=0.0,
        role="term", term="drag of the driven motor",
        shown_by="the same speed with much throttle and without throttle: acceleration steps, then coasting",
        symbol="d_m",
    )  # fmt: skip
    coulomb_forward_m_s2: float = parameter(
        "m/s²", "additional dry friction when rolling forward, d_f", low=0.0, high=1e4, default=0.0, role="term",
        symbol="d_f", sign_speed="coulomb_speed_m_s",
    )  # fmt: skip
    coulomb_backward_m_s2: float = parameter(
        "m/s²", "additional dry friction when rolling backward, d_b", low=0.0, high=1e4, default=0.0, role="term",
        symbol="d_b", sign_speed="coulomb_speed_m_s",
    )  # fmt: skip
    coulomb_speed_m_s: float = parameter(
        "m/s", "speed over which dry friction changes sign", low=1e-4, high=1e3, default=0.05, role="fixed"
    )
    cornering_drag: float = parameter(
        "1/rad", "drag of cornering k", low=0.0, high=100.0, default=0.0, neutral=0.0,
        term="drag of cornering", shown_by="turning at speed", symbol="k",
    )  # fmt: skip
    understeer: float = parameter(
        "rad s²/m", "understeer U: additional steering angle per lateral acceleration in a curve", low=0.0, high=1.0,
        default=0.0, role="tyre", term="understeer", shown_by="the same curve both slowly and fast", symbol="U",
    )  # fmt: skip
    yaw_lag_s: float = parameter(
        "s", "lag of servo and tyres λ; of the tyres if drivetrain.servo_lag_s > 0", low=0.0, high=10.0,
        default=0.05,
        shown_by="sudden changes of steering while driving", symbol=r"\lambda",
    )  # fmt: skip
    drivetrain: Drivetrain = field(
        default_factory=lambda: Drivetrain(commands=2),
        metadata={"roles": {"dead_zone_backward": "reverse", "coast": "fixed"}},
    )
    process_noise_std: np.ndarray = parameter(
        "m/s/√s, m/s/√s, rad/s/√s", "random walk of ν in 1 s; the second is not used", low=0.0, high=1e6,
        default=NO_FRICTION, shape=(3,), role="noise",
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_bounds(self)
        check_commands(self, "throttle, servo")
        if self.drivetrain.servos != 1:
            object.__setattr__(self, "drivetrain", replace(self.drivetrain, servos=1))

    @property
    def turning_arm_m(self) -> float:
        """Return ν̇_y per ν̇_ψ [m]: the distance from the rear axle (the centre of turning) forward to the origin."""
        return self.rear_axle_m

    def gravity(self, psi: float) -> np.ndarray:
        """Return gravity along body x and y (2,) [m/s²]: zeros, because the floor is level."""
        return np.zeros(2)

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: float = 0.0) -> np.ndarray:
        """Return ν̇ (3,) at ν (3,) with the effort (2,).  (1)-(3)"""
        v, r = nu[0], nu[2]
        v_dot = self._v_dot(v, r, effort)
        r_dot = (v * self._curvature(v, effort)[0] - r) / np.maximum(self.yaw_lag_s, MIN_LAG_S)
        r_dot = r_dot + self._growth(v, r, v_dot)
        return np.array([v_dot, self.rear_axle_m * r_dot, r_dot])

    def viscous_effort(self, nu: np.ndarray) -> np.ndarray:
        """Return the effort (2,) that balances the viscous drag at ν (3,)."""
        return np.array([self.linear_drag * nu[0] / self.throttle_gain, 0.0])

    def advance(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (η, ν, ν̇), (3,) each, after `dt_s` with an effort; ν̇ is the value at the end.  (1)-(4)"""
        position, nu, nu_dot, turn = self._move(eta, nu, effort, dt_s)
        return np.concatenate([position, np.array([wrap(eta[2] + turn)])]), nu, nu_dot

    def init(self, eta: np.ndarray | None = None, nu: np.ndarray | None = None) -> VehicleState:
        """Return the state at `eta` (3,) in the map with `nu` (3,) in the body, both zero by default, motor off."""
        eta = np.zeros(3) if eta is None else eta
        nu = np.zeros(3) if nu is None else self._nu(nu[0], nu[2])
        return VehicleState(eta, nu, self.nu_dot(nu, np.zeros(2)), self.drivetrain.init())

    def step(
        self, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
    ) -> tuple[VehicleState, Motion]:
        """Return the state and the Motion after a tick with the command `u` (2,).

        `noise` (3,) is standard normal, or zero for a simulation without process noise.
        """
        drivetrain, effort = tick_effort(self, state.drivetrain, state.eta[2], state.nu, u, dt_s)
        position, nu, nu_dot, turn = self._move(state.eta, state.nu, effort, dt_s)
        eta = np.concatenate([position, np.array([wrap(state.eta[2] + turn)])])
        turns = self._turn_curve(state.nu, nu, nu_dot[2], turn, effort, dt_s)

        def motion_at(eta: np.ndarray, v: Value, turn: tuple[Value, Value], effort: np.ndarray) -> Motion:
            r, r_dot = turn
            rates = np.array([self._v_dot(v, r, effort), self.rear_axle_m * r_dot, r_dot])
            return Motion(eta, self._nu(v, r), rates, self.gravity(eta[2]))

        begin = motion_at(state.eta, state.nu[0], turns[0], effort.start)
        end = motion_at(eta, nu[0], turns[2], effort.end)
        v = 0.5 * (state.nu[0] + nu[0]) + 0.125 * dt_s * (begin.nu_dot[0] - end.nu_dot[0])
        middle = motion_at(eta, v, turns[1], effort.mean)
        noise_step = self.process_noise_std * np.sqrt(dt_s) * noise
        r_dot = nu_dot[2] - noise_step[2] / np.maximum(self.yaw_lag_s, MIN_LAG_S)
        now = motion_at(eta, nu[0] + noise_step[0], (nu[2] + noise_step[2], r_dot), effort.last)
        return VehicleState(eta, now.nu, now.nu_dot, drivetrain), now._replace(tick=(begin, middle, end))

    def _move(
        self, eta: np.ndarray, nu: np.ndarray, effort: Effort, dt_s: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Value]:
        """Return position (2,), ν and ν̇ (3,) after `dt_s` with an effort, and the angle of the turn.  (1)-(4)"""
        b, lag_s, r, heading = self.rear_axle_m, self.yaw_lag_s, nu[2], eta[2]

        def x_dot(x: np.ndarray, r: Value, effort: np.ndarray) -> tuple[np.ndarray, Value, np.ndarray]:
            """Return the rates of the rear axle (x, y), v and ψ + λ ν_ψ; the last term of (2'); ∂(v κ)/∂u (2,)."""
            v, psi = x[2], heading + x[3] - lag_s * r
            v_dot = self._v_dot(v, r, effort)
            growth = self._growth(v, r, v_dot)
            curvature, slope = self._curvature(v, effort)
            rates = np.array([v * np.cos(psi), v * np.sin(psi), v_dot, v * curvature + lag_s * growth])
            return rates, growth, np.array([0.0 * v, v * slope])

        def axle(psi: Value) -> np.ndarray:
            return b * np.array([np.cos(psi), np.sin(psi)])

        x = np.concatenate([eta[:2] - axle(heading), np.array([nu[0], lag_s * r])])
        x, r, lag_rate = lagged_rk4(x_dot, x, r, effort, dt_s, lag_s)
        turn, v_dot = x[3] - lag_s * r, self._v_dot(x[2], r, effort.last)
        r_dot = lag_rate + self._growth(x[2], r, v_dot)
        return x[:2] + axle(heading + turn), self._nu(x[2], r), np.array([v_dot, b * r_dot, r_dot]), turn

    def _turn_curve(
        self, before: np.ndarray, after: np.ndarray, end_rate: Value, turn: Value, effort: Effort, dt_s: float
    ) -> list[tuple[Value, Value]]:
        """Return (ν_ψ, ν̇_ψ) at start, middle and end of a tick that turns by `turn`, with ν before and after it.

        Both are parabolas with the right mean. If λ is short, ν̇_ψ has the right first moment instead of its start,
        which can be an impulse.
        """
        h, start, end = np.maximum(dt_s, MIN_TICK_S), before[2], after[2]
        mean, moment = (end - start) / h, 3.0 * (start + end - 2.0 * turn / h) / h
        is_short = self.yaw_lag_s < h
        start_rate = np.where(is_short, end_rate - 2.0 * moment, self.nu_dot(before, effort.start)[2])
        rates = start_rate, 1.5 * mean - 0.25 * (start_rate + end_rate), end_rate
        return list(zip((start, 1.5 * turn / h - 0.25 * (start + end), end), rates, strict=True))

    def _v_dot(self, v: Value, r: Value, effort: np.ndarray) -> Value:
        """Return v̇ at the yaw rate r.  (1)"""
        t = np.tanh(v / self.coulomb_speed_m_s)
        directional_friction = self.coulomb_forward_m_s2 * (1.0 + t) + self.coulomb_backward_m_s2 * (1.0 - t)
        dry_friction = t * (self.coulomb_m_s2 + 0.5 * directional_friction)
        drag = self.linear_drag + self.quadratic_drag * np.abs(v) + self.motor_drag * self._duty(effort[0])
        straight = self.throttle_gain * effort[0] - drag * v - dry_friction
        return straight - self.cornering_drag * np.abs(r) * v

    def _curvature(self, v: Value, effort: np.ndarray) -> tuple[Value, Value]:
        """Return the curvature of the path without a lag, and its derivative by the effort of the servo.  (2)"""
        tan = np.tan(self.steering_gain * effort[1] + self.steering_offset_rad)
        length = self.wheelbase_m + self.understeer * v * v
        return tan / length, self.steering_gain * (1.0 + tan * tan) / length

    def _growth(self, v: Value, r: Value, v_dot: Value) -> Value:
        """Return ν̇_ψ at a constant curvature: the last term of (2')."""
        return r * v * v_dot / (v * v + MIN_STEERED_SPEED_M_S**2)

    def _duty(self, effort: float) -> float:
        """Return w, the share of the time in which the motor is driven.  (5)"""
        drivetrain = self.drivetrain
        zone = np.where(effort > 0.0, drivetrain.dead_zone_forward[0], drivetrain.dead_zone_backward[0])
        size = np.abs(effort)
        return size / drivetrain.gain[0] + zone * np.minimum(size / MIN_DRIVEN_EFFORT, 1.0)

    def _nu(self, v: float, r: float) -> np.ndarray:
        """Return ν (3,) for a rear axle that does not slip.  (3)"""
        return np.array([v, self.rear_axle_m * r, r])
