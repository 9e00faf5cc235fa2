"""A covariance is symmetric with eigenvalues ≥ 0. This module checks and restores both.

    nearest valid matrix, in the Frobenius norm:  V max(Λ, 0) Vᵀ  of the symmetric part     Higham 1988
    (1)

The paper's printed Q and R fail this check (errata 5), and a filter that is fed with them diverges at once.
"""

from functools import cache

import numpy as np

from baqueano.contracts.values import Value
from baqueano.diagnostics import fault
from baqueano.errors import Invalid
from baqueano.language import translated as _

ROUNDING = 1e-14  # of a variance


def covariance(matrix: Value, size: int, name: str) -> np.ndarray:
    """`matrix` as floats (size, size), or ValueError with the entry that is wrong and the nearest valid
    matrix."""
    P = np.array(matrix, dtype=float)
    if P.shape != (size, size):
        raise Invalid(fault("cov.shape", name=name, found=str(P.shape), size=size))
    if not np.all(np.isfinite(P)):
        i, j = np.argwhere(~np.isfinite(P))[0]
        raise Invalid(fault("cov.not-finite", name=name, i=i, j=j, found=P[i, j]))
    scale = np.max(np.abs(P), initial=0.0)
    gap = np.abs(P - P.T)
    if np.max(gap) > 1e-9 * scale:
        i, j = np.unravel_index(np.argmax(np.triu(gap)), P.shape)
        raise Invalid(
            fault("cov.not-symmetric", name=name, i=i, j=j, one=P[i, j], other=P[j, i], offer=_offer(P))
        )
    smallest = np.linalg.eigvalsh(P)[0]
    if smallest < -1e-12 * scale:
        i, j = _worst_pair(P)
        raise Invalid(
            fault(
                "cov.eigenvalue",
                name=name,
                smallest=smallest,
                i=i,
                j=j,
                entry=P[i, j],
                first=P[i, i],
                second=P[j, j],
                offer=_offer(P),
            )
        )
    return mirrored(P)


def nearest_covariance(matrix: np.ndarray) -> np.ndarray:
    """The symmetric positive semidefinite matrix nearest to `matrix`, (n, n).  (1)"""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return mirrored((vectors * np.maximum(values, 0.0)) @ vectors.T)


def mirrored(P: np.ndarray) -> np.ndarray:
    """`P` (n, n) with its upper triangle copied onto the lower one: symmetric by construction."""
    return P[_upper(len(P))]


def block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """(m, m) from square blocks."""
    sizes = [len(block) for block in blocks]
    rows = []
    for i, block in enumerate(blocks):
        before, right = sum(sizes[:i]), sum(sizes[i + 1 :])
        rows.append(
            np.concatenate([np.zeros((sizes[i], before)), block, np.zeros((sizes[i], right))], axis=1)
        )
    return np.concatenate(rows)


def root(P: np.ndarray) -> np.ndarray:
    """Return the lower triangular L (n, n) with L Lᵀ = P, of a covariance: where nothing is uncertain L has zeros."""
    n = len(P)
    L: list[list[Value]] = [[0.0] * n for _ in range(n)]
    for j in range(n):
        free = P[j, j] - sum(
            x * x for x in L[j][:j]
        )  # of the variance, beside what the entries before explain
        certain = free <= ROUNDING * P[j, j]
        divisor = np.sqrt(np.where(certain, 1.0, free))
        L[j][j] = np.where(certain, 0.0, divisor)
        for i in range(j + 1, n):
            rest_cov = P[i, j] - sum(x * y for x, y in zip(L[i][:j], L[j][:j], strict=True))
            L[i][j] = np.where(certain, 0.0, rest_cov / divisor)
    return np.array(L)


@cache
def _upper(n: int) -> tuple[np.ndarray, np.ndarray]:
    i, j = np.indices((n, n))
    return np.minimum(i, j), np.maximum(i, j)


def _worst_pair(P: np.ndarray) -> tuple[int, int]:
    """The pair (i, j) of an indefinite matrix with the largest impossible correlation."""
    d = np.diag(P)
    if np.min(d) < 0.0:
        i = int(np.argmin(d))
        return i, i
    excess = np.triu(np.abs(P) - np.sqrt(np.outer(d, d)), 1)
    i, j = np.unravel_index(np.argmax(excess), P.shape)
    return int(i), int(j)


def _offer(P: np.ndarray) -> str:
    rows = ", ".join("[" + ", ".join(f"{x:.6g}" for x in row) + "]" for row in nearest_covariance(P))
    return _("The nearest valid matrix is [{rows}]", rows=rows)
