"""Drive from the vehicle's pose to the nearest of several goals, on the shortest path with a smallest radius.

    path = the shortest of the shortest paths (dubins.py) from the first estimate to the goals η_j         (1)
    v²  ≤   speed²,   (v_0 + a t)²,   v_j² + 2 a (length − σ)                                              (2)
    σ̇ = v,   η_r = path(σ),   ν_r = (± v, 0, κ v),   done when σ ≥ length                                 (3)

σ is the distance along the path, a the acceleration, κ the curvature, η_r and ν_r the reference. v_0 is the speed of
the first estimate, v_j the speed of the route at the goal. ν_r has the sign of v_j: a route that is driven backward is
reached backward. The guide is done at once if the vehicle is within NEAR_M and NEAR_RAD of the first goal. For a
vehicle beside a route, the best goal is at a distance along the route that depends on R. So (1) compares several goals.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.geometry import wrap
from baqueano.guides.dubins import DubinsWay, pose_at, shorter, shortest
from baqueano.guides.route import Route
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference, seconds
from baqueano.vehicles.bounds import check_bounds

NEAR_M, NEAR_RAD = 0.01, np.radians(2.0)
SLOWEST_M_S = 0.02  # least speed of σ, so that the reference arrives
GOALS = 9
REACH_M = 1.0  # length of the route, from its start, on which the vehicle may join it


class DriveToState(NamedTuple):
    """Progress along the path to the goal."""

    t_ns: int  # -1 before the first tick
    start: Value  # (3,)
    way: DubinsWay
    goal: Value  # (3,): time of the route [s], its speed [m/s], its direction
    sigma_m: float
    v_m_s: float


@document
@dataclass(frozen=True, slots=True, eq=False)
class DriveTo:
    """Guide that drives to the nearest of several goals.

    Notes
    -----
    Equations (1)-(3) of the module.

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

    goals: np.ndarray = parameter("m, m, rad", "poses, (k, 3)", shape=None)
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
    def join(cls, route: Route, reach_m: float = REACH_M, **limits: float) -> "DriveTo":
        """Return the guide to a route: the goals are poses in its first `reach_m`, at most its first half."""
        s = np.append(0.0, np.cumsum(np.hypot(*np.diff(route.eta[:, :2], axis=0).T)))
        distances = np.linspace(0.0, min(reach_m, 0.5 * s[-1]), GOALS)
        at = np.unique(np.searchsorted(s, distances - 1e-12))
        return cls(route.eta[at], route.t_s[at], route.nu[at, 0], **limits)

    def init(self) -> DriveToState:
        """Return the state before the first tick."""
        nowhere = DubinsWay(0.0, np.zeros(3), np.zeros(2))
        return DriveToState(-1, np.zeros(3), nowhere, np.zeros(3), 0.0, 0.0)

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference pose and velocity on the path.  (3)"""
        began = state.t_ns >= 0
        start = np.where(began, state.start, estimate.eta)
        plan, goal = self._nearest(estimate.eta)
        way = DubinsWay(*(np.where(began, a, b) for a, b in zip(state.way, plan, strict=True)))
        goal = np.where(began, state.goal, goal)
        dt_s = np.where(began, seconds(estimate.t_ns, state.t_ns), 0.0)
        ahead = goal[2]
        v = (
            np.where(began, state.v_m_s, np.maximum(ahead * estimate.nu[0], 0.0))
            + self.acceleration_m_s2 * dt_s
        )
        rest_m = np.maximum(way.length_m - state.sigma_m, 0.0)
        v = np.minimum(
            np.minimum(v, self.speed_m_s), np.sqrt(goal[1] ** 2 + 2.0 * self.acceleration_m_s2 * rest_m)
        )
        sigma_m = np.minimum(state.sigma_m + np.maximum(v, SLOWEST_M_S) * dt_s, way.length_m)
        is_over: Value = np.where(sigma_m >= way.length_m, 1.0, 0.0)
        back = 0.5 * np.pi * (1.0 - ahead)  # of the body against its course
        course = np.array([start[0], start[1], start[2] - back])
        pose, kappa = pose_at(course, way, sigma_m, self.radius_m)
        eta = np.array([pose[0], pose[1], wrap(pose[2] + back)])
        v_r = np.where(is_over > 0.0, 0.0, v)
        nu = np.array([ahead * v_r, 0.0 * v_r, kappa * v_r])
        now = DriveToState(estimate.t_ns, start, way, goal, sigma_m, v)
        return now, Reference(estimate.t_ns, eta, nu, is_over)

    def _nearest(self, eta: Value) -> tuple[DubinsWay, Value]:
        """Return the path to the nearest goal, and time, speed and direction of the route at that goal.  (1)"""
        ahead = np.where(self.v_m_s < 0.0, -1.0, 1.0)
        back = 0.5 * np.pi * (1.0 - ahead)
        x, y, psi = self.goals.T
        ways = shortest((eta[0], eta[1], eta[2] - back), (x, y, psi - back), self.radius_m)
        off = eta - self.goals[0]
        at_goal = (np.hypot(off[0], off[1]) < NEAR_M) & (np.abs(wrap(off[2])) < NEAR_RAD)
        best = DubinsWay(*(field[..., 0] for field in ways))
        best = best._replace(length_m=np.where(at_goal, 0.0, best.length_m))
        goal = np.array([self.tau_s[0], np.abs(self.v_m_s[0]), ahead[0]])
        for k in range(1, len(self.goals)):
            way = DubinsWay(*(field[..., k] for field in ways))
            less = way.length_m < best.length_m
            goal = np.where(less, np.array([self.tau_s[k], np.abs(self.v_m_s[k]), ahead[k]]), goal)
            best = shorter(way, best)
        return best, goal
