"""Sum scores and information by blocks of the data, and compute the change of a fit without each block.

    s_b = Σ_t∈b ψ ∂r,   A_b = Σ_t∈b ψ' ∂r ∂rᵀ,   m_b = (A − A_b)⁻¹ s_b                                     (1)
    ∂r⊥ = ∂r P,   s_b P,   Pᵀ A_b P   with nuisance entries of a segment eliminated                       (2)

The sums of all blocks are the gradient and the information, so each row is multiplied once. Source: Quenouille 1956.
docs/derivations/robust_covariance.md
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.numerics.normal_equations import MIN_EIGENVALUE, pseudo_inverse
from baqueano.numerics.parallel import gram
from baqueano.numerics.statistics import HUBER

MIN_REMAINDER = 1e-3  # part of the information that remains without a block; an initial state would have 0


class ScoreBlocks(NamedTuple):
    """Sums over the n blocks of one segment, for its q entries of θ.  (1)"""

    scores: np.ndarray  # s_b (n, q)
    information: np.ndarray  # A_b (n, q, q)
    entries: np.ndarray  # (q,) indices in θ

    @classmethod
    def from_rows(
        cls, r: np.ndarray, d: np.ndarray, index: np.ndarray, edges: Sequence[int]
    ) -> "ScoreBlocks":
        """Return the sums of residuals r (N, m) with derivatives d (N, m, q) over the blocks between rows `edges`."""
        ends, q = d.shape[1] * np.array(edges), d.shape[2]
        r, d = r.ravel(), d.reshape(-1, q)
        g, A = np.zeros((len(ends) - 1, q)), np.zeros((len(ends) - 1, q, q))
        psi, outliers = np.clip(r, -HUBER, HUBER), np.flatnonzero(np.abs(r) >= HUBER)
        clipped_rows, clipped_ends = d[outliers], np.searchsorted(outliers, ends)
        for b, (first, end) in enumerate(pairwise(ends.tolist())):
            g[b] = psi[first:end] @ d[first:end]
            A[b] = gram(d[first:end]) - gram(clipped_rows[clipped_ends[b] : clipped_ends[b + 1]])
        return cls(g, A, index)

    @classmethod
    def nan_block(cls, index: np.ndarray) -> "ScoreBlocks":
        """Return the sums of a segment without a finite result: NaN."""
        q = len(index)
        return cls(np.full((1, q), np.nan), np.full((1, q, q), np.nan), index)

    @property
    def has_diverged(self) -> bool:
        """Return True for the sums of `nan_block`."""
        return bool(np.isnan(self.scores).any())

    @property
    def total(self) -> "ScoreBlocks":
        """Return the sums with the whole segment as one block."""
        return ScoreBlocks(self.scores.sum(axis=0)[None], self.information.sum(axis=0)[None], self.entries)

    def without(self, first: int) -> "ScoreBlocks":
        """Return the sums with the entries of θ from `first` on eliminated.  (2)"""
        nuisance, A = self.entries >= first, self.information.sum(axis=0)
        P = np.eye(len(nuisance))[:, ~nuisance]
        if not self.has_diverged:
            inverse = pseudo_inverse(A[np.ix_(nuisance, nuisance)], MIN_EIGENVALUE)
            P[nuisance] = -inverse @ A[np.ix_(nuisance, ~nuisance)]
        return ScoreBlocks(self.scores @ P, P.T @ self.information @ P, self.entries[~nuisance])

    def part(self, entries: np.ndarray) -> "ScoreBlocks":
        """Return the sums for the `entries` of θ only; the new indices are positions in `entries`."""
        position = np.full(1 + max(entries.max(initial=-1), self.entries.max(initial=-1)), -1)
        position[entries] = np.arange(len(entries))
        mask = position[self.entries] >= 0
        information = self.information[:, mask][:, :, mask]
        return ScoreBlocks(self.scores[:, mask], information, position[self.entries[mask]])


def changes_without_blocks(
    segments: Sequence[ScoreBlocks], A: np.ndarray, shared_count: int, max_share: float | None
) -> np.ndarray | None:
    """Return the change m_b (n, k) of a fit without each block of the `segments`; A (k, k) is the information.  (1)

    Return None if one block has more than `max_share` of the information on a direction of the first `shared_count`
    entries; without `max_share` this is not tested.
    """
    root, inverse = scaled_inverse(A)
    changes, shared_cov = [], inverse[:shared_count, :shared_count]
    for g, A_b, index in segments:
        g, A_b = g / root[index], A_b / np.outer(root[index], root[index])
        # a run has information on few entries: (A − A_b)⁻¹ g = A⁻¹ (1 − A_b C)⁻¹ g; C is the part of A⁻¹ for these
        remainder = (1.0 + MIN_REMAINDER) * np.eye(len(index)) - A_b @ inverse[np.ix_(index, index)]
        changes.append(np.linalg.solve(remainder, g[:, :, None])[:, :, 0] @ inverse[index] / root)
        cross_cov = inverse[index, :shared_count]
        if max_share and _is_dominated_by_one_block(A_b, remainder, cross_cov, shared_cov, max_share):
            return None
    return np.concatenate(changes)


def scaled_inverse(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return √A_ii (k,), and the inverse (k, k) of A with its entries divided by them."""
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    return root, np.linalg.inv(A / np.outer(root, root))


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
