"""Split a long run into short segments, each with its own initial state: multiple shooting.

    A_r = A − A_s A_ss⁻¹ A_sᵀ,   B_r = G B Gᵀ,   G = (I, −A_s A_ss⁻¹)                                       (1)
    d⊥ = d − d_s A_ss⁻¹ A_sᵀ,   A_r = Σ w d⊥ d⊥ᵀ                                                           (2)
    (S − Σ B_k W_k⁻¹ B_kᵀ) x = g − Σ B_k W_k⁻¹ g_k,      y_k = W_k⁻¹ (g_k − B_kᵀ x)                        (3)

A simulation without correction drifts away, because of its heading error and of process noise. Each segment of a few
seconds has its own initial state (its start), and all segments share the parameters: θ = (shared | by run | by
segment). Before its first measurement a segment has a lead, in which delayed commands and sensors fill their buffers.
The starts s are nuisance parameters. They are eliminated block by block (1), or row by row with the weights w = ψ'(r)
of A (2). Entries y_k of different segments are not coupled, so K small solves replace a solve of full size (3).
Source: Bock 1983 for the segments; Schur's complement, as in bundle adjustment (Brown 1958).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.data.record import FitRecord

MIN_SEGMENT_ROWS = 10  # for the start of a segment, at most six numbers
# of the largest eigenvalue of a start's information: directions below it are unobservable
MIN_EIGENVALUE = 1e-9


class ThetaLayout(NamedTuple):
    """Indices in θ of the entries of each segment."""

    shared_count: int
    run_entry_count: int
    start_size: int
    runs: tuple[int, ...]  # of each segment

    @property
    def first_start(self) -> int:
        """Return the index of the first start."""
        return self.shared_count + self.run_entry_count * (max(self.runs) + 1)

    @property
    def size(self) -> int:
        """Return the length of θ."""
        return self.first_start + self.start_size * len(self.runs)

    @property
    def indices(self) -> list[np.ndarray]:
        """Return for each segment the indices of its entries in θ."""
        s, o, q = self.shared_count, self.run_entry_count, self.start_size
        first = self.first_start
        return [
            np.concatenate(
                [
                    np.arange(s),
                    np.arange(s + run * o, s + (run + 1) * o),
                    np.arange(first + k * q, first + (k + 1) * q),
                ]
            )
            for k, run in enumerate(self.runs)
        ]

    def start_slice(self, k: int) -> slice:
        """Return the slice of θ with the start of segment k."""
        return slice(self.first_start + k * self.start_size, self.first_start + (k + 1) * self.start_size)


def split_record(record: FitRecord, segment_s: float, lead_s: float) -> list[FitRecord]:
    """Return segments of about `segment_s` [s]. Each segment after the first has a lead of `lead_s` [s]. The lead does
    not contain measurements. It is at least one row long, because a reading between ticks is interpolated between rows.
    Raise UsageError for segments of less than MIN_SEGMENT_ROWS."""
    ends = np.cumsum(record.dt_s)
    shortest_s = MIN_SEGMENT_ROWS * float(np.median(record.dt_s))
    if segment_s < shortest_s:
        raise UsageError(
            fault("segment.short", length_s=segment_s, rows=MIN_SEGMENT_ROWS, shortest_s=shortest_s)
        )
    count = max(1, round(float(ends[-1]) / segment_s))
    edges = np.searchsorted(ends, ends[-1] * np.arange(1, count) / count)
    edges = np.unique(np.concatenate([[0], edges, [len(ends)]]))
    segments = []
    for first, last in pairwise(edges):
        begin = int(np.searchsorted(ends, ends[first] - lead_s))
        begin = max(min(begin, int(first) - 1), 0)
        lead = int(first) - begin
        segment = record.part(slice(begin, int(last))).with_mask(np.arange(int(last) - begin) >= lead)
        segments.append(segment._replace(lead=lead))
    return segments


def eliminate_starts(
    bread: np.ndarray, meat: np.ndarray, layout: ThetaLayout
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) of the shared entries and of the entries by run, with the starts eliminated.  (1)"""
    return eliminate(
        bread, meat, layout.first_start, [layout.start_slice(k) for k in range(len(layout.runs))]
    )


