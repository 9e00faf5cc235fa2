"""Provide normal equations whose entries belong to all data, or to one segment: an arrow, and its nuisance entries.

    (S − Σ B_k W_k⁻¹ B_kᵀ) x = g − Σ B_k W_k⁻¹ g_k,      y_k = W_k⁻¹ (g_k − B_kᵀ x)                        (1)
    A_r = A − A_s A_ss⁻¹ A_sᵀ,   B_r = G B Gᵀ,   G = (I, −A_s A_ss⁻¹)                                       (2)
    d⊥ = d − d_s A_ss⁻¹ A_sᵀ,   A_r = Σ w d⊥ d⊥ᵀ                                                           (3)

Entries y_k of different segments are not coupled, so K small solves replace a solve of full size (1). Nuisance entries
s, such as the starts of segments, are eliminated block by block (2), or row by row with weights w (3). Source: Schur's
complement, as in bundle adjustment (Brown 1958).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

# fraction of the largest eigenvalue of a start's information: directions below it are unobservable
MIN_EIGENVALUE = 1e-9
MAX_PRIOR_SIGMA = 4.0  # standard deviations of a prior within which an estimate agrees with it


@dataclass(frozen=True, slots=True, eq=False)
class ArrowLayout:
    """Indices of the parts of a `BlockArrow` in a vector (p,)."""

    shared_entries: np.ndarray  # (s,) entries of x
    segment_entries: np.ndarray  # (K, q) entries of y_k
    is_segment_entry: np.ndarray  # (p,) bool
    local_index: np.ndarray  # (p,) index of an entry in x, or in its y_k


@dataclass(frozen=True, slots=True, eq=False)
class BlockArrow:
    """Matrix of (1): a corner S of the shared entries x, and for each segment a border B_k and a block W_k."""

    layout: ArrowLayout
    corner: np.ndarray  # S (s, s)
    border: np.ndarray  # B (K, s, q)
    blocks: np.ndarray  # W (K, q, q)

    @classmethod
    def from_diagonal(cls, layout: ArrowLayout, d: np.ndarray) -> "BlockArrow":
        """Return the diagonal matrix of d (p,)."""
        x, y = d[layout.shared_entries], d[layout.segment_entries]
        s, (count, q) = len(x), y.shape
        return cls(layout, np.diag(x), np.zeros((count, s, q)), y[:, :, None] * np.eye(q))

    def add(self, indices: np.ndarray, parts: np.ndarray) -> None:
        """Add the matrices `parts` (K, n, n) of the segments at the rows `indices` (K, n)."""
        # in the same order in each segment
        is_segment_entry = self.layout.is_segment_entry[indices[0]]
        part_index = self.layout.local_index[indices]
        shared_index, segment_index = part_index[:, ~is_segment_entry], part_index[:, is_segment_entry]
        k = np.arange(len(parts))[:, None, None]
        row_parts, column_parts = parts[:, ~is_segment_entry], parts[:, is_segment_entry]
        np.add.at(
            self.corner,
            (shared_index[:, :, None], shared_index[:, None, :]),
            row_parts[:, :, ~is_segment_entry],
        )
        self.border[k, shared_index[:, :, None], segment_index[:, None, :]] += row_parts[
            :, :, is_segment_entry
        ]
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
        corner_product = self.corner @ x + np.einsum("ksq,kq->s", self.border, y)
        block_products = np.einsum("ksq,s->kq", self.border, x) + np.einsum("kqr,kr->kq", self.blocks, y)
        return self._join(corner_product, block_products)

    def solve(self, damping: float, scale: np.ndarray, is_free: np.ndarray, g: np.ndarray) -> np.ndarray:
        """Return (H + λ D)⁻¹ g (p,) over the entries in the mask `is_free` (p,), with D = diag(scale); other entries
        are 0.  (1)
        """
        root = np.where(is_free, 1.0 / np.sqrt(np.where(is_free, scale, 1.0)), 0.0)
        (r, r_k), (h, h_k) = self._split(root), self._split(root * g)
        damped_D, extra_k = self._split(np.where(is_free, damping, 1.0))
        S = self.corner * (r[:, None] * r) + np.diag(damped_D)
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
        rows = self.layout.shared_entries
        H = np.zeros((len(self.layout.local_index), len(self.layout.local_index)))
        H[np.ix_(rows, rows)] = self.corner
        for k, index in enumerate(self.layout.segment_entries):
            H[np.ix_(rows, index)], H[np.ix_(index, rows)] = self.border[k], self.border[k].T
            H[np.ix_(index, index)] = self.blocks[k]
        return H

    def _split(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return v[self.layout.shared_entries], v[self.layout.segment_entries]

    def _join(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        vector = np.zeros(len(self.layout.local_index))
        vector[self.layout.shared_entries], vector[self.layout.segment_entries] = x, y
        return vector


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


def eliminate(
    bread: np.ndarray, meat: np.ndarray, first: int, blocks: Sequence[slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) of the first r = `first` entries, with the `blocks` eliminated. The information between two
    different blocks must be 0. (2)"""
    A, B = bread[:first, :first].copy(), meat[:first, :first].copy()
    for entries in blocks:
        gain = bread[:first, entries] @ pseudo_inverse(bread[entries, entries], MIN_EIGENVALUE)  # A_s A_ss⁻¹
        A -= gain @ bread[entries, :first]
        cross = gain @ meat[entries, :first]
        B += gain @ meat[entries, entries] @ gain.T - cross - cross.T
    return 0.5 * (A + A.T), 0.5 * (B + B.T)


