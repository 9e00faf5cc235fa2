"""Compute the error bars of a regression whose residuals are autocorrelated, and their degrees of freedom.

    x̂ = arg min Σ_i ρ(y_i − h_i(x)),   A = Σ_i ρ''_i ∂h_iᵀ ∂h_i                                            (1)
    s_b = Σ_{i in batch b} ρ'_i ∂h_iᵀ,   cov x̂ = A⁻¹ (Σ_b s_b s_bᵀ) A⁻¹ B/(B − p)                        (2)
    interval: x̂ ± t_{B−p} √cov                                                                             (3)

Residuals of neighbouring windows share samples and the slow errors of the vehicle. Sums over batches longer than both
are practically independent, for any autocorrelation inside a batch. (2) is the sandwich estimator with batches as
clusters. With few batches its scatter is large, so Student's quantile is used.

Source: Liang and Zeger 1986; Cornish and Fisher for Student's quantile (3e-3 from 7 degrees of freedom on; exact
below 5).
"""

import numpy as np

from baqueano.identify.residuals.simulation import HUBER


def batch_covariance(
    jacobian: np.ndarray, residuals: np.ndarray, weights: np.ndarray, batch: np.ndarray
) -> np.ndarray:
    """Return the covariance (p, p) of (2). It is infinite if a direction has zero derivative, or for at most p
    batches.

    `jacobian` (N, p) contains the derivatives; `residuals` and `weights` (N,) have one entry for each row. `batch`
    (N,) is the batch number of each row. Rows with a weight below 1 are Huber's outliers, where ρ'' = 0.
    """
    p, count = jacobian.shape[1], len(np.unique(batch))
    scale = np.sqrt(np.maximum(np.sum(jacobian**2, axis=0), 1e-300))
    J = jacobian / scale
    A = J[weights >= 1.0].T @ J[weights >= 1.0]
    values, vectors = np.linalg.eigh(A)
    if count <= p or values[0] < 1e-10 * values[-1]:
        return np.full((p, p), np.inf)
    scores = np.zeros((int(batch.max()) + 1, p))
    np.add.at(scores, batch, (weights * residuals)[:, None] * J)
    factor = (vectors / values) @ vectors.T @ scores.T  # A⁻¹ s_b
    return factor @ factor.T / np.outer(scale, scale) * (count / (count - p))


def regress(jacobian: np.ndarray, y: np.ndarray, iterations: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Return Huber's regression of y (N,) on `jacobian` (N, p): the estimate (p,) and the weights (N,)."""
    weights = np.ones(len(y))
    x = np.zeros(jacobian.shape[1])
    for _ in range(iterations):
        root_weights = np.sqrt(weights)
        x = np.linalg.lstsq(root_weights[:, None] * jacobian, root_weights * y, rcond=None)[0]
        residuals = np.abs(y - jacobian @ x)
        sigma = max(1.4826 * float(np.median(residuals)), 1e-12 * float(np.max(np.abs(y), initial=1e-300)))
        weights = np.minimum(1.0, HUBER * sigma / np.maximum(residuals, 1e-300))
    return x, weights
