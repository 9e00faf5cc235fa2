"""Covariance of what a robust fit found: one sandwich, filled with the scores of blocks of time.

    A = Σ_t ψ' ∂r ∂rᵀ,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ,   s_b = Σ_t∈b ψ ∂r                                         (1)
    d_b = (A − A_b)⁻¹ s_b,   cov = (t_{n−1}/z)² Σ_b d_b d_bᵀ + Σ_e d_e d_eᵀ                               (2)
    longer blocks where they disagree with shorter ones:   tr cov⁻¹ cov' / k > 1 + SURE √(2/(n k))        (3)

d_b is by how much the fit moves without block b of BLOCK_S, or a regression without a batch. A − A_b in place of A
corrects for small samples: a fit draws scores to 0, the most where few rows count for much (jackknife, CR3); Student's
t in place of z, as n blocks know their own scatter to 1/√(2n). What is coloured inside of a block, or comes with the
motions that a model lacks, is in (2) whatever it is. d_e = A⁻¹ σ_e ∂g/∂e is the same of a scale or a zero that is held
and known to σ_e only (scale_uncertainty.py). Of runs in pieces ∂r is without what the start of the piece makes up for
(data/segments.py); a pose is coloured all along a piece, so (3) asks the n pieces over the k shared entries. Of fewer
than FEWEST blocks, or where one tells nearly all that is known of something, a tape at the end, the blocks are single
ticks (information.py). Where σ is that of slow motion (noise_level.py, (4)), no error is below A⁻¹. What was tried:
docs/derivations/sandwich.md.
Sources: Liang and Zeger 1986; Quenouille 1956, Tukey 1958; Künsch 1989; Bell and McCaffrey 2002 for CR3.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from baqueano.identify.covariance.information import FAR, Information, covariance_of, inverse
from baqueano.identify.covariance.quantiles import QUANTILE_95, students
from baqueano.identify.data.record import FitRecord
from baqueano.identify.data.segments import slopes_without_start
from baqueano.identify.parallel import gram
from baqueano.identify.residuals.simulation import HUBER, Residuals

BLOCK_S = 1.5  # a minute has more of them than a fit has parameters
FEWEST, MOST = 10, 60  # blocks
FEWEST_PIECES = 3  # fewer agree or disagree by chance
SURE = 4.0  # times the scatter of white noise
LEAST = 1e-3  # part of the information on each entry that is left without a block: a start has none
MOST_KNOWN = 0.9  # that a block may tell, of all that is known of anything
MOST_OF_PIECE = 0.99  # that a piece may


def covariance(problem: Residuals, theta: np.ndarray, kept: np.ndarray, info: Information) -> np.ndarray:
    """Return the covariance (k, k) of the entries `kept` of θ (p,) by the blocks of the runs.  (2), (3)"""
    blocks = left_out(problem, theta, kept, info.bread)
    cov = covariance_of(info, kept) if blocks is None else _summed(blocks)
    if _cut(problem) and (pieces := left_out(problem, theta, kept, info.bread, by_piece=True)) is not None:
        k, other = int(np.sum(kept < problem.layout.shared)), _summed(pieces)
        disagree = np.trace(np.linalg.solve(cov[:k, :k], other[:k, :k])) / max(k, 1)
        cov = other if disagree > 1.0 + SURE * np.sqrt(2.0 / (len(pieces) * max(k, 1))) else cov
    if problem.slow_noise:
        white = np.diagonal(inverse(info.bread[np.ix_(kept, kept)]))
        wider = np.sqrt(np.maximum(white / np.maximum(np.diagonal(cov), 1e-300), 1.0))
        cov = cov * np.outer(wider, wider)
    return cov


def _summed(moves: np.ndarray) -> np.ndarray:
    """Return Σ_b d_b d_bᵀ (k, k) of moves d_b (n, k), wider by Student's quantile, as n are few.  (2)"""
    return moves.T @ moves * (students(0.975, len(moves) - 1) / QUANTILE_95) ** 2


def left_out(
    problem: Residuals, theta: np.ndarray, kept: np.ndarray, bread: np.ndarray, by_piece: bool = False
) -> np.ndarray | None:
    """Return d_b (n, k) of the entries `kept` of θ with the information `bread` (p, p), of runs that are cut that
    without their starts; if `by_piece`, each piece is a block. None of too few blocks, of a model that ran away, or
    where a block has more than MOST_KNOWN, a piece more than MOST_OF_PIECE, of what is known of something.  (1)"""
    A = bread[np.ix_(kept, kept)]
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    whole = np.linalg.inv(A / np.outer(root, root))
    place = np.full(problem.size, -1)
    place[kept] = np.arange(len(kept))
    block_s = np.inf if by_piece else block_of(problem)
    fewest, most = (FEWEST_PIECES, MOST_OF_PIECE) if by_piece else (FEWEST, MOST_KNOWN)
    moves, shared = [], np.flatnonzero(kept < problem.layout.shared)
    for (r, d, index), record in zip(slopes_of(problem, theta), problem.records, strict=True):
        inside = place[index] >= 0
        at = place[index[inside]]
        s, A_b = _blocks(r, d, edges_of(record, block_s, len(r)))
        s, A_b = s[:, inside] / root[at], A_b[:, inside][:, :, inside] / np.outer(root[at], root[at])
        moves.append(without_each(s, A_b, whole, at) / root)
        left = _rest(A_b, whole, at)
        if _known_by_one(A_b, left, whole[np.ix_(at, shared)], whole[np.ix_(shared, shared)], most):
            return None
    every = np.concatenate(moves)
    return every if len(every) >= fewest and np.isfinite(every).all() else None


