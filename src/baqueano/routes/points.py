"""A route through points: from a CSV file, a drawing, or clicks on a map."""

from collections.abc import Iterator

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.routes.path import GRID_M, STEP_M, RoutePath, distances_along, route_along

MAX_LEG_M = 20.0  # largest distance between two points
MIN_CORNER_COUNT, CORNER_STEP_M = 40, 1e-3  # steps of a parabola: a tenth of GRID_M gives an even curvature


@checked_call("bq.routes.through_points([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 0.2)")
def through_points(xy: np.ndarray, speed_m_s: float, *, closed: bool = False, corner_m: float = 0.1) -> Route:
    """Return a route along straight lines between points, with round corners.

    Parameters
    ----------
    xy : array_like (m, 2) [m]
        Points in the map, in the order in which they are driven.
    speed_m_s : float
        Speed along the path.
    closed : bool
        True if the route returns from the last point to the first.
    corner_m : float [m]
        Distance before a corner at which the bend begins; less if points lie close together.

    Returns
    -------
    Route
        A route with a pose every centimetre. Corners are parabolas, so the route passes each point at less than
        corner_m / 2. If several points are within a millimetre, one of them is used.

    Raises
    ------
    UsageError
        If there are fewer than two different points, a point is not finite, or the speed is not positive. If two
        neighbours are farther apart than 20 m.

    Examples
    --------
    >>> through_points([(0, 0), (1, 0), (1, 1)], 0.2)
    Route(197 poses, 9.8 s, 1.96 m, open)
    """
    points = np.atleast_2d(np.array(xy, dtype=float))
    if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < 2:
        raise UsageError.of("route.points", value=str(np.shape(xy)))
    is_wrong = ~np.isfinite(points).all(axis=1)
    if is_wrong.any():
        raise UsageError.of("route.point-not-finite", number=int(np.argmax(is_wrong)) + 1)
    if not (np.isfinite(speed_m_s) and speed_m_s > 0.0):
        raise UsageError.of("route.speed", value=speed_m_s)
    numbers = np.array(_different_points(points, closed=closed))
    if len(numbers) < 2:
        raise UsageError.of("route.no-way", length_m=float(distances_along(points)[-1]))
    numbers = np.append(numbers, 0) if closed else numbers
    corners = points[numbers]
    legs = np.hypot(*np.diff(corners, axis=0).T)
    if (is_wrong := legs > MAX_LEG_M).any():
        k = int(np.argmax(is_wrong))
        first, second = (int(number) + 1 for number in numbers[k : k + 2])
        raise UsageError.of("route.points-far", first=first, second=second, distance_m=float(legs[k]))
    rounded_points = np.concatenate(list(_round_corners(corners, legs, closed=closed, corner_m=corner_m)))
    s = distances_along(rounded_points)
    kept_mask = np.append(True, np.diff(s) > 1e-9)
    s, rounded_points = s[kept_mask], rounded_points[kept_mask]
    grid = np.linspace(0.0, s[-1], max(4, round(s[-1] / GRID_M) + 1))
    line = np.column_stack([np.interp(grid, s, column) for column in rounded_points.T])
    step = np.diff(rounded_points, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    midpoints = 0.5 * (s[1:] + s[:-1])
    if closed:
        turn = 2.0 * np.pi * np.round((heading[-1] - heading[0]) / (2.0 * np.pi))
        heading = np.concatenate([[heading[-1] - turn], heading, [heading[0] + turn]])
        midpoints = np.concatenate([[midpoints[-1] - s[-1]], midpoints, [midpoints[0] + s[-1]]])
    course = np.interp(grid, midpoints, heading)
    path = RoutePath(grid, line, course, np.gradient(course, grid))
    return route_along(path, np.full(len(grid), float(speed_m_s)), 1.0, closed=closed)


def _different_points(points: np.ndarray, *, closed: bool) -> list[int]:
    """Return the indices of points (m, 2) that are STEP_M or more from the last one, and of the first if closed."""
    indices = [0]
    for k in range(1, len(points)):
        if np.hypot(*(points[k] - points[indices[-1]])) >= STEP_M:
            indices.append(k)
    while closed and len(indices) > 1 and np.hypot(*(points[indices[-1]] - points[0])) < STEP_M:
        indices.pop()
    return indices


def _round_corners(
    corners: np.ndarray, legs: np.ndarray, *, closed: bool, corner_m: float
) -> Iterator[np.ndarray]:
    """Yield the first point (1, 2), the parabola (k, 2) of each corner, and the last point (1, 2).
    A closed line begins at the end of its last parabola, and its last point is not yielded separately.
    """
    inner_corners = range(1, len(corners) - (0 if closed else 1))
    first, last = corners[0], corners[-1]
    pieces = []
    for k in inner_corners:
        next_corner = corners[1] if k == len(corners) - 1 else corners[k + 1]
        next_leg = legs[0] if k == len(corners) - 1 else legs[k]
        distance = min(corner_m, 0.45 * legs[k - 1], 0.45 * next_leg)
        a = corners[k] + (corners[k - 1] - corners[k]) * distance / legs[k - 1]
        b = corners[k] + (next_corner - corners[k]) * distance / next_leg
        count = max(MIN_CORNER_COUNT, int(2.0 * distance / CORNER_STEP_M))
        t = np.linspace(0.0, 1.0, count + 1)[:, None]
        pieces.append((1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * corners[k] + t**2 * b)
    if closed:
        first = last = pieces[-1][-1]
    yield first[None]
    yield from pieces
    if not closed:
        yield last[None]
