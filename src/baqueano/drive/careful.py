"""The blocks of a first drive: nothing is known of the vehicle but that it has an IMU.

`Feel` dead-reckons on the IMU alone. While the command has been zero for CALM_S the vehicle is taken to stand:
that gives the biases b and the noise σ of the channels, and the speed is zero. From then on

    v ← v + (a_x − b_x) δ,   ψ ← ψ + (ω − b_ω) δ,   s ← s + v δ along ψ                                   (1)
    var v = σ_x² δ² k + σ_x² (k δ)² / n_rest        after k ticks, n_rest at rest; var ψ alike            (2)

A speed that is left when the vehicle stands is noise that was summed up, and has taken s along:

    s ← s − ½ v k δ,   var s = σ_x² δ⁴ (k³/3 + k⁴/(4 n_rest) + Σ k³/12 of all ways that are over)         (3)

`Careful` gives one pulse after the other, each of PULSE_S and in one direction, as small as may be:

    level ← level + max(STEP, GROWTH level)          as long as neither |v| nor |Δψ| exceeds SEEN sd      (4)

A pulse ends at once where |v| or |ω| passes its limit. A direction is done after such a pulse, after
ENOUGH pulses that moved the vehicle, or at full command. Of the directions that are left the one at the lowest
level is next, so that forward and backward, left and right take turns around one spot; one that leads back to
the spot goes before, and one that leads away waits for those of which nobody knows yet. Levels are parts of
[command] limit; directions are those of the channels, of a car the throttle with the wheel straight, left and right.

Guide and controller step the same `Careful` on the same estimates, so both know when it is done.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.signals import Command, Estimate, Reference, Tick, seconds

CALM_S = 0.6  # without command, after which a small vehicle stands
PULSE_S, PAUSE_S, FIRST_S = 0.25, 0.8, 2.0
STEP, GROWTH = 0.04, 0.12  # of a level
SEEN = 6.0  # standard deviations
ENOUGH = 10  # pulses in one direction that moved the vehicle
BACK_M = 0.05  # from the spot, above which the way back goes before


class Felt(NamedTuple):
    """What `Feel` remembers."""

    t_ns: int  # -1 before the first tick
    since_ns: int  # when the last command ended
    rest: float  # samples at rest
    mean: np.ndarray  # (3,) of them
    spread: np.ndarray  # (3,) sum of their squared deviations
    eta: np.ndarray  # (3,)
    v: float
    omega: float
    moving: float  # ticks since the vehicle stood
    roamed: float  # Σ k³/12 of (3)


@dataclass(frozen=True, slots=True, eq=False)
class Feel:
    """An estimator that knows no model: (1) to (3). ν is (v, 0, ω), their variances stand in the covariance."""

    sensor: str = "imu"

    def init(self) -> Felt:
        """Nothing felt yet."""
        return Felt(-1, -1, 0.0, np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0, 0.0)

    def step(self, state: Felt, tick: Tick) -> tuple[Felt, Estimate]:
        """Pose since the start, velocity, and how sure both are since the vehicle stood last."""
        s = state
        dt_s = 0.0 if s.t_ns < 0 else float(seconds(tick.t_ns, s.t_ns))
        since_ns = tick.t_ns if s.since_ns < 0 or np.any(tick.u != 0.0) else s.since_ns
        slot = getattr(tick.sensors, self.sensor)
        calm = (
            seconds(tick.t_ns, since_ns) >= CALM_S
            or s.rest == 0.0
            or (s.moving == 0.0 and not np.any(tick.u))
        )
        rest, mean, spread, v, omega = s.rest, s.mean, s.spread, s.v, s.omega
        z = np.asarray(slot.z, dtype=float)
        if slot.has > 0.5 and calm:
            rest, off = rest + 1.0, z - mean
            mean = mean + off / rest
            spread = spread + off * (z - mean)
        if slot.has > 0.5:
            omega = float(z[2] - mean[2])
        v = 0.0 if calm else v + float(z[0] - mean[0]) * dt_s * float(slot.has > 0.5)
        turn = 0.0 if calm else omega * dt_s
        psi = s.eta[2] + turn
        ahead = -0.5 * s.v * s.moving * dt_s if calm else v * dt_s
        eta = np.array([s.eta[0] + ahead * np.cos(psi), s.eta[1] + ahead * np.sin(psi), psi])
        moving, roamed = (0.0, s.roamed + s.moving**3 / 12.0) if calm else (s.moving + 1.0, s.roamed)
        state = Felt(tick.t_ns, since_ns, rest, mean, spread, eta, v, omega, moving, roamed)
        return state, Estimate(tick.t_ns, eta, np.array([v, 0.0, omega]), _cov(state, dt_s))


class Pulses(NamedTuple):
    """What `Careful` remembers. D directions."""

    begun_ns: int  # -1 before the first tick
    since_ns: int  # of the pulse or the pause
    now: int  # the direction of the pulse; -1 in a pause
    last: int  # the direction of the last pulse; -1 before the first
    level: np.ndarray  # (D,) of the next pulse
    moved: np.ndarray  # (D,) pulses that moved the vehicle
    gone: np.ndarray  # (D, 2) where each last took it, along and across its heading
    done: np.ndarray  # (D,) bool
    at: np.ndarray  # (3,) pose at the begin of the pulse
    seen: float  # the most that v and Δψ of this pulse were in standard deviations
    cut: bool  # it reached a limit


@dataclass(frozen=True, slots=True, eq=False)
class Careful:
    """Growing pulses.  (4)"""

    directions: np.ndarray  # (D, n) commands at full level
    speed_m_s: float = 0.2
    turn_rad_s: float = 2.5
    longest_s: float = 120.0
    far_m: float = 0.3  # from the spot, felt, beyond the error of that: then it is over

    def init(self) -> Pulses:
        """Standing."""
        d = len(self.directions)
        start = np.full(d, STEP), np.zeros(d), np.zeros((d, 2)), np.zeros(d, bool), np.zeros(3)
        return Pulses(-1, -1, -1, -1, *start, 0.0, False)

    def advance(self, state: Pulses, estimate: Estimate) -> tuple[Pulses, np.ndarray, bool]:
        """The command (n,) of this tick, and whether that was all."""
        t_ns, none = estimate.t_ns, np.zeros(self.directions.shape[1])
        if state.begun_ns < 0:
            state = state._replace(begun_ns=t_ns, since_ns=t_ns)
        state = self._watched(state, estimate)
        span = seconds(t_ns, state.since_ns)
        if state.now >= 0 and (span >= PULSE_S or state.cut):
            state = state._replace(now=-1, last=state.now, since_ns=t_ns)
        elif state.now < 0 and span >= (FIRST_S if state.last < 0 else PAUSE_S):
            state = self._next(self._judged(state, estimate), estimate)
        over = bool(state.done.all()) or seconds(t_ns, state.begun_ns) >= self.longest_s
        far = np.hypot(*estimate.eta[:2]) > self.far_m + np.sqrt(estimate.cov[0, 0])
        over = bool(over or far) and state.now < 0
        u = none if state.now < 0 or over else state.level[state.now] * self.directions[state.now]
        return state, u, over

    def _watched(self, state: Pulses, estimate: Estimate) -> Pulses:
        """How far the pulse is felt, and whether it is enough."""
        v, omega = abs(estimate.nu[0]), abs(estimate.nu[2])
        sd_v, sd_psi, sd_omega = np.sqrt(np.diagonal(estimate.cov)[[3, 2, 5]])
        turned = abs(estimate.eta[2] - state.at[2])
        seen = max(v / max(sd_v, 1e-9), turned / max(sd_psi, 1e-9)) if sd_v > 0.0 else 0.0
        cut = v > max(self.speed_m_s, SEEN * sd_v) or omega > self.turn_rad_s + SEEN * sd_omega
        if state.now < 0 and state.last < 0:
            return state
        return state._replace(seen=max(state.seen, float(seen)), cut=state.cut or bool(cut))

    def _judged(self, state: Pulses, estimate: Estimate) -> Pulses:
        """The last pulse, taken into account."""
        k = state.last
        if k < 0:
            return state
        level, moved, gone, done = (x.copy() for x in (state.level, state.moved, state.gone, state.done))
        shift = estimate.eta[:2] - state.at[:2]
        c, s = np.cos(state.at[2]), np.sin(state.at[2])
        if state.seen > SEEN:
            moved[k] += 1.0
            gone[k] = c * shift[0] + s * shift[1], -s * shift[0] + c * shift[1]
        done[k] |= state.cut or moved[k] >= ENOUGH or level[k] >= 1.0
        if not done[k]:
            level[k] = min(1.0, level[k] + max(STEP, GROWTH * level[k]))
        return state._replace(level=level, moved=moved, gone=gone, done=done)

    def _next(self, state: Pulses, estimate: Estimate) -> Pulses:
        """The next pulse begins, if there is one."""
        psi = estimate.eta[2]
        here = np.array([np.cos(psi) * estimate.eta[0] + np.sin(psi) * estimate.eta[1],
                         np.cos(psi) * estimate.eta[1] - np.sin(psi) * estimate.eta[0]])  # fmt: skip
        if state.done.all():
            return state
        order = np.where(state.done, np.inf, state.level)
        closer = np.hypot(*here) - np.hypot(*(here + state.gone).T)
        if np.hypot(*here) > BACK_M and np.max(closer) > 0.2 * np.hypot(*here):
            order = -closer
        elif np.hypot(*here) > BACK_M and not state.done[closer >= 0.0].all():
            order = np.where(closer < 0.0, np.inf, order)
        k = int(np.argmin(order))
        at = estimate.eta.copy()
        return state._replace(now=k, since_ns=estimate.t_ns, at=at, seen=0.0, cut=False)


@dataclass(frozen=True, slots=True, eq=False)
class CarefulGuide:
    """Says when the pulses are over; asks for nothing else."""

    pulses: Careful

    def init(self) -> Pulses:
        """Standing."""
        return self.pulses.init()

    def step(self, state: Pulses, estimate: Estimate) -> tuple[Pulses, Reference]:
        """Here, at rest."""
        state, _, over = self.pulses.advance(state, estimate)
        return state, Reference(estimate.t_ns, estimate.eta, np.zeros(3), float(over))


@dataclass(frozen=True, slots=True, eq=False)
class CarefulController:
    """Plays the pulses."""

    pulses: Careful

    def init(self) -> Pulses:
        """Standing."""
        return self.pulses.init()

    def step(self, state: Pulses, reference: Reference, estimate: Estimate) -> tuple[Pulses, Command]:
        """The command (n,) of this tick."""
        state, u, _ = self.pulses.advance(state, estimate)
        return state, Command(estimate.t_ns, u)


def _cov(s: Felt, dt_s: float) -> Any:
    """(6, 6): the variances of (2) and (3), of x, y, ψ, v and ω; zero where nothing is known."""
    cov = np.zeros((6, 6))
    if s.rest > 2.0:
        var = s.spread / (s.rest - 1.0)
        grown = dt_s * dt_s * (s.moving + s.moving * s.moving / s.rest)
        cov[2, 2], cov[3, 3], cov[5, 5] = var[2] * grown, var[0] * grown, var[2]
        way = s.roamed + s.moving**3 / 3.0 + s.moving**4 / (4.0 * s.rest)
        cov[0, 0] = cov[1, 1] = var[0] * dt_s**4 * way
    return cov
