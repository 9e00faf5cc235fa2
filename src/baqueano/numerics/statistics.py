"""Provide quantiles, robust spreads, and covariances of estimates from the scores of blocks.

    σ = MAD median |x|,   white noise: x the second differences over √6                                   (1)
    s_b = Σ_t∈b ψ ∂r,   m_b = A⁻¹ s_b,   cov = n/(n − p) Σ_b m_b m_bᵀ      over n blocks b                 (2)
    m_b the change without block b,      cov = (n − 1)/n Σ_b (m_b − m̄)(m_b − m̄)ᵀ                          (3)
    r = √(Σ_b e_b² / Σ_b ẽ_b²)            of two errors e and ẽ, with the interval of drawn blocks         (4)
    s = 6 sin(π/2 mean(sgn x_k sgn x_{k+2})),   x the second differences: 1 for white noise, 0 for a walk (5)

Sums over blocks longer than the errors of a model are independent, for any autocorrelation inside a block. With few
blocks an interval needs Student's quantile. Sources: Liang and Zeger 1986 for (2); Quenouille 1956, Tukey 1958 for (3);
Wilson and Hilferty 1931 for χ²; van Vleck 1943 for the arcsine in (5), which outliers and a varying σ do not change.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import erfc, exp, lgamma, pi, sqrt
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

QUANTILE_95 = 1.959963984540054  # standard deviations within which 95 % of a normal distribution lie
MAD = 1.4826022185056018  # 1 / Φ⁻¹(3/4)
CLIP_SIGMA = 4.0  # standard deviations beyond which an error is clipped
HUBER = 1.345  # in standard deviations: 95 % efficient on normal noise
MAX_FREEDOM = 1000.0  # degrees of freedom above which Student's t is normal to 1e-4
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)  # of a quadrature over (−1, 1)
MIN_BLOCKS, DRAWS = 5, 2000  # (4): blocks for an interval, and draws
ENCLOSING_STEPS = 100  # iterations of enclosing_cov
MIN_UNEXPLAINED = 1e-6  # of the squares of w in lines_by_sign, so that rounding gives no slope


@lru_cache(maxsize=1000)
def student_quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t with `freedom` degrees of freedom, at least 1, by bisection of the integral of
    cosⁿ⁻¹θ over θ = atan(t/√n)."""
    if probability < 0.5:
        return -student_quantile(1.0 - probability, freedom)
    if freedom > MAX_FREEDOM:
        z = NormalDist().inv_cdf(probability)
        return z + (z**3 + z) / (4.0 * freedom)
    density = np.exp(lgamma(0.5 * (freedom + 1.0)) - lgamma(0.5 * freedom)) / np.sqrt(np.pi)
    low, high = 0.0, 0.5 * np.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        heights = density * np.cos(0.5 * middle * (1.0 + NODES)) ** (freedom - 1.0)
        is_below = 0.5 * middle * float(WEIGHTS @ heights) < probability - 0.5
        low, high = (middle, high) if is_below else (low, middle)
    return float(np.sqrt(freedom) * np.tan(low))


def prediction_limit(x: np.ndarray, probability: float) -> float:
    """Return the limit below which a further normal value lies with this probability, given x (n,), n > 1."""
    t = student_quantile(probability, len(x) - 1)
    return float(np.mean(x) + t * np.std(x, ddof=1) * np.sqrt(1.0 + 1.0 / len(x)))


def chi_square(nu: np.ndarray | float, normal: float) -> np.ndarray:
    """Return the quantile of χ² with ν degrees of freedom (Wilson and Hilferty 1931). Its probability is the
    probability of the standard normal quantile `normal`."""
    term = 2.0 / (9.0 * nu)
    return nu * np.maximum(1.0 - term + normal * np.sqrt(term), 0.05) ** 3


def chi_square_tail(ratio: float, degrees: int) -> float:
    """Return the probability that χ² with 1, 2 or 3 degrees of freedom exceeds `ratio`."""
    half = max(ratio, 0.0) / 2.0
    if degrees == 2:
        return exp(-half)
    probability = erfc(sqrt(half))
    return probability if degrees == 1 else probability + 2.0 * sqrt(half / pi) * exp(-half)


def white_std(signals: Sequence[np.ndarray]) -> float:
    """Return the robust standard deviation of the white noise in `signals` (N,), from their second differences. (1)"""
    return MAD * float(np.median(np.abs(np.concatenate([np.diff(x, 2) for x in signals])))) / np.sqrt(6.0)


