"""Decide between the sensor and the model, with the other channels as the third source.

Channel c disagrees with the model. Two hypotheses predict the residuals r ~ N(0, S), S = H P Hᵀ + N, W = S⁻¹, w = W r:

    the sensor is wrong  the other sensors agree             J_A = rᵀw − w_gᵀ W_gg⁻¹ w_g + |g|            (1)
    the model is wrong   by as much as c shows               J_M = rᵀw − bᵀ (1 + Gᵀ W G)⁻¹ b,  b = Gᵀ w    (2)
    G_c = K b r_c / (K_c b),   b = cov(ν, d),   K = ∂h/∂ν with constant ν̇                                  (3)

P is the covariance of the model, H the Jacobian of h, N the noise. g, of size |g|, is only c, or all channels that fail
with it (one wheel slips, or both); the g with the smaller J_A is used. (1) is the squared distance of the other
channels. In (2) the prior is widened by the response of ν to a disturbance d of thrust or torque, whichever has the
smaller J_M. So a wrong turning gain does not imply a wrong speed, but a wrong thrust of a car implies a wrong yaw rate.
K contains only the kinematics of a wheel, a gyro, or a_y = ν_x ν_ψ. A wrong model predicts no acceleration, so no
channel confirms an accelerometer that disagrees. The log odds of a reading are half the difference of J. Only
INDEPENDENT_HZ readings have weight per second, because their errors are correlated.
"""

from collections.abc import Sequence
from functools import reduce

import numpy as np

from baqueano.contracts.values import Value

INDEPENDENT_HZ = 5.0
MAX_LOG_ODDS = 10.0  # largest log odds of one reading


def log_odds(
    r: np.ndarray,
    S: np.ndarray,
    causes: Sequence[np.ndarray],
    arrived: np.ndarray,
    groups: tuple[tuple[int, ...], ...],
) -> np.ndarray:
    """Return the log odds (m,) per second of each channel: above 0 the sensor is wrong, below 0 the model.

    r (m,) are readings minus predictions of the model, S (m, m) is their covariance. Each of the `causes` is a G (m, m)
    of (3). `arrived` (m,) is 1 for a channel that can serve as evidence, 0 for any other. `groups` lists, for each
    channel, the channels that fail with it.
    """
    m = len(r)
    pairs = arrived[:, None] * arrived[None, :]
    W = np.linalg.solve(S * pairs + np.diag(1.0 - arrived), np.eye(m))
    w = W @ (r * arrived)
    q = np.sum(r * arrived * w)
    odds = []
    for c, group in enumerate(groups):
        sets = [[c], list(group)] if len(group) > 1 else [[c]]
        of_sensor = [q - _quadratic(W[k][:, k], w[k]) + np.sum(arrived[k]) for k in sets]
        of_model = []
        for G in causes:
            cause = arrived[:, None] * G[:, list(group)]
            of_model.append(q - _quadratic(np.eye(len(group)) + cause.T @ W @ cause, cause.T @ w))
        difference = reduce(np.minimum, of_model) - reduce(np.minimum, of_sensor)
        odds.append(INDEPENDENT_HZ * np.clip(0.5 * difference, -MAX_LOG_ODDS, MAX_LOG_ODDS))
    return np.array(odds)


def _quadratic(A: np.ndarray, b: np.ndarray) -> Value:
    """Return bᵀ A⁻¹ b."""
    return b[0] * b[0] / A[0, 0] if len(b) == 1 else np.sum(b * np.linalg.solve(A, b))
