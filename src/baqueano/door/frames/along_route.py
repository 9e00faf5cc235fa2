"""Follow the progress of a vehicle along a route, tick by tick.

Of the segments within REACH_M of the last position, measured along the route, the nearest one is used. The progress
therefore does not jump where a route crosses itself, as a figure of eight does. If no segment is within REACH_M, the
nearest segment of the whole route is used:

  s = s_k + t · (p − p_k),  t = (p_{k+1} − p_k)/|p_{k+1} − p_k|,  cross = t × (p − p_k)                  (1)
"""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from baqueano.guides.route import Route

REACH_M = 0.3


class AlongRoute:
    """A tracker of the progress of a vehicle that begins at the route's first pose."""

    def __init__(self, route: "Route") -> None:
        p = np.asarray(route.eta[:, :2], dtype=float)
        d = np.diff(p, axis=0)
        length = np.hypot(d[:, 0], d[:, 1])
        moves = length > 1e-9  # a turn on the spot has no length
        self._p, self._length = p[:-1][moves], length[moves]
        self._t = d[moves] / self._length[:, None]
        self._s = np.concatenate([[0.0], np.cumsum(self._length)])[:-1]
        self._closed, self.length_m = bool(route.closed), float(np.sum(self._length))
        self._progress_m = 0.0

    def where(self, eta: list[float]) -> tuple[float, float]:
        """Return the progress over all laps [m], and the cross-track distance [m], positive to the left.  (1)

        Both are NaN for a position that is not finite, or a route without length.
        """
        if not len(self._s) or not np.isfinite(eta[0] + eta[1]):
            return float("nan"), float("nan")
        off = np.array(eta[:2]) - self._p
        along = np.clip(off[:, 0] * self._t[:, 0] + off[:, 1] * self._t[:, 1], 0.0, self._length)
        ahead = self._s + along - self._progress_m
        if self._closed:
            ahead -= self.length_m * np.round(ahead / self.length_m)
        gap = (off[:, 0] - along * self._t[:, 0]) ** 2 + (off[:, 1] - along * self._t[:, 1]) ** 2
        near = np.abs(ahead) <= REACH_M
        k = int(np.argmin(np.where(near, gap, np.inf) if near.any() else gap))
        self._progress_m = max(0.0, self._progress_m + float(ahead[k]))
        side = self._t[k, 0] * off[k, 1] - self._t[k, 1] * off[k, 0]
        return self._progress_m, float(np.copysign(np.sqrt(gap[k]), side))
