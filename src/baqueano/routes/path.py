"""The path of a route: its positions, without the time in which it is driven.

    s_k = Σ |p_j − p_{j−1}|,   κ = dχ/ds,   ψ = χ forward,  χ + π backward                                (1)
    ν = ± v (cos β, sin β, κ),   β = atan(ν_y / ν_x)                                                      (2)

p is the position, s the distance along the path, κ the curvature, ψ the heading, v the speed, ν the velocity. β is the
slip: the vehicle moves in the direction χ + β, for example the origin of a car ahead of its rear axle. Samples closer
than STEP_M belong to a stop, or to a turn on the spot, and are excluded.
"""

from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.messages.printable import baqueano_command

NAME_PLACEHOLDER = "NAME"  # placeholder for the name of a route in a command line
STEP_M = 1e-3  # a shorter step is a stop
GRID_M = 0.01  # distance between the points of a new path
MIN_SPEED_M_S = 0.02  # a vehicle with a larger backward speed drives backward
# a route closes if its start and end are nearer than this
MAX_END_GAP_M, MAX_END_GAP_RAD = (0.3, np.radians(45.0))


class RoutePath(NamedTuple):
    """A path: its points, with distance, direction and curvature.

    Attributes
    ----------
    s : ndarray (m,) [m]
        Distance from the first point, increasing.
    xy : ndarray (m, 2) [m]
        Positions in the map.
    course : ndarray (m,) [rad]
        χ, the heading of a forward drive, continuous.
    kappa : ndarray (m,) [1/m]
        Curvature; positive to the left.
    slip : ndarray (m,) [rad]
        β, the angle from χ to the direction of travel.
    """

    s: np.ndarray
    xy: np.ndarray
    course: np.ndarray
    kappa: np.ndarray
    slip: np.ndarray | float = 0.0


def distances_along(xy: np.ndarray) -> np.ndarray:
    """Return the distance s (m,) [m] from the first point along points (m, 2).  (1)"""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))


def moving_indices(route: Route) -> np.ndarray:
    """Return the indices (k,) of samples that are about STEP_M or more apart: without stops, with the last sample.

    Raise UsageError if fewer than four samples remain: the vehicle was at rest, or turned on the spot.
    """
    s = distances_along(route.eta[:, :2])
    cell = np.floor(s / STEP_M)
    indices = np.flatnonzero(np.diff(cell, prepend=-1.0) > 0.0)
    if indices[-1] != len(s) - 1:
        indices = np.append(
            indices[:-1] if s[-1] - s[indices[-1]] < STEP_M and len(indices) > 1 else indices, len(s) - 1
        )
    if len(indices) < 4:
        raise UsageError.of("route.no-way", length_m=float(s[-1]))
    return indices


def direction(route: Route) -> float:
    """Return 1 for a route that is driven forward, −1 for backward. Raise UsageError with the place if it is both."""
    speed = route.nu[:, 0]
    is_backward, is_forward = speed < -MIN_SPEED_M_S, speed > MIN_SPEED_M_S
    if np.any(is_backward) and np.any(is_forward):
        changes = np.flatnonzero(np.diff(np.sign(speed[is_backward | is_forward])))
        first = np.flatnonzero(is_backward | is_forward)[changes[0] + 1]
        place_m = float(distances_along(route.eta[:, :2])[first])
        raise UsageError.of(
            "route.both-ways",
            cut_command(distances_along(route.eta[:, :2]), int(first) - 1),
            position_m=place_m,
            count=len(changes),
        )
    return -1.0 if np.any(is_backward) else 1.0


def cut_command(s: np.ndarray, k: int) -> str:
    """Return the command that keeps a route up to its sample k, at the distances s (m,), in whole centimetres.

    If this part is shorter than a centimetre, the command keeps the rest, from the sample k + 1 on.
    """
    begin_m, end_m = np.floor(100.0 * s[k] - 1e-6) / 100.0, np.ceil(100.0 * s[k + 1] + 1e-6) / 100.0
    if begin_m > 0.0:
        return baqueano_command("route", "cut", NAME_PLACEHOLDER, "--to", f"{begin_m:.2f}")
    return baqueano_command("route", "cut", NAME_PLACEHOLDER, "--from", f"{end_m:.2f}")


def route_along(path: RoutePath, speed: np.ndarray, forward_sign: float, *, closed: bool) -> Route:
    """Return the route along a path with the speeds (m,) > 0 [m/s]; `forward_sign` −1 drives it backward.  (2)"""
    rate = 0.5 * (speed[1:] + speed[:-1])
    t_s = np.append(0.0, np.cumsum(np.diff(path.s) / rate))
    psi = path.course if forward_sign > 0.0 else path.course + np.pi
    forward_m_s, sideways_m_s = (
        forward_sign * speed * np.cos(path.slip),
        forward_sign * speed * np.sin(path.slip),
    )
    nu = np.column_stack([forward_m_s, sideways_m_s, path.kappa * speed])
    return Route(t_s, np.column_stack([path.xy, psi]), nu, closed)


def route_path(route: Route) -> RoutePath:
    """Return the path of a route as it was taught; the curvature is computed from the headings.  (1)"""
    indices = moving_indices(route)
    xy = route.eta[indices, :2]
    s = distances_along(xy)
    psi = np.unwrap(route.eta[indices, 2]) + (np.pi if direction(route) < 0.0 else 0.0)
    v_x, v_y = route.nu[indices, 0], route.nu[indices, 1]
    slip = np.arctan(v_x * v_y / (v_x**2 + MIN_SPEED_M_S**2))  # 0 at rest
    return RoutePath(s, xy, psi, np.gradient(psi, s), slip)
