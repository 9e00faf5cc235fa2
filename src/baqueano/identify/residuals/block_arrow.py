"""Solve the normal equations of a run in many segments: an arrow matrix, solved segment by segment.

The start of a segment affects only this segment, and the biases of a run affect only this run. So the blocks of
different segments are not coupled:

    ( S    B_1 … B_K ) ( x )   ( g   )
    ( B_kᵀ     W_k   ) ( y_k ) = ( g_k )                                                                  (1)
    (S − Σ B_k W_k⁻¹ B_kᵀ) x = g − Σ B_k W_k⁻¹ g_k,      y_k = W_k⁻¹ (g_k − B_kᵀ x)                        (2)

x are the shared entries, y_k the entries of segment k. K small solves and one solve of the size of x replace a solve of
full size, and no matrix of full size is stored. Source: Schur's complement, as in bundle adjustment (Brown 1958). The
information on x with the starts eliminated is the same complement: data/segments.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.identify.data.segments import ThetaLayout

MIN_OWN_ENTRIES = 48  # number of entries of segments above which (2) is faster than one solve of full size


@dataclass(frozen=True, slots=True, eq=False)
class ArrowLayout:
    """Indices of the parts of (1) in a vector (p,)."""

    common: np.ndarray  # (s,) entries of x
    own: np.ndarray  # (K, q) entries of y_k
    is_own: np.ndarray  # (p,) bool
    index_in_part: np.ndarray  # (p,) index of an entry in x, or in its y_k


def arrow_layout(layout: ThetaLayout, extra_count: int = 0) -> ArrowLayout | None:
    """Return the parts of θ, and of `extra_count` shared entries after it, or None if few entries belong to
    segments."""
    count, o, q = len(layout.runs), layout.run_entry_count, layout.start_size
    own_entries = layout.first_start + np.arange(count * q).reshape(count, q)
    if layout.runs == tuple(range(count)):  # runs of one segment: entries of the run belong to it
        own_entries = np.hstack([layout.shared_count + np.arange(count * o).reshape(count, o), own_entries])
    if count < 2 or own_entries.size < MIN_OWN_ENTRIES:
        return None
    is_own = np.zeros(layout.size + extra_count, bool)
    is_own[own_entries] = True
    common, index_in_part = np.flatnonzero(~is_own), np.zeros(len(is_own), int)
    index_in_part[common] = np.arange(len(common))
    index_in_part[own_entries] = np.arange(own_entries.shape[1])
    return ArrowLayout(common, own_entries, is_own, index_in_part)


@dataclass(frozen=True, slots=True, eq=False)
class BlockArrow:
    """Block-arrow matrix of (1)."""

    places: ArrowLayout
    corner: np.ndarray  # S (s, s)
    border: np.ndarray  # B (K, s, q)
    blocks: np.ndarray  # W (K, q, q)

    @classmethod
    def of_diagonal(cls, places: ArrowLayout, d: np.ndarray) -> "BlockArrow":
        """Return the diagonal matrix of d (p,)."""
        x, y = d[places.common], d[places.own]
        s, (count, q) = len(x), y.shape
        return cls(places, np.diag(x), np.zeros((count, s, q)), y[:, :, None] * np.eye(q))

    def add(self, indices: np.ndarray, parts: np.ndarray) -> None:
        """Add the matrices `parts` (K, n, n) of the segments at the rows `indices` (K, n)."""
        # in the same order in each segment
        is_own, part_index = self.places.is_own[indices[0]], self.places.index_in_part[indices]
        common, own_index = part_index[:, ~is_own], part_index[:, is_own]
        k = np.arange(len(parts))[:, None, None]
        row_parts, column_parts = parts[:, ~is_own], parts[:, is_own]
        np.add.at(self.corner, (common[:, :, None], common[:, None, :]), row_parts[:, :, ~is_own])
        self.border[k, common[:, :, None], own_index[:, None, :]] += row_parts[:, :, is_own]
        self.blocks[k, own_index[:, :, None], own_index[:, None, :]] += column_parts[:, :, is_own]

    @property
    def is_finite(self) -> bool:
        """Return True if all entries are finite."""
        return all(np.isfinite(part).all() for part in (self.corner, self.border, self.blocks))

    def diagonal(self) -> np.ndarray:
        """Return the diagonal (p,)."""
        return self._join(self.corner.diagonal(), np.einsum("kii->ki", self.blocks))

    def __matmul__(self, v: np.ndarray) -> np.ndarray:
        """Return the product (p,) with v (p,)."""
        x, y = self._split(v)
        up = self.corner @ x + np.einsum("ksq,kq->s", self.border, y)
        down = np.einsum("ksq,s->kq", self.border, x) + np.einsum("kqr,kr->kq", self.blocks, y)
        return self._join(up, down)

    def solve(self, damping: float, scale: np.ndarray, is_free: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return (H + λ D)⁻¹ g (p,) over the entries in the mask `is_free` (p,), with D = diag(scale); other entries
        are 0. (2)
        """
        root = np.where(is_free, 1.0 / np.sqrt(np.where(is_free, scale, 1.0)), 0.0)
        (r, r_k), (h, h_k) = self._split(root), self._split(root * g)
        extra, extra_k = self._split(np.where(is_free, damping, 1.0))
        S = self.corner * (r[:, None] * r) + np.diag(extra)
        B = self.border * (r[None, :, None] * r_k[:, None, :])
        W = self.blocks * (r_k[:, :, None] * r_k[:, None, :])
        np.einsum("kii->ki", W)[:] += extra_k
        inner = np.linalg.solve(W, np.concatenate([np.swapaxes(B, 1, 2), h_k[:, :, None]], axis=2))
        product = np.einsum("ksq,kqn->sn", B, inner, optimize=True)
        x = np.linalg.solve(S - product[:, :-1], h - product[:, -1])
        y = inner[:, :, -1] - inner[:, :, :-1] @ x
        return root * self._join(x, y)

    def dense(self) -> np.ndarray:
        """Return the matrix as a dense array (p, p)."""
        common, own = self.places.common, self.places.own
        H = np.zeros((len(self.places.index_in_part), len(self.places.index_in_part)))
        H[np.ix_(common, common)] = self.corner
        for k, index in enumerate(own):
            H[np.ix_(common, index)], H[np.ix_(index, common)] = self.border[k], self.border[k].T
            H[np.ix_(index, index)] = self.blocks[k]
        return H

    def _split(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return v[self.places.common], v[self.places.own]

    def _join(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = np.zeros(len(self.places.index_in_part))
        out[self.places.common], out[self.places.own] = x, y
        return out


class Evaluation(NamedTuple):
    """A cost and its normal equations at one θ."""

    cost: float
    gradient: np.ndarray  # (p,)
    hessian: np.ndarray | BlockArrow  # (p, p)


def diagonal_matrix(diagonal: np.ndarray, places: ArrowLayout | None) -> np.ndarray | BlockArrow:
    """Return diag(diagonal) (p, p), to which parts can be added."""
    return np.diag(diagonal) if places is None else BlockArrow.of_diagonal(places, diagonal)


def add(H: np.ndarray | BlockArrow, indices: Sequence[np.ndarray], parts: Sequence[np.ndarray]) -> None:
    """Add to H the matrix (n, n) of each segment, at its rows `indices` (n,)."""
    if isinstance(H, BlockArrow):
        H.add(np.stack(indices), np.stack(parts))
        return
    for index, part in zip(indices, parts, strict=True):
        H[np.ix_(index, index)] += part


def rows_times(H: np.ndarray | BlockArrow, index: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the rows `index` (n,) of H times v (p,)."""
    return (H @ v)[index] if isinstance(H, BlockArrow) else H[index] @ v


def dense(H: np.ndarray | BlockArrow) -> np.ndarray:
    """Return H as a dense array (p, p)."""
    return H.dense() if isinstance(H, BlockArrow) else H
