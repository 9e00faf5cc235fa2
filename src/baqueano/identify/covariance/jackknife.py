"""Estimate standard errors by leaving out one block of the run at a time (jackknife).

    θ_b − θ̂ = (A − A_b)⁻¹ g_b,   g_b = Σ_t∈b ψ ∂r,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ                                (1)
    cov = (n − 1)/n Σ_b (θ_b − θ̄)(θ_b − θ̄)ᵀ   over n blocks b of BLOCK_S                                 (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)
    cov_ii ← max(C, (2))_ii   where   tr C⁻¹ (2) / k > 1 + 4 √(2/(n k)),   C = A⁻¹ B A⁻¹                   (4)

(3) is for a model that lacks an effect, (4) for a correct model, over its k shared parameters. A parameter must not
depend on one block only, for example on the block with a hand measurement at the end. Longer runs have longer blocks,
at most MAX_BLOCKS. In a run of segments (segments.py) each block is inside one segment, and d⊥ replaces ∂r in (1).
Then the segments themselves are the blocks, at least MIN_SEGMENTS, and (4) is applied again.
docs/derivations/robust_covariance.md gives the reasons. Sources: Quenouille 1956, Tukey 1958; one step of
Gauss-Newton for each block; Künsch 1989 for blocks.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from baqueano.identify.covariance.information import MAX_DERIVATIVE, Information
from baqueano.identify.data.record import FitRecord
from baqueano.identify.data.segments import derivatives_without_start
from baqueano.identify.parallel import gram
from baqueano.identify.residuals.simulation import HUBER, Residuals

BLOCK_S = 2.0  # one minute contains more blocks than a fit has parameters
MIN_BLOCKS, MAX_BLOCKS = 10, 60  # blocks
MIN_SEGMENTS = 3  # fewer segments agree or disagree by chance
SIGNIFICANT_SIGMA = 4.0  # times the scatter of white noise
MIN_REMAINDER = 1e-3  # part of the information that remains without a block; an initial state would have 0
MAX_BLOCK_SHARE = 0.9  # largest part of the information on a direction that is allowed for one block
MAX_SEGMENT_SHARE = 0.99  # the same for one segment


def jackknife(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    bread: np.ndarray,
    alike: bool = False,
    by_segment: bool = False,
) -> np.ndarray | None:
    """Return the covariance (k, k) of the `identifiable` entries of θ. `bread` (p, p) is the information.  (1), (2)

    If runs are split, the initial states of the segments are eliminated first. If `by_segment`, each segment is one
    block. Return None for too few blocks, no entries, a model that diverged, or `by_segment` with runs that are not
    split. If `alike`, also return None if one block has more than MAX_BLOCK_SHARE of the information on a direction
    (one segment: MAX_SEGMENT_SHARE).
    """
    if not len(identifiable) or (by_segment and not _is_cut(problem)):
        return None
    A = bread[np.ix_(identifiable, identifiable)]
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    position = np.full(problem.size, -1)
    position[identifiable] = np.arange(len(identifiable))
    block_s = np.inf if by_segment else block_duration_s(problem)
    min_count, max_share = (MIN_SEGMENTS, MAX_SEGMENT_SHARE) if by_segment else (MIN_BLOCKS, MAX_BLOCK_SHARE)
    moves, shared_entries = [], np.flatnonzero(identifiable < problem.layout.shared_count)
    for (r, d, index), record in zip(segment_derivatives(problem, theta), problem.records, strict=True):
        is_identifiable = position[index] >= 0
        positions = position[index[is_identifiable]]
        g, A_b = _block_sums(r, d, edges_of(record, block_s, len(r)))
        g = g[:, is_identifiable] / root[positions]
        A_b = A_b[:, is_identifiable][:, :, is_identifiable] / np.outer(root[positions], root[positions])
        # a run has information on few entries: (A − A_b)⁻¹ g = A⁻¹ (1 − A_b C)⁻¹ g; C is the part of A⁻¹ for these
        remainder = (1.0 + MIN_REMAINDER) * np.eye(len(positions)) - A_b @ inverse[
            np.ix_(positions, positions)
        ]
        moves.append(np.linalg.solve(remainder, g[:, :, None])[:, :, 0] @ inverse[positions] / root)
        cross_cov = inverse[np.ix_(positions, shared_entries)]
        shared_cov = inverse[np.ix_(shared_entries, shared_entries)]
        if alike and _is_dominated_by_one_block(A_b, remainder, cross_cov, shared_cov, max_share):
            return None
    all_moves = np.concatenate(moves)
    n = len(all_moves)
    if n < min_count or not np.isfinite(all_moves).all():
        return None
    deviations = all_moves - np.mean(all_moves, axis=0)
    return (n - 1) / n * deviations.T @ deviations


def block_duration_s(problem: Residuals) -> float:
    """Return the duration of one block [s]."""
    return max(BLOCK_S, _total_s(problem) / MAX_BLOCKS)


def edges_of(record: FitRecord, block_s: float, n: int) -> list[int]:
    """Return the rows at which the blocks of a segment begin, and its number of rows `n` as the last entry."""
    ends = np.cumsum(record.dt_s[record.lead :])
    first = record.lead + np.flatnonzero(np.diff(ends // block_s, prepend=-1.0))
    return [*first.tolist(), n]


def segment_derivatives(
    problem: Residuals, theta: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield for each segment r (N, m), ∂r (N, m, q) and the indices of the q entries in θ.

    If runs are split, the initial states are eliminated, and ∂r is NaN in a segment in which the model diverged.
    """
    for r, d, index in problem.sensitivities(theta):
        if not _is_cut(problem):
            yield r, d, index
            continue
        start = index >= problem.layout.first_start
        if np.max(d, initial=0.0) < MAX_DERIVATIVE and np.min(d, initial=0.0) > -MAX_DERIVATIVE:
            yield r, derivatives_without_start(d, np.abs(r) < HUBER, start), index[~start]
        else:
            yield r, np.full_like(d[..., ~start], np.nan), index[~start]


