"""Set the speed along a path: constant, or as fast as the vehicle can.

    v(s) ≤ v_most(κ):   share(v, κ v, 0, 0) ≤ command_share,   |κ| v² ≤ a_y,   v ≤ v_limit                   (1)
    d(v²)/ds = 2 v̇,     share(v, κ v, v̇, κ v̇ + κ′ v²) ≤ command_share,   |v̇| ≤ a_x,   both ways        (2)

v is the speed, s the distance, κ the curvature, a_y the limit of the sideways acceleration. a_x is the limit of the
reference of the controllers (model_following.py). capability.py computes share(v, r, v̇, ṙ). (1) limits the speed in a
curve of constant radius, (2) acceleration and braking. The result is the fastest profile within both limits. Source:
Bobrow, Dubowsky and Gibson, International Journal of Robotics Research, 1985; Kunz and Stilman, RSS, 2012.
"""

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.controllers.model_following import MAX_ACCELERATION
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.messages.printable import baqueano_command
from baqueano.routes.capability import MAX_SPEED_M_S, Capability, largest_allowed
from baqueano.routes.path import GRID_M, NAME_PLACEHOLDER, RoutePath, direction, route_along, route_path
from baqueano.vehicle_file import VehicleFile

COMMAND_SHARE = 0.8  # of the command; the rest is for the controller
MAX_LATERAL_M_S2 = 3.0  # half of the grip of rubber on a smooth floor, 0.6 g
SPEED_COUNT = 24  # number of speeds at which (2) is evaluated
MIN_SPEED_M_S = 0.02  # speed at a start from rest, so that the time is finite
LAP_COUNT = 3  # laps of a closed route, until the speeds of its start and its end agree


@checked_call("bq.routes.at_speed(route, 0.2)")
def at_speed(route: Route, speed_m_s: float) -> Route:
    """Return a route that is driven at a constant speed along its path.

    Parameters
    ----------
    route : Route
        Driven only forward or only backward; it is not changed.
    speed_m_s : float
        Speed along the path, above 0.

    Returns
    -------
    Route
        The same poses without their stops.

    Raises
    ------
    UsageError
        For a speed that is not positive, or a route that drives forward and backward.

    Examples
    --------
    >>> at_speed(bq.guides.shapes.circle(0.5, 0.2), 0.4)
    Route(1441 poses, 7.9 s, 3.14 m, closed)
    """
    if not (np.isfinite(speed_m_s) and speed_m_s > 0.0):
        raise UsageError.of("route.speed", value=speed_m_s)
    path = route_path(route)
    return route_along(path, np.full(len(path.s), float(speed_m_s)), direction(route), closed=route.closed)


@checked_call("bq.routes.fastest(route, robot)")
def fastest(
    route: Route,
    vehicle_file: VehicleFile,
    *,
    command_share: float = COMMAND_SHARE,
    lateral_m_s2: float = MAX_LATERAL_M_S2,
    speed_m_s: float = MAX_SPEED_M_S,
    backend: str = "auto",
) -> Route:
    """Return a route driven as fast as the identified vehicle can.

    An open route begins and ends at rest. A closed route repeats without a stop: its guide accelerates and brakes.

    Parameters
    ----------
    route : Route
        Smooth, and driven only forward or only backward; it is not changed.
    vehicle_file : VehicleFile
        The identified vehicle: its model and the limits of its command.
    command_share : float
        Largest share of the command that the route needs [no unit], above 0, at most 1; the controller uses the rest.
    lateral_m_s2 : float [m/s²]
        Largest acceleration to the side; above it, tyres and small objects slip.
    speed_m_s : float
        Largest speed.
    backend : str
        "auto", "c", "python", or "numpy".

    Returns
    -------
    Route
        The same path; times and velocities are new.

    Raises
    ------
    UsageError
        For a share outside 0 to 1, a limit that is not positive, or a curve that the vehicle cannot drive at any speed.

    References
    ----------
    Bobrow, Dubowsky and Gibson, International Journal of Robotics Research, 1985.

    Examples
    --------
    >>> lap = bq.guides.shapes.rectangle(1.2, 0.8, 0.2, 0.2)
    >>> print(f"{lap.t_s[-1]:.1f} s, then {fastest(lap, bq.load('small')).t_s[-1]:.1f} s")
    18.3 s, then 10.6 s
    """
    for name, value, high in (("command_share", command_share, 1.0), ("lateral_m_s2", lateral_m_s2, np.inf)):
        if not 0.0 < value <= high:
            raise UsageError.of("route.limit", name=name, value=value)
    if not speed_m_s > MIN_SPEED_M_S:
        raise UsageError.of("route.speed", value=speed_m_s)
    path, forward_sign = _resample(route_path(route)), direction(route)
    capability = Capability(vehicle_file, backend)
    curvature = np.abs(path.kappa)
    high = np.minimum(speed_m_s, np.sqrt(lateral_m_s2 / np.maximum(curvature, 1e-9)))
    max_speed = capability.fastest_speed(
        forward_sign * path.kappa, np.minimum(high, MAX_SPEED_M_S), command_share
    )
    if np.any(is_too_slow := max_speed < MIN_SPEED_M_S):
        index, slow_turn = int(np.argmax(is_too_slow)), forward_sign * path.kappa * MIN_SPEED_M_S
        min_share = float(np.max(capability.share(MIN_SPEED_M_S, slow_turn)))
        larger_share = str(round(min(1.0, 1.05 * min_share), 2))
        fix = baqueano_command("route", "smooth", NAME_PLACEHOLDER, "--rms", "0.05")
        if min_share <= 1.0:
            fix = baqueano_command("route", "faster", NAME_PLACEHOLDER, "--command-share", larger_share)
        position_m, radius_m = float(path.s[index]), float(1.0 / curvature[index])
        raise UsageError.of(
            "route.too-tight", fix, position_m=position_m, radius_m=radius_m, command_share=command_share
        )
    acceleration, deceleration = (
        _rates(capability, path, forward_sign, sign, max_speed, command_share) for sign in (1.0, -1.0)
    )
    return route_along(
        path,
        _sweep(path, max_speed, acceleration, deceleration, not route.closed),
        forward_sign,
        closed=route.closed,
    )


