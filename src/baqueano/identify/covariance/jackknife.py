"""Estimate standard errors by leaving out one block of the run at a time (jackknife).

    θ_b − θ̂ = (A − A_b)⁻¹ g_b,   g_b = Σ_t∈b ψ ∂r,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ                                (1)
    cov = (n − 1)/n Σ_b (θ_b − θ̄)(θ_b − θ̄)ᵀ   over n blocks b of BLOCK_S                                 (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)
    cov_ii ← max(C, (2))_ii   where   tr C⁻¹ (2) / k > 1 + 4 √(2/(n k)),   C = A⁻¹ B A⁻¹                   (4)

(3) is for a model that lacks an effect, (4) for a correct model, over its k shared parameters. No parameter may depend
on one block only, as on the block with a hand measurement at the end. Longer runs have longer blocks, at most MOST. In
a run of segments (segments.py) each block is inside one segment, and d⊥ replaces ∂r in (1). Then the segments
themselves are the blocks, at least FEWEST_SEGMENTS, and (4) is applied again. docs/derivations/robust_covariance.md
gives the reasons.
Sources: Quenouille 1956, Tukey 1958; one step of Gauss-Newton for each block; Künsch 1989 for blocks.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from baqueano.identify.covariance.information import FAR, Information
from baqueano.identify.data.record import FitRecord
from baqueano.identify.data.segments import slopes_without_start
from baqueano.identify.parallel import gram
from baqueano.identify.residuals.simulation import HUBER, Residuals

BLOCK_S = 2.0  # one minute contains more blocks than a fit has parameters
FEWEST, MOST = 10, 60  # blocks
FEWEST_SEGMENTS = 3  # fewer segments agree or disagree by chance
SURE = 4.0  # times the scatter of white noise
LEAST = 1e-3  # part of the information on each entry that stays without a block; a start would have 0
MOST_KNOWN = 0.9  # largest part of the information on any direction that one block may have
MOST_OF_SEGMENT = 0.99  # the same for one segment


def jackknife(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    bread: np.ndarray,
    alike: bool = False,
    by_segment: bool = False,
) -> np.ndarray | None:
    """Return the covariance (k, k) of the `identifiable` entries of θ. `bread` (p, p) is the information.  (1), (2)

    If runs are cut, the starts are eliminated first. If `by_segment`, each segment is one block. Return None for too
    few blocks, no entries, a model that diverged, or `by_segment` with whole runs. If `alike`, return None also if
    one block has more than MOST_KNOWN of the information (one segment: MOST_OF_SEGMENT).
    """
    if not len(identifiable) or (by_segment and not _is_cut(problem)):
        return None
    A = bread[np.ix_(identifiable, identifiable)]
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    place = np.full(problem.size, -1)
    place[identifiable] = np.arange(len(identifiable))
    block_s = np.inf if by_segment else block_of(problem)
    fewest, most = (FEWEST_SEGMENTS, MOST_OF_SEGMENT) if by_segment else (FEWEST, MOST_KNOWN)
    moves, shared_entries = [], np.flatnonzero(identifiable < problem.layout.shared)
    for (r, d, index), record in zip(slopes_of(problem, theta), problem.records, strict=True):
        inside = place[index] >= 0
        at = place[index[inside]]
        g, A_b = _blocks(r, d, edges_of(record, block_s, len(r)))
        g, A_b = g[:, inside] / root[at], A_b[:, inside][:, :, inside] / np.outer(root[at], root[at])
        # a run has information on few entries: (A − A_b)⁻¹ g = A⁻¹ (1 − A_b C)⁻¹ g, with C the part of A⁻¹ of these
        remainder = (1.0 + LEAST) * np.eye(len(at)) - A_b @ inverse[np.ix_(at, at)]
        moves.append(np.linalg.solve(remainder, g[:, :, None])[:, :, 0] @ inverse[at] / root)
        between, own = inverse[np.ix_(at, shared_entries)], inverse[np.ix_(shared_entries, shared_entries)]
        if alike and _of_one_block_only(A_b, remainder, between, own, most):
            return None
    every = np.concatenate(moves)
    n = len(every)
    if n < fewest or not np.isfinite(every).all():
        return None
    off = every - np.mean(every, axis=0)
    return (n - 1) / n * off.T @ off


def block_of(problem: Residuals) -> float:
    """Return the duration of one block [s]."""
    return max(BLOCK_S, _driven_s(problem) / MOST)


def edges_of(record: FitRecord, block_s: float, n: int) -> list[int]:
    """Return the rows at which the blocks of a segment of `n` rows begin, and `n`."""
    ends = np.cumsum(record.dt_s[record.lead :])
    first = record.lead + np.flatnonzero(np.diff(ends // block_s, prepend=-1.0))
    return [*first.tolist(), n]


def slopes_of(problem: Residuals, theta: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield for each segment r (N, m), ∂r (N, m, q) and the indices of the q entries in θ. If runs are cut, the
    starts are eliminated, and ∂r is NaN in a segment in which the model diverged."""
    for r, d, index in problem.sensitivities(theta):
        if not _is_cut(problem):
            yield r, d, index
            continue
        start = index >= problem.layout.starts
        if np.max(d, initial=0.0) < FAR and np.min(d, initial=0.0) > -FAR:
            yield r, slopes_without_start(d, np.abs(r) < HUBER, start), index[~start]
        else:
            yield r, np.full_like(d[..., ~start], np.nan), index[~start]


