"""Consistency of the covariance: errors measured in their own standard deviations.

    NEES_t = eᵀ P⁻¹ e,   e = estimate − truth, heading wrapped, P its covariance;  mean d if consistent  (1)
    NIS_t  = yᵀ S⁻¹ y,   y the innovation, S its covariance;  mean m if consistent                       (2)
    ρ̄ = Σ NEES_t / Σ d,  1 if consistent; where a consistent filter's would lie:  χ²_{Nd}(a/2, 1 − a/2) / Nd  (3)
    N = n / (1 + 2 Σ_k ρ_k),   ρ the autocorrelation of NEES_t, summed to its first value below 0.05     (4)

Bar-Shalom, Li & Kirubarajan 2001, section 5.4. N counts independent samples. Where it is below FEW, the mean of a
series hides its slow part: then (4) about the mean that is expected, 1, counts too. The interval of ρ̄ is the wider of
(3) and of a circular block bootstrap (Politis & Romano 1992). Its blocks have at least 2 n/N samples. Over M runs with
different seeds, (3) with N = M is exact at each time. A block of S of a silent sensor is left out.
"""

from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError

FALSE_ALARM = 0.05  # a consistent filter is called inconsistent this often
FEW = 60  # independent samples
DRAWS, BLOCKS, LEAST = 400, 200, 5  # of the bootstrap, blocks of a draw, and independent samples for it
CLOSE = 1.1  # a variance that is right within this factor is right
FAR = 1.6  # who cannot tell a variance from one that is off by this factor cannot tell


class Band(NamedTuple):
    """A mean of squared, normalised errors, and where a consistent filter's would lie."""

    mean: float  # per degree of freedom: 1 if consistent; NaN if nothing was reported
    low: float
    high: float
    freedom: int  # d or m, the largest that occurred
    samples: float  # independent samples counted

    @property
    def verdict(self) -> str:
        """Return "too sure", "too cautious", "consistent", "cannot tell" or "not reported"."""
        if not np.isfinite(self.mean):
            return "not reported"
        if self.mean > max(self.high, CLOSE):
            return "too sure"
        if self.mean < min(self.low, 1.0 / CLOSE):
            return "too cautious"
        is_narrow = self.high <= FAR * self.mean and self.mean <= FAR * self.low
        return "consistent" if is_narrow else "cannot tell"


NOT_REPORTED = Band(float("nan"), float("nan"), float("nan"), 0, 0.0)


def nees(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """(N,) of errors (N, d) with covariances (N, d, d); NaN where not known or P is singular.  (1)"""
    return _squared(error, cov)


def nis(innovation: np.ndarray, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """NIS (N,) and its degrees of freedom (N,) of innovations (N, m); NaN: nothing arrived.  (2)"""
    came = np.isfinite(innovation)
    value, freedom = np.full(len(innovation), np.nan), np.sum(came, axis=1)
    for pattern in np.unique(came, axis=0):
        rows, keep = np.flatnonzero(np.all(came == pattern, axis=1)), np.flatnonzero(pattern)
        if keep.size:
            value[rows] = _squared(innovation[np.ix_(rows, keep)], cov[np.ix_(rows, keep, keep)])
    return value, freedom


def band(squared: np.ndarray, freedom: np.ndarray | int, false_alarm: float = FALSE_ALARM) -> Band:
    """Return NEES or NIS (N,) with their degrees of freedom (N,) against their band.  (3), (4)"""
    freedom = np.broadcast_to(freedom, squared.shape)
    finite = np.isfinite(squared) & (freedom > 0)
    if not np.any(finite):
        return NOT_REPORTED
    squared, freedom = squared[finite], freedom[finite].astype(float)
    ratio, mean = squared / freedom, float(np.sum(squared) / np.sum(freedom))
    samples = independent(ratio)
    if samples < FEW:
        samples = min(samples, independent(ratio, 1.0))
    low, high = _limits(samples * float(np.mean(freedom)), false_alarm)
    if samples >= LEAST and mean > 0.0:
        least, most = _bootstrap(squared, freedom, round(2.0 * len(ratio) / samples), false_alarm)
        low, high = min(low, mean / most), max(high, mean / max(least, 1e-300))
    return Band(mean, low, high, int(np.max(freedom)), samples)


def band_over_runs(
    squared: np.ndarray, freedom: int, false_alarm: float = FALSE_ALARM
) -> tuple[np.ndarray, Band]:
    """Mean over M independent runs, per degree of freedom, at each of N times (N,), and the band of each.
    (3)

    squared (M, N). `Band.mean` is the mean over all; judge by the share of times inside the band.
    """
    mean = np.mean(squared, axis=0) / freedom
    runs = squared.shape[0]
    low, high = _limits(runs * freedom, false_alarm)
    return mean, Band(float(np.mean(mean)), low, high, freedom, float(runs))


def independent(series: np.ndarray, mean: float | None = None) -> float:
    """Return how many independent samples a correlated series (N,) is worth, about a `mean` that is known or its
    own.  (4)"""
    n = len(series)
    x = series - (np.mean(series) if mean is None else mean)
    power = float(x @ x)
    if n < 3 or power == 0.0:
        return float(n)
    length = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x, length)) ** 2
    rho = np.fft.irfft(spectrum, length)[1:n] / power
    end = int(np.argmax(rho < 0.05)) if np.any(rho < 0.05) else len(rho)
    return max(1.0, n / (1.0 + 2.0 * float(np.sum(rho[:end]))))


