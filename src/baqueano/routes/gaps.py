"""Find places of a route where the path between two poses is not known.

    jump    |Δp| > MAX_JUMP_M + 2 v Δt                      farther than the speed v allows                   (1)
    ends    |p_m − p_1| > MAX_END_GAP_M                     of a closed route: the next lap begins elsewhere
    gap     Δt > GAP_FACTOR median(Δt),  |Δp| > GAP_FACTOR median(|Δp|),  |Δp| > MIN_GAP_M   samples are missing     (2)
    turn    |Δψ| > MAX_TURN_RAD + 2 |r| Δt                   more than the yaw rate r allows                (3)
    corner  |Δp| |tan(Δψ / 4)| / 2 > MAX_CORNER_OFFSET_M           the arc between the headings deviates too much    (4)

Δp, Δψ, Δt: change of position, heading and time between two poses. The medians of (2) include only samples in motion,
without stops and starts from rest. A guide moves straight from pose to pose. So the height of the arc over its chord
|Δp|, (4), is the distance between guide and path.
"""

import numpy as np

from baqueano.diagnostics import Diagnostic, fault
from baqueano.geometry import wrap
from baqueano.guides.route import Route
from baqueano.messages.printable import baqueano_command
from baqueano.routes.path import MAX_END_GAP_M, NAME_PLACEHOLDER, STEP_M, cut_command

MAX_JUMP_M = 0.1  # allowed distance between two poses, in addition to 2 v Δt
MAX_TURN_RAD = np.radians(45.0)  # allowed turn between two poses, in addition to 2 r Δt
GAP_FACTOR = 5.0
MIN_GAP_M = 0.05
MAX_CORNER_OFFSET_M = 0.05


def route_gaps(route: Route, s: np.ndarray) -> list[Diagnostic]:
    """Return a list with a finding about the first kind of fault in the route, or an empty list.

    `s` (m,) [m] is the distance along the route. The kinds are tested in this order: values that are not finite, times,
    jumps, ends, turns, gaps and corners.
    """
    columns = np.column_stack([route.t_s, route.eta, route.nu])
    is_not_finite = ~np.isfinite(columns).all(axis=1)
    if is_not_finite.any():
        row = int(np.argmax(is_not_finite))
        return [
            fault(
                "route.no-number",
                baqueano_command("teach", NAME_PLACEHOLDER),
                row=row + 1,
                count=int(is_not_finite.sum()),
            )
        ]
    step, dt_s = np.diff(s), np.diff(route.t_s)
    if np.any(dt_s <= 0.0):
        advice = baqueano_command("route", "faster", NAME_PLACEHOLDER, "--speed", "0.2")
        return [fault("route.time-order", advice, row=int(np.argmax(dt_s <= 0.0)) + 2)]
    speed = np.maximum(np.abs(route.nu[1:, 0]), np.abs(route.nu[:-1, 0]))
    is_jump = step > MAX_JUMP_M + 2.0 * speed * dt_s  # (1)
    if is_jump.any():
        return [_gap_finding("route.jump", route, s, is_jump)]
    end_gap_m = float(np.hypot(*(route.eta[-1, :2] - route.eta[0, :2])))
    if route.closed and end_gap_m > MAX_END_GAP_M:
        advice = baqueano_command("route", "cut", NAME_PLACEHOLDER, "--from", "0")
        return [fault("route.open-ends", advice, gap_m=end_gap_m)]
    turn = np.abs(wrap(np.diff(route.eta[:, 2])))
    yaw_rate = np.maximum(np.abs(route.nu[1:, 2]), np.abs(route.nu[:-1, 2]))
    is_sudden = turn > MAX_TURN_RAD + 2.0 * yaw_rate * dt_s  # (3)
    if is_sudden.any():
        return [_gap_finding("route.sudden-turn", route, s, is_sudden)]
    is_moving = step > 0.1 * STEP_M
    if not is_moving.any():
        return []
    max_step_s = GAP_FACTOR * np.median(dt_s[is_moving])
    long_m = max(GAP_FACTOR * np.median(step[is_moving]), MIN_GAP_M)
    is_gap = (dt_s > max_step_s) & (step > long_m)  # (2)
    is_gap |= 0.5 * step * np.tan(0.25 * turn) > MAX_CORNER_OFFSET_M  # (4)
    return [_gap_finding("route.gap", route, s, is_gap)] if is_gap.any() else []


def _gap_finding(code: str, route: Route, s: np.ndarray, mask: np.ndarray) -> Diagnostic:
    """Return a finding with the place of the first True entry of the mask (m − 1,), and the number of such entries."""
    k = int(np.argmax(mask))
    figures = {"count": int(mask.sum()), "position_m": float(s[k]), "t_s": float(route.t_s[k])}
    figures |= {"gap_m": float(s[k + 1] - s[k]), "gap_s": float(route.t_s[k + 1] - route.t_s[k])}
    figures |= {"turn_deg": float(np.degrees(wrap(route.eta[k + 1, 2] - route.eta[k, 2])))}
    return fault(code, cut_command(s, k), **figures)
