"""Follow the progress of a vehicle along a route, tick by tick.

Of the segments within MAX_ADVANCE_M of the last position, measured along the route, the nearest one is used. The
progress therefore does not jump where a route crosses itself, as a figure of eight does. If no segment is within
MAX_ADVANCE_M, the nearest segment of the whole route is used:

  s = s_k + t · (p − p_k),  t = (p_{k+1} − p_k)/|p_{k+1} − p_k|,  |cross| = distance to the segment      (1)
"""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from baqueano.guides.route import Route

MAX_ADVANCE_M = 0.3


class RouteProgress:
    """A tracker of the progress of a vehicle that begins at the route's first pose."""

    def __init__(self, route: "Route") -> None:
        p = np.asarray(route.eta[:, :2], dtype=float)
        d = np.diff(p, axis=0)
        length = np.hypot(d[:, 0], d[:, 1])
        has_length = length > 1e-9  # a turn in place does not have a length
        self._p, self._length = p[:-1][has_length], length[has_length]
        self._t = d[has_length] / self._length[:, None]
        self._s = np.concatenate([[0.0], np.cumsum(self._length)])[:-1]
        self._is_closed, self.length_m = bool(route.closed), float(np.sum(self._length))
        self._progress_m = 0.0

    def update(self, eta: list[float]) -> tuple[float, float]:
        """Return the progress over all laps [m], and the cross-track distance [m], positive to the left.  (1)

        Both are NaN for a position that is not finite, or a route without length.
        """
        if not len(self._s) or not np.isfinite(eta[0] + eta[1]):
            return float("nan"), float("nan")
        offsets = np.array(eta[:2]) - self._p
        along_m = np.clip(offsets[:, 0] * self._t[:, 0] + offsets[:, 1] * self._t[:, 1], 0.0, self._length)
        advance_m = self._s + along_m - self._progress_m
        if self._is_closed:
            advance_m -= self.length_m * np.round(advance_m / self.length_m)
        distances2 = (offsets[:, 0] - along_m * self._t[:, 0]) ** 2 + (
            offsets[:, 1] - along_m * self._t[:, 1]
        ) ** 2
        is_near = np.abs(advance_m) <= MAX_ADVANCE_M
        k = int(np.argmin(np.where(is_near, distances2, np.inf) if is_near.any() else distances2))
        self._progress_m = max(0.0, self._progress_m + float(advance_m[k]))
        side = self._t[k, 0] * offsets[k, 1] - self._t[k, 1] * offsets[k, 0]
        return self._progress_m, float(np.copysign(np.sqrt(distances2[k]), side))
