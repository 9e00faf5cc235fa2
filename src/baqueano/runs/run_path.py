"""Make a route of the path that a drive estimated."""

import numpy as np

from baqueano.errors import AnswerNo
from baqueano.guides.route import Route, end_gap, with_closed_gap, with_flying_start
from baqueano.runs.run import Run
from baqueano.signals import seconds

ROUTE_RATE_HZ = 20.0  # poses per second of a taught route
STILL_M_S, STILL_RAD_S = 0.01, 0.05  # slower motion at both ends of a drive is removed
CLOSE_M, CLOSE_RAD, MIN_LOOP_M = 0.3, 0.6, 1.2  # of a closed drive: ends apart at most, length at least


def run_route(run: Run, *, closed: bool | None = False) -> Route:
    """Return the estimated path of a run at ROUTE_RATE_HZ, without the rest at both ends.

    If `closed` is None, the route is closed if the drive returned to its start. Raise AnswerNo for a run without
    estimates or motion, or if `closed` is True and the ends are too far apart.
    """
    log = run.without_rest.estimate
    stop = next((event.diagnostic for event in run.events if event.level == "error"), None)
    if log is None or len(log.t_ns) < 2:
        raise AnswerNo.of("route.stopped" if stop else "route.no-estimates", name=run.name, cause=stop)
    speed, turn = np.hypot(log.nu[:, 0], log.nu[:, 1]), np.abs(log.nu[:, 2])
    moving_indices = np.flatnonzero(((speed > STILL_M_S) | (turn > STILL_RAD_S)) & np.isfinite(speed + turn))
    if len(moving_indices) < 2:
        raise AnswerNo.of("route.stopped" if stop else "route.no-motion", name=run.name, cause=stop)
    first, last = max(moving_indices[0] - 1, 0), moving_indices[-1]
    t_s = seconds(log.t_ns[first : last + 1], log.t_ns[first])
    rows = np.unique(np.searchsorted(t_s, np.append(np.arange(0.0, t_s[-1], 1.0 / ROUTE_RATE_HZ), t_s[-1])))
    eta = log.eta[first : last + 1][rows].copy()
    eta[:, 2] = np.unwrap(eta[:, 2])
    route = Route(t_s[rows], eta, log.nu[first : last + 1][rows], closed=False)
    gap_m, gap_rad = end_gap(route)
    is_at_start = gap_m <= CLOSE_M and gap_rad <= CLOSE_RAD
    if closed and not is_at_start:
        gap, close = {"gap_m": gap_m, "gap_deg": np.degrees(gap_rad)}, np.degrees(CLOSE_RAD)
        raise AnswerNo.of("route.open", name=run.name, **gap, tolerance_m=CLOSE_M, tolerance_deg=close)
    length_m = float(np.sum(np.hypot(*np.diff(eta[:, :2], axis=0).T)))
    is_loop = is_at_start and length_m > MIN_LOOP_M if closed is None else closed
    return with_flying_start(with_closed_gap(route)) if is_loop else route
