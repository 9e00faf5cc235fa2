"""Hold the heading with the gyro while a person requests a speed but does not request a turn.

    e = ψ_r − ψ:   u_ψ = s (K_ψ e + K_i ∫e dt − K_r r),   |u_ψ| ≤ bound                                   (1)
    τ ṙ = k u_ψ − r, with a total delay T                                   the model                     (2)
    K_r = (τp + 2ωτ − 1)/k,  K_ψ = (ω²τ + 2ω τp)/k,  K_i = ω² τp/k                                        (3)
                                 two poles at ω = 1/(BANDWIDTH_MARGIN T), one at p = max(ω, 1/τ − 2ω)

ψ, r: heading and yaw rate; u_ψ: turning command. With this p no gain is negative, and (1) tolerates a k up to 3.3 times
as large, and any smaller k. The integral removes the effect of unequal wheels. A car turns in proportion to its speed
v, so s = v₀ v / (v² + (v₀/4)²); else s is 1. `heading_gains` finds k, τ and T for a vehicle file. ψ_r is the heading at
the first tick with |r| < MAX_QUIET_RAD_S after the turn, at the latest SETTLING_CONSTANTS (τ + T) after its end. Before
that tick, only −K_r r acts.

If an estimator has rejected the IMU for more than MIN_REJECTED_S, r and ψ follow the gyro: its innovation is added.
"""

from dataclasses import dataclass
from math import copysign, inf, isfinite, isnan, nan
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.geometry import wrap
from baqueano.signals import Command, Estimate, Reference, seconds

BANDWIDTH_MARGIN = 6.0
MAX_TURN_SHARE = 0.25  # largest correction, as a share of the limit of u_ψ
MAX_SPEED_SHARE = 0.5  # share of the speed command: no wheel stops or turns backward for the correction
MAX_QUIET_RAD_S = 0.05
SETTLING_CONSTANTS = 3.0
MIN_REJECTED_S = 0.05  # longer than any spike


class Gains(NamedTuple):
    """The gains of (3), in units of u_ψ."""

    psi: float
    integral: float
    rate: float
    wait_s: float  # longest time until ψ_r is set
    speed_m_s: float = 0.0  # v₀ of a car, 0 for s = 1


class Gyro(NamedTuple):
    """Position of the gyro in the innovations of an estimator, and the gate of the IMU."""

    rows: slice  # of the IMU in the innovation; the gyro is the last entry
    scale: float
    gate: float  # squared distance beyond which the estimator rejects the IMU


class HeadingHoldState(NamedTuple):
    """State of a heading hold between two ticks."""

    controller: Tree
    t_ns: int  # of the last tick, -1 before the first
    rejected_s: float  # duration for which the IMU has been rejected
    forward_sign: float = 0.0  # sign of the requested speed, 0 without a reference heading
    straight_start_ns: int = 0  # time of the first request of this speed without a turn
    psi: float = nan  # ψ_r [rad], NaN until it is set
    integral: float = 0.0  # ∫e dt [rad s]
    missing_angle: float = 0.0  # integral of the rejected innovations [rad]


