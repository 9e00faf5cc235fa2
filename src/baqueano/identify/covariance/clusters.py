"""Compute error bars from the scores of blocks: the jackknife, and the comparison with the sandwich.

    s_b = Σ_t∈b ψ ∂r,   over n blocks b         numerics/statistics.py                                            (1)
    A_b = Σ_t∈b ψ' ∂r ∂rᵀ,   m_b = (A − A_b)⁻¹ s_b,  cov = (n − 1)/n Σ_b (m_b − m̄)(m_b − m̄)ᵀ                (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)
    cov_ii ← max(C, (2))_ii   where   tr C⁻¹ (2) / k > 1 + 4 √(2/(n k)),   C = A⁻¹ B A⁻¹                   (4)

(3) is for a model that lacks an effect, (4) for a correct model, over its k shared parameters. In a run of segments,
(4) is applied again with the segments as blocks. docs/derivations/robust_covariance.md derives (1) to (4).
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from baqueano.identify.data.record import FitRecord
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.normal_equations import projected_derivatives
from baqueano.numerics.parallel import gram, parallel_map
from baqueano.numerics.statistics import HUBER, change_covariance

if TYPE_CHECKING:
    from baqueano.identify.covariance.information import Information

MAX_DERIVATIVE = 1e100  # a larger one belongs to a model that diverged; its square is still finite
BLOCK_S = 2.0  # one minute contains more blocks than a fit has parameters
MIN_BLOCKS, MAX_BLOCKS = 10, 60  # blocks
MIN_SEGMENTS = 3  # fewer segments agree or disagree by chance
SIGNIFICANT_SIGMA = 4.0  # times the scatter of white noise
MIN_REMAINDER = 1e-3  # part of the information that remains without a block; an initial state would have 0
MAX_BLOCK_SHARE = 0.9  # largest part of the information on a direction that is allowed for one block
MAX_SEGMENT_SHARE = 0.99  # the same for one segment


def inflation_factors(variance: np.ndarray, min_variance: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of standard errors that raise each `variance` (k,) to at least `min_variance` (k,)."""
    return np.sqrt(np.maximum(min_variance / np.maximum(variance, 1e-300), 1.0))


def jackknife(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    bread: np.ndarray,
    is_limited: bool = False,
    by_segment: bool = False,
) -> np.ndarray | None:
    """Return the covariance (k, k) of the `identifiable` entries of θ. `bread` (p, p) is the information.  (2)

    If runs are split, the initial states of the segments are eliminated first. If `by_segment`, each segment is one
    block. Return None for too few blocks, no entries, a model that diverged, or `by_segment` with runs that are not
    split. If `is_limited`, also return None if one block has more than MAX_BLOCK_SHARE of the information on a
    direction (one segment: MAX_SEGMENT_SHARE).
    """
    if not len(identifiable) or (by_segment and not problem.layout.has_split_runs):
        return None
    root, inverse = _scaled_inverse(bread[np.ix_(identifiable, identifiable)])
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
        identity, run_inverse = np.eye(len(positions)), inverse[np.ix_(positions, positions)]
        remainder = (1.0 + MIN_REMAINDER) * identity - A_b @ run_inverse
        changes.append(np.linalg.solve(remainder, g[:, :, None])[:, :, 0] @ inverse[positions] / root)
        cross_cov = inverse[np.ix_(positions, shared_entries)]
        shared_cov = inverse[np.ix_(shared_entries, shared_entries)]
        if is_limited and _is_dominated_by_one_block(A_b, remainder, cross_cov, shared_cov, max_share):
            return None
    all_changes = np.concatenate(changes)
    if len(all_changes) < min_count or not np.isfinite(all_changes).all():
        return None
    return change_covariance(all_changes)


def _scaled_inverse(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return √A_ii (k,), and the inverse (k, k) of A with its entries divided by them."""
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    return root, np.linalg.inv(A / np.outer(root, root))


def are_finite(d: np.ndarray) -> bool:
    """Return True if derivatives (N, m, q) belong to a model that did not diverge."""
    return bool(np.max(d, initial=0.0) < MAX_DERIVATIVE and np.min(d, initial=0.0) > -MAX_DERIVATIVE)


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
        if not problem.layout.has_split_runs:
            yield r, d, index
            continue
        start = index >= problem.layout.first_start
        if are_finite(d):
            yield r, projected_derivatives(d, np.abs(r) < HUBER, start), index[~start]
        else:
            yield r, np.full_like(d[..., ~start], np.nan), index[~start]


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
    """Return `info` with B replaced: no `identifiable` entry has a smaller error than in `cov` (k, k). (3)"""
    index = np.ix_(identifiable, identifiable)
    A, meat = info.bread[index], info.meat.copy()
    root, inverse = _scaled_inverse(A)
    sandwich = inverse @ (meat[index] / np.outer(root, root)) @ inverse
    D = inflation_factors(np.diagonal(cov) * root**2, np.maximum(np.diagonal(sandwich), np.diagonal(inverse)))
    product = A @ (cov * np.outer(D, D)) @ A
    meat[index] = 0.5 * (product + product.T)
    return info._replace(meat=meat)