def _resample(path: RoutePath) -> RoutePath:
    """Return the path with a point every GRID_M, and the curvature averaged over that distance."""
    s = np.linspace(0.0, path.s[-1], max(8, round(path.s[-1] / GRID_M) + 1))
    xy = np.column_stack([np.interp(s, path.s, column) for column in path.xy.T])
    course, slip = (np.interp(s, path.s, column) for column in (path.course, path.slip))
    return RoutePath(s, xy, course, np.gradient(course, s), slip)


def _rates(
    capability: Capability,
    path: RoutePath,
    forward_sign: float,
    sign: float,
    max_speed: np.ndarray,
    command_share: float,
) -> np.ndarray:
    """Return the largest |v̇| (m, SPEED_COUNT) [m/s²] of the sign `sign`, at fractions of `max_speed` (m,).  (2)
    The result is at most a_x.
    """
    v = max_speed[:, None] * np.linspace(0.0, 1.0, SPEED_COUNT)
    kappa = forward_sign * path.kappa[:, None]
    kappa_slope = forward_sign * np.gradient(path.kappa, path.s)[:, None]

    def is_possible(rate: np.ndarray) -> np.ndarray:
        v_dot = sign * rate
        return (
            capability.share(
                forward_sign * v,
                kappa * forward_sign * v,
                forward_sign * v_dot,
                forward_sign * (kappa * v_dot + kappa_slope * v**2),
            )
            <= command_share
        )

    return largest_allowed(is_possible, np.full(v.shape, MAX_ACCELERATION[0]))


def _sweep(
    path: RoutePath,
    max_speed: np.ndarray,
    acceleration: np.ndarray,
    deceleration: np.ndarray,
    begins_at_rest: bool,
) -> np.ndarray:
    """Return the largest speed (m,) [m/s] that satisfies (1) and (2).

    `acceleration` and `deceleration` (m, SPEED_COUNT) are the largest values [m/s²] at fractions of `max_speed` (m,).
    """
    v, ds, fractions = max_speed.copy(), np.diff(path.s), np.linspace(0.0, 1.0, SPEED_COUNT)
    if begins_at_rest:
        v[[0, -1]] = MIN_SPEED_M_S
    for _ in range(1 if begins_at_rest else LAP_COUNT):
        for k in range(len(ds)):
            gain = 2.0 * ds[k] * np.interp(v[k] / max_speed[k], fractions, acceleration[k])
            v[k + 1] = min(v[k + 1], np.sqrt(v[k] ** 2 + gain))
        v[0] = v[0] if begins_at_rest else min(v[0], v[-1])
        for k in reversed(range(len(ds))):
            gain = 2.0 * ds[k] * np.interp(v[k + 1] / max_speed[k + 1], fractions, deceleration[k + 1])
            v[k] = min(v[k], np.sqrt(v[k + 1] ** 2 + gain))
        v[-1] = v[-1] if begins_at_rest else min(v[0], v[-1])
    return v
