"""Is the covariance right? Errors measured in their own standard deviations.

    NEES_t = eᵀ P⁻¹ e,   e = estimate − truth, heading wrapped, P its covariance;  mean d if consistent  (1)
    NIS_t  = yᵀ S⁻¹ y,   y the innovation, S its covariance;  mean m if consistent                       (2)

Bar-Shalom, Li & Kirubarajan 2001, section 5.4. The mean of N independent χ²_d lies with
probability 1 − a between

    χ²_{Nd}(a/2) / N   and   χ²_{Nd}(1 − a/2) / N                                                        (3)

Innovations of a right filter are independent from tick to tick, so (3) holds for one run with N = its
measurements. State errors are not: one run has far fewer than N independent ones. There N is replaced by

    N / (1 + 2 Σ_k ρ_k),   ρ the autocorrelation of NEES_t, summed to its first value below 0.05         (4)

which is an estimate; over M runs with different seeds, (3) with N = M is exact at each time.
Where S has a block for a sensor that was silent, that block is left out.
"""

from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError

FALSE_ALARM = 0.05  # a consistent filter is called inconsistent this often


class Band(NamedTuple):
    """A mean of squared, normalised errors, and where a consistent filter's would lie."""

    mean: float  # per degree of freedom: 1 if consistent; NaN if nothing was reported
    low: float
    high: float
    freedom: int  # d or m, the largest that occurred
    samples: float  # independent samples counted

    @property
    def verdict(self) -> str:
        """In one word or two."""
        if not np.isfinite(self.mean):
            return "not reported"
        return (
            "too sure" if self.mean > self.high else "too cautious" if self.mean < self.low else "consistent"
        )


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


def band_of_run(squared: np.ndarray, freedom: int) -> Band:
    """NEES (N,) of one run against its band, with as many samples as are independent.  (3), (4)"""
    known = squared[np.isfinite(squared)]
    if known.size == 0:
        return NOT_REPORTED
    return _band(known, np.full(known.size, freedom), independent(known))


def band_of_innovations(squared: np.ndarray, freedom: np.ndarray) -> Band:
    """NIS (N,) with its degrees of freedom (N,) against its band.  (3)"""
    known = np.isfinite(squared) & (freedom > 0)
    if not np.any(known):
        return NOT_REPORTED
    return _band(squared[known], freedom[known], float(np.sum(known)))


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


def independent(series: np.ndarray) -> float:
    """How many independent samples a correlated series (N,) is worth.  (4)"""
    n = len(series)
    x = series - np.mean(series)
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


def _band(known: np.ndarray, freedom: np.ndarray, samples: float) -> Band:
    low, high = _limits(samples * float(np.mean(freedom)), FALSE_ALARM)
    return Band(float(np.sum(known) / np.sum(freedom)), low, high, int(np.max(freedom)), samples)


def _limits(freedom: float, false_alarm: float) -> tuple[float, float]:
    """Where χ²_f / f lies with probability 1 − `false_alarm`."""
    try:
        from scipy.stats import chi2
    except ImportError as error:
        raise UsageError(
            'scipy is not installed, and the χ² bands need it. Type: pip install "baqueano[lab]"'
        ) from error
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
