"""Compute error bars from the scores of blocks: the sandwich with blocks as clusters, and the jackknife.

    s_b = Σ_t∈b ψ ∂r,   m_b = A⁻¹ s_b,              cov = n/(n − p) Σ_b m_b m_bᵀ      over n blocks b         (1)
    A_b = Σ_t∈b ψ' ∂r ∂rᵀ,   m_b = (A − A_b)⁻¹ s_b,  cov = (n − 1)/n Σ_b (m_b − m̄)(m_b − m̄)ᵀ                (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)
    cov_ii ← max(C, (2))_ii   where   tr C⁻¹ (2) / k > 1 + 4 √(2/(n k)),   C = A⁻¹ B A⁻¹                   (4)

Sums over blocks longer than the errors of the vehicle are independent, for any autocorrelation inside a block. With few
blocks an interval needs Student's quantile. (2) leaves out each block in one step of Gauss-Newton; (3) is for a model
that lacks an effect, (4) for a correct model, over its k shared parameters. No parameter may depend on one block only.
Longer runs have longer blocks. In a run of segments each block is inside one segment, and d⊥ replaces ∂r. Then the
segments are the blocks, and (4) is applied again. Reasons: docs/derivations/robust_covariance.md. Sources: Liang and
Zeger 1986; Quenouille 1956, Tukey 1958; Künsch 1989 for blocks; Cornish and Fisher for Student's quantile.
"""

from collections.abc import Iterator
from itertools import pairwise
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from baqueano.identify.data.record import FitRecord
from baqueano.identify.data.segments import derivatives_without_start
from baqueano.identify.parallel import gram, parallel_map
from baqueano.identify.residuals.simulation import HUBER, Residuals

if TYPE_CHECKING:
    from baqueano.identify.covariance.information import Information

# derivatives beyond it belong to a model that diverged; their squares are still finite
MAX_DERIVATIVE = 1e100
BLOCK_S = 2.0  # one minute contains more blocks than a fit has parameters
MIN_BLOCKS, MAX_BLOCKS = 10, 60  # blocks
MIN_SEGMENTS = 3  # fewer segments agree or disagree by chance
SIGNIFICANT_SIGMA = 4.0  # times the scatter of white noise
MIN_REMAINDER = 1e-3  # part of the information that remains without a block; an initial state would have 0
MAX_BLOCK_SHARE = 0.9  # largest part of the information on a direction that is allowed for one block
MAX_SEGMENT_SHARE = 0.99  # the same for one segment
QUANTILE_95 = 1.959963984540054  # standard deviations within which 95 % of a normal distribution lie


def student_quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t with `freedom` degrees of freedom (below 5: a whole number)."""
    if freedom < 5:
        return _exact_student_quantile(probability, int(freedom))
    z, n = NormalDist().inv_cdf(probability), float(freedom)
    first = (z**3 + z) / (4.0 * n)
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / (96.0 * n**2)
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / (384.0 * n**3)
    return z + first + second + third


def _exact_student_quantile(probability: float, freedom: int) -> float:
    """Return the exact quantile for n = 1 to 4 degrees of freedom, by bisection of the integral over θ = atan(t/√n)."""
    distribution = {
        1: lambda x: x / np.pi,
        2: lambda x: 0.5 * np.sin(x),
        3: lambda x: (x + np.sin(x) * np.cos(x)) / np.pi,
        4: lambda x: 0.5 * np.sin(x) * (1.0 + 0.5 * np.cos(x) ** 2),
    }[freedom]
    low, high = -0.5 * np.pi, 0.5 * np.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if distribution(middle) < probability - 0.5 else (low, middle)
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


def covariance_of_changes(changes: np.ndarray, parameter_count: int | None = None) -> np.ndarray:
    """Return the covariance (p, p) of an estimate from its `changes` (n, p), one for each independent block. A move is
    A⁻¹ s_b if the number of `parameter_count` parameters is given (1), else the change without the block (2)."""
    n = len(changes)
    if parameter_count is not None:
        return changes.T @ changes * (n / (n - parameter_count))
    deviations = changes - np.mean(changes, axis=0)
    return (n - 1) / n * deviations.T @ deviations


def inflation_factors(variance: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of standard errors that raise each `variance` (k,) to `least` (k,) if it is below."""
    return np.sqrt(np.maximum(least / np.maximum(variance, 1e-300), 1.0))


