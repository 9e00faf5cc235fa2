"""Check and repair covariances: a covariance must be symmetric, with eigenvalues ≥ 0.

The nearest valid matrix in the Frobenius norm follows from the symmetric part V Λ Vᵀ (Higham 1988):

    V max(Λ, 0) Vᵀ                                                                                        (1)

The printed Q and R of the paper fail this check (errata 5), and a filter with these matrices diverges at once.
"""

from functools import cache

import numpy as np

from baqueano.contracts.values import Value
from baqueano.errors import Invalid
from baqueano.messages.language import translate as _

ROUNDING_SHARE = 1e-14  # of a variance
CHI_SQUARE_95 = 5.991  # 95 % quantile of χ² with two degrees of freedom: of a position


def covariance(matrix: Value, size: int, name: str) -> np.ndarray:
    """Return `matrix` as floats (size, size). Raise Invalid with the wrong entry and the nearest valid matrix."""
    P = np.array(matrix, dtype=float)
    if P.shape != (size, size):
        raise Invalid.of("cov.shape", name=name, value=str(P.shape), size=size)
    if not np.all(np.isfinite(P)):
        i, j = np.argwhere(~np.isfinite(P))[0]
        raise Invalid.of("cov.not-finite", name=name, i=i, j=j, value=P[i, j])
    scale = np.max(np.abs(P), initial=0.0)
    asymmetry = np.abs(P - P.T)
    if np.max(asymmetry) > 1e-9 * scale:
        i, j = np.unravel_index(np.argmax(np.triu(asymmetry)), P.shape)
        entries = {"i": i, "j": j, "first": P[i, j], "second": P[j, i]}
        raise Invalid.of("cov.not-symmetric", name=name, **entries, offer=_nearest_valid_text(P))
    min_eigenvalue = np.linalg.eigvalsh(P)[0]
    if min_eigenvalue < -1e-12 * scale:
        i, j = _worst_pair(P)
        entries = {"i": i, "j": j, "entry": P[i, j], "first": P[i, i], "second": P[j, j]}
        offer = _nearest_valid_text(P)
        raise Invalid.of("cov.eigenvalue", name=name, smallest=min_eigenvalue, **entries, offer=offer)
    return mirror_upper(P)


def nearest_covariance(matrix: np.ndarray) -> np.ndarray:
    """Return the symmetric positive semidefinite matrix (n, n) that is nearest to `matrix`.  (1)"""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return mirror_upper((vectors * np.maximum(values, 0.0)) @ vectors.T)


def mirror_upper(P: np.ndarray) -> np.ndarray:
    """Return `P` (n, n) with its upper triangle copied onto the lower one, so that it is exactly symmetric."""
    return P[_upper_indices(len(P))]


def block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """Return the block diagonal matrix (m, m) of square blocks."""
    sizes = [len(block) for block in blocks]
    rows = []
    for i, block in enumerate(blocks):
        left_width, right_width = sum(sizes[:i]), sum(sizes[i + 1 :])
        rows.append(
            np.concatenate(
                [np.zeros((sizes[i], left_width)), block, np.zeros((sizes[i], right_width))], axis=1
            )
        )
    return np.concatenate(rows)


def cholesky_root(P: np.ndarray) -> np.ndarray:
    """Return the lower triangular L (n, n) with L Lᵀ = P; a direction without variance has a column of zeros."""
    n = len(P)
    L: list[list[Value]] = [[0.0] * n for _ in range(n)]
    for j in range(n):
        # the variance that the previous entries do not explain
        remainder = P[j, j] - sum(x * x for x in L[j][:j])
        is_certain = remainder <= ROUNDING_SHARE * P[j, j]
        divisor = np.sqrt(np.where(is_certain, 1.0, remainder))
        L[j][j] = np.where(is_certain, 0.0, divisor)
        for i in range(j + 1, n):
            rest_cov = P[i, j] - sum(x * y for x, y in zip(L[i][:j], L[j][:j], strict=True))
            L[i][j] = np.where(is_certain, 0.0, rest_cov / divisor)
    return np.array(L)


@cache
def _upper_indices(n: int) -> tuple[np.ndarray, np.ndarray]:
    i, j = np.indices((n, n))
    return np.minimum(i, j), np.maximum(i, j)


def _worst_pair(P: np.ndarray) -> tuple[int, int]:
    """Return the pair (i, j) of an indefinite matrix with the largest impossible correlation; (i, i) if P_ii < 0."""
    d = np.diag(P)
    if np.min(d) < 0.0:
        i = int(np.argmin(d))
        return i, i
    excesses = np.triu(np.abs(P) - np.sqrt(np.outer(d, d)), 1)
    i, j = np.unravel_index(np.argmax(excesses), P.shape)
    return int(i), int(j)


def _nearest_valid_text(P: np.ndarray) -> str:
    rows = ", ".join("[" + ", ".join(f"{x:.6g}" for x in row) + "]" for row in nearest_covariance(P))
    return _("The nearest valid matrix is [{rows}]", rows=rows)
