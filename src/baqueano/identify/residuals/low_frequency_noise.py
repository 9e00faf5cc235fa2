"""How sure a channel is of what is slow: the scatter of its residuals summed over a second, not one by one.

    y_b = (Σ_t∈b r_t)² / n_b      over blocks b of BLOCK_S, of n_b measurements                           (1)
    E y_b = S(v) = S₀ (1 + (κ v)²),   S₀, κ by the likelihood of (1) for normal sums                      (2)
    σ(v)² = max(S(v), variance of the single residuals at v)                                              (3)

Of white residuals S is their variance, and (3) changes nothing. On a real vehicle the channels of an IMU err in
different ways and none of them whitely: a mount shakes with the speed, a body pitches under thrust, a servo has
slack. Weighed by (3), each counts for the slow motion, which is what friction and force are seen in, as much as
it knows of it: at the frequency of the blocks and below. Residuals are clipped at FAR standard deviations in (1).
"""

from collections.abc import Sequence

import numpy as np

from baqueano.identify.residuals import speed_dependent_noise as by_speed

BLOCK_S = 1.0  # longer than a servo's or motor's lag, shorter than a manoeuvre
FAR = 4.0
FULL = 1.0 / 3.0  # part of a block that must have been measured
FEWEST = 12  # blocks for (2)
RATIOS = np.array([0.0, *np.geomspace(0.25, 16.0, 13)])  # κ times the root mean square of the speed


def spread_and_profile(
    left: Sequence[np.ndarray],
    has: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    dt_s: Sequence[np.ndarray],
    floor: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """σ (m,), and its profile (N, m) of mean square 1 per piece, of residuals (N, m) at speeds (N,).  (3)"""
    sigma, profile = by_speed.spread_and_profile(left, has, speeds, floor)
    out, typical = sigma.copy(), float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))
    for c in range(len(sigma)):
        single = [(sigma[c] * p[:, c]) ** 2 for p in profile]
        sums, squares = _blocks(
            [np.clip(r[:, c], -FAR * np.sqrt(s), FAR * np.sqrt(s)) for r, s in zip(left, single, strict=True)],
            [w[:, c] for w in has], speeds, dt_s,
        )  # fmt: skip
        if len(sums) < FEWEST:
            continue
        s_0, kappa = _growth(sums, squares, max(typical, 1e-9))
        both = [
            np.sqrt(np.maximum(s, s_0 * (1.0 + (kappa * v) ** 2)))
            for s, v in zip(single, speeds, strict=True)
        ]
        there = np.concatenate([b[w[:, c] > 0.0] for b, w in zip(both, has, strict=True)])
        out[c] = np.sqrt(np.mean(there**2))
        for p, b in zip(profile, both, strict=True):
            p[:, c] = b / out[c]
    return out, profile


def _blocks(
    left: Sequence[np.ndarray],
    has: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    dt_s: Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """y (B,) of (1) and the mean of v² (B,), over the blocks of all pieces."""
    sums, squares = [], []
    for r, w, v, dt in zip(left, has, speeds, dt_s, strict=True):
        block = (np.cumsum(dt) / BLOCK_S).astype(int)
        n, rows = np.bincount(block, w), np.bincount(block)
        full = n >= max(2.0, FULL * float(np.median(rows)))
        sums.append((np.bincount(block, r * w)[full]) ** 2 / n[full])
        squares.append(np.bincount(block, v * v)[full] / rows[full])
    return np.concatenate(sums), np.concatenate(squares)


def _growth(y: np.ndarray, v_squared: np.ndarray, typical: float) -> tuple[float, float]:
    """S₀ and κ.  (2)"""
    best = (np.inf, float(np.mean(y)), 0.0)
    for ratio in RATIOS:
        kappa = ratio / typical
        g = 1.0 + kappa**2 * v_squared
        s_0 = float(np.mean(y / g))
        best = min(best, (float(np.sum(np.log(g))) + len(y) * np.log(max(s_0, 1e-300)), s_0, kappa))
    return best[1], best[2]
