"""Find places of a route where the path between two poses is not known.

    jump    |Δp| > JUMP_M + 2 v Δt                      farther than the speed v allows                   (1)
    gap     Δt > MANY median(Δt),  |Δp| > MANY median(|Δp|),  |Δp| > LEAST_M      samples are missing     (2)
    corner  |Δp| |tan(Δψ / 4)| / 2 > OFF_M              the arc between the headings deviates too much    (3)

Δp, Δψ, Δt: change of position, heading and time between two poses. The medians of (2) include only samples in motion,
without stops and starts from rest. A guide moves straight from pose to pose. So the height of the arc over its chord
|Δp|, (3), is the distance between guide and path.
"""

import numpy as np

from baqueano.diagnostics import Diagnostic, fault
from baqueano.guides.route import Route
from baqueano.messages.printable import baqueano_command
from baqueano.routes.path import NAME, STEP_M

JUMP_M = 0.1  # allowed distance between two poses, in addition to the distance by the speed
MANY = 5.0
LEAST_M = 0.05
OFF_M = 0.05


def unknown_places(route: Route, s: np.ndarray) -> list[Diagnostic]:
    """Return a list with the finding about the first kind of fault, or an empty list; `s` (m,) [m] is the distance
    along it.

    The kinds are tested in this order: numbers that are not finite, then jumps, then gaps and corners.
    """
    numbers = np.column_stack([route.t_s, route.eta, route.nu])
    wrong = ~np.isfinite(numbers).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        return [
            fault("route.no-number", baqueano_command("teach", NAME), row=row + 1, count=int(wrong.sum()))
        ]
    step, dt_s = np.diff(s), np.diff(route.t_s)
    speed = np.maximum(np.abs(route.nu[1:, 0]), np.abs(route.nu[:-1, 0]))
    jumps = step > JUMP_M + 2.0 * speed * dt_s  # (1)
    if jumps.any():
        return [_place("route.jump", route, s, jumps)]
    moves = step > 0.1 * STEP_M
    if not moves.any():
        return []
    long_s, long_m = MANY * np.median(dt_s[moves]), max(MANY * np.median(step[moves]), LEAST_M)
    gaps = (dt_s > long_s) & (step > long_m)  # (2)
    turn = np.minimum(np.abs(np.diff(np.unwrap(route.eta[:, 2]))), np.pi)
    gaps |= 0.5 * step * np.tan(0.25 * turn) > OFF_M  # (3)
    return [_place("route.gap", route, s, gaps)] if gaps.any() else []


def _place(code: str, route: Route, s: np.ndarray, mask: np.ndarray) -> Diagnostic:
    """Return a finding with the place and the count of the True entries of the mask."""
    k = int(np.argmax(mask))
    figures = {"count": int(mask.sum()), "at_m": float(s[k]), "at_s": float(route.t_s[k])}
    figures |= {"gap_m": float(s[k + 1] - s[k]), "gap_s": float(route.t_s[k + 1] - route.t_s[k])}
    return fault(code, baqueano_command("route", "cut", NAME, "--to", f"{s[k]:.2f}"), **figures)
