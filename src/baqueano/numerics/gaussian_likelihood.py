"""Provide the two terms of a Gaussian log-likelihood, for values that can be traced: log |S| and ρ(yᵀ S⁻¹ y).

ρ(d²) = d² up to k², beyond it 2 k d − k²: limits the effect of an outlier                            (1)
"""

import numpy as np

from baqueano.contracts.values import Tree


def log_det_and_square(S: np.ndarray, y: np.ndarray, mask: np.ndarray) -> tuple[Tree, Tree]:
    """Return log |S| and yᵀ S⁻¹ y of the entries with `mask` (m,) 1, not 0; S (m, m) is positive definite."""
    pivots, square = _elimination(
        S * np.outer(mask, mask) + np.diag(1.0 - mask), np.where(mask > 0.0, y, 0.0)
    )
    return sum(map(np.log, pivots), 0.0), square


def squared_distance(S: np.ndarray, y: np.ndarray) -> Tree:
    """Return yᵀ S⁻¹ y of a covariance S (m, m)."""
    return _elimination(S, y)[1]


def _elimination(S: np.ndarray, y: np.ndarray) -> tuple[list[Tree], Tree]:
    """Return the pivots of S (m, m), whose product is |S|, and yᵀ S⁻¹ y."""
    rows, v, square = [list(row) for row in S], list(y), 0.0
    for k in range(len(v)):
        square = square + v[k] * v[k] / rows[k][k]
        for i in range(k + 1, len(v)):
            factor = rows[i][k] / rows[k][k]
            v[i] = v[i] - factor * v[k]
            for j in range(k + 1, len(v)):
                rows[i][j] = rows[i][j] - factor * rows[k][j]
    return [rows[k][k] for k in range(len(v))], square


def robust_square(square: Tree, limit: Tree) -> Tree:
    """Return ρ of the squared distance `square`, which grows linearly with a distance above `limit`.  (1)"""
    d = np.sqrt(np.maximum(square, 1e-12))
    return np.where(d < limit, square, 2.0 * limit * d - limit**2)
