"""Estimate the noise level of each channel from residuals with outliers: constant, or growing with the speed v.

    σ = 1.4826 median |r|                                                                                 (1)
    σ(v)² = σ₀² (1 + (κ v)²),   κ = arg min Σ_t log σ(v_t) + ½ min((r_t / σ(v_t))², ROBUST_SIGMA²)         (2)
    y_b = (Σ_t∈b r_t)² / n_b   over blocks b of BLOCK_S,   E y_b = S(v) = S₀ (1 + (κ v)²)                  (3)
    σ(v)² = max(S(v), variance of the single residuals at v)                                              (4)

(2) is the likelihood of a scale: gears, wheels and floor shake a vehicle more at a higher speed. (4) weights a
channel by its information on slow motion, which shows friction and force; for white residuals (4) is (2). A profile
has mean square 1, and stays fixed while the parameters are searched.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.numerics.statistics import MAD

SPEED_RATIOS = np.array([0.0, *np.geomspace(0.125, 32.0, 17)])  # κ times the root mean square of the speed
ROBUST_SIGMA = 3.0  # standard deviations
MIN_SPEED_SAMPLES = 50  # measurements of a channel, below which its noise is taken as constant
MIN_LOG_GAIN = 5.0  # least gain of the log-likelihood for a noise that grows with speed
BLOCK_S = 1.0  # longer than a servo's or motor's lag, shorter than a manoeuvre
SLOW_CLIP_SIGMA = 4.0
MIN_BLOCK_FRACTION = 1.0 / 3.0  # part of a block that must have been measured
MIN_BLOCKS = 12  # blocks for (3)
SLOW_RATIOS = np.array([0.0, *np.geomspace(0.25, 16.0, 13)])  # κ times the root mean square of the speed


def robust_sigma(
    residuals: Sequence[np.ndarray], masks: Sequence[np.ndarray], floor: np.ndarray
) -> np.ndarray:
    """Return σ (m,) of residuals (N, m) of several runs, in their unit.  (1)"""
    m = residuals[0].shape[1]
    sigma = np.zeros(m)
    for c in range(m):
        x = np.concatenate([r[mask[:, c] > 0.0, c] for r, mask in zip(residuals, masks, strict=True)])
        x = np.abs(x[np.isfinite(x)])
        sigma[c] = MAD * np.median(x) if len(x) else 0.0
    return np.maximum(sigma, floor)


def speed_profile(
    residuals: Sequence[np.ndarray],
    masks: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    floor: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return σ (m,), and its profile (N, m) per segment, of residuals (N, m) at speeds (N,)."""
    v = np.concatenate(speeds)
    typical_v = max(float(np.sqrt(np.mean(v**2))), 1e-9)
    profile = [np.ones_like(r) for r in residuals]
    sigma = np.zeros(len(floor))
    for c in range(len(floor)):
        is_present = [w[:, c] > 0.0 for w in masks]
        r = np.concatenate([x[t, c] for x, t in zip(residuals, is_present, strict=True)])
        speed = np.concatenate([x[t] for x, t in zip(speeds, is_present, strict=True)])
        can_grow = len(r) >= MIN_SPEED_SAMPLES
        kappa = _fit_speed_growth(r, speed, typical_v, floor[c]) / typical_v if can_grow else 0.0
        mean = np.sqrt(1.0 + kappa**2 * np.mean(speed**2)) if len(speed) else 1.0
        for k, x in enumerate(speeds):
            profile[k][:, c] = np.sqrt(1.0 + (kappa * x) ** 2) / mean
        scaled_residuals = [(x[:, c] / p[:, c])[:, None] for x, p in zip(residuals, profile, strict=True)]
        sigma[c] = robust_sigma(scaled_residuals, [w[:, c : c + 1] for w in masks], floor[c : c + 1])[0]
    return sigma, profile


def _fit_speed_growth(r: np.ndarray, v: np.ndarray, typical_v: float, floor: float) -> float:
    """Return κ times `typical_v`, or 0 if the growth is not significant.  (2)"""
    costs = []
    for ratio in SPEED_RATIOS:
        g = np.sqrt(1.0 + (ratio * v / typical_v) ** 2)
        sigma = robust_sigma([(r / g)[:, None]], [np.ones((len(r), 1))], np.array([floor]))[0]
        squares = np.minimum((r / (sigma * g)) ** 2, ROBUST_SIGMA**2)
        costs.append(float(np.sum(np.log(g)) + 0.5 * np.sum(squares)) + len(r) * np.log(sigma))
    best_index = int(np.argmin(costs))
    return float(SPEED_RATIOS[best_index]) if costs[0] - costs[best_index] > MIN_LOG_GAIN else 0.0


def slow_noise_profile(
    residuals: Sequence[np.ndarray],
    masks: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    dt_s: Sequence[np.ndarray],
    floor: np.ndarray,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return σ (m,) and its profile (N, m) of mean square 1 per segment, of residuals (N, m) at speeds (N,).  (4)"""
    sigma, profile = speed_profile(residuals, masks, speeds, floor)
    extended_sigma, typical_v = sigma.copy(), float(np.sqrt(np.mean(np.concatenate(speeds) ** 2)))
    for c in range(len(sigma)):
        variances = [(sigma[c] * p[:, c]) ** 2 for p in profile]
        limits = [SLOW_CLIP_SIGMA * np.sqrt(variance) for variance in variances]
        clipped_residuals = [np.clip(r[:, c], -x, x) for r, x in zip(residuals, limits, strict=True)]
        sums, squares = _block_squares(clipped_residuals, [w[:, c] for w in masks], speeds, dt_s)
        if len(sums) < MIN_BLOCKS:
            continue
        s_0, kappa = _fit_slow_noise(sums, squares, max(typical_v, 1e-9))
        stds = [
            np.sqrt(np.maximum(s, s_0 * (1.0 + (kappa * v) ** 2)))
            for s, v in zip(variances, speeds, strict=True)
        ]
        samples = np.concatenate([b[w[:, c] > 0.0] for b, w in zip(stds, masks, strict=True)])
        extended_sigma[c] = np.sqrt(np.mean(samples**2))
        for p, b in zip(profile, stds, strict=True):
            p[:, c] = b / extended_sigma[c]
    return extended_sigma, profile


def _block_squares(
    residuals: Sequence[np.ndarray],
    masks: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    dt_s: Sequence[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Return y (B,) of (3) and the mean of v² (B,), over the blocks of all segments."""
    sums, squares = [], []
    for r, w, v, dt in zip(residuals, masks, speeds, dt_s, strict=True):
        block = (np.cumsum(dt) / BLOCK_S).astype(int)
        n, rows = np.bincount(block, w), np.bincount(block)
        is_full = n >= max(2.0, MIN_BLOCK_FRACTION * float(np.median(rows)))
        sums.append((np.bincount(block, r * w)[is_full]) ** 2 / n[is_full])
        squares.append(np.bincount(block, v * v)[is_full] / rows[is_full])
    return np.concatenate(sums), np.concatenate(squares)


def _fit_slow_noise(y: np.ndarray, v_squared: np.ndarray, typical_v: float) -> tuple[float, float]:
    """Return S₀ and κ.  (3)"""
    best_fit = (np.inf, float(np.mean(y)), 0.0)
    for ratio in SLOW_RATIOS:
        kappa = ratio / typical_v
        g = 1.0 + kappa**2 * v_squared
        s_0 = float(np.mean(y / g))
        best_fit = min(best_fit, (float(np.sum(np.log(g))) + len(y) * np.log(max(s_0, 1e-300)), s_0, kappa))
    return best_fit[1], best_fit[2]
