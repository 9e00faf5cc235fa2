"""Compute the overlapping Allan deviation of a sensor at rest, and its three coefficients.

With x the integral of the signal, N samples τ₀ apart, and τ = n τ₀:

    σ²(τ) = Σ_{k=1}^{N+1−2n} (x_{k+2n} − 2 x_{k+n} + x_k)² / (2 τ² (N + 1 − 2n))                           (1)
    σ²(τ) = W²/τ + (2 ln 2/π) B² + K² τ/3                                                                 (2)
    ν = (3 N / (2 n) − 2 (N − 1)/(N + 1)) · 4 n² / (4 n² + 5),   95 % interval: σ² ν / χ²                  (3)

W is the white noise (angle or velocity random walk), B the instability of the bias, K its random walk. (2) is fitted
to (1) at octaves of τ. The weights are the degrees of freedom ν of white noise, at most MAX_FREEDOM, because real
sensors are not as simple as (2). A coefficient below twice its error is not measurable. Sources: IEEE Std 952-1997,
annex C for (2); Riley, NIST Special Publication 1065 (2008), 5.2.4 for (1) and 5.3.2 for (3).
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.covariance.clusters import QUANTILE_95, chi_square

MIN_SAMPLES = 16  # samples
MIN_FREEDOM = 1.0  # degrees of freedom, below which an average is not shown
MAX_FREEDOM = 200.0  # of (1) in the fit of (2): 7 % of σ
ROUNDS = 20  # of the weights of (2)
FLICKER = 2.0 * np.log(2.0) / np.pi


class AllanDeviation(NamedTuple):
    """Averaging times, the Allan deviation, and its 95 % interval."""

    tau_s: np.ndarray  # (K,)
    deviation: np.ndarray  # (K,) in the unit of the signal
    low: np.ndarray  # (K,)
    high: np.ndarray  # (K,)
    degrees_of_freedom: np.ndarray  # (K,) degrees of freedom


class Coefficients(NamedTuple):
    """Coefficients W, B, K with their standard errors; 0 for a coefficient that the data do not show."""

    value: np.ndarray  # (3,) per √Hz, in the unit of the signal, per s^1.5 times √Hz·s
    std: np.ndarray  # (3,)

    @property
    def is_measurable(self) -> np.ndarray:
        """Return a mask (3,) of the coefficients above twice their error."""
        return self.value > 2.0 * self.std


def averaging_counts(sample_count: int) -> np.ndarray:
    """Return the numbers of samples n of (1): octaves with at least one degree of freedom."""
    n = 2 ** np.arange(int(np.log2(max(2, sample_count))) + 1)
    return n[(2 * n <= sample_count) & (degrees_of_freedom(sample_count, n) >= MIN_FREEDOM)]


def degrees_of_freedom(sample_count: int, n: np.ndarray) -> np.ndarray:
    """Return the degrees of freedom ν (K,) of averages over n samples.  (3)"""
    n = np.asarray(n, dtype=float)
    N = sample_count + 1.0  # points of the integral
    return (3.0 * (N - 1.0) / (2.0 * n) - 2.0 * (N - 2.0) / N) * 4.0 * n**2 / (4.0 * n**2 + 5.0)


def allan_deviation(y: np.ndarray, rate_hz: float, n: np.ndarray | None = None) -> AllanDeviation:
    """Return the Allan deviation of a signal y (N,), sampled `rate_hz` times per second.

    Averages are over `n` (K,) samples, by default octaves.  (1) Raise UsageError for fewer than MIN_SAMPLES samples,
    a sample that is not finite, or a rate of 0 or below. Raise it also for averages over more than half of the
    samples.

    >>> white = np.random.default_rng(0).normal(0.0, 0.1, 10_000)  # 0.1 at 100 Hz: 0.01 per √Hz
    >>> coefficients(allan_deviation(white, 100.0)).value.round(3)
    array([0.01, 0.  , 0.  ])
    """
    y = np.asarray(y, dtype=float)
    if y.ndim != 1 or len(y) < MIN_SAMPLES or not np.all(np.isfinite(y)):
        raise UsageError(fault("allan.numbers", least=MIN_SAMPLES, found=y.size))
    if not rate_hz > 0.0:
        raise UsageError(fault("allan.rate", rate_hz=rate_hz))
    n = averaging_counts(len(y)) if n is None else np.atleast_1d(n).astype(int)
    if np.any(n < 1) or np.any(2 * n > len(y)):
        raise UsageError(fault("allan.averages", samples=len(y), most=len(y) // 2, found=n.tolist()))
    x = np.concatenate([[0.0], np.cumsum(y - y.mean())]) / rate_hz
    variance = np.empty(len(n))
    for k, count in enumerate(n.tolist()):
        second = x[2 * count :] - 2.0 * x[count:-count] + x[: -2 * count]
        variance[k] = np.mean(second**2) / (2.0 * (count / rate_hz) ** 2)
    nu = np.maximum(degrees_of_freedom(len(y), n), MIN_FREEDOM)
    high = variance * nu / chi_square(nu, -QUANTILE_95)
    low = variance * nu / chi_square(nu, QUANTILE_95)
    return AllanDeviation(n / rate_hz, np.sqrt(variance), np.sqrt(low), np.sqrt(high), nu)


def coefficients(curve: AllanDeviation) -> Coefficients:
    """Return W, B, K of (2), none below 0, for the combination of coefficients that fits best."""
    tau, variance = curve.tau_s, np.maximum(curve.deviation**2, 1e-300)
    terms = np.stack([1.0 / tau, np.full_like(tau, FLICKER), tau / 3.0], axis=1)
    best_fit, min_cost = (np.zeros(3), np.full(3, np.nan)), np.inf
    for term_count in (1, 2, 3):
        for members in combinations(range(3), term_count):
            nu = np.minimum(curve.degrees_of_freedom, MAX_FREEDOM)
            squares, stds, cost = _fit(terms[:, members], variance, nu)
            if np.all(squares > 0.0) and cost < min_cost - 2.0 * (
                term_count > 1
            ):  # penalty for another coefficient
                min_cost, all_squares, all_stds = cost, np.zeros(3), np.full(3, np.nan)
                all_squares[list(members)], all_stds[list(members)] = squares, stds
                best_fit = (all_squares, all_stds)
    squares, stds = best_fit
    value = np.sqrt(squares)
    return Coefficients(value, np.where(value > 0.0, stds / (2.0 * np.maximum(value, 1e-300)), np.nan))


def _fit(terms: np.ndarray, variance: np.ndarray, nu: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the squares (c,) of the coefficients, their standard errors (c,), and −2 log of the likelihood of (1)."""
    model, squares, cov = variance, np.zeros(terms.shape[1]), np.eye(terms.shape[1])
    for _ in range(ROUNDS):
        weight = np.sqrt(0.5 * nu) / model  # the variance of σ² is 2 σ⁴/ν
        A, b = terms * weight[:, None], variance * weight
        scale = np.linalg.norm(A, axis=0)
        cov = np.linalg.pinv((A / scale).T @ (A / scale)) / np.outer(scale, scale)
        squares = cov @ (A.T @ b)
        model = np.maximum(terms @ squares, 1e-3 * variance)
    cost = float(np.sum(nu * (np.log(model) + variance / model)))
    return squares, np.sqrt(np.diagonal(cov)), cost
