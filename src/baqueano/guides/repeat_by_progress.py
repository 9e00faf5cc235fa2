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
slack = slack_m + slack_s |v|. e is the distance beside k, where ν_r > 0, because most laws cannot steer at rest. A
closed route that ends in motion goes on until (6). Source: the virtual target of Aicardi et al., 1995.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.geometry import wrap
from baqueano.guides.repeat import REST_M_S, TINY, Repeat, RepeatState
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds

HEADING_WEIGHT_M = 0.1  # of a radian, in (1) and e
FAR_AWAY = 1e9
MIN_SPEED_M_S = 0.02  # a slower pose belongs to the piece before it
MIN_PACE = 0.05  # of (5), so that the reference reaches the end
END_WAIT_S = 3.0  # of (6): the vehicle is at most wait_m + slack behind
MIN_SPACING_M, MAX_SPACING_M = 0.04, 0.05  # of the points of (1)


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
        end = self.end_s
        entry = self._joined(state.entry, estimate)
        phase = self._phase(state.tau_s)
        dt_s = np.where(state.t_ns >= 0, seconds(estimate.t_ns, state.t_ns), 0.0)
        pace, aside_m, behind_m = self._pace(phase, estimate)
        largest_pace = np.minimum(
            self._starting_pace(entry, estimate.t_ns), self._braking_pace(end - state.tau_s)
        )
        clock_pace = np.minimum(pace, largest_pace)
        if not self._continues:  # the reference rests at the end, and τ counts the time
            clock_pace = np.where(state.tau_s >= end, 1.0, clock_pace)
        tau_s = np.clip(state.tau_s + clock_pace * dt_s, 0.0, end + END_WAIT_S)
        phase = self._phase(tau_s)
        eta = [np.interp(phase, self.t_s, self.eta[:, i]) for i in range(3)]
        nu = np.array([np.interp(phase, self.t_s, self.nu[:, i]) for i in range(3)])
        is_over = self._is_over(state.tau_s, tau_s, behind_m, estimate)
        forward_pace = np.minimum(np.maximum(pace, np.minimum(aside_m / self.wait_m, 1.0)), largest_pace)
        forward_pace = np.where(is_over > 0.0, 0.0, forward_pace)
        pose = np.array([eta[0], eta[1], wrap(eta[2])])
        return ProgressState(estimate.t_ns, tau_s, entry), Reference(
            estimate.t_ns, pose, forward_pace * nu, is_over
        )

    @property
    def _continues(self) -> bool:
        """Return True if the reference continues on the next lap until the vehicle is at the end.  (6)"""
        return self.closed and self.ends_in_motion

    def _phase(self, tau_s: Value) -> Value:
        """Return the time [s] of the lap; the end of the route after the last lap, unless the reference goes on."""
        period = self.t_s[-1]
        phase = tau_s - period * np.floor(tau_s / period)
        return phase if self._continues else np.where(tau_s >= self.end_s, period, phase)

    def _is_over(self, former_tau_s: Value, tau_s: Value, behind_m: Value, estimate: Estimate) -> Value:
        """Return 1 if the drive is done, else 0; the vehicle is `behind_m` behind the former reference.  (6)"""
        is_at_rest, slack_m = 1.0, self.slack_m
        if self._continues:  # and the vehicle passes the end
            behind_m, slack_m = behind_m - self._route_distance(former_tau_s - self.end_s), 0.0
        elif not self.ends_in_motion:
            is_at_rest = np.where(np.abs(estimate.nu[0]) < REST_M_S, 1.0, 0.0)
        is_there = np.where(behind_m <= slack_m, is_at_rest, 0.0)
        is_there = np.where(tau_s >= self.end_s + END_WAIT_S, 1.0, is_there)
        return np.where(tau_s >= self.end_s, is_there, 0.0)

    def _route_distance(self, t: Value) -> Value:
        """Return the length [m] of the route in its first `t` seconds; 0 before its start."""
        steps_m = np.hypot(np.diff(self.eta[:, 0]), np.diff(self.eta[:, 1]))
        return np.interp(t, self.t_s, np.append(0.0, np.cumsum(steps_m)))

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
        t_s, eta, s = self._points()
        pieces = np.interp(t_s, self.t_s, self._pieces())
        piece, has_cusps = np.interp(phase, t_s, pieces), bool(np.any(pieces > 0.0))
        (behind_s, front), distances, is_on_route = self._window(s), s, 1.0
        if behind_s + front + 2 < len(s):
            indices = np.arange(len(s), dtype=float)
            k = np.floor(np.interp(phase, t_s, indices)) + np.arange(-behind_s, front + 2)
            if self.closed:
                k = k - (len(s) - 1) * np.floor(k / (len(s) - 1))  # the last point equals the first one
            is_on_route = np.where((k >= 0.0) & (k <= len(s) - 1.0), 1.0, 0.0)
            eta = np.stack([np.interp(k, indices, column) for column in eta.T], axis=1)
            distances, pieces = np.interp(k, indices, s), np.interp(k, indices, pieces)
        lag_m = np.interp(phase, t_s, s) - distances  # (k,) d, if the vehicle is at each of these points
        if self.closed and s[-1] > 0.0:
            lag_m = lag_m - s[-1] * np.floor(lag_m / s[-1] + 0.5)
        squared_distances = (eta[:, 0] - estimate.eta[0]) ** 2 + (eta[:, 1] - estimate.eta[1]) ** 2
        squared_distances = squared_distances + (HEADING_WEIGHT_M * wrap(eta[:, 2] - estimate.eta[2])) ** 2
        squared_distances = np.where(
            (np.abs(lag_m) <= self.reach_m) & (is_on_route > 0.0), squared_distances, FAR_AWAY
        )
        if has_cusps:
            squared_distances = np.where(np.abs(pieces - piece) < 1.0, squared_distances, FAR_AWAY)
        min_squared_distance = np.min(squared_distances)
        is_nearest = squared_distances <= min_squared_distance
        count = np.sum(np.where(is_nearest, 1.0, 0.0))
        x, y, psi, d = (np.sum(np.where(is_nearest, column, 0.0)) / count for column in (*eta.T, lag_m))
        forward_sign = np.sign(np.interp(phase, self.t_s, self.nu[:, 0]))
        dx, dy = estimate.eta[0] - x, estimate.eta[1] - y
        ahead_m = forward_sign * (np.cos(psi) * dx + np.sin(psi) * dy)
        ahead_m = np.clip(ahead_m, -0.5 * MAX_SPACING_M, 0.5 * MAX_SPACING_M)
        d = d - ahead_m
        tolerance_m = self.slack_m + self.slack_s * np.abs(np.interp(phase, self.t_s, self.nu[:, 0]))
        waiting_pace = 1.0 - np.maximum(d - tolerance_m, 0.0) / self.wait_m
        catching_pace = np.maximum(-d - tolerance_m, 0.0) / self.wait_m
        turn_m = HEADING_WEIGHT_M * wrap(psi - estimate.eta[2])
        aside_m = np.sqrt(np.maximum(dx**2 + dy**2 + turn_m**2 - ahead_m**2, 0.0))
        return np.clip(waiting_pace + catching_pace, self.slowest, self.fastest), aside_m, d

    def _points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the times (m,), the poses (m, 3) and the distances s (m,) of the points of (1).

        They are poses of the route about MIN_SPACING_M apart, and points between poses that are more than MAX_SPACING_M
        apart.
        """
        steps_m = np.hypot(np.diff(self.eta[:, 0]), np.diff(self.eta[:, 1]))
        counts = np.maximum(np.ceil(steps_m / MAX_SPACING_M), 1.0).astype(int)
        first, segment = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
        fraction = (np.arange(len(segment)) - first[segment]) / counts[segment]
        index = np.append(segment + fraction, len(counts))
        t_s, *eta, s = (
            np.interp(index, np.arange(len(self.t_s)), column)
            for column in (self.t_s, *self.eta.T, np.append(0.0, np.cumsum(steps_m)))
        )
        turn_m = HEADING_WEIGHT_M * np.append(0.0, np.cumsum(np.abs(np.diff(eta[2]))))
        cell = np.floor((s + turn_m) / MIN_SPACING_M)
        is_kept = np.append(True, np.diff(cell) > 0.0)
        is_kept[-1] = True
        return t_s[is_kept], np.column_stack(eta)[is_kept], s[is_kept]

    def _pieces(self) -> np.ndarray:
        """Return the number (m,) of the piece of each pose; a piece ends where the route changes its direction."""
        sign = np.where(np.abs(self.nu[:, 0]) < MIN_SPEED_M_S, 0.0, np.sign(self.nu[:, 0]))
        last_moving = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
        return np.append(0.0, np.cumsum(sign[last_moving][1:] * sign[last_moving][:-1] < 0.0))

    def _window(self, s: np.ndarray) -> tuple[int, int]:
        """Return the largest number of points within `reach_m` of a point: behind this point, and in front of it.
        The compiled step searches only these points.
        """
        reach_m = self.reach_m + 1e-9
        wrapped_distances = np.concatenate([s - s[-1], s[1:], s[1:] + s[-1]]) if self.closed else s
        first = np.searchsorted(wrapped_distances, wrapped_distances - reach_m, side="left")
        last = np.searchsorted(wrapped_distances, wrapped_distances + reach_m, side="right")
        indices = np.arange(len(wrapped_distances))
        return int(np.max(indices - first)), int(np.max(last - indices)) - 1