def largest_white_share(signals: Sequence[np.ndarray]) -> float:
    """Return the upper end of the 95 % interval of the share of white noise in the variance of (1), in [0, 1]. The rest
    is a random walk, or motion with a spectrum that falls more steeply.  (5)"""
    signs = [np.sign(np.diff(x, 2)) for x in signals]
    products = np.concatenate([np.zeros(0), *(s[2:] * s[:-2] for s in signs)])
    products = products[products != 0.0]  # quantised readings repeat
    if not len(products):
        return 1.0
    correlation = max(0.0, float(np.sin(0.5 * pi * np.mean(products))))
    std_error = 0.5 * pi / sqrt(len(products))
    return min(1.0, 6.0 * (correlation + QUANTILE_95 * std_error))


def expected_variance(estimate: float, std_error: float) -> float:
    """Return the mean of a variance given its `estimate`, which can be negative, if all positive values are equally
    likely before: v + s φ(v/s)/Φ(v/s). If v is well above s, it is v.

    >>> [round(expected_variance(v, 1.0), 2) for v in (-1.0, 0.0, 1.0, 5.0)]
    [0.53, 0.8, 1.29, 5.0]
    """
    if not std_error > 0.0:
        return max(estimate, 0.0)
    z = max(estimate / std_error, -20.0)
    return std_error * (z + exp(-0.5 * z**2) * sqrt(2.0 / pi) / erfc(-z / sqrt(2.0)))


def change_covariance(changes: np.ndarray, parameter_count: int | None = None) -> np.ndarray:
    """Return the covariance (p, p) of an estimate from its `changes` (n, p), one for each independent block. A move is
    A⁻¹ s_b if the number of `parameter_count` parameters is given (2), else the change without the block (3)."""
    n = len(changes)
    if parameter_count is not None:
        return changes.T @ changes * (n / (n - parameter_count))
    deviations = changes - np.mean(changes, axis=0)
    return (n - 1) / n * deviations.T @ deviations


def batch_covariance(
    jacobian: np.ndarray, residuals: np.ndarray, weights: np.ndarray, batch: np.ndarray
) -> np.ndarray:
    """Return the covariance (p, p) of a regression; infinite without information or for at most p batches. (2)
    `jacobian` (N, p) contains the derivatives; `residuals` and `weights` (N,) have one entry for each row. `batch` (N,)
    is the batch number of each row. Rows with a weight below 1 are Huber's outliers, where ρ'' = 0."""
    p, (numbers, index) = jacobian.shape[1], np.unique(batch, return_inverse=True)
    scale = np.sqrt(np.maximum(np.sum(jacobian**2, axis=0), 1e-300))
    J = jacobian / scale
    A = J[weights >= 1.0].T @ J[weights >= 1.0]
    values, vectors = np.linalg.eigh(A)
    if len(numbers) <= p or values[0] < 1e-10 * values[-1]:
        return np.full((p, p), np.inf)
    scores = np.zeros((len(numbers), p))
    np.add.at(scores, index, (weights * residuals)[:, None] * J)
    changes = (vectors / values) @ vectors.T @ scores.T
    return change_covariance(changes.T, p) / np.outer(scale, scale)


def explained_variance(z: np.ndarray, h: np.ndarray, sigma: float) -> float:
    """Return 1 − var(z − h) / var(z) of a run, with outliers clipped; NaN without measurements.

    An outlier is a residual beyond CLIP_SIGMA times the noise `sigma`, or times the typical error of the run if that
    is larger. The clipped residuals remove outliers of z from var(z). Jumps of h do not increase it.
    """
    if len(z) < 2:
        return float("nan")
    limit = CLIP_SIGMA * max(sigma, MAD * float(np.median(np.abs(z - h))))
    residuals = np.clip(z - h, -limit, limit)
    total = float(min(np.var(h + residuals), np.var(z)))
    return 1.0 - float(np.mean(residuals**2)) / total if total > 0.0 else 0.0


def huber_cost(residuals: np.ndarray) -> float:
    """Return the sum of Huber's cost over `residuals` of any shape, in standard deviations."""
    r = np.abs(residuals)
    clipped_residuals = np.minimum(r, HUBER)
    return float(np.sum(clipped_residuals * (r - 0.5 * clipped_residuals)))


