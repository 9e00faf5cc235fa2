"""Plan the pulses of a first drive, when only the IMU of the vehicle is known.

`PulsePlanner` sends one pulse after the other, each of PULSE_S and in one direction, as small as possible:

  level ← min(1, level + max(STEP, GROWTH level))        after each pulse of an unfinished direction      (1)

A pulse moved the vehicle if |v| or |Δψ| exceeded MIN_SIGMA standard deviations. A pulse ends at once if |v| or |ω|
exceeds its limit. A direction is finished after a pulse that ended in this way, after MAX_MOVING_PULSES pulses that
moved the vehicle, or at full command. The next pulse uses the unfinished direction with the lowest level, so that
opposite directions alternate around one spot. A direction that leads back to the spot has priority. A direction that
leads away waits until all directions with an unknown effect are tried. Levels are parts of [command] limit. There are
two directions per channel; for a car, the throttle with the wheels straight, left and right. `PulseGuide` and
`PulseController` advance the same `PulsePlanner` with the estimates of `Inertial`, so both stop together.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.signals import Estimate, seconds

PULSE_S, PAUSE_S, FIRST_S = 0.25, 0.8, 2.0
STEP, GROWTH = 0.04, 0.12  # growth of a level, as in (1)
MIN_SIGMA = 6.0  # standard deviations
MAX_MOVING_PULSES = 10  # pulses in one direction that moved the vehicle
RETURN_DISTANCE_M = 0.05  # distance from the spot above which the path back has priority


class PulseState(NamedTuple):
    """The state of `PulsePlanner`, for D directions."""

    start_ns: int  # -1 before the first tick
    phase_start_ns: int  # beginning of the pulse or the pause
    active: int  # the direction of the pulse; -1 in a pause
    previous: int  # the direction of the last pulse; -1 before the first
    level: np.ndarray  # (D,) level of the next pulse
    moved_count: np.ndarray  # (D,) number of pulses that moved the vehicle
    displacement: np.ndarray  # (D, 2) last displacement [m] by each direction, along and across the heading
    is_done: np.ndarray  # (D,) bool
    start_pose: np.ndarray  # (3,) pose at the beginning of the pulse
    significance: float  # largest v or Δψ of this pulse in standard deviations
    is_limited: bool  # the pulse reached a limit


@dataclass(frozen=True, slots=True, eq=False)
class PulsePlanner:
    """A planner of growing pulses in D directions.  (1)"""

    directions: np.ndarray  # (D, n) commands at full level
    speed_m_s: float = 0.2
    turn_rad_s: float = 2.5
    max_duration_s: float = 120.0
    max_distance_m: float = 0.3  # the drive ends if the estimated distance exceeds this by more than one std

    def init(self) -> PulseState:
        """Return the state before the first tick."""
        d = len(self.directions)
        initial_values = np.full(d, STEP), np.zeros(d), np.zeros((d, 2)), np.zeros(d, bool), np.zeros(3)
        return PulseState(-1, -1, -1, -1, *initial_values, 0.0, False)

    def advance(self, state: PulseState, estimate: Estimate) -> tuple[PulseState, np.ndarray, bool]:
        """Return the new state, the command (n,) of this tick, and True once the pulses are over."""
        t_ns, none = estimate.t_ns, np.zeros(self.directions.shape[1])
        if state.start_ns < 0:
            state = state._replace(start_ns=t_ns, phase_start_ns=t_ns)
        state = self._observe(state, estimate)
        span = seconds(t_ns, state.phase_start_ns)
        if state.active >= 0 and (span >= PULSE_S or state.is_limited):
            state = state._replace(active=-1, previous=state.active, phase_start_ns=t_ns)
        elif state.active < 0 and span >= (FIRST_S if state.previous < 0 else PAUSE_S):
            state = self._begin_pulse(self._evaluate(state, estimate), estimate)
        is_over = bool(state.is_done.all()) or seconds(t_ns, state.start_ns) >= self.max_duration_s
        is_outside = np.hypot(*estimate.eta[:2]) > self.max_distance_m + np.sqrt(estimate.cov[0, 0])
        is_over = bool(is_over or is_outside) and state.active < 0
        u = none if state.active < 0 or is_over else state.level[state.active] * self.directions[state.active]
        return state, u, is_over

    def _observe(self, state: PulseState, estimate: Estimate) -> PulseState:
        """Return the state with `significance` and `is_limited` updated by an estimate, from the first pulse on."""
        v, omega = abs(estimate.nu[0]), abs(estimate.nu[2])
        std_v, std_psi, std_omega = np.sqrt(np.diagonal(estimate.cov)[[3, 2, 5]])
        turn = abs(estimate.eta[2] - state.start_pose[2])
        significance = max(v / max(std_v, 1e-9), turn / max(std_psi, 1e-9)) if std_v > 0.0 else 0.0
        cut = v > max(self.speed_m_s, MIN_SIGMA * std_v) or omega > self.turn_rad_s + MIN_SIGMA * std_omega
        if state.active < 0 and state.previous < 0:
            return state
        return state._replace(
            significance=max(state.significance, float(significance)),
            is_limited=state.is_limited or bool(cut),
        )

    def _evaluate(self, state: PulseState, estimate: Estimate) -> PulseState:
        """Return the state updated by the result of the last pulse."""
        k = state.previous
        if k < 0:
            return state
        level, count, displacement_m, is_done = (
            x.copy() for x in (state.level, state.moved_count, state.displacement, state.is_done)
        )
        shift = estimate.eta[:2] - state.start_pose[:2]
        c, s = np.cos(state.start_pose[2]), np.sin(state.start_pose[2])
        if state.significance > MIN_SIGMA:
            count[k] += 1.0
            displacement_m[k] = c * shift[0] + s * shift[1], -s * shift[0] + c * shift[1]
        is_done[k] |= state.is_limited or count[k] >= MAX_MOVING_PULSES or level[k] >= 1.0
        if not is_done[k]:
            level[k] = min(1.0, level[k] + max(STEP, GROWTH * level[k]))
        return state._replace(level=level, moved_count=count, displacement=displacement_m, is_done=is_done)

    def _begin_pulse(self, state: PulseState, estimate: Estimate) -> PulseState:
        """Return the state with the next pulse begun, unless all directions are finished."""
        psi = estimate.eta[2]
        position = np.array([np.cos(psi) * estimate.eta[0] + np.sin(psi) * estimate.eta[1],
                         np.cos(psi) * estimate.eta[1] - np.sin(psi) * estimate.eta[0]])  # fmt: skip
        if state.is_done.all():
            return state
        order = np.where(state.is_done, np.inf, state.level)
        closer = np.hypot(*position) - np.hypot(*(position + state.displacement).T)
        if np.hypot(*position) > RETURN_DISTANCE_M and np.max(closer) > 0.2 * np.hypot(*position):
            order = -closer
        elif np.hypot(*position) > RETURN_DISTANCE_M and not state.is_done[closer >= 0.0].all():
            order = np.where(closer < 0.0, np.inf, order)
        k = int(np.argmin(order))
        start_pose = estimate.eta.copy()
        return state._replace(
            active=k, phase_start_ns=estimate.t_ns, start_pose=start_pose, significance=0.0, is_limited=False
        )
