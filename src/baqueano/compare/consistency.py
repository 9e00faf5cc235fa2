"""Test the consistency of a covariance, by errors in units of their standard deviations.
    w_t = L⁻¹ e_t,   P = L Lᵀ;   e = estimate − truth with its heading wrapped, or an innovation, whose P is S    (1)
    NEES_t or NIS_t = w_tᵀ w_t;   mean d if consistent, d the number of known entries                            (2)
    ρ̄ = Σ w_tᵀ w_t / Σ d,   1 if consistent; then it is mostly within  χ²_f(a/2, 1 − a/2) / f               (3)
    f = N (tr Γ_0)² / Σ_k (1 − |k|/N) |Γ_k|²,   Γ_k = mean of w_t w_{t+k}ᵀ, until |Γ_k|² < 0.05 |Γ_0|², then w̄ w̄ᵀ (4)
    l_i = 1 − mean of w_i² + w̄_i² instead of w̄_i²  unless  w̄_i²/l_i < χ²_1(a)                                  (5)

Bar-Shalom, Li & Kirubarajan 2001, section 5.4. By (4), f/d is the number of independent samples of Gaussian errors.
Their correlation uses the known mean 0: an error that lasts for the whole drive is one sample. Such an error can be
small by chance; then ρ̄ < 1 although the filter is consistent. So the missing variance of an entry is treated as a
lasting error, unless that is improbable (5). The interval is the wider one of (3) and a circular block bootstrap
(Politis, Romano 1992) with blocks of ≥ 2 N d/f.
"""

from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError

FALSE_ALARM = 0.05  # probability that a consistent filter is called inconsistent
# draws and blocks of the bootstrap, and the independent samples that it needs
BOOTSTRAP_DRAWS, MAX_BLOCKS, MIN_SAMPLES = 400, 200, 5
MIN_CORRELATION = 0.05  # of |Γ_0|²: a smaller correlation is considered random
ACCEPTED_RATIO = 1.1  # a variance within this factor of 1 is considered consistent
MAX_BAND_RATIO = 1.6  # the verdict is "cannot tell" if the band is wider than this factor on either side


class Band(NamedTuple):
    """The mean of normalised squared errors, and the interval for this mean of a consistent filter."""

    mean: float  # per degree of freedom: 1 if consistent; NaN if nothing was reported
    low: float
    high: float
    freedom: int  # d, the largest that occurred
    samples: float  # independent samples, f/d

    @property
    def verdict(self) -> str:
        """Return "too sure", "too cautious", "consistent", "cannot tell" or "not reported"."""
        if not np.isfinite(self.mean):
            return "not reported"
        if self.mean > max(self.high, ACCEPTED_RATIO):
            return "too sure"
        if self.mean < min(self.low, 1.0 / ACCEPTED_RATIO):
            return "too cautious"
        is_narrow = self.high <= MAX_BAND_RATIO * self.mean and self.mean <= MAX_BAND_RATIO * self.low
        return "consistent" if is_narrow else "cannot tell"


NOT_REPORTED = Band(float("nan"), float("nan"), float("nan"), 0, 0.0)