def _is_cut(problem: Residuals) -> bool:
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
    increase = cross_cov.T @ np.linalg.solve(
        remainder, A_b @ cross_cov
    )  # increase of `shared_cov` without the block
    slack = max_share / (1.0 - max_share) * shared_cov - 0.5 * (increase + increase.transpose(0, 2, 1))
    try:
        np.linalg.cholesky(slack)
    except np.linalg.LinAlgError:
        return True
    return not np.isfinite(slack).all()


def _block_sums(r: np.ndarray, d: np.ndarray, edges: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return g (n, q) and A (n, q, q) of (1), from residuals (N, m), derivatives (N, m, q) and the rows `edges`."""
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
    """Return `cov` (p, p). The standard errors of the first k entries are replaced by those of `jackknife_cov`, if
    larger.

    All runs share the first k entries. Return `cov` unchanged if `jackknife_cov` is None, or if the two covariances
    agree within the scatter of the blocks (`by_segment`: of the segments).  (4)"""
    if jackknife_cov is None or not k:
        return cov
    shared_cov, block_cov = cov[:k, :k], jackknife_cov[:k, :k]
    n = len(problem.records) if by_segment else min(MAX_BLOCKS, int(_total_s(problem) / BLOCK_S))
    disagreement = np.trace(np.linalg.solve(shared_cov, block_cov)) / k
    if not disagreement > 1.0 + SIGNIFICANT_SIGMA * np.sqrt(2.0 / (n * k)):
        return cov
    widening = np.ones(len(cov))
    widening[:k] = np.sqrt(
        np.maximum(np.diagonal(block_cov) / np.maximum(np.diagonal(shared_cov), 1e-300), 1.0)
    )
    return cov * np.outer(widening, widening)


def with_jackknife(info: Information, identifiable: np.ndarray, cov: np.ndarray) -> Information:
    """Return `info` with B replaced, so that no `identifiable` entry has a smaller standard error than in `cov` (k,
    k). The correlations are those of `cov`.  (3)
    """
    index = np.ix_(identifiable, identifiable)
    A, meat = info.bread[index], info.meat.copy()
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    sandwich = inverse @ (meat[index] / np.outer(root, root)) @ inverse
    variance = np.diagonal(cov) * root**2
    max_variance = np.maximum(variance, np.maximum(np.diagonal(sandwich), np.diagonal(inverse)))
    D = np.sqrt(max_variance / np.maximum(variance, 1e-300))
    product = A @ (cov * np.outer(D, D)) @ A
    meat[index] = 0.5 * (product + product.T)
    return info._replace(meat=meat)