def huber_regression(
    jacobian: np.ndarray, y: np.ndarray, iterations: int = 10
) -> tuple[np.ndarray, np.ndarray]:
    """Return Huber's regression of y (N,) on `jacobian` (N, p): the estimate (p,) and the weights (N,)."""
    weights = np.ones(len(y))
    x = np.zeros(jacobian.shape[1])
    for _ in range(iterations):
        root_weights = np.sqrt(weights)
        x = np.linalg.lstsq(root_weights[:, None] * jacobian, root_weights * y, rcond=None)[0]
        residuals = np.abs(y - jacobian @ x)
        sigma = max(1.4826 * float(np.median(residuals)), 1e-12 * float(np.max(np.abs(y), initial=1e-300)))
        weights = np.minimum(1.0, HUBER * sigma / np.maximum(residuals, 1e-300))
    return x, weights


def block_ratio(sums: np.ndarray, reference: np.ndarray) -> tuple[float, float, float]:
    """Return the ratio of two root mean square errors, and its 95 % interval. `sums` and `reference` (B,) are sums of
    squares in B blocks, which are drawn with replacement. The interval is NaN with fewer than MIN_BLOCKS blocks. (4)"""
    ratio = float(np.sqrt(sums.sum() / reference.sum()))
    if len(sums) < MIN_BLOCKS:
        return ratio, float("nan"), float("nan")
    draws = np.random.default_rng(0).integers(0, len(sums), (DRAWS, len(sums)))
    low, high = np.quantile(np.sqrt(sums[draws].sum(axis=1) / reference[draws].sum(axis=1)), [0.025, 0.975])
    return ratio, float(low), float(high)


class SignedLine(NamedTuple):
    """Least-squares lines through the columns of y sgn x as functions of |x|, over the rows of one sign of x. Their
    residuals have a slope by w sgn x."""

    share: float  # of the rows with |x| > minimum
    X: np.ndarray  # (n, 3) of |x|, 1 and the part of w sgn x that a line through |x| does not explain
    D: np.ndarray  # (n, q) y sgn x
    B: np.ndarray  # (3, q) slopes and constants, slopes by w


def lines_by_sign(xw: np.ndarray, y: np.ndarray, minimum: float) -> list[SignedLine]:
    """Return the lines of y (N, q) for positive and for negative x, over finite rows with |x| > `minimum`. `xw` (N, 2)
    contains x and w; what |x| and w explain alike is counted for |x|."""
    x, w = xw.T
    is_used, lines = np.isfinite(y).all(axis=1) & (np.abs(x) > minimum), []
    for sign in (1.0, -1.0):
        rows = is_used & (np.sign(x) == sign)
        X, D = np.stack([np.abs(x[rows]), np.ones(rows.sum())], axis=1), sign * y[rows]
        share, inverse = float(rows.sum() / max((np.abs(x) > minimum).sum(), 1)), np.linalg.pinv(X)
        z = sign * w[rows] - X @ (inverse @ (sign * w[rows]))
        B = np.concatenate([inverse @ D, [z @ D / max(z @ z, MIN_UNEXPLAINED * (w[rows] @ w[rows]), 1e-300)]])
        lines.append(SignedLine(share, np.column_stack([X, z]), D, B))
    return lines


def enclosing_cov(x: np.ndarray) -> np.ndarray:
    """Return the least C (q, q) with gᵀ C g ≥ (gᵀ x_i)² for all g and all rows x_i (n, q): Löwner's ellipsoid of ± x_i,
    by the multiplicative iteration of Silvey, Titterington and Torsney (1978)."""
    weights, C, distances = np.full(len(x), 1.0 / max(len(x), 1)), np.zeros((x.shape[1],) * 2), np.zeros(1)
    for _ in range(ENCLOSING_STEPS):
        C = (x.T * weights) @ x
        distances = np.einsum("ni,ij,nj->n", x, np.linalg.pinv(C, rcond=1e-9), x)
        weights = weights * distances / max(float(weights @ distances), 1e-300)
    return C * float(np.max(distances, initial=0.0))


def largest_errors_cov(errors: np.ndarray) -> np.ndarray:
    """Return C (k, k) of the `errors` (n, k) of n effects. They can have one cause, so C is not their sum:
    C = D Σ_i e_i e_iᵀ D,   D diagonal with C_jj = max_i e_ij²."""
    squares = np.sum(errors**2, axis=0)
    scale = np.max(np.abs(errors), axis=0) / np.sqrt(np.where(squares > 0.0, squares, 1.0))
    scaled_errors = errors * scale
    return scaled_errors.T @ scaled_errors


def row_cov(r: np.ndarray) -> np.ndarray:
    """Return the covariance (m, m) of rows r (N, m)."""
    return np.atleast_2d(np.cov(r.T)) if len(r) > 1 else np.zeros((r.shape[1], r.shape[1]))
