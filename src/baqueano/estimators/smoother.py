"""The smoother: estimate each row of a run from earlier and later measurements, for any gains of the filter.

A row multiplies the error of the state by G, then by I − K_c H_c for each number y_c of its measurements. The filter
corrects some states only: K_c = E_c K̂_c, with E, w, s and Kalman's gain K̂_c = w P H_cᵀ/s of kalman.py. y_c corrects
the same states at every earlier row. A group g of states with the same E has an adjoint λ_g, and shares the information
Λ_gh with group h. Both are 0 after the last row, and are computed backward:

    λ_g ← A_g λ_g + E_gc H_cᵀ y_c w/s,   A_g = I − H_cᵀ (K̂_c if E_gc = 1, else K_c)ᵀ                       (1)
    Λ_gh ← A_g Λ_gh A_hᵀ + max(E_gc, E_hc) H_cᵀ H_c w/s                                                   (2)
    λ_g ← Gᵀ λ_g,   Λ_gh ← Gᵀ Λ_gh G                                                                       (3)
    x_s,i = x_i ⊞ P_i λ_g,   (P_s)_ij = P_ij − P_i Λ_gh P_jᵀ,   g, h: the groups of the states i, j        (4)

P_s is the covariance of x_s for any E (docs/derivations/kalman.md). With E = 1 it is the smoother of Bryson and Frazier
1963, with the result of Rauch, Tung and Striebel 1965. A filter with Kalman's gains needs no method `row_errors`: its
belief has `mean` (n,), starting with η, ν, and `cov` (n, n), from which `kalman_row_errors` computes H and K̂.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.covariance import mirror_upper
from baqueano.estimators.kalman import HEADING_INDEX, Correction, StatePrediction, boxplus
from baqueano.geometry import wrap
from baqueano.signals import Estimate, Slot, Tick
from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.function import KernelKey
from baqueano.symbolic.scan import Scan

MIN_EIGENVALUE_SHARE = 1e-13  # share of the largest eigenvalue of the correlations: less is rounding
MIN_INFORMATION = 1e-11  # share of a variance that a measurement removes: a smaller one is rounding


class RowErrors(NamedTuple):
    """Change of the errors of the state in a row: the motion, then C numbers, one after the other."""

    G: np.ndarray  # (n, n) error before the first number per error before the row
    H: np.ndarray  # (C, n)
    gain: np.ndarray  # (C, n) K̂, Kalman's gains
    corrected_mask: np.ndarray  # (C, n) E: 1 for the states that a number corrects, else 0
    y: np.ndarray  # (C,) innovations
    information: np.ndarray  # (C,) w/s
    output: np.ndarray  # (6, n) derivative of the estimated η and ν


def make_row_errors(
    correction: Correction, G: np.ndarray, corrected_mask: np.ndarray, output: np.ndarray, is_new: Value
) -> RowErrors:
    """Return the RowErrors of a row with this correction; the numbers of a row that is not new are not used."""
    y, information = correction.e * np.sqrt(correction.s), correction.weight / correction.s
    information = np.where(is_new, information, 0.0)
    return RowErrors(G, correction.H, correction.gain, corrected_mask, y, information, output)


class ForwardPass(NamedTuple):
    """Result of the filter; the first axis of each array has length N."""

    mean: np.ndarray  # (N, n) after the row
    cov: np.ndarray  # (N, n, n)
    estimate: Estimate
    errors: RowErrors


def can_be_smoothed(estimator: Estimator, belief: Tree, tick: Tick) -> bool:
    """Return True for a filter with `row_errors`, or with `mean` and `cov` in its belief and an innovation."""
    if optional.attribute(estimator, "row_errors") is not None:
        return True
    if not {"mean", "cov"} <= set(getattr(belief, "_fields", ())) or len(belief.mean) < 6:
        return False
    return estimator.step(belief, tick)[1].innovation is not None


def smooth(estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto") -> Estimate:
    """Return the Estimate of each row from all measurements.

    The leaves of `ticks` and of the Estimate have N rows. Raise TraceError for an estimator that cannot be compiled.
    """
    forward = run_forward(estimator, belief, ticks, backend)
    mean, cov = smooth_backward(forward)
    J, estimate = forward.errors.output, forward.estimate
    mean_change = np.einsum("kij,kj->ki", J, _difference(mean, forward.mean))
    eta, nu = estimate.eta + mean_change[:, :3], estimate.nu + mean_change[:, 3:]
    eta[:, HEADING_INDEX] = wrap(eta[:, HEADING_INDEX])
    change = J @ (cov - forward.cov) @ np.swapaxes(J, 1, 2)
    output_cov = np.array([mirror_upper(P) for P in estimate.cov + change])
    return Estimate(estimate.t_ns, eta, nu, output_cov)


def run_forward(estimator: Estimator, belief: Tree, ticks: Tick, backend: str = "auto") -> ForwardPass:
    """Run the filter over `ticks`, and return the state of each row and its errors."""
    silent_slots = type(ticks.sensors)(*(Slot(0.0, 0.0 * slot.z[0]) for slot in ticks.sensors))
    first = Tick(1, 0.0 * ticks.u[0], silent_slots)
    forward = _forward_kernel(KernelKey(estimator, belief, first), backend).run(ticks)[1]
    if optional.attribute(estimator, "row_errors") is not None:
        return forward
    return forward._replace(errors=kalman_row_errors(forward.mean, forward.cov, forward.errors))


@lru_cache(maxsize=8)
def _forward_kernel(key: KernelKey, backend: str) -> Scan:
    """Return the scan of the filter of `key`: estimator, belief, first tick. Equal filters and starts share it."""
    estimator, belief, first = key.parts
    row_errors: Tree = optional.attribute(estimator, "row_errors")
    row: Tree = optional.attribute(estimator, "row") or estimator.step

    def step(belief: Tree, tick: Tick) -> tuple[Tree, ForwardPass]:
        errors: Tree
        if row_errors is not None:
            belief, estimate, errors = row_errors(belief, tick)
        else:
            silent_slots = type(tick.sensors)(*(Slot(0.0, 0.0 * slot.z) for slot in tick.sensors))
            silent_tick = Tick(tick.t_ns, tick.u, silent_slots)
            prediction = row(belief, silent_tick)[0]
            G = jacobian(lambda mean: row(belief._replace(mean=mean), silent_tick)[0].mean)(belief.mean)
            errors = StatePrediction(prediction.mean, prediction.cov, G)
            belief, estimate = row(belief, tick)
        return belief, ForwardPass(belief.mean, belief.cov, Estimate(*estimate[:4]), errors)

    return scan(step, belief, first, backend=backend)


def kalman_row_errors(mean: np.ndarray, cov: np.ndarray, prediction: StatePrediction) -> RowErrors:
    """Return the errors of N rows of a filter with Kalman's gains, from x, P after and x̄, P̄ before its correction.

    With P̄ = L Lᵀ and L⁻¹ (P̄ − P) L⁻ᵀ = V diag(i) Vᵀ, the same correction is made by n independent numbers:

        H = Vᵀ L⁻¹,   K̂ = L V diag(i),   w/s = i,   y = diag(1/i) H (x ⊟ x̄)                                  (5)
    """
    std = np.sqrt(np.maximum(np.einsum("kii->ki", prediction.cov), 0.0))
    scale = np.where(std > 0.0, 1.0 / np.where(std > 0.0, std, 1.0), 0.0)
    values, vectors = np.linalg.eigh(prediction.cov * scale[:, :, None] * scale[:, None, :])
    is_positive = values > MIN_EIGENVALUE_SHARE * values[:, -1:]
    root = np.sqrt(np.where(is_positive, values, 1.0))[:, None, :]
    L = std[:, :, None] * vectors * root * is_positive[:, None, :]
    inverse = scale[:, :, None] * vectors / root * is_positive[:, None, :]  # L⁻ᵀ
    information, V = np.linalg.eigh(np.swapaxes(inverse, 1, 2) @ (prediction.cov - cov) @ inverse)
    information = np.where(information > MIN_INFORMATION, information, 0.0)
    H = np.swapaxes(inverse @ V, 1, 2)
    y = np.einsum("kcj,kj->kc", H, _difference(mean, prediction.mean))
    y = y / np.where(information > 0.0, information, 1.0)
    gain = np.swapaxes(L @ V, 1, 2) * information[:, :, None]
    output = np.broadcast_to(np.eye(6, mean.shape[1]), (len(mean), 6, mean.shape[1]))
    return RowErrors(prediction.G, H, gain, np.ones_like(H), y, information, output)


def smooth_backward(forward: ForwardPass) -> tuple[np.ndarray, np.ndarray]:
    """Return the smoothed mean (N, n) and covariance (N, n, n) of each row.  (1)-(4)"""
    mean, cov, errors, n = forward.mean.copy(), forward.cov.copy(), forward.errors, forward.mean.shape[1]
    groups, group = np.unique(errors.corrected_mask.reshape(-1, n).T, axis=0, return_inverse=True)
    groups, group = groups.reshape(len(groups), *errors.y.shape), group.ravel()
    adjoint, information = np.zeros((len(groups), n)), np.zeros((len(groups), len(groups), n, n))
    for k in reversed(range(len(mean))):
        P = forward.cov[k]
        mean[k] = boxplus(mean[k], np.sum(P * adjoint[group], axis=1))
        shared_term = np.einsum("ia,ijab->ijb", P, information[group[:, None], group[None, :]])
        cov[k] = mirror_upper(P - np.einsum("ijb,jb->ij", shared_term, P))
        for c in reversed(np.flatnonzero(errors.information[k])):
            H, K, E, i = errors.H[k, c], errors.gain[k, c], groups[:, k, c], errors.information[k, c]
            gains = np.where(E[:, None] > 0.0, K, errors.corrected_mask[k, c] * K)
            adjoint = adjoint + np.outer(E * (errors.y[k, c] * i) - np.sum(gains * adjoint, axis=1), H)
            information = information - H[:, None] * np.einsum("ga,ghab->ghb", gains, information)[:, :, None]
            information = information - np.einsum("ghab,hb->gha", information, gains)[..., None] * H
            information = information + np.multiply.outer(np.maximum.outer(E, E) * i, np.outer(H, H))
        adjoint = adjoint @ errors.G[k]
        information = errors.G[k].T @ information @ errors.G[k]
    return mean, cov


def _difference(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return x ⊟ y (N, n): the differences with their headings wrapped."""
    difference = x - y
    difference[:, HEADING_INDEX] = wrap(difference[:, HEADING_INDEX])
    return difference
