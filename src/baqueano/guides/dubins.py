"""The shortest path between two poses: two arcs of the radius R and a straight line between them.

    (x, y)/R of the goal relative to the start is turned to (D, 0); α, β: headings of start and goal after this turn
    LSL  p² = 2 + D² − 2 cos(α − β) + 2 D (sin α − sin β),   χ = atan2(cos β − cos α, D + sin α − sin β)
    LSR  p² = D² − 2 + 2 cos(α − β) + 2 D (sin α + sin β),   χ = atan2(−cos α − cos β, D + sin α + sin β) + atan2(2, p)
    t = (χ − α) mod 2π,   q = (β − χ) mod 2π of LSL, (χ − β) mod 2π of LSR                                 (1)
    RSR and RSL are LSL and LSR of the mirrored problem (−α, −β); length = R (t + p + q)                  (2)

The word LSL means left arc, straight, left arc. t and q are the angles of the arcs, p R is the length of the line, χ
its heading. Source: Dubins, American Journal of Mathematics, 1957; Shkel and Lumelsky, Robotics and Autonomous Systems,
2001. Departure: words of three arcs, which are shorter for some goals nearer than 4 R, are excluded. LSL and RSR always
exist.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value

FULL_TURN = 2.0 * np.pi
ROUNDING_RAD = 1e-9  # an angle below zero by less than this is 0, not a full turn
MISSING_LENGTH_M = 1e9  # length of a word that does not exist
ARC_DIRECTIONS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # first and last arc; 1 turns left


class DubinsPath(NamedTuple):
    """A path of two arcs and the line between them."""

    length_m: Value
    arcs_m: Value  # (3,) lengths of the first arc, the line and the last arc
    turns: Value  # (2,) of the arcs: 1 left, −1 right


def shortest_dubins_path(start: Value, goal: Value, radius_m: float) -> DubinsPath:
    """Return the shortest path from the pose `start` (3,) to the pose `goal` (3,).  (1), (2)

    `goal` can also be (3, k), the x, y and ψ of k goals; the result then contains the path to each goal. `radius_m` is
    R.
    """
    dx, dy = (goal[0] - start[0]) / radius_m, (goal[1] - start[1]) / radius_m
    D, bearing = np.sqrt(dx * dx + dy * dy), np.arctan2(dy, dx)
    shortest_path = None
    for first, last in ARC_DIRECTIONS:
        t, p, q, exists = _solve_word(
            D, first * (start[2] - bearing), first * (goal[2] - bearing), first == last
        )
        length_m = np.where(exists, radius_m * (t + p + q), MISSING_LENGTH_M)
        arcs_m = radius_m * np.array([t, p, q])
        path = DubinsPath(length_m, arcs_m, np.array([first + 0.0 * t, last + 0.0 * t]))
        shortest_path = path if shortest_path is None else shorter_path(path, shortest_path)
    assert shortest_path is not None
    return shortest_path


def shorter_path(first: DubinsPath, second: DubinsPath) -> DubinsPath:
    """Return the shorter of two paths, `second` if both are equally long."""
    is_shorter = first.length_m < second.length_m
    return DubinsPath(*(np.where(is_shorter, a, b) for a, b in zip(first, second, strict=True)))


def pose_at(start: Value, path: DubinsPath, sigma_m: Value, radius_m: float) -> tuple[Value, Value]:
    """Return the pose (3,) and curvature [1/m] after `sigma_m` of a path from `start`; the heading is continuous."""
    x, y, psi = start[0], start[1], start[2]
    left_m, kappa = sigma_m, 0.0 * sigma_m
    for k, turn in enumerate((path.turns[0], 0.0, path.turns[1])):
        ds = np.clip(left_m, 0.0, path.arcs_m[k])
        curvature = turn / radius_m
        mean_heading = psi + 0.5 * curvature * ds
        half_angle = 0.5 * curvature * ds
        is_straight = np.abs(half_angle) < ROUNDING_RAD
        chord = np.where(is_straight, ds, ds * np.sin(half_angle) / np.where(is_straight, 1.0, half_angle))
        x, y, psi = x + chord * np.cos(mean_heading), y + chord * np.sin(mean_heading), psi + curvature * ds
        kappa = np.where(left_m > 0.0, curvature, kappa)
        left_m = left_m - path.arcs_m[k]
    return np.array([x, y, psi]), kappa


def _solve_word(D: Value, alpha: Value, beta: Value, is_same_side: bool) -> tuple[Value, Value, Value, Value]:
    """Return t, p, q of LSL if `is_same_side`, else of LSR, and True if this word exists.  (1)"""
    sa, sb, ca, cb = np.sin(alpha), np.sin(beta), np.cos(alpha), np.cos(beta)
    if is_same_side:
        square = 2.0 + D * D - 2.0 * np.cos(alpha - beta) + 2.0 * D * (sa - sb)
        p = np.sqrt(np.maximum(square, 0.0))
        chi = np.arctan2(cb - ca, D + sa - sb)
        return _positive_angle(chi - alpha), p, _positive_angle(beta - chi), square >= -ROUNDING_RAD
    square = D * D - 2.0 + 2.0 * np.cos(alpha - beta) + 2.0 * D * (sa + sb)
    p = np.sqrt(np.maximum(square, 0.0))
    chi = np.arctan2(-ca - cb, D + sa + sb) + np.arctan2(2.0, p)
    return _positive_angle(chi - alpha), p, _positive_angle(chi - beta), square >= 0.0


def _positive_angle(angle: Value) -> Value:
    """Return an angle in the range 0 to 2π."""
    return angle + ROUNDING_RAD - FULL_TURN * np.floor((angle + ROUNDING_RAD) / FULL_TURN)
