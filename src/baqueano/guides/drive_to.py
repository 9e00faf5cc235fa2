"""Drive from the vehicle's pose to the nearest of several goals, on the shortest path with a limited curvature.

    path = the shortest of the paths (clothoids.py) from the first estimate to each of the goals η_j      (1)
    v²  ≤   speed²,   v_0² + a max(d, JOIN_LENGTH),   (v_0 + a t)²,   v_j² + 2 a (length − σ)              (2)
    σ̇ = v,   η_r = path(σ),   ν_r = (± v, 0, κ v),   done when σ ≥ length and the vehicle follows          (3)

σ is the distance along the path, a the acceleration, κ the curvature, η_r and ν_r the reference. v_0 and κ_0 are those
of the first estimate, v_j and κ_j those of the route at the goal. d is the distance of the first goal. By its second
limit, (2) accelerates on half of d, and κ changes within a shorter length. κ v is continuous; at rest it is 0. ν_r has
the sign of v_j: a route that is driven backward is reached backward. At a goal at rest, the guide is done when the
vehicle rests, at the latest after SETTLE_S. The guide is done at once if the vehicle is within tolerance_m and
tolerance_rad of the first goal. From up to the radius R beside a route and 30° off, two arcs join it within 2.3 R, and
later if κ changes slowly. So (1) compares goals on JOIN_RADII R and JOIN_RAMPS ramps of the route.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.geometry import wrap
from baqueano.guides.clothoids import NO_PATH, ClothoidPath, pose_at, shortest_path
from baqueano.guides.route import Route
from baqueano.parameter import document, parameter
from baqueano.signals import NANOSECONDS, Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

MAX_GOAL_DISTANCE_M, MAX_GOAL_ANGLE_RAD = 0.01, np.radians(2.0)
MIN_SPEED_M_S = 0.02  # lower bound of σ̇, so that the reference reaches the goal
REST_M_S, REST_RAD_S, SETTLE_S = 0.01, 0.05, 2.0  # a vehicle at a goal is at rest below these speeds
GOAL_SPACING_M = 0.125
JOIN_LENGTH_M = 1.0  # least length of the route, from its start, on which the vehicle can join it
JOIN_RADII, JOIN_RAMPS = 3.0, 2.0  # and in radii and ramps of the path


def join_length_m(radius_m: float, ramp_m: float) -> float:
    """Return the length [m] of a route, from its start, on which a path with this radius and ramp can end."""
    return max(JOIN_LENGTH_M, JOIN_RADII * radius_m + JOIN_RAMPS * ramp_m)


class DriveToState(NamedTuple):
    """Progress along the path to the goal."""

    t_ns: int  # -1 before the first tick
    path: ClothoidPath
    goal: np.ndarray  # (3,): time of the route [s], its speed [m/s], its direction
    sigma_m: float
    v_m_s: float
    limit_m_s: float  # largest v
    goal_ns: int  # time at which the reference reached the goal; -1 before


@document
@dataclass(frozen=True, slots=True, eq=False)
class DriveTo:
    """Guide that drives to the nearest of several goals.

    References
    ----------
    Dubins, American Journal of Mathematics, 1957; Fraichard and Scheuer, IEEE Transactions on Robotics, 2004.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> guide = DriveTo(goals=[[1.0, 0.0, 0.0]])
    >>> _, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> float(reference.at_end)
    0.0
    """

    is_interpreted: ClassVar[bool] = True  # the path is computed once

    goals: np.ndarray = parameter("m, m, rad", "poses in the map, (k, 3)", shape=None)
    tau_s: np.ndarray = parameter("s", "times of the route at the goals, (k,)", default=(0.0,), shape=None)
    v_m_s: np.ndarray = parameter("m/s", "speeds of the route there, (k,)", default=(0.0,), shape=None)
    kappa_1_m: np.ndarray = parameter("1/m", "curvatures there, (k,)", default=(0.0,), shape=None)
    radius_m: float = parameter("m", "smallest radius of a curve", low=0.01, high=1e3, default=0.25)
    ramp_m: float = parameter(
        "m",
        "length on which the curvature changes from 0 to 1/radius, at speed_m_s",
        low=1e-3,
        high=1e3,
        default=0.1,
    )
    speed_m_s: float = parameter("m/s", "speed on the path to there", low=0.01, high=100.0, default=0.2)
    acceleration_m_s2: float = parameter("m/s²", "change of the speed", low=0.01, default=0.3)
    tolerance_m: float = parameter(
        "m", "distance from the first goal that needs no path", low=0.0, default=MAX_GOAL_DISTANCE_M
    )
    tolerance_rad: float = parameter(
        "rad", "angle to the first goal that needs no path", low=0.0, default=MAX_GOAL_ANGLE_RAD
    )

    def __post_init__(self) -> None:
        goals = np.atleast_2d(np.array(self.goals, dtype=float))
        object.__setattr__(self, "goals", goals)
        for name in ("tau_s", "v_m_s", "kappa_1_m"):
            rows = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, np.broadcast_to(rows, (len(goals),)).copy())
        check_bounds(self)

    @classmethod
    def to_route(cls, route: Route, reach_m: float = JOIN_LENGTH_M, **limits: float) -> "DriveTo":
        """Return the guide to a route: the goals are poses at its start, but at most in its first half.

        They are on its first `reach_m`, or on `join_length_m` of the `limits`, if this is longer.
        """
        s = np.append(0.0, np.cumsum(np.hypot(*np.diff(route.eta[:, :2], axis=0).T)))
        length_m = max(reach_m, join_length_m(limits.get("radius_m", 0.0), limits.get("ramp_m", 0.0)))
        distances = np.arange(0.0, min(length_m, 0.5 * s[-1]) + 1e-9, GOAL_SPACING_M)
        next_index = np.searchsorted(s, distances - 1e-12)
        previous_index = np.maximum(next_index - 1, 0)
        index = previous_index + (distances - s[previous_index]) / np.where(
            next_index > previous_index, s[next_index] - s[previous_index], 1.0
        )
        columns = (route.t_s, route.nu[:, 0], route.nu[:, 2], *route.eta.T)
        tau_s, v_m_s, r, *eta = (np.interp(index, np.arange(len(s)), column) for column in columns)
        is_moving = np.abs(v_m_s) > MIN_SPEED_M_S
        kappa = np.where(is_moving, r / np.where(is_moving, v_m_s, 1.0), 0.0)
        return cls(np.column_stack(eta), tau_s, v_m_s, kappa, **limits)

    def init(self) -> DriveToState:
        """Return the state before the first tick."""
        return DriveToState(-1, NO_PATH, np.zeros(3), 0.0, 0.0, 0.0, -1)

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference pose and velocity on the path.  (3)"""
        t_ns = estimate.t_ns
        if state.t_ns < 0:
            limit_m_s = self._limit_m_s(estimate)
            path, goal = self._nearest_goal(estimate, self.ramp_m * limit_m_s / self.speed_m_s)
            v_0 = max(goal[2] * float(estimate.nu[0]), 0.0)
            state = DriveToState(t_ns, path, goal, 0.0, v_0, limit_m_s, -1)
        path, (_, goal_speed, forward_sign) = state.path, state.goal
        rest_m = max(path.length_m - state.sigma_m, 0.0)
        dt_s = seconds(t_ns, state.t_ns)
        dv = self.acceleration_m_s2 * dt_s
        # (2) at the end of the tick, with the mean speed of the tick
        square = goal_speed**2 + 2.0 * self.acceleration_m_s2 * rest_m - dv * state.v_m_s + 0.25 * dv**2
        v = min(state.v_m_s + dv, state.limit_m_s, max(float(np.sqrt(max(square, 0.0))) - 0.5 * dv, 0.0))
        mean_m_s = max(0.5 * (state.v_m_s + v), MIN_SPEED_M_S)
        sigma_m = min(state.sigma_m + mean_m_s * dt_s, path.length_m)
        goal_ns = t_ns if sigma_m >= path.length_m and state.goal_ns < 0 else state.goal_ns
        course, kappa = pose_at(path, sigma_m)
        heading_offset = 0.5 * np.pi * (1.0 - forward_sign)  # angle from the course to the heading
        eta = np.array([course[0], course[1], wrap(course[2] + heading_offset)])
        v_r = v if goal_ns < 0 else 0.0
        nu = np.array([forward_sign * v_r, 0.0, kappa * v_r])
        next_state = state._replace(t_ns=t_ns, sigma_m=sigma_m, v_m_s=v, goal_ns=goal_ns)
        return next_state, Reference(t_ns, eta, nu, float(self._is_done(next_state, estimate)))

    @staticmethod
    def _is_done(state: DriveToState, estimate: Estimate) -> bool:
        """Return True at the goal, if the vehicle continues from there or is at rest.  (3)"""
        if state.goal_ns < 0:
            return False
        u, v, r = np.abs(estimate.nu)
        is_at_rest = max(u, v) < REST_M_S and r < REST_RAD_S
        return bool(
            state.goal[1] > 0.0 or is_at_rest or estimate.t_ns - state.goal_ns >= SETTLE_S * NANOSECONDS
        )

    def _limit_m_s(self, estimate: Estimate) -> float:
        """Return the largest speed [m/s] on the path from this estimate.  (2)"""
        distance_m = float(np.hypot(*(np.array(estimate.eta) - self.goals[0])[:2]))
        gain = self.acceleration_m_s2 * max(distance_m, JOIN_LENGTH_M)
        return min(self.speed_m_s, float(np.sqrt(float(estimate.nu[0]) ** 2 + gain)))

    def _nearest_goal(self, estimate: Estimate, ramp_m: float) -> tuple[ClothoidPath, np.ndarray]:
        """Return the path to the nearest goal, and time, speed and direction of the route at that goal.  (1)"""
        eta, (v, _, r) = np.array(estimate.eta), estimate.nu
        offset, max_curvature = eta - self.goals[0], 1.0 / self.radius_m
        is_at_goal = (
            np.hypot(offset[0], offset[1]) < self.tolerance_m and abs(wrap(offset[2])) < self.tolerance_rad
        )
        kappa_0 = float(np.clip(r / v, -max_curvature, max_curvature)) if abs(v) > MIN_SPEED_M_S else None
        best_path, nearest_index = NO_PATH._replace(eta=np.tile(eta[:, None], 9)), 0
        for sign in (1.0, -1.0):
            index = np.flatnonzero((self.v_m_s >= 0.0) == (sign > 0.0))
            if is_at_goal or not len(index):
                continue
            # driven backward, the course is opposite
            start, goals = (
                x - np.array([0.0, 0.0, 0.5 * np.pi * (1.0 - sign)]) for x in (eta, self.goals[index])
            )
            kappa_g = sign * np.clip(self.kappa_1_m[index], -max_curvature, max_curvature)
            first = None if kappa_0 is None else sign * kappa_0
            path, k = shortest_path(start, first, goals, kappa_g, self.radius_m, ramp_m)
            if best_path.length_m == 0.0 or path.length_m < best_path.length_m:
                best_path, nearest_index = path, int(index[k])
        forward_sign = -1.0 if self.v_m_s[nearest_index] < 0.0 else 1.0
        return best_path, np.array([self.tau_s[nearest_index], abs(self.v_m_s[nearest_index]), forward_sign])