def whiteness(innovation: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Autocorrelation at lag 1 of each innovation in its own deviations, (m,); white: within ±1.96/√N."""
    with np.errstate(invalid="ignore"):
        y = innovation / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    out = np.full(y.shape[1], np.nan)
    for k, column in enumerate(y.T):
        column = column[np.isfinite(column)]
        if column.size > 2 and (power := float(column @ column)) > 0.0:
            out[k] = float(column[1:] @ column[:-1]) / power
    return out


def _bootstrap(
    squared: np.ndarray, freedom: np.ndarray, length: int, false_alarm: float
) -> tuple[float, float]:
    """Return the interval of Σ NEES / Σ d by drawing blocks of `length` samples with replacement."""
    n = len(squared)
    length = min(max(length, 1, n // BLOCKS), max(n // 4, 1))
    first = np.random.default_rng(0).integers(0, n, (DRAWS, n // length))

    def block_sums(series: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(np.concatenate([series, series[:length]]))])
        return np.sum(total[first + length] - total[first], axis=1)

    low, high = np.quantile(
        block_sums(squared) / block_sums(freedom), [0.5 * false_alarm, 1.0 - 0.5 * false_alarm]
    )
    return float(low), float(high)


def _limits(freedom: float, false_alarm: float) -> tuple[float, float]:
    """Return the interval that holds χ²_f / f with probability 1 − `false_alarm`."""
    try:
        from scipy.stats import chi2
    except ImportError as error:
        raise UsageError(fault("lab.scipy-for-bands", "pip install scipy")) from error
    low, high = chi2.ppf([0.5 * false_alarm, 1.0 - 0.5 * false_alarm], freedom)
    return float(low / freedom), float(high / freedom)


def _squared(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """eᵀ P⁻¹ e (N,), by Cholesky's condition on each P; NaN where P is not positive definite."""
    out = np.full(len(error), np.nan)
    good = np.all(np.isfinite(error), axis=1) & np.all(np.isfinite(cov), axis=(1, 2))
    if not np.any(good):
        return out
    scale = np.sqrt(np.maximum(np.diagonal(cov[good], axis1=1, axis2=2), 1e-300))
    R = cov[good] / (scale[:, :, None] * scale[:, None, :])  # correlations: metres and radians weigh alike
    y = error[good] / scale
    definite = np.linalg.eigvalsh(R)[:, 0] > 1e-12
    value = np.full(len(y), np.nan)
    value[definite] = np.sum(
        y[definite] * np.linalg.solve(R[definite], y[definite][..., None])[..., 0], axis=1
    )
    out[good] = value
    return out
