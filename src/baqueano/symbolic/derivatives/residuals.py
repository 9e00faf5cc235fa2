"""Compute the normal equations of the residuals of a run, r (N, m) with ∂r (N, m, p).

cost = Σ ρ(r),   gradient = Σ ψ(r) ∂r,   hessian = Σ w ∂r ∂rᵀ,   w = ψ(r) / r                         (1)
ρ = ½ r² and ψ = r if |r| ≤ k,   else ρ = k |r| − ½ k² and ψ = k sign r                Huber 1964     (2)
"""

import numpy as np


def normal_equations(
    r: np.ndarray, jacobian: np.ndarray, huber: float | None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return cost, gradient (p,) and hessian (p, p); `huber` is k, or None for ρ = ½ r² everywhere.  (1), (2)"""
    k = np.inf if huber is None else huber
    size = np.abs(r)
    is_in_tail = size > k
    rho = np.where(is_in_tail, k * size - 0.5 * k * k if huber is not None else 0.0, 0.5 * r * r)
    w = np.where(is_in_tail, k / np.where(is_in_tail, size, 1.0), 1.0).ravel()
    d = jacobian.reshape(len(w), -1)
    weighted_d = w[:, None] * d
    return float(rho.sum()), weighted_d.T @ r.ravel(), weighted_d.T @ d
