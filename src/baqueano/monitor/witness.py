"""Decide between the sensor and the model. The other numbers are the third witness.

Number c disagrees with the model. Two hypotheses foretell the others, r ~ N(0, S), S = H P Hᵀ + N, W = S⁻¹, w = W r:

    the sensor is off   the others agree with the model     J_A = rᵀw − w_gᵀ W_gg⁻¹ w_g + |g|             (1)
    the model is off    so far that it meets c              J_M = rᵀw − bᵀ (1 + Gᵀ W G)⁻¹ b,  b = Gᵀ w     (2)
    G_c = K P K_cᵀ r_c / (K_c P K_cᵀ),   K = ∂h/∂ν with ν̇ held                                             (3)

g is c alone, or all that fails with it, whichever tells more: both wheels slip, or one. (1) is the distance of the
others alone; (2) that with a prior that was widened by G Gᵀ: by how much the velocity is off if the model is. (3) is
kinematics alone, of a wheel, a gyro, a_y by ν_x ν_ψ: a model that is in doubt tells no acceleration. So an
accelerometer that disagrees stands alone. The log odds of a reading are half the difference; readings that follow one
another err alike, and INDEPENDENT_HZ of them count. Where no other number tells, it stays unknown.
"""

import numpy as np

from baqueano.contracts.blocks import Sensor
from baqueano.contracts.values import Value

INDEPENDENT_HZ = 5.0
MOST = 10.0  # that one reading may say


def log_odds(
    r: np.ndarray, S: np.ndarray, G: np.ndarray, arrived: np.ndarray, groups: tuple[tuple[int, ...], ...]
) -> np.ndarray:
    """Return per number the log odds (m,) that a second adds: above 0 the sensor is off, below 0 the model.

    r (m,) are readings less the model's, S (m, m) their covariance, G (m, m) as in (3); `arrived` (m,) is 1 for what
    may witness.
    """
    m = len(r)
    pairs = arrived[:, None] * arrived[None, :]
    W = np.linalg.solve(S * pairs + np.diag(1.0 - arrived), np.eye(m))
    w = W @ (r * arrived)
    q = np.sum(r * arrived * w)
    odds = []
    for c, group in enumerate(groups):
        off, sets = [], [(c,), group] if len(group) > 1 else [(c,)]
        for some in sets:
            k = list(some)
            off.append(q - _quadratic(W[k][:, k], w[k]) + np.sum(arrived[k]))
        k = list(group)
        wide = arrived[:, None] * G[:, k]
        model = q - _quadratic(np.eye(len(k)) + wide.T @ W @ wide, wide.T @ w)
        sensor: Sensor = off[0] if len(off) == 1 else np.minimum(off[0], off[1])
        odds.append(INDEPENDENT_HZ * np.clip(0.5 * (model - sensor), -MOST, MOST))
    return np.array(odds)


def _quadratic(A: np.ndarray, b: np.ndarray) -> Value:
    """bᵀ A⁻¹ b."""
    return b[0] * b[0] / A[0, 0] if len(b) == 1 else np.sum(b * np.linalg.solve(A, b))
