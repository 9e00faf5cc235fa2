"""The path between two poses with a continuous curvature: two turns with clothoids and a straight line between them.

    κ′ = ± k:  κ_0 → s_1 κ_1,  arc,  s_1 κ_1 → 0,  line p,  0 → s_2 κ_2,  arc,  s_2 κ_2 → κ_g             (1)
    Ω_i: centre of arc i;  J(χ) q_1, J(χ) q_2: from Ω_1 to the start of the line, from Ω_2 to its end; q_i by (1)
    J(χ)ᵀ (Ω_2 − Ω_1) + q_2 − q_1 = (p, 0)     the heading χ and the length p ≥ 0 of the line             (2)
    t_1 = s_1 (χ − φ_1) − m_1,  t_2 = s_2 (φ_2 − χ) − m_2   mod 2π,   m_i = κ_i² / 2k                     (3)
    κ_i² = SHARE² (k θ_i + c_i²/2) ≤ 1/R²,   θ_1 = s_1 (χ − ψ_0), θ_2 = s_2 (ψ_g − χ)                     (4)

κ is the curvature, k its change per length, κ_0 and κ_g that of the start and the goal; s = 1 turns left, −1 right. t_i
is the angle of arc i, φ_i its heading next to κ_0 and κ_g, θ_i the angle of turn i, c_1 = s_1 κ_0, c_2 = s_2 κ_g. χ
follows from κ_i, and (4) from χ: the path of each iteration is exact, the shortest one is used. A vehicle at rest has
time to steer: its first turn begins with κ_0 = s_1 κ_1, and κ_1² = 2 SHARE² k θ_1. With a line before the first turn, a
path to a near goal exists. Source: Dubins, American Journal of Mathematics, 1957; Fraichard and Scheuer,
IEEE Transactions on Robotics, 2004. Departure: words of three turns are excluded.
"""

from typing import NamedTuple

import numpy as np

FULL_TURN = 2.0 * np.pi
ROUNDING_RAD = 1e-9  # an angle below zero by less than this is 0, not a full turn
ITERATION_COUNT = 12  # of (4)
CURVATURE_SHARE = (
    0.9  # of the largest curvature of a turn without an arc, so that the angle of the arc stays positive
)
FIRST_LINES = (0.0, 2.0, 8.0)  # length of the line before the first turn, in R + length of a clothoid
WORDS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # directions of the two turns
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # exact to 1e-9 for an angle of 2π


class ClothoidPath(NamedTuple):
    """A path of nine pieces whose curvature is linear in the length."""

    length_m: float
    piece_m: np.ndarray  # (9,) lengths
    kappa: np.ndarray  # (2, 9) [1/m], at the start and at the end of each piece
    eta: np.ndarray  # (3, 9) pose at the start of each piece


NO_PATH = ClothoidPath(0.0, np.zeros(9), np.zeros((2, 9)), np.zeros((3, 9)))


def shortest_path(
    start: np.ndarray,
    kappa_0: float | None,
    goals: np.ndarray,
    kappa_g: np.ndarray,
    radius_m: float,
    ramp_m: float,
) -> tuple[ClothoidPath, int]:
    """Return the shortest path from the pose `start` (3,) to one of the `goals` (n, 3), and the index of this goal.

    `kappa_0` and `kappa_g` (n,) [1/m] are the curvatures of start and goals, `radius_m` is R, and R k = 1 / `ramp_m`.
    Without `kappa_0` the vehicle is at rest, and the path begins with any curvature.
    """
    n, k = len(goals), 1.0 / (radius_m * ramp_m)
    grid = np.indices((len(FIRST_LINES), len(WORDS), n)).reshape(3, -1)
    first_m = np.array(FIRST_LINES)[grid[0]] * (radius_m + ramp_m)
    s_1, s_2 = np.array(WORDS)[grid[1]].T
    kappa_g, psi_g = kappa_g[grid[2]], goals[grid[2], 2]
    # the line before the first turn
    is_line, is_free, kappa_0 = first_m > 0.0, (first_m == 0.0) & (kappa_0 is None), kappa_0 or 0.0
    ramp_0_m, kappa_1_0 = np.where(is_line, abs(kappa_0) / k, 0.0), np.where(is_line, 0.0, kappa_0)
    k_1 = np.where(is_free, 2.0 * k, k)
    line_start = _compose(start, _displacement(ramp_0_m, kappa_0 + 0.0 * s_1, kappa_1_0))
    turn_start = _compose(line_start, np.stack([first_m, 0.0 * first_m, 0.0 * first_m]))
    end = goals[grid[2]].T + np.array([[0.0], [0.0], [np.pi]])  # the last turn is computed from the goal
    floor = np.sqrt(0.5 * ROUNDING_RAD * k)
    kappa_1 = kappa_2 = np.full(len(s_1), 1.0 / radius_m)
    best_length_m, best = np.inf, np.zeros((3, 9))
    best_index = 0
    for _ in range(ITERATION_COUNT):
        first = np.where(is_free, s_1 * kappa_1, kappa_1_0)
        entry, exit_1, phi_1, out_1 = _turn(s_1, kappa_1, first, k)
        entry_2, exit_2, phi_2, out_2 = _turn(-s_2, kappa_2, -kappa_g, k)
        c_1 = _compose(turn_start, np.stack([*entry, phi_1]))
        c_2 = _compose(end, np.stack([*entry_2, phi_2]))
        dx, dy = c_2[0] - c_1[0], c_2[1] - c_1[1]
        q_1, q_2 = exit_1, -exit_2  # the exit of the last turn, seen from the line that enters it
        offset = q_1[1] - q_2[1]
        root = dx * dx + dy * dy - offset * offset
        length = np.sqrt(np.maximum(root, 0.0))
        p = length + q_2[0] - q_1[0]
        chi = np.arctan2(dy, dx) - np.arctan2(offset, length)
        phi_end = c_2[2] - np.pi
        t_1 = _positive_angle(s_1 * (chi - c_1[2]) - out_1)
        t_2 = _positive_angle(s_2 * (phi_end - chi) - out_2)
        rows = np.stack(
            [
                ramp_0_m, first_m, np.abs(s_1 * kappa_1 - first) / k, t_1 / kappa_1, kappa_1 / k, p,
                kappa_2 / k, t_2 / kappa_2, np.abs(s_2 * kappa_2 - kappa_g) / k,
            ]
        )  # fmt: skip
        length_m = np.where((root >= 0.0) & (p >= 0.0), np.sum(rows, axis=0), np.inf)
        i = int(np.argmin(length_m))
        if length_m[i] < best_length_m:
            zero, a, b = 0.0, s_1[i] * kappa_1[i], s_2[i] * kappa_2[i]
            ends = [first[i], first[i], a, a, zero, zero, b, b, kappa_g[i]]
            best_length_m, best_index = float(length_m[i]), i
            best = np.stack([rows[:, i], [a if is_free[i] else kappa_0, *ends[:-1]], ends])
        theta_1 = _turn_angle(s_1 * (chi - turn_start[2]), s_1 * kappa_1_0, k)
        theta_2 = _turn_angle(s_2 * (psi_g - chi), s_2 * kappa_g, k)
        kappa_1, kappa_2 = (
            np.clip(
                CURVATURE_SHARE * np.sqrt(np.maximum(change * theta + 0.5 * c * c, 0.0)),
                floor,
                1.0 / radius_m,
            )
            for change, theta, c in ((k_1, theta_1, s_1 * kappa_1_0), (k, theta_2, s_2 * kappa_g))
        )
    return _join_pieces(start, *best), int(grid[2][best_index])


