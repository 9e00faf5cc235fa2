"""Errors of a model that is not quite right: what a fit would have said without one piece of the run.

    θ_b − θ̂ = (A − A_b)⁻¹ g_b,   g_b = Σ_t∈b ψ ∂r,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ                                (1)
    cov = (n − 1)/n Σ_b (θ_b − θ̄)(θ_b − θ̄)ᵀ   over n blocks b of BLOCK_S                                 (2)
    cov ← D cov D,   D_i² = max(cov, A⁻¹, A⁻¹ B A⁻¹)_ii / cov_ii                                           (3)

The errors of intervals.py take residuals for a noise that is the same all along the run. Those of a model that
lacks something are not: they come with the motions that it lacks, and with the slopes ∂r of the very parameters
that try to make up for it. (2) asks the blocks, but knows nothing of colour beyond BLOCK_S, of which B does. Both
are made of residuals that the fit has drawn to 0, the most where few rows count for much; A⁻¹ is not, being that
of noise of the level that was found, but it knows of that level alone. Each is blind to something and none sees
what is not there but by chance: a parameter is told the largest, under the correlations of (2). The mean of (2)
and B's held 90 to 92 % of the time where 95 % was told: simulated cars, benchmarks/coverage_without_encoders.py.
Sources: Quenouille 1956, Tukey 1958; one step of Gauss-Newton for each block; Künsch 1989 for blocks.
"""

import numpy as np

from baqueano.identify.solve.intervals import Information
from baqueano.identify.solve.problem import HUBER, Problem

BLOCK_S = 2.0  # a minute has more of them than a fit has parameters
FEWEST = 10  # blocks
LEAST = 1e-9  # eigenvalue of the information without a block, of its largest, that still counts


def jackknife(problem: Problem, theta: np.ndarray, kept: np.ndarray, bread: np.ndarray) -> np.ndarray | None:
    """(2), (k, k), of the entries `kept` of θ with the information `bread` (p, p); None of too few blocks, or of
    no entries."""
    if not len(kept):
        return None
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
    """The information whose errors of the entries `kept` are those of `cov` (k, k), or its own where larger.  (3)"""
    at = np.ix_(kept, kept)
    A, meat = info.bread[at], info.meat.copy()
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    inverse = np.linalg.inv(A / np.outer(root, root))
    own = inverse @ (meat[at] / np.outer(root, root)) @ inverse
    told = np.diagonal(cov) * root**2
    most = np.maximum(told, np.maximum(np.diagonal(own), np.diagonal(inverse)))
    D = np.sqrt(most / np.maximum(told, 1e-300))
    other = A @ (cov * np.outer(D, D)) @ A
    meat[at] = 0.5 * (other + other.T)
    return info._replace(meat=meat)


def _solved(A: np.ndarray, g: np.ndarray) -> np.ndarray:
    """A⁻¹ g, 0 in directions that nothing shows any more."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    seen = values > LEAST * max(float(values[-1]), 1e-300)
    kept = vectors[:, seen]
    return np.asarray(kept @ ((kept.T @ g) / values[seen]))
