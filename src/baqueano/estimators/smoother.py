"""The Rauch-Tung-Striebel smoother: what a Kalman filter would have believed, had it known what came later.

The filter runs once and keeps of each row its state x, P, the prediction x̄⁺, P̄⁺ of the next one and G = ∂x̄⁺/∂x. Then
backwards, from the last row, which stays as it is:

    C = P Gᵀ (P̄⁺)⁻¹,   x_s = x ⊞ C (x_s⁺ ⊟ x̄⁺)                                                            (1)
    P_s = (I − C G) P (I − C G)ᵀ + C (P_s⁺ + R) Cᵀ,   R = P̄⁺ − G P Gᵀ                                      (2)

(2) is P + C (P_s⁺ − P̄⁺) Cᵀ in a form that stays a covariance, as Joseph's does. ⊞ and ⊟ wrap the heading. What is
certain in P̄⁺ is left out of its inverse. Source: Rauch, Tung, Striebel 1965.

The prediction is what the filter makes of a tick in which every sensor is silent: so one smoother serves every filter
whose belief has `mean` (n,), beginning with η, ν, and `cov` (n, n), and whose estimate tells its innovations.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator
from baqueano.contracts.values import Tree
from baqueano.estimators.covariance import mirrored
from baqueano.estimators.kalman import HEADING, boxplus
from baqueano.geometry import wrap
from baqueano.signals import Slot, Tick
from baqueano.symbolic import jacobian, scan

CERTAIN = 1e-13  # of the largest eigenvalue of the correlations


class ForwardPass(NamedTuple):
    """A forward pass of the filter; all lead with N."""

    mean: np.ndarray  # (N, n) after the row
    cov: np.ndarray  # (N, n, n)
    ahead: np.ndarray  # (N, n) as it was predicted for the row
    ahead_cov: np.ndarray  # (N, n, n)
    G: np.ndarray  # (N, n, n) of that prediction


def can_be_smoothed(estimator: Estimator, belief: Tree, tick: Tick) -> bool:
    """Return whether it is a Kalman filter: its belief has a mean and a covariance, it tells its innovations, and it
    does not say that its gains are others than Kalman's."""
    if not optional.of(estimator, "has_kalman_gains"):
        return False
    if not {"mean", "cov"} <= set(getattr(belief, "_fields", ())) or len(belief.mean) < 6:
        return False
    return estimator.step(belief, tick)[1].innovation is not None


def smooth(
    estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto"
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (N, n) and covariance (N, n, n) of each row, given all rows; the leaves of `ticks` lead with N.
    TraceError for an estimator that cannot be compiled."""
    return backward(forward(estimator, belief, ticks, backend))


def forward(estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto") -> ForwardPass:
    """Return what the filter keeps of each row."""
    row = optional.of(estimator, "row") or estimator.step

    def step(belief: Tree, tick: Tick) -> tuple[Tree, ForwardPass]:
        quiet = Tick(
            tick.t_ns, tick.u, type(tick.sensors)(*(Slot(0.0, 0.0 * slot.z) for slot in tick.sensors))
        )

        def ahead(mean: np.ndarray) -> np.ndarray:
            return row(belief._replace(mean=mean), quiet)[0].mean

        predicted, after = row(belief, quiet)[0], row(belief, tick)[0]
        G = jacobian(ahead)(belief.mean)
        return after, ForwardPass(after.mean, after.cov, predicted.mean, predicted.cov, G)

    first = Tick(1, ticks.u[0], type(ticks.sensors)(*(Slot(0.0, 0.0 * s.z[0]) for s in ticks.sensors)))
    return scan(step, belief, first, backend=backend).run(ticks)[1]


def backward(passed: ForwardPass) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (N, n) and covariance (N, n, n) of each row, smoothed.  (1, 2)"""
    mean, cov, G = passed.mean.copy(), passed.cov.copy(), passed.G[1:]
    P, P_bar = passed.cov[:-1], passed.ahead_cov[1:]
    GP = G @ P
    C = np.swapaxes(_inverse(P_bar) @ GP, 1, 2)
    remainder, R = np.eye(mean.shape[1]) - C @ G, P_bar - GP @ np.swapaxes(G, 1, 2)
    own_cov = remainder @ P @ np.swapaxes(remainder, 1, 2) + C @ R @ np.swapaxes(C, 1, 2)
    for k in reversed(range(len(C))):
        gap = mean[k + 1] - passed.ahead[k + 1]
        gap[HEADING] = wrap(gap[HEADING])
        mean[k] = boxplus(mean[k], C[k] @ gap)
        cov[k] = mirrored(own_cov[k] + C[k] @ cov[k + 1] @ C[k].T)
    return mean, cov


def _inverse(P: np.ndarray) -> np.ndarray:
    """The inverses of covariances (N, n, n), without their certain directions."""
    sd = np.sqrt(np.maximum(np.einsum("kii->ki", P), 0.0))
    scale = np.where(sd > 0.0, 1.0 / np.where(sd > 0.0, sd, 1.0), 0.0)
    values, vectors = np.linalg.eigh(P * scale[:, :, None] * scale[:, None, :])
    positive = values > CERTAIN * values[:, -1:]
    inverse = np.where(positive, 1.0 / np.where(positive, values, 1.0), 0.0)
    half = vectors * scale[:, :, None]
    return (half * inverse[:, None, :]) @ np.swapaxes(half, 1, 2)