def projected_derivatives(d: np.ndarray, w: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return d⊥ (N, m, q) from the derivatives d (N, m, p) of a segment with weights w (N, m). `start` (p,) is a mask
    of the entries of its start. (3)"""
    start_derivatives, other_derivatives = d[..., start], d[..., ~start]
    weighted_derivatives = start_derivatives * w[..., None]
    A_ss, A_so = (
        np.tensordot(weighted_derivatives, x, ((0, 1), (0, 1)))
        for x in (start_derivatives, other_derivatives)
    )
    return other_derivatives - start_derivatives @ (pseudo_inverse(A_ss, MIN_EIGENVALUE) @ A_so)


def mean_square_error(prior: np.ndarray, N: np.ndarray, meat: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return P + δ δᵀ (K, K) of parameters that stay at their prior mean, or `prior` (K, K) if δ contradicts it.

        K = Σ N (N Σ N + M)⁻¹,   δ = −K g,   P = Σ − K N Σ                                                 (4)

    N (K, K) is their information in the data, and `meat`, M (K, K), the covariance of their score `g` (K,). δ of more
    than MAX_PRIOR_SIGMA standard deviations is an error of the model. Source: the consider filter of Schmidt 1966.
    """
    noise = meat + MIN_EIGENVALUE * max(float(np.trace(N)), 1e-300) * np.eye(len(N))
    gain = np.linalg.solve(N @ prior @ N + noise, N @ prior).T
    delta, P = -gain @ g, prior - gain @ N @ prior
    is_contradicted = not delta @ pseudo_inverse(prior) @ delta < MAX_PRIOR_SIGMA**2 + len(delta)
    return prior if is_contradicted else 0.5 * (P + P.T) + np.outer(delta, delta)


def pseudo_inverse(A: np.ndarray, rcond: float = 1e-12) -> np.ndarray:
    """Return the pseudo-inverse (p, p) of an information A. It is 0 in directions below `rcond` of the largest
    eigenvalue of the scaled A. It is also 0 for an entry with a diagonal of at most 0, as at a saddle."""
    diagonal = np.diagonal(A)
    root = np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    return np.linalg.pinv(A / np.outer(root, root), rcond=rcond, hermitian=True) / np.outer(root, root)


def segment_sum(
    parts: Sequence[Evaluation],
    indices: Sequence[np.ndarray],
    x: np.ndarray,
    prior: np.ndarray,
    layout: ArrowLayout | None,
) -> Evaluation:
    """Return cost, gradient (p,) and Hessian (p, p) at x (p,), summed over the segments. `indices` are the entries of
    each segment, `prior` (p,) the weights of a prior at 0."""
    cost, g = 0.5 * float(prior @ x**2), prior * x
    H = diagonal_matrix(prior, layout)
    for part, index in zip(parts, indices, strict=True):
        cost += part.cost
        g[index] += part.gradient
    add(H, indices, [dense(part.hessian) for part in parts])
    return Evaluation(cost, g, H)


def marginal_information(A: np.ndarray, index: np.ndarray, nuisance_indices: np.ndarray) -> float:
    """Return the smallest eigenvalue of the normalised information on the entries `index`, with
    `nuisance_indices` eliminated. Return 0 if one of the entries `index` does not have information."""
    if not np.all(np.diagonal(A)[index] > 0.0):
        return 0.0
    indices = np.concatenate([index, nuisance_indices])
    root = np.sqrt(np.diagonal(A)[indices])
    C = A[np.ix_(indices, indices)] / np.outer(root, root)
    n = len(index)
    schur = C[:n, :n] - C[:n, n:] @ pseudo_inverse(C[n:, n:]) @ C[n:, :n]
    return float(np.linalg.eigvalsh(0.5 * (schur + schur.T))[0])


def marginal_std(A: np.ndarray, index: np.ndarray, is_free: np.ndarray) -> np.ndarray:
    """Return the standard errors (q,) of the entries `index` of θ, if these and the entries in the mask `is_free` (p,)
    are estimated together. A (p, p) is the information. An entry without information has an infinite error."""
    entries = np.flatnonzero((is_free | np.isin(np.arange(len(is_free)), index)) & (np.diagonal(A) > 0.0))
    root = np.sqrt(np.diagonal(A)[entries])
    inverse = np.linalg.pinv(A[np.ix_(entries, entries)] / np.outer(root, root), hermitian=True)
    std = np.full(len(is_free), np.inf)
    std[entries] = np.sqrt(np.maximum(np.diagonal(inverse), 0.0)) / root
    return np.asarray(std[index])


def square_root(B: np.ndarray) -> np.ndarray:
    """Return F (k, k) with F Fᵀ = B + ε I; a small ε replaces eigenvalues below ε, also negative ones by rounding."""
    jitter = 1e-13 * max(float(np.trace(B)), 1e-300)
    try:
        return np.linalg.cholesky(B + jitter * np.eye(len(B)))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(B)
        return vectors * np.sqrt(np.maximum(values, jitter))
