"""Compute error bars from the scores of blocks: the jackknife, and the comparison with the sandwich.

    s_b = Σ_t∈b ψ ∂r,   over n blocks b         numerics/block_sums.py                                            (1)
    A_b = Σ_t∈b ψ' ∂r ∂rᵀ,   m_b = (A − A_b)⁻¹ s_b,  cov = (n − 1)/n Σ_b (m_b − m̄)(m_b − m̄)ᵀ                (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)
    cov_ii ← max(C, (2))_ii   where   tr C⁻¹ (2) / k > 1 + 4 √(2/(n k)),   C = A⁻¹ B A⁻¹                   (4)

(3) is for a model that lacks an effect, (4) for a correct model, over its k shared parameters. In a run of segments,
(4) is applied again with the segments as blocks. docs/derivations/robust_covariance.md derives (1) to (4).
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from baqueano.identify.data.record import FitRecord
from baqueano.identify.parameters.theta import ThetaLayout
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.block_sums import changes_without_blocks, scaled_inverse
from baqueano.numerics.normal_equations import projected_derivatives
from baqueano.numerics.statistics import HUBER, change_covariance

if TYPE_CHECKING:
    from baqueano.identify.covariance.information import Information

MAX_DERIVATIVE = 1e100  # a larger one belongs to a model that diverged; its square is still finite
BLOCK_S = 2.0  # one minute contains more blocks than a fit has parameters
MIN_BLOCKS, MAX_BLOCKS = 10, 60  # blocks
MIN_SEGMENTS = 3  # fewer segments agree or disagree by chance
SIGNIFICANT_SIGMA = 4.0  # times the scatter of white noise
MAX_BLOCK_SHARE = 0.9  # largest part of the information on a direction that is allowed for one block
MAX_SEGMENT_SHARE = 0.99  # the same for one segment


def inflation_factors(variance: np.ndarray, min_variance: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of standard errors that raise each `variance` (k,) to at least `min_variance` (k,)."""
    return np.sqrt(np.maximum(min_variance / np.maximum(variance, 1e-300), 1.0))


def jackknife(
    info: "Information",
    layout: ThetaLayout,
    identifiable: np.ndarray,
    is_limited: bool = False,
    by_segment: bool = False,
) -> np.ndarray | None:
    """Return the covariance (k, k) of the `identifiable` entries of θ from the blocks of `info`.  (2)

    If `by_segment`, each segment is one block. Return None for too few blocks, no entries, a model that diverged, or
    `by_segment` with runs that are not split. If `is_limited`, also return None if one block has more than
    MAX_BLOCK_SHARE of the information on a direction (one segment: MAX_SEGMENT_SHARE).
    """
    if not len(identifiable) or (by_segment and not layout.has_split_runs):
        return None
    A, segments = info.bread[np.ix_(identifiable, identifiable)], [s.part(identifiable) for s in info.blocks]
    min_count, max_share = (MIN_SEGMENTS, MAX_SEGMENT_SHARE) if by_segment else (MIN_BLOCKS, MAX_BLOCK_SHARE)
    segments = [segment.total for segment in segments] if by_segment else segments
    shared_count = int(np.sum(identifiable < layout.shared_count))
    changes = changes_without_blocks(segments, A, shared_count, max_share if is_limited else None)
    if changes is None or len(changes) < min_count or not np.isfinite(changes).all():
        return None
    return change_covariance(changes)


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
    root, inverse = scaled_inverse(A)
    sandwich = inverse @ (meat[index] / np.outer(root, root)) @ inverse
    D = inflation_factors(np.diagonal(cov) * root**2, np.maximum(np.diagonal(sandwich), np.diagonal(inverse)))
    product = A @ (cov * np.outer(D, D)) @ A
    meat[index] = 0.5 * (product + product.T)
    return info._replace(meat=meat)