def batch_covariance(
    jacobian: np.ndarray, residuals: np.ndarray, weights: np.ndarray, batch: np.ndarray
) -> np.ndarray:
    """Return the covariance (p, p) of a regression; infinite without information or for at most p batches. (1)
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
    return covariance_of_changes(changes.T, p) / np.outer(scale, scale)


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


def jackknife(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    bread: np.ndarray,
    alike: bool = False,
    by_segment: bool = False,
) -> np.ndarray | None:
    """Return the covariance (k, k) of the `identifiable` entries of θ. `bread` (p, p) is the information.  (2)

    If runs are split, the initial states of the segments are eliminated first. If `by_segment`, each segment is one
    block. Return None for too few blocks, no entries, a model that diverged, or `by_segment` with runs that are not
    split. If `alike`, also return None if one block has more than MAX_BLOCK_SHARE of the information on a direction
    (one segment: MAX_SEGMENT_SHARE).
    """
    if not len(identifiable) or (by_segment and not _has_split_runs(problem)):
        return None
    A = bread[np.ix_(identifiable, identifiable)]
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    position = np.full(problem.size, -1)
    position[identifiable] = np.arange(len(identifiable))
    block_s = np.inf if by_segment else block_duration_s(problem)
    min_count, max_share = (MIN_SEGMENTS, MAX_SEGMENT_SHARE) if by_segment else (MIN_BLOCKS, MAX_BLOCK_SHARE)
    changes, shared_entries = [], np.flatnonzero(identifiable < problem.layout.shared_count)
    segments = list(segment_derivatives(problem, theta))

    def sums(segment: tuple[np.ndarray, ...], record: FitRecord) -> tuple[np.ndarray, np.ndarray]:
        r, d, _ = segment
        return _block_sums(r, d, block_edges(record, block_s, len(r)))

    rows = sum(len(r) for r, _, _ in segments)
    block_sums = parallel_map(sums, segments, problem.records, rows=rows)
    for (_, _, index), (g, A_b) in zip(segments, block_sums, strict=True):
        is_identifiable = position[index] >= 0
        positions = position[index[is_identifiable]]
        g = g[:, is_identifiable] / root[positions]
        A_b = A_b[:, is_identifiable][:, :, is_identifiable] / np.outer(root[positions], root[positions])
        # a run has information on few entries: (A − A_b)⁻¹ g = A⁻¹ (1 − A_b C)⁻¹ g; C is the part of A⁻¹ for these
        remainder = (1.0 + MIN_REMAINDER) * np.eye(len(positions)) - A_b @ inverse[
            np.ix_(positions, positions)
        ]
        changes.append(np.linalg.solve(remainder, g[:, :, None])[:, :, 0] @ inverse[positions] / root)
        cross_cov = inverse[np.ix_(positions, shared_entries)]
        shared_cov = inverse[np.ix_(shared_entries, shared_entries)]
        if alike and _is_dominated_by_one_block(A_b, remainder, cross_cov, shared_cov, max_share):
            return None
    all_changes = np.concatenate(changes)
    if len(all_changes) < min_count or not np.isfinite(all_changes).all():
        return None
    return covariance_of_changes(all_changes)


def block_duration_s(problem: Residuals) -> float:
    """Return the duration of one block [s]."""
    return max(BLOCK_S, _total_s(problem) / MAX_BLOCKS)


def block_edges(record: FitRecord, block_s: float, n: int) -> list[int]:
    """Return the rows at which the blocks of a segment begin, and its number of rows `n` as the last entry."""
    ends = np.cumsum(record.dt_s[record.lead :])
    first = record.lead + np.flatnonzero(np.diff(ends // block_s, prepend=-1.0))
    return [*first.tolist(), n]


def segment_derivatives(
    problem: Residuals, theta: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield for each segment r (N, m), ∂r (N, m, q) and the indices of the q entries in θ. If runs are split, the
    initial states are eliminated, and ∂r is NaN in a segment in which the model diverged."""
    for r, d, index in problem.sensitivities(theta):
        if not _has_split_runs(problem):
            yield r, d, index
            continue
        start = index >= problem.layout.first_start
        if np.max(d, initial=0.0) < MAX_DERIVATIVE and np.min(d, initial=0.0) > -MAX_DERIVATIVE:
            yield r, derivatives_without_start(d, np.abs(r) < HUBER, start), index[~start]
        else:
            yield r, np.full_like(d[..., ~start], np.nan), index[~start]


