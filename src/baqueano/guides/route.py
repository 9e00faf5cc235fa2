"""A route: the pose that the vehicle should have at each time, taught or drawn.

    s(θ) = ∫ |p′| dθ,  t = s / v,  ψ = atan2(p′_y, p′_x),  ν_ψ = κ v,  κ = (p′_x p″_y − p′_y p″_x) / |p′|³   (1)

p(θ) is a curve, s its length, v the speed, t the time, ψ the heading, ν_ψ the yaw rate, κ the curvature.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.result import Result
from baqueano.diagnostics import note
from baqueano.geometry import map_from_body, wrap
from baqueano.messages import text
from baqueano.messages.language import mark as N_

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow

MIN_SPOT_TURN_RAD, SPOT_SPEED_SHARE = 0.5, 0.1  # a turn at a smaller share of the speed is on the spot
REACHED_SHARE = 0.9  # a start from rest can end at this share of a speed, which fluctuates
MIN_STEP_SHARE = 1e-3  # smallest factor of a time step


class Route(NamedTuple):
    """Pose and velocity over time; the first pose is the start of the vehicle.

    Attributes
    ----------
    t_s : ndarray (m,)
        Times, increasing from 0.
    eta : ndarray (m, 3) [m, m, rad]
        Poses in the map; the heading is continuous, not wrapped.
    nu : ndarray (m, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    closed : bool
        True if the last pose equals the first one.

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
        with np.errstate(over="ignore"):  # a file that was not driven can contain any values
            length_m = float(np.sum(np.hypot(*np.diff(self.eta[:, :2], axis=0).T)))
        return text(
            note(
                "front.route", poses=len(self.t_s), duration_s=self.t_s[-1], length_m=length_m,
                ends=N_("closed") if self.closed else N_("open"),
            )
        )  # fmt: skip

    def rows(self) -> list["TableRow"]:
        """Return one flat dict per pose: time, pose and velocity, each key with its unit."""
        names = ("t_s", "x_m", "y_m", "psi_rad", "v_x_m_s", "v_y_m_s", "yaw_rate_rad_s")
        columns = np.column_stack([self.t_s, self.eta, self.nu])
        return [dict(zip(names, map(float, row), strict=True)) for row in columns]

    def table(self) -> str:
        """Return one line: number of poses, duration, length, and "closed" or "open"."""
        return repr(self)

    _repr_html_ = Result._repr_html_
    plot = Result.plot
    to_pandas = Result.to_pandas


def curve_route(
    p: np.ndarray, p1: np.ndarray, p2: np.ndarray, theta: np.ndarray, speed_m_s: float, *, closed: bool = True
) -> Route:
    """Return the route of a curve p(θ) (m, 2) with the derivatives p′ and p″ (m, 2), at a constant speed.  (1)

    `theta` (m,) are the values of θ. The route starts at the origin, along x.
    """
    stretch = np.hypot(p1[:, 0], p1[:, 1])
    s = np.concatenate([[0.0], np.cumsum(0.5 * (stretch[1:] + stretch[:-1]) * np.diff(theta))])
    psi = np.unwrap(np.arctan2(p1[:, 1], p1[:, 0]))
    kappa = (p1[:, 0] * p2[:, 1] - p1[:, 1] * p2[:, 0]) / stretch**3
    eta = np.column_stack([p, psi])
    nu = np.column_stack([np.full_like(s, speed_m_s), np.zeros_like(s), kappa * speed_m_s])
    return Route(s / speed_m_s, relative_poses(eta), nu, closed)


def relative_poses(eta: np.ndarray) -> np.ndarray:
    """Return the poses `eta` (m, 3) in the frame of the first pose: the route then starts at the origin, along x."""
    start_from_map = map_from_body(eta[0, 2])[:2, :2]
    return np.column_stack([(eta[:, :2] - eta[0, :2]) @ start_from_map, eta[:, 2] - eta[0, 2]])


def move_route(route: Route, start: np.ndarray) -> Route:
    """Return the route in the map, moved and turned so that its origin is at the pose `start` (3,)."""
    xy = start[:2] + route.eta[:, :2] @ map_from_body(start[2])[:2, :2].T
    return route._replace(eta=np.column_stack([xy, route.eta[:, 2] + start[2]]))


def with_closed_gap(route: Route) -> Route:
    """Return the route as a closed route, whose end is equal to its start.

    The driver returned to the mark, so the difference
    between the two poses is drift. The drift is removed linearly over time.
    """
    turn_rad = 2.0 * np.pi * np.round((route.eta[-1, 2] - route.eta[0, 2]) / (2.0 * np.pi))
    gap = route.eta[-1] - route.eta[0] - np.array([0.0, 0.0, turn_rad])
    share = (route.t_s - route.t_s[0]) / (route.t_s[-1] - route.t_s[0])
    return route._replace(eta=route.eta - np.outer(share, gap), closed=True)


def with_flying_start(route: Route) -> Route:
    """Return a closed route that does not start from rest, so that laps follow one another without a stop.

    v is the speed at the end of the route, or the median speed if it is less. The start lasts until the teacher
    reached v, or no longer accelerated above REACHED_SHARE v. There the velocities change linearly from the velocity at
    the end to the velocity that was reached. The time steps follow from these speeds. A start with a turn on the spot,
    and a route that ends at rest, stay unchanged.
    """
    speed = np.abs(route.nu[:, 0])
    v = min(speed[-1], float(np.median(speed)))
    is_steady = (speed >= REACHED_SHARE * v) & (np.append(speed[1:], 0.0) <= speed)
    slow_count = int(np.argmax((speed >= v) | is_steady))  # number of samples of the start
    spot_count = int(np.argmax(speed >= SPOT_SPEED_SHARE * v))
    if slow_count == 0 or np.ptp(route.eta[: spot_count + 1, 2]) > MIN_SPOT_TURN_RAD:
        return route
    dt_s, nu, start = np.diff(route.t_s), route.nu.copy(), slice(slow_count)
    rest_share = np.linspace(1.0, 0.0, slow_count, endpoint=False)[:, None]
    nu[start] = nu[slow_count] + rest_share * (nu[-1] - nu[slow_count])
    steps, new_steps = (speed[:-1] + speed[1:])[start], np.abs(nu[:-1, 0] + nu[1:, 0])[start]
    dt_s[start] *= np.maximum(steps / new_steps, MIN_STEP_SHARE)
    return route._replace(t_s=np.append(0.0, np.cumsum(dt_s)), nu=nu)


def end_gap(route: Route) -> tuple[float, float]:
    """Return the distance [m] and the absolute angle [rad] between the end and the start of a route."""
    d = route.eta[-1] - route.eta[0]
    return float(np.hypot(d[0], d[1])), float(abs(wrap(d[2])))
