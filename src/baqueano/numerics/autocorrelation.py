"""Test if residuals are white, and sum their scores if they are not.

    B = Σ_c Σ_t Σ_s γ_c(t − s) (1 − |t − s|/L) ∂r_ct ∂r_csᵀ                                               (1)
    c(τ) = σ² (e^(−aτ)/a − e^(−λτ)/λ) a/(λ² − a²),   −c̈ = σ² (λ e^(−λτ) − a e^(−aτ)) a/(λ² − a²),  a = 1/T (2)

    σ² = (xᵀ A x + q² tr Qᵀ A Q)/tr (M A M C),   C = g gᵀ c(t − s),   x = M r,   M = 1 − Q Qᵀ             (3)

In (3) A is C without its short lags, Q a basis of the regressors of r, q the noise of r. The regression also removes
a part of the disturbance and of the noise, and (3) corrects for it. γ_c(l) is the autocovariance of the scores ψ in
channel c, L = WINDOW_S or a tenth of a shorter run. The sum of the autocorrelation over the first LAGS ticks decides if
residuals are white. Source: Newey and West 1987 for the taper of (1), Patterson and Thompson 1971 for (3).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.numerics.parallel import dot, inner, parallel_map
from baqueano.numerics.statistics import white_std

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


class RegressionSignal(NamedTuple):
    """A signal r = X b + g e + white noise; b is common to several signals."""

    r: np.ndarray  # (N,) NaN for a missing value
    g: np.ndarray  # (N,)
    X: np.ndarray  # (N, p)

    def without_gaps(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return r, g and X with zeros where r is missing."""
        mask = np.isfinite(self.r)
        return np.where(mask, self.r, 0.0), np.where(mask, self.g, 0.0), np.where(mask[:, None], self.X, 0.0)


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


def correlated_variance(
    signals: Sequence[RegressionSignal], c: np.ndarray, first_lag: int
) -> tuple[float, float, float]:
    """Return σ², its standard error, and the standard deviation q of the noise in `signals`.  (3)

    e has the autocovariance σ² `c` (L,), and 0 at longer lags. Lags below `first_lag` are not used. With too few
    values the standard error is infinite.
    """
    is_present = [np.isfinite(signal.r) for signal in signals]
    empty = RegressionSignal(np.zeros(0), np.zeros(0), np.zeros((0, signals[0].X.shape[1] if signals else 0)))
    r, g, X = (np.concatenate(x) for x in zip(*(s.without_gaps() for s in (empty, *signals)), strict=True))
    if not 0 < ROWS_PER_COLUMN * X.shape[1] <= sum(map(np.sum, is_present)):
        return 0.0, np.inf, 0.0
    X = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    squares, axes = np.linalg.eigh(X.T @ X)
    is_independent = squares > 1e-10 * squares[-1]
    Q = X @ axes[:, is_independent] / np.sqrt(squares[is_independent])
    ends = np.cumsum([len(mask) for mask in is_present])[:-1]
    parts = [np.split(column, ends) for column in (r - Q @ (Q.T @ r), g, Q)]
    noise_std = white_std([x[mask] for x, mask in zip(parts[0], is_present, strict=True)])
    used_c = np.where(np.arange(len(c)) < first_lag, 0.0, c)
    product, square, common, QAQ, QCQ = 0.0, 0.0, 0.0, 0.0, 0.0  # xᵀ A x, tr A C, tr Qᵀ A C Q, …
    for x, gain, basis in zip(*parts, strict=True):
        n = fourier_length(max(len(x), len(c)))
        columns = gain[:, None] * np.column_stack([basis, x])
        Ax, Cx = (gain[:, None] * _correlate(kernel, columns, n) for kernel in (used_c, c))
        product += x @ Ax[:, -1]
        square += 2.0 * used_c**2 @ lag_products(gain**2, n)[: len(c)]
        common += np.sum(Ax[:, :-1] * Cx[:, :-1])
        QAQ, QCQ = QAQ + basis.T @ Ax[:, :-1], QCQ + basis.T @ Cx[:, :-1]
    information = float(square - 2.0 * common + np.sum(QAQ * QCQ))
    if not information > 0.0:
        return 0.0, np.inf, noise_std
    variance = float(product + noise_std**2 * np.trace(QAQ)) / information
    return variance, noise_std**2 * float(np.sqrt(2.0 * square)) / information, noise_std


def _correlate(c: np.ndarray, x: np.ndarray, n: int) -> np.ndarray:
    """Return Σ_s c(|t − s|) x_s (N, p) for the columns of x (N, p); n is the length of the Fourier transform."""
    kernel = np.zeros(n)
    kernel[: len(c)], kernel[n - len(c) + 1 :] = c, c[:0:-1]
    return np.fft.irfft(np.fft.rfft(kernel)[:, None] * np.fft.rfft(x, n, axis=0), n, axis=0)[: len(x)]


def speed_error_autocorrelations(
    tau_s: np.ndarray, fade_s: float, decay_rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the autocovariances (K,) of a speed error and of its derivative, relative to σ², at the lags `tau_s` (K,).
    The disturbance decays with `fade_s`, the speed with `decay_rate` λ [1/s]. Without drag the derivative has
    exp(−τ/T). A run does not contain many independent errors that decay slower than the disturbance, so for the first
    one λ is at least 1/T.  (2)

    >>> [c.round(2).tolist() for c in speed_error_autocorrelations(np.array([0.0, 1.0]), 1.0, 0.0)]
    [[0.5, 0.37], [1.0, 0.37]]
    """
    a = 1.0 / fade_s
    # two equal rates are a limit
    speed_rate, rate = (x if abs(x - a) > 1e-3 * a else 1.001 * a for x in (max(decay_rate, a), decay_rate))
    speed = a * (np.exp(-a * tau_s) / a - np.exp(-speed_rate * tau_s) / speed_rate) / (speed_rate**2 - a**2)
    derivative = a * (rate * np.exp(-rate * tau_s) - a * np.exp(-a * tau_s)) / (rate**2 - a**2)
    return speed, derivative


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