def _has_split_runs(problem: Residuals) -> bool:
    """Return True if any run is split into segments."""
    return len(problem.records) > max(problem.layout.runs) + 1


def _total_s(problem: Residuals) -> float:
    """Return the total duration of all runs [s], without the leads of their segments."""
    return sum(float(np.sum(record.dt_s[record.lead :])) for record in problem.records)


def _is_dominated_by_one_block(
    A_b: np.ndarray, remainder: np.ndarray, cross_cov: np.ndarray, shared_cov: np.ndarray, max_share: float
) -> bool:
    """Return True if a block has more than `max_share` of the information on a direction of the shared entries.
    `shared_cov` (k, k) is the covariance of the shared entries, `cross_cov` (q, k) the covariance of the entries of
    this run with the shared entries."""
    # increase of `shared_cov` without the block
    increase = cross_cov.T @ np.linalg.solve(remainder, A_b @ cross_cov)
    slack = max_share / (1.0 - max_share) * shared_cov - 0.5 * (increase + increase.transpose(0, 2, 1))
    try:
        np.linalg.cholesky(slack)
    except np.linalg.LinAlgError:
        return True
    return not np.isfinite(slack).all()


def _block_sums(r: np.ndarray, d: np.ndarray, edges: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return s_b (n, q) and A_b (n, q, q) of (2), from residuals (N, m), derivatives (N, m, q) and the rows `edges`."""
    (m, q), r, d = d.shape[1:], r.ravel(), d.reshape(-1, d.shape[2])
    g, A = np.zeros((len(edges) - 1, q)), np.zeros((len(edges) - 1, q, q))
    with np.errstate(invalid="ignore", over="ignore"):  # a model that diverged
        for b, (first, end) in enumerate(pairwise(m * np.array(edges))):
            x, residuals = d[first:end], r[first:end]
            g[b] = np.clip(residuals, -HUBER, HUBER) @ x
            A[b] = gram(x) - gram(x[np.abs(residuals) >= HUBER])
    return g, A


def with_larger_errors(
    problem: Residuals, cov: np.ndarray, jackknife_cov: np.ndarray | None, k: int, by_segment: bool = False
) -> np.ndarray:
    """Return `cov` (p, p) with the standard errors of the first k entries raised to those of `jackknife_cov`. All runs
    share the first k entries. Return `cov` unchanged if `jackknife_cov` is None, or if the two covariances agree within
    the scatter of the blocks (`by_segment`: of the segments). (4)"""
    if jackknife_cov is None or not k:
        return cov
    shared_cov, block_cov = cov[:k, :k], jackknife_cov[:k, :k]
    n = len(problem.records) if by_segment else min(MAX_BLOCKS, int(_total_s(problem) / BLOCK_S))
    disagreement = np.trace(np.linalg.solve(shared_cov, block_cov)) / k
    if not disagreement > 1.0 + SIGNIFICANT_SIGMA * np.sqrt(2.0 / (n * k)):
        return cov
    factors = np.ones(len(cov))
    factors[:k] = inflation_factors(np.diagonal(shared_cov), np.diagonal(block_cov))
    return cov * np.outer(factors, factors)


def with_jackknife(info: "Information", identifiable: np.ndarray, cov: np.ndarray) -> "Information":
    """Return `info` with B replaced, so that no `identifiable` entry has a smaller standard error than in `cov` (k, k).
    The correlations are those of `cov`. (3)"""
    index = np.ix_(identifiable, identifiable)
    A, meat = info.bread[index], info.meat.copy()
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    sandwich = inverse @ (meat[index] / np.outer(root, root)) @ inverse
    D = inflation_factors(np.diagonal(cov) * root**2, np.maximum(np.diagonal(sandwich), np.diagonal(inverse)))
    product = A @ (cov * np.outer(D, D)) @ A
    meat[index] = 0.5 * (product + product.T)
    return info._replace(meat=meat)
