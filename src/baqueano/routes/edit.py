"""Cut, join, reverse and scale routes.

the other direction: the vehicle is turned by 180° ψ + π,  (ν_x, ν_y, −ν_ψ),  from the end to the start   (1)
backing up along the same poses                    ψ,      −ν                                             (2)
"""

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.guides.route import Route, move_route, relative_poses
from baqueano.messages.printable import baqueano_command
from baqueano.routes.path import MAX_END_GAP_M, MAX_END_GAP_RAD, NAME_PLACEHOLDER, distances_along


@checked_call("bq.routes.cut(route, 0.0, 2.0)")
def cut(route: Route, from_m: float = 0.0, to_m: float | None = None) -> Route:
    """Return the part of a route between two distances along it.

    Parameters
    ----------
    route : Route
        The route; it is not changed.
    from_m, to_m : float [m]
        Distances along the route; without `to_m`, the part extends to the end.

    Returns
    -------
    Route
        The open part, at the same position in the map.

    Raises
    ------
    UsageError
        If the two distances are not on the route, in this order.

    Examples
    --------
    >>> cut(bq.guides.shapes.circle(0.5, 0.2), 0.0, 1.0)
    Route(460 poses, 5.0 s, 1.00 m, open)
    """
    s = distances_along(route.eta[:, :2])
    to_m = float(s[-1]) if to_m is None else to_m
    if not 0.0 <= from_m < to_m <= s[-1] + 1e-9:
        raise UsageError.of("route.cut", start_m=from_m, end_m=to_m, length_m=float(s[-1]))
    first = max(int(np.searchsorted(s, from_m, side="right")) - 1, 0)
    last = min(int(np.searchsorted(s, to_m)), len(s) - 1)
    kept_slice = slice(first, max(last, first + 1) + 1)
    return Route(
        route.t_s[kept_slice] - route.t_s[first], route.eta[kept_slice], route.nu[kept_slice], closed=False
    )


@checked_call("bq.routes.join(first, second)")
def join(first: Route, second: Route) -> Route:
    """Return two routes as one: the second begins where the first ends.

    Parameters
    ----------
    first, second : Route
        Open or closed; the second is moved so that its start is at the end of the first.

    Returns
    -------
    Route
        Closed if it ends within 0.3 m and 45° of its start, and is longer than 1.2 m.

    Raises
    ------
    UsageError
        If the first ends forward and the second begins backward, or the reverse.

    Examples
    --------
    >>> quarter = cut(bq.guides.shapes.circle(0.5, 0.2), 0.0, 0.785)
    >>> join(quarter, quarter)
    Route(721 poses, 7.9 s, 1.57 m, open)
    """
    if first.nu[-1, 0] * second.nu[0, 0] < 0.0:
        raise UsageError.of(
            "route.join-reverses",
            baqueano_command("route", "reverse", NAME_PLACEHOLDER, "--backing"),
            first_m_s=float(first.nu[-1, 0]),
            second_m_s=float(second.nu[0, 0]),
        )
    shifted_route = move_route(second._replace(eta=relative_poses(second.eta)), first.eta[-1])
    eta = np.concatenate([first.eta, shifted_route.eta[1:]])
    t_s = np.concatenate([first.t_s, first.t_s[-1] + second.t_s[1:]])
    nu = np.concatenate([first.nu, second.nu[1:]])
    route = Route(t_s, eta, nu, closed=False)
    return route._replace(closed=has_close_ends(route))


@checked_call("bq.routes.reverse(route)")
def reverse(route: Route, backing: bool = False) -> Route:
    """Return a route in the other direction: from its end to its start.

    Parameters
    ----------
    route : Route
        The route; it is not changed.
    backing : bool
        True: the vehicle passes the same poses backward. False: the vehicle is turned by 180° and drives forward.

    Returns
    -------
    Route
        At the same position in the map, with the same length and duration; closed if `route` is closed.

    Notes
    -----
    Equations (1) and (2) of the module.

    Examples
    --------
    >>> there = bq.guides.shapes.circle(0.5, 0.2)
    >>> back = reverse(there)
    >>> print(back.nu[0].round(2))
    [ 0.2  0.  -0.4]
    """
    eta, t_s = route.eta[::-1].copy(), route.t_s[-1] - route.t_s[::-1]
    if backing:
        return route._replace(t_s=t_s, eta=eta, nu=-route.nu[::-1])
    eta[:, 2] += np.pi
    eta[:, 2] -= 2.0 * np.pi * np.round(eta[0, 2] / (2.0 * np.pi))
    return route._replace(t_s=t_s, eta=eta, nu=route.nu[::-1] * np.array([1.0, 1.0, -1.0]))


@checked_call("bq.routes.scale(route, 0.5)")
def scale(route: Route, factor: float) -> Route:
    """Return a route of another size, driven at the same speed.

    Parameters
    ----------
    route : Route
        The route; it is not changed.
    factor : float
        Ratio between the lengths of the new and the old route [no unit], above 0.

    Returns
    -------
    Route
        From the same start; times grow with the lengths, curvatures and yaw rates shrink with them.

    Raises
    ------
    UsageError
        For a factor that is not a positive number.

    Examples
    --------
    >>> scale(bq.guides.shapes.circle(0.5, 0.2), 2.0)
    Route(1441 poses, 31.4 s, 6.28 m, closed)
    """
    if not (np.isfinite(factor) and factor > 0.0):
        raise UsageError.of("route.factor", value=factor)
    xy = route.eta[0, :2] + factor * (route.eta[:, :2] - route.eta[0, :2])
    eta = np.column_stack([xy, route.eta[:, 2]])
    return route._replace(t_s=factor * route.t_s, eta=eta, nu=route.nu * np.array([1.0, 1.0, 1.0 / factor]))


def has_close_ends(route: Route) -> bool:
    """Return True if a route longer than 4 MAX_END_GAP_M ends within MAX_END_GAP_M and MAX_END_GAP_RAD of its start."""
    end_gap = route.eta[-1] - route.eta[0]
    is_close = (
        np.hypot(end_gap[0], end_gap[1]) <= MAX_END_GAP_M and abs(float(wrap(end_gap[2]))) <= MAX_END_GAP_RAD
    )
    return bool(is_close and distances_along(route.eta[:, :2])[-1] > 4.0 * MAX_END_GAP_M)
