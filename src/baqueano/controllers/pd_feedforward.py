"""PD with feed-forward from the vehicle's model: the recommended controller. It drives evenly.

    η_p = η + J(ψ + ½ T ω) T (ν + 2 ν_f + ν_r) / 4          the pose when a command of now is felt        (1)
    e = J(ψ_p)⁻¹ (η_r − η_p),    e_χ = ψ_r + β_r − ψ_p − β,    β = atan(ν_y / ν_x)                        (2)
    v_w = v_f + k_x e_x + v_i,    ω_w = ω_f + k_χ (e_χ ± atan(e_y / L))            velocity wanted        (3)
    λ ν̇_f = ν_r − ν_f,    v̇_i = k_i e_x                       reference without jumps, integral          (4)
    u = drivetrain⁻¹(ε),    ε: the model at ν_w accelerates with ν̇_f                                      (5)

(5) inverts friction, actuator matrix, unequal wheels and dead zone, so that the command for a speed comes from the
model and the feedback (3) stays weak: the same rates and length suit a small robot and a car. Where a wheel cannot do
both, the turn goes before the speed. Delay and lag of the motors are not inverted, which would amplify noise: the
vehicle follows its reference T = delay + lag + λ later, and (1) predicts over T. (5) is one Newton step a tick, exact
where the model is linear in its effort. The model must be an identified one: a guessed dead zone gives a wrong speed.
Sources: line of sight, (3), Fossen, Handbook of Marine
Craft, 2011, ch. 12; computed torque, (5), Slotine and Li, Applied Nonlinear Control, 1991, ch. 9. Derivation:
docs/derivations/pd_feedforward.md.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.geometry import map_from_body, pose_error, wrap
from baqueano.parameter import INF, parameter
from baqueano.signals import Command, Estimate, Reference, seconds
from baqueano.symbolic import jacobian
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.effort import steady

SMOOTHING_S = 0.08  # λ: a corner of 1.5 rad/s costs a tenth of full command
FASTEST = np.array([1.0, 1.0, 20.0])  # acceleration of ν_f: a start does not take the whole command
SHARE = 0.5  # of the asked speed: what the integral may add
REACH_M = 0.3  # a larger error asks for no more
SLOW_M_S = 0.02  # below, the course is the heading
DAMPING = 1e-6  # of the Newton step where no effort helps, as the servo of a car at rest


class PdFeedforwardState(NamedTuple):
    """The reference without jumps, and the effort that follows it."""

    t_ns: int  # -1 before the first tick
    nu: np.ndarray  # (3,) ν_f [m/s, m/s, rad/s]
    v_i: float  # integral of the error ahead [m/s]
    effort: np.ndarray  # (n,) ε [unit of u]


@dataclass(frozen=True, slots=True, eq=False)
class PdFeedforward:
    """Feed-forward from `vehicle`, a block of vehicles/, with weak feedback of place and course."""

    vehicle: Any
    k_x: float = parameter("1/s", "speed per error ahead e_x", low=0.0, high=10.0, default=1.0)
    k_chi: float = parameter("1/s", "turn per error of the course e_χ", low=0.0, high=20.0, default=4.0)
    join_m: float = parameter("m", "way L in which the path is joined", low=0.01, high=10.0, default=0.25)
    k_i: float = parameter("1/s²", "speed per integral of e_x", low=0.0, high=10.0, default=0.5)
    rate_hz: float = 100.0
    limit: np.ndarray = parameter(
        "unit of u", "largest command, (n,)", low=0.0, default=(INF, INF, INF), shape=None
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.limit.shape != (self.vehicle.commands,):
            raise ValueError(
                f"PdFeedforward.limit has shape {self.limit.shape}: expected ({self.vehicle.commands},), one "
                f"number per command of the vehicle."
            )

    def init(self) -> PdFeedforwardState:
        """Return the state of a vehicle at rest."""
        return PdFeedforwardState(-1, np.zeros(3), 0.0, np.zeros(self.vehicle.commands))

    def step(
        self, state: PdFeedforwardState, reference: Reference, estimate: Estimate
    ) -> tuple[PdFeedforwardState, Command]:
        """Return the command (n,) with which the model keeps to the reference."""
        eta_r, nu_r, eta, nu = reference.eta, reference.nu, estimate.eta, estimate.nu
        dt_s = np.where(state.t_ns >= 0, seconds(estimate.t_ns, state.t_ns), 1.0 / self.rate_hz)
        nu_f_dot = np.clip((nu_r - state.nu) / SMOOTHING_S, -FASTEST, FASTEST)
        nu_f = state.nu + nu_f_dot * np.minimum(dt_s, SMOOTHING_S)  # (4)
        way = 0.25 * self.late_s * (nu + 2.0 * nu_f + nu_r)
        eta_p = eta + map_from_body(eta[2] + 0.5 * way[2]) @ way  # (1)
        e = pose_error(eta_r, eta_p)
        e_chi = wrap(eta_r[2] + slip(nu_r) - eta_p[2] - slip(nu))  # (2)
        e_x, most = np.clip(e[0], -REACH_M, REACH_M), SHARE * np.abs(nu_f[0])
        v_i = np.clip(state.v_i + self.k_i * e_x * dt_s, -most, most)
        v_w = nu_f[0] + self.k_x * e_x + v_i
        ahead = nu_f[0] / np.hypot(nu_f[0], SLOW_M_S)  # ±1 forward and backward, 0 at rest
        omega_w = nu_f[2] + self.k_chi * (e_chi + ahead * np.arctan(e[1] / self.join_m))  # (3)
        effort = self._effort(state.effort, np.array([v_w, nu[1], omega_w]), nu_f_dot[::2])
        drivetrain = self.vehicle.drivetrain
        u = drivetrain.turn_first(np.clip(drivetrain.inverse(effort), -self.limit, self.limit))
        return PdFeedforwardState(estimate.t_ns, nu_f, v_i, effort), Command(estimate.t_ns, u)

    @property
    def late_s(self) -> float:
        """Return T [s], the time by which the vehicle is behind its reference."""
        drivetrain = self.vehicle.drivetrain
        return drivetrain.delay_s + drivetrain.lag_s + SMOOTHING_S

    def _effort(self, effort: np.ndarray, wanted: np.ndarray, wanted_dot: np.ndarray) -> np.ndarray:
        """Return ε (n,) from which the model at (v_w, ν_y, ω_w) has this acceleration (2,) over one tick.  (5)"""
        dt_s = 1.0 / self.rate_hz

        def after(effort: np.ndarray) -> np.ndarray:
            return self.vehicle.advance(np.zeros(3), wanted, steady(effort), dt_s)[1][::2]

        B = jacobian(after)(effort)
        missing = wanted[::2] + wanted_dot * dt_s - after(effort)
        effort = effort + B.T @ np.linalg.solve(B @ B.T + DAMPING * np.eye(2), missing)
        return np.clip(effort, -self.limit, self.limit)


def slip(nu: np.ndarray) -> Any:
    """Return β [rad], the course of a velocity ν (3,) to the left of the heading.  (2)"""
    return np.arctan(nu[1] * nu[0] / (nu[0] * nu[0] + SLOW_M_S**2))
