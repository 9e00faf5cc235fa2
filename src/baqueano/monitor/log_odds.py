"""Decide between the sensor and the model, with the other channels as the third source.

Each hypothesis predicts the residuals r ~ N(0, S), S = H P Hᵀ + N, W = S⁻¹, w = W r; the smaller J is likelier:

    channels g are wrong   the other channels agree          J_A = rᵀw − E_g + |g|,   E_g = w_gᵀ W_gg⁻¹ w_g   (1)
    the model is wrong     by as much as c shows             J_M = rᵀw − bᵀ (1 + Gᵀ W G)⁻¹ b,  b = Gᵀ w       (2)
    G_c = K b r_c / (K_c b),   b = cov(ν, d),   K = ∂h/∂ν with constant ν̇                                     (3)
    c is contradicted      E_g − E_(g without c) > σ²,  and no other J_A is smaller by 2 MIN_LOG_ODDS         (4)

P is the covariance of the model, H the Jacobian of h, N the noise. g is one channel, or all channels that fail together
(one wheel slips, or both). (4) compares channels where the model predicts little. (2) widens the prior by a disturbance
d of thrust or torque, whichever has the smaller J_M: a wrong turning gain does not imply a wrong speed. K contains only
kinematics, so a wrong model does not confirm an accelerometer. Sources: Baarda 1968 for (4); Gertler 1998.
"""

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value

INDEPENDENT_HZ = 5.0  # readings with a weight, because errors are correlated
MIN_LOG_ODDS = 3.0  # of a decision: 20 to 1
MAX_LOG_ODDS = 10.0  # largest log odds of one reading


class Verdicts(NamedTuple):
    """The verdicts on m channels after a reading."""

    log_odds: np.ndarray  # (m,) per second: above 0 the sensor is wrong, below 0 the model
    is_contradicted: np.ndarray  # (m,) bool: see (4)


def verdicts(
    r: np.ndarray,
    S: np.ndarray,
    causes: Sequence[np.ndarray],
    evidence_mask: np.ndarray,
    groups: tuple[tuple[int, ...], ...],
    sigma: float,
) -> Verdicts:
    """Return the verdicts on each channel; `sigma` is the gate of (4).

    r (m,) are readings minus predictions of the model, S (m, m) is their covariance. Each of the `causes` is a G (m, m)
    of (3). `evidence_mask` (m,) is 1 for a channel that can serve as evidence, 0 for any other. `groups` lists, for
    each channel, the channels that fail with it.
    """
    m = len(r)
    pairs = evidence_mask[:, None] * evidence_mask[None, :]
    W = np.linalg.solve(S * pairs + np.diag(1.0 - evidence_mask), np.eye(m))
    w = W @ (r * evidence_mask)
    q = np.sum(r * evidence_mask * w)
    E = {g: _quadratic(W[list(g)][:, list(g)], w[list(g)]) for g in _faulty_sets(groups)}
    J_A = {g: q - E[g] + np.sum(evidence_mask[list(g)]) for g in E if g}
    J_min = reduce(np.minimum, J_A.values())
    odds, contradictions = [], []
    for c, group in enumerate(groups):
        J_M = []
        for G in causes:
            cause = evidence_mask[:, None] * G[:, list(group)]
            J_M.append(q - _quadratic(np.eye(len(group)) + cause.T @ W @ cause, cause.T @ w))
        J_channel = reduce(np.minimum, [J for g, J in J_A.items() if c in g])
        J_others = reduce(np.minimum, [J for g, J in J_A.items() if c not in g], q)
        difference = np.minimum(reduce(np.minimum, J_M) - J_channel, np.maximum(J_others - J_channel, 0.0))
        odds.append(INDEPENDENT_HZ * np.clip(0.5 * difference, -MAX_LOG_ODDS, MAX_LOG_ODDS))
        is_likely = [
            (E[g] - E[tuple(k for k in g if k != c)] > sigma**2) & (J_min + 2.0 * MIN_LOG_ODDS >= J)
            for g, J in J_A.items()
            if c in g
        ]
        contradictions.append((evidence_mask[c] > 0.0) & reduce(np.logical_or, is_likely))
    return Verdicts(np.array(odds), np.array(contradictions))


def _faulty_sets(groups: tuple[tuple[int, ...], ...]) -> list[tuple[int, ...]]:
    """Return the sets of channels that can be wrong together: none, each alone, each group, a group without one."""
    channel_sets = [(), *((c,) for c in range(len(groups)))]
    for group in groups:
        channel_sets += [tuple(sorted(group)), *(tuple(k for k in sorted(group) if k != c) for c in group)]
    return list(dict.fromkeys(channel_sets))


def _quadratic(A: np.ndarray, b: np.ndarray) -> Value:
    """Return bᵀ A⁻¹ b."""
    if len(b) < 2:
        return b[0] * b[0] / A[0, 0] if len(b) else 0.0
    return np.sum(b * np.linalg.solve(A, b))
