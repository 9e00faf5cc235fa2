"""Error bars of a regression whose residuals are coloured, and how far they may be trusted.

    x̂ = arg min Σ_i ρ(y_i − h_i(x)),   A = Σ_i ρ''_i ∂h_iᵀ ∂h_i                                            (1)
    s_b = Σ_{i in batch b} ρ'_i ∂h_iᵀ,   cov x̂ = Σ_b d_b d_bᵀ,   d_b = (A − A_b)⁻¹ s_b                   (2)
    interval: x̂ ± t_{B−p} √cov                                                                             (3)

Residuals of neighbouring windows share their samples and the vehicle's own slow errors. Sums over batches that
are longer than both are as good as independent, whatever the colour inside: (2) is the sandwich with batches
for clusters (sandwich.py). With few batches its scatter is not small, so the quantile is Student's.
Source: Liang and Zeger 1986.
"""

import numpy as np

from baqueano.identify.covariance.sandwich import without_each
from baqueano.identify.residuals.simulation import HUBER


def batch_covariance(
    slopes: np.ndarray, residuals: np.ndarray, weights: np.ndarray, batch: np.ndarray
) -> np.ndarray:
    """Return (p, p) of (2): `slopes` (N, p) of what was regressed on, `residuals` and `weights` (N,), `batch` (N,) the
    number of the batch of each row. Rows whose weight is below 1 are Huber's outliers, and have no ρ''. Infinite where
    a direction has no slope, or batches are no more than directions."""
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