@dataclass(frozen=True, slots=True, eq=False)
class HeadingHold:
    """Controller that holds the heading with the gyro while another controller requests a speed, but no turn.

    Parameters
    ----------
    controller : Controller
        Controller whose commands are corrected.
    gains : Gains
        Gains of (1), from (3): `drive.manual.heading_gains` finds them for a vehicle file.
    limit : float [unit of u]
        Largest u_ψ; the correction is at most a quarter of it.
    speed_scale : float
        Bound of the correction, as a ratio to |u_x| [no unit].
    gyro : Gyro, optional
        Position of the gyro in the innovations, for an estimator that can reject the gyro.

    Notes
    -----
    Equations (1)-(3) of the module: a PI-D loop around the heading with placed poles.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> from baqueano.controllers.manual import ManualController
    >>> gains = pole_placement_gains(k=8.0, tau_s=0.2, delay_s=0.03)
    >>> hold = HeadingHold(ManualController(lambda: [0.3, 0.0, 0.0]), gains, limit=1.0)
    >>> state, command = hold.step(hold.init(), None, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> print(command.u)
    [0.3 0.  0. ]
    """

    is_interpreted: ClassVar[bool] = True

    controller: Tree
    gains: Gains
    limit: float
    speed_scale: float = inf
    gyro: Gyro | None = None

    def init(self) -> HeadingHoldState:
        """Return the state before the first tick, without a reference heading."""
        return HeadingHoldState(self.controller.init(), -1, 0.0)

    def step(
        self, state: HeadingHoldState, reference: Reference, estimate: Estimate
    ) -> tuple[HeadingHoldState, Command]:
        """Return the state and the command (n,) of `controller`, with a turning command that keeps the heading."""
        controller, command = self.controller.step(state.controller, reference, estimate)
        u, t_ns = command.u, estimate.t_ns
        dt_s = seconds(t_ns, state.t_ns) if state.t_ns >= 0 else 0.0
        missing_rate = self._missing_yaw_rate(estimate)
        rejected_s = state.rejected_s + dt_s if missing_rate else 0.0
        missing_rate = missing_rate if rejected_s > MIN_REJECTED_S else 0.0
        v, r = float(estimate.nu[0]), float(estimate.nu[2]) + missing_rate
        forward_sign = copysign(1.0, u[0]) if u[0] and not u[-1] else 0.0
        if not forward_sign or not isfinite(v + r + float(estimate.eta[2])):
            return HeadingHoldState(controller, t_ns, rejected_s), command
        if forward_sign != state.forward_sign:
            state = HeadingHoldState(controller, t_ns, rejected_s, forward_sign, t_ns)
        missing_angle = state.missing_angle + missing_rate * dt_s
        psi, psi_r = float(estimate.eta[2]) + missing_angle, state.psi
        is_quiet = abs(r) < MAX_QUIET_RAD_S or seconds(t_ns, state.straight_start_ns) >= self.gains.wait_s
        psi_r = psi if isnan(psi_r) and is_quiet else psi_r
        e = 0.0 if isnan(psi_r) else float(wrap(psi_r - psi))
        u = u.copy()
        u[-1], sum_e = self._turn(e, state.integral, r, dt_s, v, abs(float(u[0])))
        next_state = HeadingHoldState(
            controller, t_ns, rejected_s, forward_sign, state.straight_start_ns, psi_r, sum_e, missing_angle
        )
        return next_state, command._replace(u=u)

    def _turn(
        self, e: float, sum_e: float, r: float, dt_s: float, v: float, speed: float
    ) -> tuple[float, float]:
        """Return u_ψ and ∫e dt [rad s]; the integral does not grow while u_ψ is at its bound.  (1)"""
        K, bound = self.gains, min(MAX_TURN_SHARE * self.limit, self.speed_scale * speed)
        s = K.speed_m_s * v / (v * v + (0.25 * K.speed_m_s) ** 2) if K.speed_m_s else 1.0
        integral = sum_e + e * dt_s
        turn = s * (K.psi * e + K.integral * integral - K.rate * r)
        if abs(turn) > bound and turn * s * e > 0.0:
            integral = sum_e
        return min(max(turn, -bound), bound), integral

    def _missing_yaw_rate(self, estimate: Estimate) -> float:
        """Return the gyro's yaw rate minus the estimate [rad/s] if the estimator rejected the IMU; else 0."""
        y, S = estimate.innovation, estimate.innovation_cov
        if self.gyro is None or y is None or S is None:
            return 0.0
        y, S = y[self.gyro.rows], S[self.gyro.rows, self.gyro.rows]
        is_rejected = isfinite(sum(y.tolist())) and y @ np.linalg.solve(S, y) > self.gyro.gate
        return float(y[-1]) / self.gyro.scale if is_rejected else 0.0


def pole_placement_gains(k: float, tau_s: float, delay_s: float) -> Gains:
    """Return the gains of (3) for the model (2) with gain `k`, time constant `tau_s` and total delay `delay_s`."""
    omega = 1.0 / (BANDWIDTH_MARGIN * delay_s)
    tp = max(omega * tau_s, 1.0 - 2.0 * omega * tau_s)
    return Gains(
        (omega**2 * tau_s + 2.0 * omega * tp) / k, omega**2 * tp / k, (tp + 2.0 * omega * tau_s - 1.0) / k,
        SETTLING_CONSTANTS * (tau_s + delay_s),
    )  # fmt: skip
