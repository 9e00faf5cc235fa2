"""The Kalman filter: pure functions `predict` and `correct`, for the filters of this package and the fits.

    x̄ = g(x),   P̄ = G P Gᵀ + R,   G = ∂g/∂x                                                              (1)

x, P are mean and covariance of the state, R the process noise. `correct` uses a measurement z = h(x) + noise Q one
channel at a time. With Q = L diag(q) Lᵀ, the entries of L⁻¹ z have independent noise; Δ is the change of the mean:

    y ← L⁻¹ (z − h(x̄)),   H ← L⁻¹ ∂h/∂x̄,   Δ = 0,   and for each row c                                    (2)
    s = H_c P H_cᵀ + q_c,   e = (y_c − H_c Δ)/√s,   K = E P H_cᵀ/s,   Δ ← Δ + K √s e                        (3)
    D = P − K H_c P,   P ← D + (q_c K − D H_cᵀ) Kᵀ                    Joseph's form, multiplied out        (4)

(3) computes the same Δ and P as all rows at once, without a matrix to invert; yᵀ S⁻¹ y = Σ e², log |S| = Σ log s. E is
1 for an estimated state, 0 for a consider state, whose uncertainty is included. A weight w ≤ 1 replaces q_c by q_c + s
(1/w − 1). A channel without a measurement has weight 0 and independent noise: the others are corrected as without it.
Derivation: docs/derivations/kalman.md. Sources: Bierman 1977 (2, 3); Bucy and Joseph 1968 (4); Schmidt 1966 for E.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.covariance import mirror_upper
from baqueano.geometry import wrap
from baqueano.symbolic import jacobian

HEADING_INDEX = 2  # the entry of a state that is an angle: (x, y, ψ, …)


class Gaussian(NamedTuple):
    """A normally distributed state: mean and covariance."""

    mean: np.ndarray  # (n,)
    cov: np.ndarray  # (n, n)


class StatePrediction(NamedTuple):
    """The state after a motion, and the derivative of the motion."""

    mean: np.ndarray  # (n,)
    cov: np.ndarray  # (n, n)
    G: np.ndarray  # (n, n)


class Correction(NamedTuple):
    """The change of mean and covariance by a measurement, and the normalised innovations."""

    mean_change: np.ndarray  # Δ (n,), to be added to the mean
    cov: np.ndarray  # (n, n) afterwards
    e: np.ndarray  # (m,) whitened innovations: independent standard normals if the filter is consistent
    s: np.ndarray  # (m,) their variances before they were divided
    weight: np.ndarray  # (m,) w
    gain: np.ndarray  # (m, n) w P H_cᵀ/s, before E
    H: np.ndarray  # (m, n) L⁻¹ ∂h/∂x̄


def predict(
    x: Gaussian,
    g: Callable[[np.ndarray], np.ndarray],
    R: np.ndarray | Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> StatePrediction:
    """Return the state after `g`, with the process noise covariance R (n, n), or R(x̄, G).  (1)"""
    mean, G = g(x.mean), jacobian(g)(x.mean)
    return StatePrediction(mean, mirror_upper(G @ x.cov @ G.T + (R(mean, G) if callable(R) else R)), G)


def correct(
    cov: np.ndarray,
    y: np.ndarray,
    H: np.ndarray,
    Q: np.ndarray,
    state_mask: np.ndarray | None = None,
    weight: Callable[[int, Value, Value], object] | None = None,
    mask: np.ndarray | None = None,
) -> Correction:
    """Return the change that the innovation y (m,) causes; the caller adds it to the mean.  (2)-(4)

    H (m, n) is ∂h/∂x̄. Q is the measurement noise: (m, m), or (m,) for independent channels; each variance is above 0.
    `state_mask` is E: (n,) for all channels, or (m, n) with a row for each channel; the default is ones. The function
    `weight(c, e, s)` returns the weight w of channel c. `mask` (m,) is 1 for a channel with a measurement and 0 for one
    without: its y can be NaN, its e and w are 0. The default is ones.
    """
    if mask is not None:
        y = np.where(mask > 0.0, y, 0.0)
        Q = Q if Q.ndim == 1 else np.where(np.eye(len(y)) > 0.0, Q, Q * np.outer(mask, mask))
    y, H, q = independent(y, H, Q)
    E = None if state_mask is None else np.broadcast_to(state_mask, H.shape)
    P, mean_change, e, s, weights, gains = cov, np.zeros(cov.shape[0]), [], [], [], []
    for c in range(H.shape[0]):
        PH = P @ H[c]
        cross = H[c] @ PH
        s.append(cross + q[c])
        remainder = y[c] - H[c] @ mean_change
        e.append(remainder / np.sqrt(s[c]) * (1.0 if mask is None else mask[c]))
        w = 1.0 if weight is None else weight(c, e[c], s[c])
        weights.append(w if mask is None else mask[c] * w)
        w = weights[c]
        gains.append(PH * (w / s[c]))
        K = gains[c] if E is None else E[c] * gains[c]
        mean_change = mean_change + K * remainder
        D = P - K[:, None] * PH[None, :]
        noise = q[c] * K if weight is None else PH * (1.0 - cross * (w / s[c]))  # (q_c + s (1/w − 1)) K
        noise = noise if weight is None or E is None else E[c] * noise
        P = mirror_upper(D + (noise - D @ H[c])[:, None] * K[None, :])
    return Correction(mean_change, P, np.array(e), np.array(s), np.array(weights), _rows(gains, H), H)


def independent(y: np.ndarray, H: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return y (m,), H (m, n) and q (m,) of the measurement L⁻¹ z, whose noise is independent: Q = L diag(q) Lᵀ."""
    if Q.ndim == 1:
        return y, H, Q
    m = len(y)
    remainder, q = [[Q[i, j] for j in range(m)] for i in range(m)], []
    values, rows = [y[i] for i in range(m)], [H[i] for i in range(m)]
    for k in range(m):
        q.append(remainder[k][k])
        for i in range(k + 1, m):
            factor = remainder[i][k] / q[k]
            if isinstance(factor, float) and factor == 0.0:
                continue
            values[i] = values[i] - factor * values[k]
            rows[i] = rows[i] - factor * rows[k]
            for j in range(k + 1, m):
                remainder[i][j] = remainder[i][j] - factor * remainder[k][j]
    return np.array(values), _rows(rows, H), np.array(q)


def _rows(rows: Sequence[np.ndarray], H: np.ndarray) -> np.ndarray:
    """Return the rows (m, n) as an array with the shape of H, even without a row."""
    return np.stack(rows) if rows else H


def boxplus(mean: np.ndarray, mean_change: np.ndarray) -> np.ndarray:
    """Return x ⊞ Δ: `mean` + `mean_change` (n,) with the heading wrapped, for a state that begins with a pose."""
    x = mean + mean_change
    return np.concatenate([x[:HEADING_INDEX], np.array([wrap(x[HEADING_INDEX])]), x[HEADING_INDEX + 1 :]])
