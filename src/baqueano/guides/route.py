"""A route: where the vehicle should be at each time, as it was taught or drawn.

s(θ) = ∫ |p′| dθ,  t = s / v,  ψ = atan2(p′_y, p′_x),  ν_ψ = κ v,  κ = (p′_x p″_y − p′_y p″_x) / |p′|³   (1)
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.result import Result
from baqueano.geometry import map_from_body, wrap

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow

ON_THE_SPOT_RAD = 0.5
SHORTEST = 1e-3  # part of its time that a sample keeps


class Route(NamedTuple):
    """Pose and velocity over time; the first pose is where the vehicle starts.

    Attributes
    ----------
    t_s : ndarray (m,)
        Times, increasing from 0.
    eta : ndarray (m, 3) [m, m, rad]
        Poses in the map; the heading is continuous, not wrapped.
    nu : ndarray (m, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    closed : bool
        True where the last pose is the first one again.

    Examples
    --------
    >>> bq.guides.shapes.circle(0.5, 0.2)
    Route(1441 poses, 15.7 s, 3.14 m, closed)
    """

    t_s: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    closed: bool

    def __repr__(self) -> str:
        with np.errstate(over="ignore"):  # of a file that nobody drove
            length_m = float(np.sum(np.hypot(*np.diff(self.eta[:, :2], axis=0).T)))
        kind = "closed" if self.closed else "open"
        return f"Route({len(self.t_s)} poses, {self.t_s[-1]:.1f} s, {length_m:.2f} m, {kind})"

    def rows(self) -> list["TableRow"]:
        """Return one flat row per pose."""
        names = ("t_s", "x_m", "y_m", "psi_rad", "v_x_m_s", "v_y_m_s", "yaw_rate_rad_s")
        numbers = np.column_stack([self.t_s, self.eta, self.nu])
        return [dict(zip(names, map(float, row), strict=True)) for row in numbers]

    def table(self) -> str:
        """Return its size, in words."""
        return repr(self)

    _repr_html_ = Result._repr_html_
    plot = Result.plot
    to_pandas = Result.to_pandas


def route_of_curve(
    p: np.ndarray,
    p1: np.ndarray,
    p2: np.ndarray,
    theta: np.ndarray,
    speed_m_s: float,
    *,
    closed: bool = True,
) -> Route:
    """A curve p(θ) (m, 2) with its derivatives p′, p″, driven at a steady speed from the origin along x.  (1)"""
    stretch = np.hypot(p1[:, 0], p1[:, 1])
    s = np.concatenate([[0.0], np.cumsum(0.5 * (stretch[1:] + stretch[:-1]) * np.diff(theta))])
    psi = np.unwrap(np.arctan2(p1[:, 1], p1[:, 0]))
    kappa = (p1[:, 0] * p2[:, 1] - p1[:, 1] * p2[:, 0]) / stretch**3
    eta = np.column_stack([p, psi])
    nu = np.column_stack([np.full_like(s, speed_m_s), np.zeros_like(s), kappa * speed_m_s])
    return Route(s / speed_m_s, from_start(eta), nu, closed)


def from_start(eta: np.ndarray) -> np.ndarray:
    """Poses (m, 3) seen from the first of them: the route then starts at the origin, along x."""
    back = map_from_body(eta[0, 2])[:2, :2]
    return np.column_stack([(eta[:, :2] - eta[0, :2]) @ back, eta[:, 2] - eta[0, 2]])


def moved(route: Route, start: np.ndarray) -> Route:
    """The same route, laid into the map with its own origin at the pose `start` (3,)."""
    xy = start[:2] + route.eta[:, :2] @ map_from_body(start[2])[:2, :2].T
    return route._replace(eta=np.column_stack([xy, route.eta[:, 2] + start[2]]))


def closed_up(route: Route) -> Route:
    """The route with its end brought back onto its start: the driver returned to the mark, so what is
    left between the two poses is drift, and is spread evenly over the time."""
    turns = 2.0 * np.pi * np.round((route.eta[-1, 2] - route.eta[0, 2]) / (2.0 * np.pi))
    gap = route.eta[-1] - route.eta[0] - np.array([0.0, 0.0, turns])
    share = (route.t_s - route.t_s[0]) / (route.t_s[-1] - route.t_s[0])
    return route._replace(eta=route.eta - np.outer(share, gap), closed=True)


def run_through(route: Route) -> Route:
    """Return a closed route that does not begin from rest, so that a lap follows another without a stop.

    v is the speed of the route's end, or its median if that is less. Until the teacher had reached v, times shrink by
    the part of v that was driven. There velocities go evenly from those of the end to those that were reached. A start
    that turns on the spot, and a route that ends at rest, stay as they are.
    """
    speed = np.abs(route.nu[:, 0])
    v = min(speed[-1], float(np.median(speed)))
    slow = int(np.argmax(speed >= v))  # samples before it was as fast
    if slow == 0 or np.ptp(route.eta[: slow + 1, 2]) > ON_THE_SPOT_RAD:
        return route
    dt_s, nu = np.diff(route.t_s), route.nu.copy()
    dt_s[:slow] *= np.maximum(0.5 * (speed[:slow] + speed[1 : slow + 1]) / v, SHORTEST)
    nu[:slow] = nu[-1] + np.linspace(0.0, 1.0, slow, endpoint=False)[:, None] * (nu[slow] - nu[-1])
    return route._replace(t_s=np.append(0.0, np.cumsum(dt_s)), nu=nu)


def end_gap(route: Route) -> tuple[float, float]:
    """Return the distance [m] and the turn [rad] between the end and the start."""
    d = route.eta[-1] - route.eta[0]
    return float(np.hypot(d[0], d[1])), float(abs(wrap(d[2])))