def pose_at(path: ClothoidPath, sigma_m: float) -> tuple[np.ndarray, float]:
    """Return the pose (3,) and the curvature [1/m] after `sigma_m` of a path; the heading is continuous."""
    start_m = np.cumsum(path.piece_m) - path.piece_m
    i = int(np.searchsorted(start_m, sigma_m, side="right")) - 1
    length_m, (a, b) = path.piece_m[i], path.kappa[:, i]
    done_m = min(max(sigma_m - start_m[i], 0.0), length_m)
    kappa = a + (b - a) * (done_m / length_m if length_m > 0.0 else 1.0)
    return _compose(path.eta[:, i], _displacement(done_m, a, kappa)), float(kappa)


def _join_pieces(
    start: np.ndarray, piece_m: np.ndarray, first_curvature: np.ndarray, last_curvature: np.ndarray
) -> ClothoidPath:
    """Return the path of pieces with these lengths, and curvatures at their starts and ends, each (9,)."""
    steps, eta = _displacement(piece_m, first_curvature, last_curvature), [np.array(start, dtype=float)]
    for step in steps.T[:-1]:
        eta.append(_compose(eta[-1], step))
    return ClothoidPath(
        float(np.sum(piece_m)), piece_m, np.stack([first_curvature, last_curvature]), np.array(eta).T
    )


def _displacement(
    length_m: np.ndarray, first_curvature: np.ndarray, last_curvature: np.ndarray
) -> np.ndarray:
    """Return the pose (3, …) after a piece from the origin, along x, with a curvature that changes linearly."""
    length_m, first_curvature, last_curvature = (
        np.asarray(x)[..., None] for x in (length_m, first_curvature, last_curvature)
    )
    share = 0.5 * (NODES + 1.0)
    psi = length_m * share * (first_curvature + 0.5 * (last_curvature - first_curvature) * share)
    x, y = (0.5 * length_m[..., 0] * (f(psi) @ WEIGHTS) for f in (np.cos, np.sin))
    return np.stack([x, y, 0.5 * (length_m * (first_curvature + last_curvature))[..., 0]])


def _compose(eta: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the pose (3, …) after a displacement `step` (3, …) in the frame of the pose `eta` (3, …)."""
    c, s = np.cos(eta[2]), np.sin(eta[2])
    return np.stack(
        [eta[0] + c * step[0] - s * step[1], eta[1] + s * step[0] + c * step[1], eta[2] + step[2]]
    )


def _turn(
    s: np.ndarray, kappa: np.ndarray, kappa_0: np.ndarray, k: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return of a turn from κ_0 to s κ and to 0: the centre (2, n) in the frame of its start, q of (2), φ, and m."""
    x, y, phi = _displacement(np.abs(s * kappa - kappa_0) / k, kappa_0, s * kappa)
    centre = np.stack([x - s / kappa * np.sin(phi), y + s / kappa * np.cos(phi)])
    end_x, end_y, angle = _displacement(kappa / k, s * kappa, 0.0 * kappa)
    radius_vector = np.stack([end_x, end_y - s / kappa, 0.0 * s])
    q = _compose(np.stack([0.0 * s, 0.0 * s, -angle]), radius_vector)
    return centre, q[:2], phi, s * angle


def _turn_angle(angle: np.ndarray, c: np.ndarray, k: float) -> np.ndarray:
    """Return the angle θ of a turn, from −c²/2k, the smallest one with the curvature c at one end."""
    min_angle = -0.5 * c * c / k
    return _positive_angle(angle - min_angle) + min_angle


def _positive_angle(angle: np.ndarray) -> np.ndarray:
    """Return an angle in the range 0 to 2π."""
    return np.maximum(angle - FULL_TURN * np.floor((angle + ROUNDING_RAD) / FULL_TURN), 0.0)
