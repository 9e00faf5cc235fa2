"""Errors of a model that is not quite right: what a fit would have said without one piece of the run.

    θ_b − θ̂ = (A − A_b)⁻¹ g_b,   g_b = Σ_t∈b ψ ∂r,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ                                (1)
    cov = (n − 1)/n Σ_b (θ_b − θ̄)(θ_b − θ̄)ᵀ   over n blocks b of BLOCK_S                                 (2)
    B ← (B + A cov A)/2                                                                                    (3)

The errors of intervals.py take residuals for a noise that is the same all along the run. Those of a model that
lacks something are not: they come with the motions that it lacks, and with the slopes ∂r of the very parameters
that try to make up for it. (2) asks the blocks, but knows nothing of colour beyond BLOCK_S, of which B does. Neither
sees all, each overstates by chance as often as it understates, and both are told by half: where they agree,
nothing changes.
Sources: Quenouille 1956, Tukey 1958; one step of Gauss-Newton for each block; Künsch 1989 for blocks.
"""

import numpy as np

from baqueano.identify.answer.intervals import Information
from baqueano.identify.solve.problem import HUBER, Problem

BLOCK_S = 2.0  # a minute has more of them than a fit has parameters
FEWEST = 10  # blocks
LEAST = 1e-9  # eigenvalue of the information without a block, of its largest, that still counts


def jackknife(problem: Problem, theta: np.ndarray, kept: np.ndarray, bread: np.ndarray) -> np.ndarray | None:
    """(2), (k, k), of the entries `kept` of θ with the information `bread` (p, p); None of too few blocks."""
    A = bread[np.ix_(kept, kept)]
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    place = np.full(problem.size, -1)
    place[kept] = np.arange(len(kept))
    moves = []
    for (r, d, index), record in zip(problem.sensitivities(theta), problem.records, strict=True):
        inside = place[index] >= 0
        at, slopes = place[index[inside]], d[:, :, inside]
        block = (np.cumsum(record.dt_s) / BLOCK_S).astype(int)
        for b in np.unique(block):
            there = block == b
            x = slopes[there].reshape(-1, len(at))
            psi = np.clip(r[there].ravel(), -HUBER, HUBER)
            g, without = np.zeros(len(kept)), A.copy()
            g[at] = psi @ x
            without[np.ix_(at, at)] -= (x * (np.abs(r[there].ravel()) < HUBER)[:, None]).T @ x
            moves.append(_solved(without / np.outer(root, root), g / root) / root)
    n = len(moves)
    if n < FEWEST:
        return None
    off = np.array(moves) - np.mean(moves, axis=0)
    return (n - 1) / n * off.T @ off


def with_blocks(info: Information, kept: np.ndarray, cov: np.ndarray) -> Information:
    """The information whose covariance of the entries `kept` is half of what it was and half `cov` (k, k).  (3)"""
    at = np.ix_(kept, kept)
    A, meat = info.bread[at], info.meat.copy()
    other = A @ cov @ A
    meat[at] = 0.5 * (meat[at] + 0.5 * (other + other.T))
    return info._replace(meat=meat)


def _solved(A: np.ndarray, g: np.ndarray) -> np.ndarray:
    """A⁻¹ g, 0 in directions that nothing shows any more."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    seen = values > LEAST * max(float(values[-1]), 1e-300)
    kept = vectors[:, seen]
    return np.asarray(kept @ ((kept.T @ g) / values[seen]))