def _is_cut(problem: Residuals) -> bool:
    """Return True if runs are cut into segments."""
    return len(problem.records) > max(problem.layout.runs) + 1


def _driven_s(problem: Residuals) -> float:
    """Return the duration of all runs [s], without the leads of their segments."""
    return sum(float(np.sum(record.dt_s[record.lead :])) for record in problem.records)


def _of_one_block_only(
    A_b: np.ndarray, remainder: np.ndarray, between: np.ndarray, own: np.ndarray, most: float
) -> bool:
    """Return True if a block has more than `most` of the information on a direction of the shared entries. `own`
    (k, k) is the covariance of the shared entries, `between` (q, k) the covariance of the entries of this run with
    the shared entries."""
    more = between.T @ np.linalg.solve(remainder, A_b @ between)  # increase of `own` without the block
    room = most / (1.0 - most) * own - 0.5 * (more + more.transpose(0, 2, 1))
    try:
        np.linalg.cholesky(room)
    except np.linalg.LinAlgError:
        return True
    return not np.isfinite(room).all()


def _blocks(r: np.ndarray, d: np.ndarray, edges: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return g (n, q) and A (n, q, q) of (1), from residuals (N, m), derivatives (N, m, q) and the rows `edges`."""
    (m, q), r, d = d.shape[1:], r.ravel(), d.reshape(-1, d.shape[2])
    g, A = np.zeros((len(edges) - 1, q)), np.zeros((len(edges) - 1, q, q))
    with np.errstate(invalid="ignore", over="ignore"):  # a model that diverged
        for b, (first, end) in enumerate(pairwise(m * np.array(edges))):
            x, residuals = d[first:end], r[first:end]
            g[b] = np.clip(residuals, -HUBER, HUBER) @ x
            A[b] = gram(x) - gram(x[np.abs(residuals) >= HUBER])
    return g, A


def no_smaller(
    problem: Residuals, cov: np.ndarray, other: np.ndarray | None, k: int, by_segment: bool = False
) -> np.ndarray:
    """Return `cov` (p, p) with the errors of the first k entries raised to their errors in `other` (p, p), if larger.

    All runs share the first k entries. Return `cov` unchanged without `other`, or if the blocks (`by_segment`: the
    segments) agree.  (4)"""
    if other is None or not k:
        return cov
    shared_cov, blocks = cov[:k, :k], other[:k, :k]
    n = len(problem.records) if by_segment else min(MOST, int(_driven_s(problem) / BLOCK_S))
    disagree = np.trace(np.linalg.solve(shared_cov, blocks)) / k
    if not disagree > 1.0 + SURE * np.sqrt(2.0 / (n * k)):
        return cov
    wider = np.ones(len(cov))
    wider[:k] = np.sqrt(np.maximum(np.diagonal(blocks) / np.maximum(np.diagonal(shared_cov), 1e-300), 1.0))
    return cov * np.outer(wider, wider)


def with_blocks(info: Information, identifiable: np.ndarray, cov: np.ndarray) -> Information:
    """Return `info` with the error of each `identifiable` entry raised to its error in `cov` (k, k), if that is
    larger.  (3)"""
    at = np.ix_(identifiable, identifiable)
    A, meat = info.bread[at], info.meat.copy()
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    own = inverse @ (meat[at] / np.outer(root, root)) @ inverse
    variance = np.diagonal(cov) * root**2
    most = np.maximum(variance, np.maximum(np.diagonal(own), np.diagonal(inverse)))
    D = np.sqrt(most / np.maximum(variance, 1e-300))
    product = A @ (cov * np.outer(D, D)) @ A
    meat[at] = 0.5 * (product + product.T)
    return info._replace(meat=meat)