def eliminate(
    bread: np.ndarray, meat: np.ndarray, first: int, blocks: Sequence[slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) of the first r = `first` entries, with the `blocks` eliminated. The information between two
    different blocks must be 0. (1)"""
    A, B = bread[:first, :first].copy(), meat[:first, :first].copy()
    for entries in blocks:
        gain = bread[:first, entries] @ pseudo_inverse(bread[entries, entries], MIN_EIGENVALUE)  # A_s A_ss⁻¹
        A -= gain @ bread[entries, :first]
        cross = gain @ meat[entries, :first]
        B += gain @ meat[entries, entries] @ gain.T - cross - cross.T
    return 0.5 * (A + A.T), 0.5 * (B + B.T)


def derivatives_without_start(d: np.ndarray, w: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return d⊥ (N, m, q) from the derivatives d (N, m, p) of a segment with weights w (N, m). `start` (p,) is a mask
    of the entries of its start. (2)"""
    start_derivatives, other_derivatives = d[..., start], d[..., ~start]
    weighted_derivatives = start_derivatives * w[..., None]
    A_ss, A_so = (
        np.tensordot(weighted_derivatives, x, ((0, 1), (0, 1)))
        for x in (start_derivatives, other_derivatives)
    )
    return other_derivatives - start_derivatives @ (pseudo_inverse(A_ss, MIN_EIGENVALUE) @ A_so)


def pseudo_inverse(A: np.ndarray, rcond: float = 1e-12) -> np.ndarray:
    """Return the pseudo-inverse (p, p) of an information A. It is 0 in directions below `rcond` of the largest
    eigenvalue of the scaled A. It is also 0 for an entry with a diagonal of at most 0, as at a saddle."""
    diagonal = np.diagonal(A)
    root = np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    return np.linalg.pinv(A / np.outer(root, root), rcond=rcond, hermitian=True) / np.outer(root, root)


# number of entries of segments above which (3) is faster than one solve of full size
MIN_SEGMENT_ENTRIES = 48


@dataclass(frozen=True, slots=True, eq=False)
class ArrowLayout:
    """Indices of the parts of a `BlockArrow` in a vector (p,)."""

    shared: np.ndarray  # (s,) entries of x
    segment_entries: np.ndarray  # (K, q) entries of y_k
    is_segment_entry: np.ndarray  # (p,) bool
    index_in_part: np.ndarray  # (p,) index of an entry in x, or in its y_k


def arrow_layout(layout: ThetaLayout, extra_count: int = 0) -> ArrowLayout | None:
    """Return the parts of θ, and of `extra_count` shared entries after it, or None if few entries belong to
    segments."""
    count, o, q = len(layout.runs), layout.run_entry_count, layout.start_size
    segment_entries = layout.first_start + np.arange(count * q).reshape(count, q)
    if layout.runs == tuple(range(count)):  # runs of one segment: entries of the run belong to it
        segment_entries = np.hstack(
            [layout.shared_count + np.arange(count * o).reshape(count, o), segment_entries]
        )
    if count < 2 or segment_entries.size < MIN_SEGMENT_ENTRIES:
        return None
    is_segment_entry = np.zeros(layout.size + extra_count, bool)
    is_segment_entry[segment_entries] = True
    shared, index_in_part = np.flatnonzero(~is_segment_entry), np.zeros(len(is_segment_entry), int)
    index_in_part[shared] = np.arange(len(shared))
    index_in_part[segment_entries] = np.arange(segment_entries.shape[1])
    return ArrowLayout(shared, segment_entries, is_segment_entry, index_in_part)


@dataclass(frozen=True, slots=True, eq=False)
class BlockArrow:
    """Matrix of (3): a corner S of the shared entries x, and for each segment a border B_k and a block W_k."""

    layout: ArrowLayout
    corner: np.ndarray  # S (s, s)
    border: np.ndarray  # B (K, s, q)
    blocks: np.ndarray  # W (K, q, q)

    @classmethod
    def from_diagonal(cls, layout: ArrowLayout, d: np.ndarray) -> "BlockArrow":
        """Return the diagonal matrix of d (p,)."""
        x, y = d[layout.shared], d[layout.segment_entries]
        s, (count, q) = len(x), y.shape
        return cls(layout, np.diag(x), np.zeros((count, s, q)), y[:, :, None] * np.eye(q))

    def add(self, indices: np.ndarray, parts: np.ndarray) -> None:
        """Add the matrices `parts` (K, n, n) of the segments at the rows `indices` (K, n)."""
        # in the same order in each segment
        is_segment_entry, part_index = (
            self.layout.is_segment_entry[indices[0]],
            self.layout.index_in_part[indices],
        )
        shared, segment_index = part_index[:, ~is_segment_entry], part_index[:, is_segment_entry]
        k = np.arange(len(parts))[:, None, None]
        row_parts, column_parts = parts[:, ~is_segment_entry], parts[:, is_segment_entry]
        np.add.at(self.corner, (shared[:, :, None], shared[:, None, :]), row_parts[:, :, ~is_segment_entry])
        self.border[k, shared[:, :, None], segment_index[:, None, :]] += row_parts[:, :, is_segment_entry]
        self.blocks[k, segment_index[:, :, None], segment_index[:, None, :]] += column_parts[
            :, :, is_segment_entry
        ]

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
        are 0.  (3)
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
        shared, segment_entries = self.layout.shared, self.layout.segment_entries
        H = np.zeros((len(self.layout.index_in_part), len(self.layout.index_in_part)))
        H[np.ix_(shared, shared)] = self.corner
        for k, index in enumerate(segment_entries):
            H[np.ix_(shared, index)], H[np.ix_(index, shared)] = self.border[k], self.border[k].T
            H[np.ix_(index, index)] = self.blocks[k]
        return H

    def _split(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return v[self.layout.shared], v[self.layout.segment_entries]

    def _join(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = np.zeros(len(self.layout.index_in_part))
        out[self.layout.shared], out[self.layout.segment_entries] = x, y
        return out


class Evaluation(NamedTuple):
    """A cost and its normal equations at one θ."""

    cost: float
    gradient: np.ndarray  # (p,)
    hessian: np.ndarray | BlockArrow  # (p, p)


def diagonal_matrix(diagonal: np.ndarray, layout: ArrowLayout | None) -> np.ndarray | BlockArrow:
    """Return diag(diagonal) (p, p), to which parts can be added."""
    return np.diag(diagonal) if layout is None else BlockArrow.from_diagonal(layout, diagonal)


def add(H: np.ndarray | BlockArrow, indices: Sequence[np.ndarray], parts: Sequence[np.ndarray]) -> None:
    """Add to H the matrix (n, n) of each segment, at its rows `indices` (n,)."""
    if isinstance(H, BlockArrow):
        H.add(np.stack(indices), np.stack(parts))
        return
    for index, part in zip(indices, parts, strict=True):
        H[np.ix_(index, index)] += part


def row_product(H: np.ndarray | BlockArrow, index: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the rows `index` (n,) of H times v (p,)."""
    return (H @ v)[index] if isinstance(H, BlockArrow) else H[index] @ v


def dense(H: np.ndarray | BlockArrow) -> np.ndarray:
    """Return H as a dense array (p, p)."""
    return H.dense() if isinstance(H, BlockArrow) else H
