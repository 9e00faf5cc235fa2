"""Separate the slow part of a signal from its white noise, by Whittle's likelihood and Wiener's filter.

    S_e(f) = N (1 + ρ P_τ(f)),   N, ρ, τ by Whittle's likelihood                                          (1)
    slow part = F⁻¹ [ρ P_τ/(1 + ρ P_τ)] F e,   P_τ of an Ornstein-Uhlenbeck process of variance 1         (2)

Sources: Whittle 1953; Wiener 1949.
"""

import numpy as np

from baqueano.numerics.statistics import MAD

RATIOS = np.geomspace(1.0 / 64.0, 1024.0, 33)  # ρ, and τ in ticks
TIME_CONSTANTS = np.geomspace(0.5, 256.0, 19)
CLIP_SIGMA = 6.0
MIN_LOG_GAIN = 2.0
MIN_ROWS = 64  # rows, below which the whole signal is the slow part


def slow_part(e: np.ndarray) -> np.ndarray:
    """Return the slow part (N,) of residuals e (N,) at uniform ticks.  (1), (2)"""
    n = len(e)
    if n < MIN_ROWS:
        return e
    limit = CLIP_SIGMA * MAD * float(np.median(np.abs(e - np.median(e))))
    clipped_errors = np.clip(e, np.median(e) - limit, np.median(e) + limit)
    # mirrored, so that its ends meet
    spectrum = np.fft.rfft(np.concatenate([clipped_errors, clipped_errors[::-1]]))
    ratio = _most_likely_ratio(np.abs(np.fft.rfft(clipped_errors - clipped_errors.mean()))[1:] ** 2 / n, n)
    if ratio is None:
        return np.zeros(n)
    power = ratio[0] * _spectrum(ratio[1], 2 * n)
    return np.asarray(np.fft.irfft(spectrum * (power / (1.0 + power)), 2 * n)[:n])


def _most_likely_ratio(periodogram: np.ndarray, n: int) -> tuple[float, float] | None:
    """Return ρ and τ of a periodogram without its mean, or None if white noise explains it equally well.  (1)"""
    white_cost = len(periodogram) * np.log(max(float(np.mean(periodogram)), 1e-300))
    best_cost, best_pair = white_cost - MIN_LOG_GAIN, None
    for time_constant in TIME_CONSTANTS:
        relative_gain = 1.0 + RATIOS[:, None] * _spectrum(float(time_constant), n)[None, 1:]
        costs = np.sum(np.log(relative_gain), axis=1)
        noise = np.mean(periodogram / relative_gain, axis=1)
        costs = costs + len(periodogram) * np.log(np.maximum(noise, 1e-300))
        k = int(np.argmin(costs))
        if costs[k] < best_cost:
            best_cost, best_pair = float(costs[k]), (float(RATIOS[k]), float(time_constant))
    return best_pair


def _spectrum(time_constant: float, n: int) -> np.ndarray:
    """Return P_τ (n/2 + 1,) at the frequencies of a transform of n ticks, τ = `time_constant` ticks.  (2)"""
    a = np.exp(-1.0 / time_constant)
    return np.asarray(
        (1.0 - a * a) / (1.0 - 2.0 * a * np.cos(2.0 * np.pi * np.arange(n // 2 + 1) / n) + a * a)
    )
