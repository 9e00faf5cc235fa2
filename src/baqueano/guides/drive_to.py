"""Drive from the vehicle's pose to the nearest of several goals, on the shortest path with a limited curvature.

    path = the shortest of the paths (dubins.py) from the first estimate to each of the goals η_j          (1)
    v²  ≤   speed²,   (v_0 + a t)²,   v_j² + 2 a (length − σ)                                              (2)
    σ̇ = v,   η_r = path(σ),   ν_r = (± v, 0, κ v),   done when σ ≥ length                                 (3)

σ is the distance along the path, a the acceleration, κ the curvature, η_r and ν_r the reference. v_0 is the speed of
the first estimate, v_j the speed of the route at the goal. ν_r has the sign of v_j: a route that is driven backward is
reached backward. The guide is done at once if the vehicle is within MAX_GOAL_DISTANCE_M and MAX_GOAL_ANGLE_RAD of the
first goal. For a vehicle beside a route, the distance along the route to the best goal depends on the radius. So (1)
compares several goals.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.geometry import wrap
from baqueano.guides.dubins import DubinsPath, pose_at, shorter_path, shortest_dubins_path
from baqueano.guides.route import Route
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

MAX_GOAL_DISTANCE_M, MAX_GOAL_ANGLE_RAD = 0.01, np.radians(2.0)
MIN_SPEED_M_S = 0.02  # lower bound of σ̇, so that the reference reaches the goal
GOAL_COUNT = 9
JOIN_LENGTH_M = 1.0  # length of the route, from its start, on which the vehicle can join it


class DriveToState(NamedTuple):
    """Progress along the path to the goal."""

    t_ns: int  # -1 before the first tick
    start: Value  # (3,)
    path: DubinsPath
    goal: Value  # (3,): time of the route [s], its speed [m/s], its direction
    sigma_m: float
    v_m_s: float


@document
@dataclass(frozen=True, slots=True, eq=False)
class DriveTo:
    """Guide that drives to the nearest of several goals.

    References
    ----------
    Dubins, American Journal of Mathematics, 1957.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> guide = DriveTo(goals=[[1.0, 0.0, 0.0]])
    >>> _, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> float(reference.done)
    0.0
    """

    goals: np.ndarray = parameter("m, m, rad", "poses in the map, (k, 3)", shape=None)
    tau_s: np.ndarray = parameter("s", "times of the route at the goals, (k,)", default=(0.0,), shape=None)
    v_m_s: np.ndarray = parameter("m/s", "speeds of the route there, (k,)", default=(0.0,), shape=None)
    radius_m: float = parameter("m", "smallest radius of a curve", low=0.01, high=1e3, default=0.25)
    speed_m_s: float = parameter("m/s", "speed on the path to there", low=0.01, high=100.0, default=0.2)
    acceleration_m_s2: float = parameter("m/s²", "change of the speed", low=0.01, default=0.3)

    def __post_init__(self) -> None:
        goals = np.atleast_2d(np.array(self.goals, dtype=float))
        object.__setattr__(self, "goals", goals)
        for name in ("tau_s", "v_m_s"):
            rows = np.array(getattr(self, name), dtype=float)
            object.__setattr__(self, name, np.broadcast_to(rows, (len(goals),)).copy())
        check_bounds(self)

    @classmethod
    def to_route(cls, route: Route, reach_m: float = JOIN_LENGTH_M, **limits: float) -> "DriveTo":
        """Return the guide to a route: the goals are poses in its first `reach_m`, but at most in its first half."""
        s = np.append(0.0, np.cumsum(np.hypot(*np.diff(route.eta[:, :2], axis=0).T)))
        distances = np.linspace(0.0, min(reach_m, 0.5 * s[-1]), GOAL_COUNT)
        next_index = np.searchsorted(s, distances - 1e-12)
        previous_index = np.maximum(next_index - 1, 0)
        index = previous_index + (distances - s[previous_index]) / np.where(
            next_index > previous_index, s[next_index] - s[previous_index], 1.0
        )
        columns = (route.t_s, route.nu[:, 0], *route.eta.T)
        tau_s, v_m_s, *eta = (np.interp(index, np.arange(len(s)), column) for column in columns)
        return cls(np.column_stack(eta), tau_s, v_m_s, **limits)

    def init(self) -> DriveToState:
        """Return the state before the first tick."""
        empty_path = DubinsPath(0.0, np.zeros(3), np.zeros(2))
        return DriveToState(-1, np.zeros(3), empty_path, np.zeros(3), 0.0, 0.0)

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference pose and velocity on the path.  (3)"""
        has_begun = state.t_ns >= 0
        start = np.where(has_begun, state.start, estimate.eta)
        new_path, goal = self._nearest_goal(estimate.eta)
        path = DubinsPath(*(np.where(has_begun, a, b) for a, b in zip(state.path, new_path, strict=True)))
        goal = np.where(has_begun, state.goal, goal)
        dt_s = np.where(has_begun, seconds(estimate.t_ns, state.t_ns), 0.0)
        forward_sign = goal[2]
        v = (
            np.where(has_begun, state.v_m_s, np.maximum(forward_sign * estimate.nu[0], 0.0))
            + self.acceleration_m_s2 * dt_s
        )
        rest_m = np.maximum(path.length_m - state.sigma_m, 0.0)
        v = np.minimum(
            np.minimum(v, self.speed_m_s), np.sqrt(goal[1] ** 2 + 2.0 * self.acceleration_m_s2 * rest_m)
        )
        sigma_m = np.minimum(state.sigma_m + np.maximum(v, MIN_SPEED_M_S) * dt_s, path.length_m)
        is_over: Value = np.where(sigma_m >= path.length_m, 1.0, 0.0)
        heading_offset = 0.5 * np.pi * (1.0 - forward_sign)  # angle from the course to the heading
        course = np.array([start[0], start[1], start[2] - heading_offset])
        pose, kappa = pose_at(course, path, sigma_m, self.radius_m)
        eta = np.array([pose[0], pose[1], wrap(pose[2] + heading_offset)])
        v_r = np.where(is_over > 0.0, 0.0, v)
        nu = np.array([forward_sign * v_r, 0.0 * v_r, kappa * v_r])
        next_state = DriveToState(estimate.t_ns, start, path, goal, sigma_m, v)
        return next_state, Reference(estimate.t_ns, eta, nu, is_over)

    def _nearest_goal(self, eta: Value) -> tuple[DubinsPath, Value]:
        """Return the path to the nearest goal, and time, speed and direction of the route at that goal.  (1)"""
        forward_signs = np.where(self.v_m_s < 0.0, -1.0, 1.0)
        heading_offsets = 0.5 * np.pi * (1.0 - forward_signs)
        x, y, psi = self.goals.T
        paths = shortest_dubins_path(
            (eta[0], eta[1], eta[2] - heading_offsets), (x, y, psi - heading_offsets), self.radius_m
        )
        offset = eta - self.goals[0]
        is_at_goal = (np.hypot(offset[0], offset[1]) < MAX_GOAL_DISTANCE_M) & (
            np.abs(wrap(offset[2])) < MAX_GOAL_ANGLE_RAD
        )
        shortest_path = DubinsPath(*(field[..., 0] for field in paths))
        shortest_path = shortest_path._replace(length_m=np.where(is_at_goal, 0.0, shortest_path.length_m))
        goal = np.array([self.tau_s[0], np.abs(self.v_m_s[0]), forward_signs[0]])
        for k in range(1, len(self.goals)):
            path = DubinsPath(*(field[..., k] for field in paths))
            is_shorter = path.length_m < shortest_path.length_m
            goal = np.where(
                is_shorter, np.array([self.tau_s[k], np.abs(self.v_m_s[k]), forward_signs[k]]), goal
            )
            shortest_path = shorter_path(path, shortest_path)
        return shortest_path, goal
