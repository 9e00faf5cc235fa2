"""Find the point of a route that is nearest to a vehicle, near one time of the route.

    k = argmin |p − p_i|² + (HEADING_WEIGHT_M (ψ − ψ_i))²,   |s_i − s(τ)| ≤ reach_m                       (1)

The points are poses of the route about MIN_SPACING_M apart, and points between poses that are more than MAX_SPACING_M
apart. A piece of the route ends where its direction changes; only points on the piece of the time τ are searched, so
that no crossing or cusp is a short cut.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.geometry import wrap

HEADING_WEIGHT_M = 0.1  # of a radian
MIN_SPACING_M, MAX_SPACING_M = 0.04, 0.05
MIN_SPEED_M_S = 0.02  # a slower pose belongs to the piece before it
FAR_M2 = 1e9  # squared distance of a point that is not valid


class NearPoints(NamedTuple):
    """The k points near one time of the route."""

    eta: Value  # (k, 3) poses
    lag_m: Value  # (k,) distance along the route from the point to that of the time
    is_valid: Value  # (k,) True within reach, on the route, and on the same piece

    def nearest(self, eta: Value) -> tuple[list[Value], Value]:
        """Return the pose [x, y, ψ] and the lag [m] of the point nearest to the pose `eta` (3,).  (1)"""
        squared_distances = (self.eta[:, 0] - eta[0]) ** 2 + (self.eta[:, 1] - eta[1]) ** 2
        squared_distances = squared_distances + (HEADING_WEIGHT_M * wrap(self.eta[:, 2] - eta[2])) ** 2
        squared_distances = np.where(self.is_valid, squared_distances, FAR_M2)
        is_nearest = squared_distances <= np.min(squared_distances)
        count = np.sum(np.where(is_nearest, 1.0, 0.0))
        *pose, lag_m = (
            np.sum(np.where(is_nearest, column, 0.0)) / count for column in (*self.eta.T, self.lag_m)
        )
        return pose, lag_m


class RoutePoints(NamedTuple):
    """The m points of a route."""

    t_s: np.ndarray  # (m,) times
    eta: np.ndarray  # (m, 3) poses
    s: np.ndarray  # (m,) distances along the route [m]
    piece: np.ndarray  # (m,) number of the piece

    def near(self, t: Value, reach_m: float, is_closed: bool) -> NearPoints:
        """Return the points within `reach_m` of the time `t` [s], with other points that are not valid.

        If the window around `t` is shorter than the route, only its points are returned: the compiled step is shorter.
        """
        last, (behind, in_front) = len(self.s) - 1, self._window(reach_m, is_closed)
        eta, s, piece, is_on_route = self.eta, self.s, self.piece, 1.0
        if behind + in_front < last - 1:
            indices = np.arange(last + 1, dtype=float)
            k = np.floor(np.interp(t, self.t_s, indices)) + np.arange(-behind, in_front + 2)
            if is_closed:
                k = k - last * np.floor(k / last)  # the last point equals the first one
            is_on_route = np.where((k >= 0.0) & (k <= float(last)), 1.0, 0.0)
            eta = np.stack([np.interp(k, indices, column) for column in eta.T], axis=1)
            s, piece = np.interp(k, indices, s), np.interp(k, indices, piece)
        lag_m = np.interp(t, self.t_s, self.s) - s
        if is_closed and self.s[-1] > 0.0:
            lag_m = lag_m - self.s[-1] * np.floor(lag_m / self.s[-1] + 0.5)
        is_valid = (np.abs(lag_m) <= reach_m) & (is_on_route > 0.0)
        if np.any(self.piece > 0.0):
            is_valid = is_valid & (np.abs(piece - np.interp(t, self.t_s, self.piece)) < 1.0)
        return NearPoints(eta, lag_m, is_valid)

    def _window(self, reach_m: float, is_closed: bool) -> tuple[int, int]:
        """Return the largest number of points within `reach_m` of a point: behind this point, and in front of it."""
        s = (
            np.concatenate([self.s - self.s[-1], self.s[1:], self.s[1:] + self.s[-1]])
            if is_closed
            else self.s
        )
        first = np.searchsorted(s, s - (reach_m + 1e-9), side="left")
        last = np.searchsorted(s, s + (reach_m + 1e-9), side="right")
        indices = np.arange(len(s))
        return int(np.max(indices - first)), int(np.max(last - indices)) - 1


def route_points(t_s: np.ndarray, eta: np.ndarray, nu: np.ndarray) -> RoutePoints:
    """Return the points of a route with times (n,), poses (n, 3) and velocities (n, 3)."""
    s = distances_m(eta)
    counts = np.maximum(
        np.ceil(np.hypot(np.diff(eta[:, 0]), np.diff(eta[:, 1])) / MAX_SPACING_M), 1.0
    ).astype(int)
    first, segment = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts)
    fraction = (np.arange(len(segment)) - first[segment]) / counts[segment]
    index = np.append(segment + fraction, len(counts))
    t, *pose, s = (np.interp(index, np.arange(len(t_s)), column) for column in (t_s, *eta.T, s))
    turn_m = HEADING_WEIGHT_M * np.append(0.0, np.cumsum(np.abs(np.diff(pose[2]))))
    is_kept = np.append(True, np.diff(np.floor((s + turn_m) / MIN_SPACING_M)) > 0.0)
    is_kept[-1] = True
    t = t[is_kept]
    return RoutePoints(t, np.column_stack(pose)[is_kept], s[is_kept], np.interp(t, t_s, _pieces(nu)))


def distances_m(eta: np.ndarray) -> np.ndarray:
    """Return the distances (n,) [m] along the route of its poses (n, 3)."""
    return np.append(0.0, np.cumsum(np.hypot(np.diff(eta[:, 0]), np.diff(eta[:, 1]))))


def _pieces(nu: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the piece of each pose; a piece ends where the route changes its direction."""
    sign = np.where(np.abs(nu[:, 0]) < MIN_SPEED_M_S, 0.0, np.sign(nu[:, 0]))
    last_moving = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
    return np.append(0.0, np.cumsum(sign[last_moving][1:] * sign[last_moving][:-1] < 0.0))
