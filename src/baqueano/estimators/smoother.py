"""The Rauch-Tung-Striebel smoother: estimate each row of a run from earlier and later measurements.

The filter runs once. For each row it stores its state x, P, the prediction x̄⁺, P̄⁺ of the next row, and G = ∂x̄⁺/∂x. A
backward pass then computes the smoothed x_s, P_s. It starts at the last row, which it does not change:

    C = P Gᵀ (P̄⁺)⁻¹,   x_s = x ⊞ C (x_s⁺ ⊟ x̄⁺)                                                            (1)
    P_s = (I − C G) P (I − C G)ᵀ + C (P_s⁺ + R) Cᵀ,   R = P̄⁺ − G P Gᵀ                                      (2)

(2) equals P + C (P_s⁺ − P̄⁺) Cᵀ, but stays a covariance despite rounding, as Joseph's form does. ⊞ and ⊟ wrap the
heading. The inverse excludes the directions with almost zero variance in P̄⁺. Source: Rauch, Tung, Striebel 1965.

The prediction is a step of the filter with a tick in which every sensor is silent. So one smoother serves every filter
whose belief has `mean` (n,), starting with η, ν, and `cov` (n, n), and whose estimate contains its innovations.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator
from baqueano.contracts.values import Tree
from baqueano.estimators.covariance import mirror_upper
from baqueano.estimators.kalman import HEADING_INDEX, boxplus
from baqueano.geometry import wrap
from baqueano.signals import Slot, Tick
from baqueano.symbolic import jacobian, scan

MIN_EIGENVALUE_SHARE = 1e-13  # of the largest eigenvalue of the correlations


class ForwardPass(NamedTuple):
    """Result of the forward pass of the filter; the first axis of each array has length N."""

    mean: np.ndarray  # (N, n) after the row
    cov: np.ndarray  # (N, n, n)
    predicted_mean: np.ndarray  # (N, n) mean that was predicted for the row
    predicted_cov: np.ndarray  # (N, n, n)
    G: np.ndarray  # (N, n, n) of that prediction


def can_be_smoothed(estimator: Estimator, belief: Tree, tick: Tick) -> bool:
    """Return True for a Kalman filter: its belief has `mean` and `cov`, and its estimate contains the innovation.

    An estimator with `has_kalman_gains` = False is not smoothed, because its gains differ from Kalman's.
    """
    if not optional.attribute(estimator, "has_kalman_gains"):
        return False
    if not {"mean", "cov"} <= set(getattr(belief, "_fields", ())) or len(belief.mean) < 6:
        return False
    return estimator.step(belief, tick)[1].innovation is not None


def smooth(
    estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean (N, n) and covariance (N, n, n) of each row from all measurements.

    The leaves of `ticks` have N rows.

    Raise TraceError for an estimator that cannot be compiled.
    """
    return smooth_backward(run_forward(estimator, belief, ticks, backend))


def run_forward(estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto") -> ForwardPass:
    """Run the filter over `ticks`, and return the state and the prediction of each row."""
    row = optional.attribute(estimator, "row") or estimator.step

    def step(belief: Tree, tick: Tick) -> tuple[Tree, ForwardPass]:
        silent_tick = Tick(
            tick.t_ns, tick.u, type(tick.sensors)(*(Slot(0.0, 0.0 * slot.z) for slot in tick.sensors))
        )

        def predicted_mean(mean: np.ndarray) -> np.ndarray:
            return row(belief._replace(mean=mean), silent_tick)[0].mean

        prediction, next_belief = row(belief, silent_tick)[0], row(belief, tick)[0]
        G = jacobian(predicted_mean)(belief.mean)
        return next_belief, ForwardPass(next_belief.mean, next_belief.cov, prediction.mean, prediction.cov, G)

    first = Tick(1, ticks.u[0], type(ticks.sensors)(*(Slot(0.0, 0.0 * s.z[0]) for s in ticks.sensors)))
    return scan(step, belief, first, backend=backend).run(ticks)[1]


def smooth_backward(forward_pass: ForwardPass) -> tuple[np.ndarray, np.ndarray]:
    """Return the smoothed mean (N, n) and covariance (N, n, n) of each row.  (1, 2)"""
    mean, cov, G = forward_pass.mean.copy(), forward_pass.cov.copy(), forward_pass.G[1:]
    P, P_bar = forward_pass.cov[:-1], forward_pass.predicted_cov[1:]
    GP = G @ P
    C = np.swapaxes(_inverse(P_bar) @ GP, 1, 2)
    remainder, R = np.eye(mean.shape[1]) - C @ G, P_bar - GP @ np.swapaxes(G, 1, 2)
    own_cov = remainder @ P @ np.swapaxes(remainder, 1, 2) + C @ R @ np.swapaxes(C, 1, 2)
    for k in reversed(range(len(C))):
        correction = mean[k + 1] - forward_pass.predicted_mean[k + 1]
        correction[HEADING_INDEX] = wrap(correction[HEADING_INDEX])
        mean[k] = boxplus(mean[k], C[k] @ correction)
        cov[k] = mirror_upper(own_cov[k] + C[k] @ cov[k + 1] @ C[k].T)
    return mean, cov


def _inverse(P: np.ndarray) -> np.ndarray:
    """Return the inverses of covariances (N, n, n); directions with almost zero variance are excluded."""
    std = np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    scale = np.where(std > 0.0, 1.0 / np.where(std > 0.0, std, 1.0), 0.0)
    values, vectors = np.linalg.eigh(P * scale[:, :, None] * scale[:, None, :])
    is_positive = values > MIN_EIGENVALUE_SHARE * values[:, -1:]
    inverse = np.where(is_positive, 1.0 / np.where(is_positive, values, 1.0), 0.0)
    scaled_vectors = vectors * scale[:, :, None]
    return (scaled_vectors * inverse[:, None, :]) @ np.swapaxes(scaled_vectors, 1, 2)
