"""Repeat a route by the progress of the vehicle along it: the reference waits, moves back, or catches up.

    s*(η) = s_k + (p − p_k) · t_k,   k: the point nearest to the vehicle, |s_k − s(τ)| ≤ reach_m          (1)
    d = s(τ) − s*(η)                                          distance of the vehicle behind              (2)
    τ̇ = 1                                                     while |d| ≤ slack
      = max(1 − (d − slack) / wait_m, slowest)                behind: slower, stop, move back
      = min(1 − (d + slack) / wait_m, fastest)                in front: faster                            (3)
    η_r = route(τ),   ν_r = max(τ̇, min(e / wait_m, 1)) ν(τ)                                               (4)
    τ̇ ≤ σ̇ at the start,   τ̇ ≤ √(2 (laps T − τ) / D) at the end           of (2) and (3) of repeat.py     (5)
    done when τ ≥ laps T and the vehicle is there: at rest, d ≤ slack_m, in motion d ≤ 0; or END_WAIT_S later   (6)

τ: time of the teacher; s: distance; T: duration of a lap; p: position of the pose η; t_k: direction at k. τ is
continuous, and (1) searches only near τ and between two changes of direction: no crossing or cusp is a short cut.
slack = slack_m + slack_s |v|. e is the cross-track distance at k, where ν_r > 0, because most laws cannot steer at
rest. A closed route that ends in motion continues until (6). Source: the virtual target of Aicardi et al., 1995.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.geometry import wrap
from baqueano.guides.repeat import REST_M_S, TINY, Repeat, RepeatState
from baqueano.guides.route_points import HEADING_WEIGHT_M, MAX_SPACING_M, distances_m, route_points
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds

MIN_PACE = 0.05  # of (5), so that the reference reaches the end
END_WAIT_S = 3.0  # of (6): the vehicle is at most wait_m + slack behind


class ProgressState(NamedTuple):
    """Progress of the reference along the route."""

    t_ns: int  # -1 before the first tick
    tau_s: float  # time of the teacher, over all laps
    entry: RepeatState  # when, where and at which pace the vehicle joined the route


@document
@dataclass(frozen=True, slots=True, eq=False)
class RepeatByProgress(Repeat):
    """Guide along a route that waits for its vehicle, for `laps` laps; 0 laps repeat without end.

    Notes
    -----
    Equations (1)-(6) of the module; the virtual target of Aicardi et al., IEEE Robotics and Automation Magazine, 1995.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> from baqueano.guides.shapes import circle
    >>> guide = RepeatByProgress.along(circle(0.5, 0.2))
    >>> _, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> print(reference.eta)
    [0. 0. 0.]
    """

    slack_m: float = parameter(
        "m", "along-track distance that the vehicle may lag or lead", low=0.0, default=0.03
    )
    slack_s: float = parameter("s", "time by which it may be delayed", low=0.0, high=10.0, default=0.3)
    wait_m: float = parameter(
        "m", "distance beyond the slack at which the route stops", low=0.01, default=0.1
    )
    reach_m: float = parameter("m", "length of route in which the vehicle is searched", low=0.05, default=0.5)
    slowest: float = parameter(
        "1",
        "smallest pace τ̇; below 0 the route goes back, above 0 its duration is bounded",
        low=-1.0,
        high=1.0,
        default=-1.0,
    )
    fastest: float = parameter("1", "largest pace τ̇, to catch up", low=1.0, high=10.0, default=1.5)

    def init(self) -> Tree:
        """Return the state before the first tick."""
        return ProgressState(-1, 0.0, Repeat.init(self))

    def entry_state(self, t_ns: Value, tau_s: Value, speed_m_s: Value) -> Tree:
        """Return the state of a vehicle that joins the route with this speed, at the time `tau_s` of the route."""
        return ProgressState(t_ns, tau_s, Repeat.entry_state(self, t_ns, tau_s, speed_m_s))

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference at the teacher's time τ.  (4)"""
        entry = self._entry_state(state.entry, estimate)
        pace, lateral_m, behind_m = self._pace(self._phase(state.tau_s), estimate)
        largest_pace = np.minimum(
            self._starting_pace(entry, estimate.t_ns), self._braking_pace(self.end_s - state.tau_s)
        )
        clock_pace = np.minimum(pace, largest_pace)
        if not self._has_next_lap:  # the reference rests at the end, and τ counts the time
            clock_pace = np.where(state.tau_s >= self.end_s, 1.0, clock_pace)
        dt_s = np.where(state.t_ns >= 0, seconds(estimate.t_ns, state.t_ns), 0.0)
        tau_s = np.clip(state.tau_s + clock_pace * dt_s, 0.0, self.end_s + END_WAIT_S)
        is_over = self._is_over(state.tau_s, tau_s, behind_m, estimate)
        forward_pace = np.minimum(np.maximum(pace, np.minimum(lateral_m / self.wait_m, 1.0)), largest_pace)
        forward_pace = np.where(is_over > 0.0, 0.0, forward_pace)
        phase = self._phase(tau_s)
        x, y, psi = (np.interp(phase, self.t_s, column) for column in self.eta.T)
        nu = np.array([np.interp(phase, self.t_s, column) for column in self.nu.T])
        reference = Reference(estimate.t_ns, np.array([x, y, wrap(psi)]), forward_pace * nu, is_over)
        return ProgressState(estimate.t_ns, tau_s, entry), reference

    @property
    def _has_next_lap(self) -> bool:
        """Return True if the reference continues on the next lap until the vehicle is at the end.  (6)"""
        return self.closed and self.ends_in_motion

    def _phase(self, tau_s: Value) -> Value:
        """Return the time [s] of the lap; the end of the route after the last lap, unless the reference continues."""
        period = self.t_s[-1]
        phase = tau_s - period * np.floor(tau_s / period)
        return phase if self._has_next_lap else np.where(tau_s >= self.end_s, period, phase)

    def _is_over(self, former_tau_s: Value, tau_s: Value, behind_m: Value, estimate: Estimate) -> Value:
        """Return 1 if the drive is done, else 0; the vehicle is `behind_m` behind the former reference.  (6)"""
        is_at_rest, slack_m = 1.0, self.slack_m
        if self._has_next_lap:  # and the vehicle passes the end
            behind_m, slack_m = behind_m - self._route_distance(former_tau_s - self.end_s), 0.0
        elif not self.ends_in_motion:
            is_at_rest = np.where(np.abs(estimate.nu[0]) < REST_M_S, 1.0, 0.0)
        has_arrived = np.where(behind_m <= slack_m, is_at_rest, 0.0)
        has_arrived = np.where(tau_s >= self.end_s + END_WAIT_S, 1.0, has_arrived)
        return np.where(tau_s >= self.end_s, has_arrived, 0.0)

    def _route_distance(self, t: Value) -> Value:
        """Return the length [m] of the route in its first `t` seconds; 0 before its start."""
        return np.interp(t, self.t_s, distances_m(self.eta))

    def _starting_pace(self, entry: RepeatState, t_ns: Value) -> Value:
        """Return the largest pace τ̇ at the time `t_ns`, while the vehicle starts.  (5)"""
        pace = self._start(entry, t_ns)[1]
        return np.where(pace < 1.0, pace, self.fastest)

    def _braking_pace(self, left_s: Value) -> Value:
        """Return the largest pace τ̇ if `left_s` [s] of the teacher's time are left.  (5)"""
        if self.ends_in_motion:
            return self.fastest
        rest = np.maximum(left_s, 0.0) / np.maximum(self.braking_s, TINY)
        return np.where(rest < 0.5, np.maximum(np.sqrt(2.0 * rest + 1e-12), MIN_PACE), self.fastest)

    def _pace(self, phase: Value, estimate: Estimate) -> tuple[Value, Value, Value]:
        """Return τ̇ at the time `phase` [s] of a lap, and the distances e and d [m] of the vehicle.  (1)-(3)"""
        points = route_points(self.t_s, self.eta, self.nu).near(phase, self.reach_m, self.closed)
        (x, y, psi), lag_m = points.nearest(estimate.eta)
        speed_m_s = np.interp(phase, self.t_s, self.nu[:, 0])
        dx, dy = estimate.eta[0] - x, estimate.eta[1] - y
        turn_m = HEADING_WEIGHT_M * wrap(psi - estimate.eta[2])
        ahead_m = np.sign(speed_m_s) * (np.cos(psi) * dx + np.sin(psi) * dy)
        ahead_m = np.clip(ahead_m, -0.5 * MAX_SPACING_M, 0.5 * MAX_SPACING_M)
        lateral_m = np.sqrt(np.maximum(dx**2 + dy**2 + turn_m**2 - ahead_m**2, 0.0))
        behind_m = lag_m - ahead_m
        tolerance_m = self.slack_m + self.slack_s * np.abs(speed_m_s)
        waiting_pace = 1.0 - np.maximum(behind_m - tolerance_m, 0.0) / self.wait_m
        catching_pace = np.maximum(-behind_m - tolerance_m, 0.0) / self.wait_m
        return np.clip(waiting_pace + catching_pace, self.slowest, self.fastest), lateral_m, behind_m