def whiten(error: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return the whitened errors w (N, d) of errors (N, d) with covariances (N, d, d).  (1)

    An unknown entry, such as that of a sensor without a reading, is excluded: its w is NaN. A row whose P is singular
    is NaN.
    """
    is_finite = np.isfinite(error) & np.isfinite(np.diagonal(cov, axis1=1, axis2=2))
    w = np.full(error.shape, np.nan)
    for pattern in np.unique(is_finite, axis=0):
        columns = np.flatnonzero(pattern)
        rows = np.flatnonzero(np.all(is_finite == pattern, axis=1))
        rows = rows[np.all(np.isfinite(cov[np.ix_(rows, columns, columns)]), axis=(1, 2))]
        if not (columns.size and rows.size):
            continue
        P = cov[np.ix_(rows, columns, columns)]
        scale = np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 1e-300))
        R = P / (scale[:, :, None] * scale[:, None, :])  # correlations: metres and radians have equal weight
        is_definite = np.linalg.eigvalsh(R)[:, 0] > 1e-12
        rows = rows[is_definite]
        if rows.size:
            e = error[np.ix_(rows, columns)] / scale[is_definite]
            w[np.ix_(rows, columns)] = np.linalg.solve(np.linalg.cholesky(R[is_definite]), e[..., None])[
                ..., 0
            ]
    return w


def normalised_squared_error(w: np.ndarray) -> np.ndarray:
    """Return NEES or NIS (N,) of whitened errors (N, d); NaN for a row whose entries are all unknown.  (2)"""
    return np.where(np.any(np.isfinite(w), axis=1), np.nansum(w**2, axis=1), np.nan)


def band(w: np.ndarray, false_alarm: float = FALSE_ALARM) -> Band:
    """Return the mean of NEES or NIS of whitened errors (N, d), and its band.  (3)-(5)"""
    w = w[np.any(np.isfinite(w), axis=1)]
    if not len(w):
        return NOT_REPORTED
    entries = np.sum(np.isfinite(w), axis=1).astype(float)
    sums, d = np.nansum(w**2, axis=1), float(np.mean(entries))
    mean, samples = float(np.sum(sums) / np.sum(entries)), degrees_of_freedom(w) / d
    low, high = _limits(samples * d, false_alarm)
    if samples >= MIN_SAMPLES and mean > 0.0:
        ratio_low, ratio_high = _bootstrap(sums, entries, round(2.0 * len(w) / samples), false_alarm)
        low, high = min(low, mean / ratio_high), max(high, mean / max(ratio_low, 1e-300))
    return Band(mean, low, high, int(np.max(entries)), samples)


def degrees_of_freedom(w: np.ndarray) -> float:
    """Return the degrees of freedom f of the sum of squares of errors w (N, d) with mean 0.  (4), (5)"""
    x, count = np.nan_to_num(w), np.maximum(np.sum(np.isfinite(w), axis=0), 1)
    n, power = len(x), float(np.sum(x**2)) / len(x)
    if power == 0.0:
        return float(w.size)
    length = 1 << (2 * n - 1).bit_length()
    spectra = np.fft.rfft(x, length, axis=0).T
    squares = np.zeros(n)
    for first in spectra:
        for second_spectrum in spectra:
            squares += (np.fft.irfft(np.conj(first) * second_spectrum, length)[:n] / n) ** 2
    rho, overlap = squares / squares[0], 1.0 - np.arange(n) / n
    end = int(np.argmax(rho < MIN_CORRELATION)) if np.any(rho < MIN_CORRELATION) else n
    correlated_share = squares[0] * (1.0 + 2.0 * float(np.sum(rho[1:end] / overlap[1:end]))) / (n * power**2)
    bias = (np.sum(x, axis=0) / count) ** 2
    variance_deficit = 1.0 - np.sum(x**2, axis=0) / count + bias
    is_bias_significant = (variance_deficit > 1.0 - 1.0 / ACCEPTED_RATIO) & (
        bias > _one_degree_quantile(FALSE_ALARM) * variance_deficit
    )
    share, d = count / n, float(np.sum(count)) / n
    lasting_bias = np.maximum(
        bias * (1.0 - end / n) / power, np.where(is_bias_significant, variance_deficit, 0.0) / d
    )
    return 1.0 / (correlated_share + float(np.sum((share * lasting_bias) ** 2)))


def whiteness(innovation: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return the lag-1 autocorrelation (m,) of the normalised innovations; white noise: 95 % within ±1.96/√N."""
    with np.errstate(invalid="ignore"):
        y = innovation / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    correlations = np.full(y.shape[1], np.nan)
    for k, column in enumerate(y.T):
        column = column[np.isfinite(column)]
        if column.size > 2 and (power := float(column @ column)) > 0.0:
            correlations[k] = float(column[1:] @ column[:-1]) / power
    return correlations


def _bootstrap(sums: np.ndarray, entries: np.ndarray, length: int, false_alarm: float) -> tuple[float, float]:
    """Return the interval of Σ NEES / Σ d from a bootstrap with blocks of `length` samples."""
    n = len(sums)
    length = min(max(length, 1, n // MAX_BLOCKS), max(n // 4, 1))
    first = np.random.default_rng(0).integers(0, n, (BOOTSTRAP_DRAWS, n // length))

    def block_sums(series: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(np.concatenate([series, series[:length]]))])
        return np.sum(total[first + length] - total[first], axis=1)

    low, high = np.quantile(
        block_sums(sums) / block_sums(entries), [0.5 * false_alarm, 1.0 - 0.5 * false_alarm]
    )
    return float(low), float(high)


def _one_degree_quantile(probability: float) -> float:
    """Return the quantile of χ² with one degree of freedom at `probability`."""
    return NormalDist().inv_cdf(0.5 + 0.5 * probability) ** 2


def _limits(freedom: float, false_alarm: float) -> tuple[float, float]:
    """Return the interval of χ²_f / f with probability 1 − `false_alarm`. Raise UsageError if SciPy is missing."""
    try:
        from scipy.special import gammaincinv  # scipy.stats takes three times as long to import
    except ImportError as error:
        raise UsageError.of("lab.scipy-for-bands", "pip install scipy") from error
    low, high = 2.0 * gammaincinv(0.5 * freedom, [0.5 * false_alarm, 1.0 - 0.5 * false_alarm])
    return float(low / freedom), float(high / freedom)
