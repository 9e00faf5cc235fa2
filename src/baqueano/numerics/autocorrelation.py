"""Test if residuals are white, and sum their scores if they are not.

    B = Σ_c Σ_t Σ_s γ_c(t − s) (1 − |t − s|/L) ∂r_ct ∂r_csᵀ                                               (1)
    c(τ) = σ² (λ e^(−λτ) − a e^(−aτ)) a/(λ² − a²),   a = 1/T                                              (2)

γ_c(l) is the autocovariance of the scores ψ in channel c, L = WINDOW_S or a tenth of a shorter run. The sum of the
autocorrelation over the first LAGS ticks decides if residuals are white. Source: Newey and West 1987 for the taper.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from baqueano.numerics.parallel import dot, inner, parallel_map

WINDOW_S = 5.0
LAGS = 20  # ticks over which the autocorrelation is summed
ROWS_PER_COLUMN = 10  # of a regression, at least
WHITE_LIMIT = 0.15  # above this sum of the autocorrelation, residuals are not treated as white noise


def autocorrelation_sums(residuals: list[np.ndarray], masks: list[np.ndarray]) -> np.ndarray:
    """Return the sum (m,) of the autocorrelation over lags 1 to LAGS, or 0 if it is not significant. Residuals are
    clipped, and rows without a measurement are excluded."""
    sums = parallel_map(_first_lag_products, residuals, masks, rows=sum(map(len, masks)))
    total, power, count = np.sum(sums, axis=0)
    rho = total / np.maximum(power, 1e-300)
    threshold = 4.0 * np.sqrt(LAGS / np.maximum(count, 1.0))
    return np.where(np.abs(rho) > threshold, rho, 0.0)


def _first_lag_products(r: np.ndarray, is_present: np.ndarray) -> np.ndarray:
    """Return (3, m) for residuals (N, m): Σ_l Σ_t x_t x_{t+l}, Σ x², and the number of values of x."""
    products = np.zeros((3, r.shape[1]))
    for c in range(r.shape[1]):
        x = r[is_present[:, c] > 0.0, c]
        if len(x) <= 2 * LAGS:
            continue
        x = np.minimum(np.maximum(x, -3.0), 3.0)
        x -= x.mean()
        sums = np.cumsum(x)
        later_sums = np.full(len(x), sums[-1])
        later_sums[:-LAGS] = sums[LAGS:]
        products[:, c] = dot(x, later_sums - sums), dot(x, x), len(x)
    return products


def fourier_length(n: int) -> int:
    """Return the power of 2 that is at least 2 n."""
    return 1 << int(np.ceil(np.log2(2 * n)))


def lag_products(x: np.ndarray, length: int) -> np.ndarray:
    """Return Σ_t x_t x_{t+l} (length,) of x (N,) for the lags l = 0, 1, …, and the lags −1, −2, … from the end;
    `length` ≥ 2 N is the length of the Fourier transform.

    >>> lag_products(np.array([1.0, 2.0, 3.0]), 8)[:3].round(6)
    array([14.,  8.,  3.])
    """
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(x, length)) ** 2, length))


def lag_sums(signals: Sequence[np.ndarray], lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Σ_t x_t x_{t+l} (K,) over all `signals` (N,) at the `lags` (K,), and the number (K,) of these pairs. NaN
    marks a missing value.

    >>> lag_sums([np.array([1.0, 2.0, np.nan]), np.ones(2)], np.array([1, 2]))[0].round(6) + 0.0
    array([3., 0.])
    """
    products, count = np.zeros(len(lags)), np.zeros(len(lags))
    for x in signals:
        mask, short_lags = np.isfinite(x), lags[lags < len(x)]
        if len(short_lags):
            length = fourier_length(len(x))
            products[: len(short_lags)] += lag_products(np.where(mask, x, 0.0), length)[short_lags]
            count[: len(short_lags)] += lag_products(mask.astype(float), length)[short_lags]
    return products, count


def regression_residuals(signals: Sequence[np.ndarray], columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return `signals` (N,) without their regression on `columns` (N, p), over all signals; NaN is a missing value.
    With too few rows, they are unchanged.

    >>> t = np.arange(20.0)
    >>> regression_residuals([3.0 * t], [t[:, None]])[0].round(6)[:2] + 0.0
    array([0., 0.])
    """
    x, X = np.concatenate([np.zeros(0), *signals]), np.concatenate(columns) if columns else np.zeros((0, 1))
    is_finite = np.isfinite(x)
    if np.count_nonzero(is_finite) < ROWS_PER_COLUMN * X.shape[1]:
        return [*signals]
    b = np.linalg.lstsq(X[is_finite], x[is_finite], rcond=None)[0]
    return [signal - regressors @ b for signal, regressors in zip(signals, columns, strict=True)]


def residual_autocorrelation(tau_s: np.ndarray, fade_s: float, decay_rate: float) -> np.ndarray:
    """Return c/σ² (K,) of (2) at the lags `tau_s` (K,), for a disturbance that decays with `fade_s`, and the decay
    rate λ [1/s] of the speed. Without drag it is exp(−τ/T).

    >>> residual_autocorrelation(np.array([0.0, 1.0]), 1.0, 0.0).round(3)
    array([1.   , 0.368])
    """
    a, rate = 1.0 / fade_s, decay_rate
    rate = rate if abs(rate - a) > 1e-3 * a else 1.001 * a  # the limit of two equal rates
    return a * (rate * np.exp(-rate * tau_s) - a * np.exp(-a * tau_s)) / (rate**2 - a**2)


def autocorrelated_scores(psi: np.ndarray, mask: np.ndarray, d: np.ndarray, dt_s: np.ndarray) -> np.ndarray:
    """Return B (p, p) for scores ψ (N, m) and derivatives d (N, m, p), from the autocovariance of ψ.  (1)"""
    n, m, p = d.shape
    lags = int(np.clip(WINDOW_S / np.mean(dt_s), 1, max(1, n // 10)))
    fft_length = fourier_length(n)
    taper = np.zeros(fft_length)
    taper[: lags + 1] = 1.0 - np.arange(lags + 1) / (lags + 1.0)
    taper[-lags:] = taper[lags:0:-1]
    B = np.zeros((p, p))
    for c in range(m):
        products, pair_counts = (lag_products(x[:, c], fft_length) for x in (psi, mask))
        gamma = np.where(pair_counts > 0.5, products / np.maximum(pair_counts, 0.5), 0.0) * taper
        power = np.maximum(np.fft.rfft(gamma).real, 0.0)
        derivatives = np.ascontiguousarray(d[:, c, :])
        filtered_scores = np.fft.irfft(
            np.fft.rfft(derivatives, fft_length, axis=0) * power[:, None], fft_length, axis=0
        )[:n]
        B += inner(derivatives, filtered_scores)
    return 0.5 * (B + B.T)


def decay_since_sign_change(x: np.ndarray, t: np.ndarray, decay_s: float) -> np.ndarray:
    """Return sign x e^(−s/decay_s) (N, 1) for x (N, 1); s is the time since the sign last changed, infinite before."""
    decay, sign = np.zeros_like(x), np.sign(x[:, 0])
    moving_rows = np.flatnonzero(sign)
    reversals = moving_rows[1:][np.diff(sign[moving_rows]) != 0.0]
    for begin, end in pairwise([*reversals, len(t)]):
        decay[begin:end, 0] = np.exp((t[begin] - t[begin:end]) / decay_s) * sign[begin]
    return decay