def without_each(s: np.ndarray, A_b: np.ndarray, whole: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return d_b (n, k) of scores s (n, q) and information A_b (n, q, q) on the entries `at` (q,), of which A⁻¹ is
    `whole` (k, k), in units in which A has ones on its diagonal.  (2)"""
    # the entries of one run are few: (A − A_b)⁻¹ s = A⁻¹ (1 − A_b C)⁻¹ s, C the part of A⁻¹ between them
    return np.linalg.solve(_rest(A_b, whole, at), s[:, :, None])[:, :, 0] @ whole[at]


def _rest(A_b: np.ndarray, whole: np.ndarray, at: np.ndarray) -> np.ndarray:
    """1 − A_b C (n, q, q), with a little on its diagonal."""
    return (1.0 + LEAST) * np.eye(len(at)) - A_b @ whole[np.ix_(at, at)]


def block_of(problem: Residuals) -> float:
    """Return the duration of a block [s]."""
    return max(BLOCK_S, _driven_s(problem) / MOST)


def edges_of(record: FitRecord, block_s: float, n: int) -> list[int]:
    """Return the rows at which the blocks of a piece of `n` rows begin, and its end."""
    ends = np.cumsum(record.dt_s[record.lead :])
    first = record.lead + np.flatnonzero(np.diff(ends // block_s, prepend=-1.0))
    return [*first.tolist(), n]


def slopes_of(problem: Residuals, theta: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Per piece r (N, m), ∂r (N, m, q), and where the q entries stand in θ; where runs are cut without the starts, NaN
    of a piece in which the model ran away."""
    for r, d, index in problem.sensitivities(theta):
        if not _cut(problem):
            yield r, d, index
            continue
        start = index >= problem.layout.starts
        if np.max(d, initial=0.0) < FAR and np.min(d, initial=0.0) > -FAR:
            yield r, slopes_without_start(d, np.abs(r) < HUBER, start), index[~start]
        else:
            yield r, np.full_like(d[..., ~start], np.nan), index[~start]


def _cut(problem: Residuals) -> bool:
    """Whether runs are in pieces."""
    return len(problem.records) > max(problem.layout.runs) + 1


def _driven_s(problem: Residuals) -> float:
    """Duration of all runs, the leads of their pieces not among it."""
    return sum(float(np.sum(record.dt_s[record.lead :])) for record in problem.records)


def _known_by_one(
    A_b: np.ndarray, left: np.ndarray, between: np.ndarray, own: np.ndarray, most: float
) -> bool:
    """Whether a block tells more than `most` of what is known of any direction of the shared entries; `own` (k, k)
    is their covariance, `between` (q, k) that of the entries of this run with them."""
    more = between.T @ np.linalg.solve(left, A_b @ between)  # of `own`, without the block
    room = most / (1.0 - most) * own - 0.5 * (more + more.transpose(0, 2, 1))
    try:
        np.linalg.cholesky(room)
    except np.linalg.LinAlgError:
        return True
    return not np.isfinite(room).all()


def _blocks(r: np.ndarray, d: np.ndarray, edges: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """g (n, q) and A (n, q, q) of (1), of residuals (N, m) with slopes (N, m, q) between the rows `edges`."""
    (m, q), r, d = d.shape[1:], r.ravel(), d.reshape(-1, d.shape[2])
    g, A = np.zeros((len(edges) - 1, q)), np.zeros((len(edges) - 1, q, q))
    with np.errstate(invalid="ignore", over="ignore"):  # a model that ran away
        for b, (first, end) in enumerate(pairwise(m * np.array(edges))):
            x, here = d[first:end], r[first:end]
            g[b] = np.clip(here, -HUBER, HUBER) @ x
            A[b] = gram(x) - gram(x[np.abs(here) >= HUBER])
    return g, A


def batch_covariance(
    slopes: np.ndarray, residuals: np.ndarray, weights: np.ndarray, batch: np.ndarray
) -> np.ndarray:
    """Return (p, p) by d_b of batches: `slopes` (N, p) of what was regressed on, `residuals` and `weights` (N,), and
    `batch` (N,), the number of the batch of each row. Rows whose weight is below 1 are Huber's outliers, without ρ''.
    Infinite where a direction has no slope, or batches are no more than directions."""
    p, numbers = slopes.shape[1], np.unique(batch)
    scale = np.sqrt(np.maximum(np.sum(slopes[weights >= 1.0] ** 2, axis=0), 1e-300))
    J, inside = slopes / scale, np.where(weights >= 1.0, 1.0, 0.0)[:, None]
    J_b = [J * (batch == b)[:, None] for b in numbers]
    A_b = np.array([(inside * x).T @ x for x in J_b])
    values = np.linalg.eigvalsh(A_b.sum(axis=0))
    if len(numbers) <= p or values[0] < 1e-10 * values[-1]:
        return np.full((p, p), np.inf)
    s = np.array([(weights * residuals) @ x for x in J_b])
    moves = without_each(s, A_b, np.linalg.inv(A_b.sum(axis=0)), np.arange(p))
    return moves.T @ moves / np.outer(scale, scale)


def regress(slopes: np.ndarray, y: np.ndarray, rounds: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Huber's regression of y (N,) on `slopes` (N, p): estimate (p,) and weights (N,)."""
    weights = np.ones(len(y))
    x = np.zeros(slopes.shape[1])
    for _ in range(rounds):
        root = np.sqrt(weights)
        x = np.linalg.lstsq(root[:, None] * slopes, root * y, rcond=None)[0]
        left = np.abs(y - slopes @ x)
        sigma = max(1.4826 * float(np.median(left)), 1e-12 * float(np.max(np.abs(y), initial=1e-300)))
        weights = np.minimum(1.0, HUBER * sigma / np.maximum(left, 1e-300))
    return x, weights
