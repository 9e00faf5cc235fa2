"""Routes that are drawn, not taught. All start at the origin along x and turn left first.

    sinuous circle  p(θ) = (R + A sin kθ) (sin θ, −cos θ)   the path of the paper's evaluation            (1)
    eight           p(θ) = a (sin θ, sin θ cos θ)           Gerono's lemniscate, without a net turn       (2)
    slalom          p(x) = (x, A/2 (1 − cos 2πn x/L))       open                                          (3)
    clothoid        κ(s) = κ_m (1 − |2s/L − 1|)             open; the curvature rises and falls linearly  (4)

p is the position on the path. R, A, k: radius, amplitude and number of waves; a: half the length; n, L: number of
crests and length; κ, s: curvature and distance along the path. (1) and (2) are moved so that they start at the origin
along x, and they are closed. The speed along the path is constant.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.names import SHAPE_NAMES
from baqueano.contracts.values import Value
from baqueano.diagnostics import nearest
from baqueano.errors import Invalid
from baqueano.guides.repeat import Repeat, RepeatState
from baqueano.guides.route import Route, curve_route, relative_poses
from baqueano.on_demand import unknown_names
from baqueano.parameter import document, parameter
from baqueano.signals import Estimate, Reference
from baqueano.vehicles.bounds import check_bounds

__all__ = ["SinuousCircle", "circle", "clothoid", "eight", "line", "rectangle", "sinuous_circle", "slalom"]
__getattr__ = unknown_names(__name__)

POINT_COUNT = 1441  # poses of a drawn route, four per degree of a circle


@checked_call("bq.guides.shapes.sinuous_circle(0.6, 0.08, 5, 0.2)")
@lru_cache(maxsize=32)
def sinuous_circle(radius_m: float, amplitude_m: float, waves: int, speed_m_s: float) -> Route:
    """Return a circle whose radius varies `waves` times per lap; the route is one lap.

    Parameters
    ----------
    radius_m : float
        Mean radius.
    amplitude_m : float
        Largest deviation of the radius.
    waves : int
        Number of waves in a lap.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Closed, from the origin of the map along x, to the left.

    Notes
    -----
    Equation (1) of the module: the path of the evaluation in Grotz et al.

    Examples
    --------
    >>> route = sinuous_circle(0.6, 0.08, 5, 0.2)
    >>> print(route.eta.shape, f"{route.t_s[-1]:.1f} s, {route.eta[-1, 2] / np.pi:.1f} π")
    (1441, 3) 20.8 s, 2.0 π
    """
    _check(radius_m, speed_m_s)
    th = np.linspace(0.0, 2.0 * np.pi, POINT_COUNT)
    r = radius_m + amplitude_m * np.sin(waves * th)
    r1, r2 = amplitude_m * waves * np.cos(waves * th), -amplitude_m * waves**2 * np.sin(waves * th)
    outward, tangent = np.column_stack([np.sin(th), -np.cos(th)]), np.column_stack([np.cos(th), np.sin(th)])
    r, r1, r2 = r[:, None], r1[:, None], r2[:, None]
    return curve_route(
        r * outward, r1 * outward + r * tangent, (r2 - r) * outward + 2.0 * r1 * tangent, th, speed_m_s
    )


@checked_call("bq.guides.shapes.circle(0.5, 0.2)")
def circle(radius_m: float, speed_m_s: float) -> Route:
    """Return a circle to the left.

    Parameters
    ----------
    radius_m : float
        Radius.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Closed, from the origin of the map along x.

    Examples
    --------
    >>> circle(0.5, 0.2)
    Route(1441 poses, 15.7 s, 3.14 m, closed)
    """
    return sinuous_circle(radius_m, 0.0, 1, speed_m_s)


@checked_call("bq.guides.shapes.eight(0.6, 0.2)")
def eight(half_length_m: float, speed_m_s: float) -> Route:
    """Return a figure-of-eight route without a net turn.

    Parameters
    ----------
    half_length_m : float
        Distance from the crossing to each end.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Closed, from the origin of the map along x.

    Notes
    -----
    Equation (2) of the module: Gerono's lemniscate.

    Examples
    --------
    >>> eight(0.6, 0.2)
    Route(1441 poses, 18.3 s, 3.66 m, closed)
    """
    _check(half_length_m, speed_m_s)
    th = np.linspace(0.0, 2.0 * np.pi, POINT_COUNT)
    s, c = np.sin(th), np.cos(th)
    p, p1 = np.column_stack([s, s * c]), np.column_stack([c, c**2 - s**2])
    p2 = np.column_stack([-s, -4.0 * s * c])
    return curve_route(half_length_m * p, half_length_m * p1, half_length_m * p2, th, speed_m_s)


@checked_call("bq.guides.shapes.rectangle(1.2, 0.8, 0.2, 0.2)")
def rectangle(length_m: float, width_m: float, corner_m: float, speed_m_s: float) -> Route:
    """Return a rectangle with round corners, from the middle of a long side.

    Parameters
    ----------
    length_m, width_m : float
        Sides.
    corner_m : float
        Radius of the corners.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Closed, from the origin of the map along x, to the left.

    Raises
    ------
    Invalid
        If the corners do not fit into the sides; Invalid is a ValueError.

    Examples
    --------
    >>> rectangle(1.2, 0.8, 0.2, 0.2)
    Route(360 poses, 18.3 s, 3.66 m, closed)
    """
    _check(length_m, speed_m_s)
    a, b = length_m - 2.0 * corner_m, width_m - 2.0 * corner_m
    if not (a > 0.0 and b > 0.0 and corner_m > 0.0):
        raise Invalid.of(
            "shape.corners",
            length_m=length_m,
            width_m=width_m,
            corner_m=corner_m,
            max_m=min(length_m, width_m) / 2.0,
        )
    quarter = 0.5 * np.pi * corner_m
    pieces = [(a / 2, 0.0), (quarter, 1.0), (b, 0.0), (quarter, 1.0), (a, 0.0), (quarter, 1.0), (b, 0.0)]
    pieces += [(quarter, 1.0), (a / 2, 0.0)]
    x, y, psi, distance_m = 0.0, 0.0, 0.0, 0.0
    rows = []
    for length, turn_sign in pieces:
        s = np.linspace(0.0, length, max(2, int(np.ceil(length / 0.01))))
        turn = turn_sign / corner_m * s
        if turn_sign:
            dx, dy = corner_m * np.sin(turn), corner_m * (1.0 - np.cos(turn))
        else:
            dx, dy = s, np.zeros_like(s)
        xs = x + np.cos(psi) * dx - np.sin(psi) * dy
        ys = y + np.sin(psi) * dx + np.cos(psi) * dy
        rows.append(
            np.column_stack([distance_m + s, xs, ys, psi + turn, np.full_like(s, turn_sign / corner_m)])[:-1]
        )
        x, y, psi, distance_m = xs[-1], ys[-1], psi + turn[-1], distance_m + length
    rows.append(np.array([[distance_m, x, y, psi, 0.0]]))
    table = np.concatenate(rows)
    nu = np.column_stack([np.full(len(table), speed_m_s), np.zeros(len(table)), table[:, 4] * speed_m_s])
    return Route(table[:, 0] / speed_m_s, relative_poses(table[:, 1:4]), nu, closed=True)


@checked_call("bq.guides.shapes.line(2.0, 0.2)")
def line(length_m: float, speed_m_s: float) -> Route:
    """Return a straight line.

    Parameters
    ----------
    length_m : float
        Length.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Open, from the origin of the map along x.

    Examples
    --------
    >>> line(2.0, 0.2)
    Route(201 poses, 10.0 s, 2.00 m, open)
    """
    _check(length_m, speed_m_s)
    return _curvature_route(np.zeros(_points(length_m)), length_m, speed_m_s)


@checked_call("bq.guides.shapes.slalom(2.0, 0.3, 3, 0.2)")
def slalom(length_m: float, width_m: float, waves: int, speed_m_s: float) -> Route:
    """Return a slalom: a wavy line that starts and ends along x.

    Parameters
    ----------
    length_m : float
        Distance between the ends of the slalom.
    width_m : float
        Distance from the x axis to the crests.
    waves : int
        Number of crests.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Open, from the origin of the map along x, to the left first.

    Notes
    -----
    Equation (3) of the module.

    Examples
    --------
    >>> slalom(2.0, 0.3, 3, 0.2)
    Route(1441 poses, 13.9 s, 2.78 m, open)
    """
    _check(length_m, speed_m_s)
    x = np.linspace(0.0, length_m, POINT_COUNT)
    k, a = 2.0 * np.pi * waves / length_m, 0.5 * width_m
    unit, zero_turn = np.ones(POINT_COUNT), np.zeros(POINT_COUNT)
    p = np.column_stack([x, a * (1.0 - np.cos(k * x))])
    p1 = np.column_stack([unit, a * k * np.sin(k * x)])
    p2 = np.column_stack([zero_turn, a * k**2 * np.cos(k * x)])
    return curve_route(p, p1, p2, x, speed_m_s, closed=False)


@checked_call("bq.guides.shapes.clothoid(1.0, 1.57, 0.2)")
def clothoid(length_m: float, turn_rad: float, speed_m_s: float) -> Route:
    """Return a curve that starts and ends straight; its curvature rises and falls linearly.

    Parameters
    ----------
    length_m : float
        Length of the path.
    turn_rad : float
        Turn from the start to the end of the curve; positive to the left.
    speed_m_s : float
        Speed along the path.

    Returns
    -------
    Route
        Open, from the origin of the map along x.

    Notes
    -----
    Equation (4) of the module: two Euler spirals, with the largest curvature κ_m = 2 · turn / length between them.

    Examples
    --------
    >>> route = clothoid(1.0, np.pi / 2, 0.2)
    >>> print(route.eta[-1].round(2))
    [0.6  0.6  1.57]
    """
    _check(length_m, speed_m_s)
    fraction = np.linspace(0.0, 1.0, _points(length_m))
    return _curvature_route(
        2.0 * turn_rad / length_m * (1.0 - np.abs(2.0 * fraction - 1.0)), length_m, speed_m_s
    )


def _check(length_m: float, speed_m_s: float) -> None:
    """Raise Invalid for a length or a speed that is not a positive finite number."""
    for code, value in (("shape.length", length_m), ("route.speed", speed_m_s)):
        if not 0.0 < value < np.inf:
            raise Invalid.of(code, value=value)


def _points(length_m: float) -> int:
    """Return the number of poses of a line, one per centimetre."""
    return max(3, round(100.0 * length_m) + 1)


def _curvature_route(kappa: np.ndarray, length_m: float, speed_m_s: float) -> Route:
    """Return the open route with the curvatures (m,) [1/m] at even distances along it, by the midpoint rule."""
    s = np.linspace(0.0, length_m, len(kappa))
    psi = np.append(0.0, np.cumsum(0.5 * (kappa[1:] + kappa[:-1]) * np.diff(s)))
    mean_heading = 0.5 * (psi[1:] + psi[:-1])
    step = np.diff(s)[:, None] * np.column_stack([np.cos(mean_heading), np.sin(mean_heading)])
    xy = np.vstack([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    nu = np.column_stack([np.full_like(s, speed_m_s), np.zeros_like(s), kappa * speed_m_s])
    return Route(s / speed_m_s, np.column_stack([xy, psi]), nu, closed=False)


def shape(name: str, size_m: float, speed_m_s: float) -> Route:
    """Return the route of a name in SHAPE_NAMES. Raise Invalid for another name, size or speed.

    `size_m` is the radius of a circle, or half the length of another shape.
    """
    match name:
        case "sinuous-circle":
            return sinuous_circle(size_m, 0.1 * size_m, 6, speed_m_s)
        case "circle":
            return circle(size_m, speed_m_s)
        case "eight":
            return eight(size_m, speed_m_s)
        case "rectangle":
            return rectangle(2 * size_m, size_m, 0.2 * size_m, speed_m_s)
        case "line":
            return line(2 * size_m, speed_m_s)
        case "slalom":
            return slalom(2 * size_m, 0.3 * size_m, 3, speed_m_s)
        case "clothoid":
            return clothoid(2 * size_m, 0.5 * np.pi, speed_m_s)
    raise Invalid.of("shape.unknown", value=str(name), suggestion=nearest(str(name), SHAPE_NAMES))


@document
@dataclass(frozen=True, slots=True, eq=False)
class SinuousCircle:
    """The paper's sinuous circle as a guide, repeated for `laps` laps.

    Parameters
    ----------
    waves : int
        Number of waves in a lap.
    laps : int
        Number of laps; 0 repeats without end.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> guide = SinuousCircle(radius_m=0.6, amplitude_m=0.08, waves=5, speed_m_s=0.2)
    >>> _, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.array([0.2, 0.0, 0.0]), np.eye(6)))
    >>> print(reference.nu.round(2))
    [0.2  0.   0.36]
    """

    radius_m: float = parameter("m", "mean radius", low=0.01, high=1e3, default=0.5)
    amplitude_m: float = parameter("m", "amplitude of the radius", low=0.0, high=1e3, default=0.05)
    speed_m_s: float = parameter("m/s", "speed along the path", low=1e-3, high=100.0, default=0.25)
    waves: int = 6
    laps: int = 1

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.amplitude_m >= self.radius_m:
            raise Invalid.of("shape.amplitude", amplitude_m=self.amplitude_m, radius_m=self.radius_m)

    def _repeat(self) -> Repeat:
        return _repeat(self.radius_m, self.amplitude_m, self.waves, self.speed_m_s, self.laps)

    def init(self) -> RepeatState:
        """Return the state before the first tick."""
        return self._repeat().init()

    def entry_state(self, t_ns: Value, tau_s: Value, speed_m_s: Value) -> RepeatState:
        """Return the state of a vehicle that joins the route with this speed, at the time `tau_s` of the route."""
        return self._repeat().entry_state(t_ns, tau_s, speed_m_s)

    def step(self, state: RepeatState, estimate: Estimate) -> tuple[RepeatState, Reference]:
        """Return the state, and the reference pose and velocity at this time.  (1)"""
        return self._repeat().step(state, estimate)


@lru_cache(maxsize=32)
def _repeat(radius_m: float, amplitude_m: float, waves: int, speed_m_s: float, laps: int) -> Repeat:
    return Repeat.along(sinuous_circle(radius_m, amplitude_m, waves, speed_m_s), laps)
