"""Estimate the lasting error of the model's speed from the errors of a fit.

    ∂|ν_x|/∂θ ≈ a |ν_x| + b,   a, b (p,) by least squares over the runs, forward and backward separately  (1)
    C = f Σ_i w_i [a b]ᵢᵀ P [a b]ᵢ + diag(σ_s², 0),   w_i the share of the direction i in the rows         (2)
    var |ν_x| = C_aa ν_x² + 2 C_ab |ν_x| + C_bb = σ₀² + σ₁² (|ν_x| − v₀)²                                  (3)
    c = Σ_i w_i a_iᵀ ∂θ/∂κ_ψ                                                                               (4)

P is the covariance of the parameters of the model. σ_s is the relative error of the speed by the scales of the
accelerometers; it is 0 if P contains it. κ_ψ is the error of the gyro's scale: a gyro that reads too much gives a speed
that is too low, because the fit compares ν_x ν_ψ with a_y. f restores the variance that (1) does not describe, as that
of turns: with it and σ_s = 0, the mean of (3) over the rows equals that of ∂ν_x P ∂ν_xᵀ. No sensor on board shows these
errors, so they last for the whole drive.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.estimators.augmented.motion import MIN_SPEED_M_S
from baqueano.estimators.augmented.state import layout, start_std
from baqueano.estimators.augmented_ekf import SCALE_INDEX, AugmentedEkf
from baqueano.identify.data.record import record_of
from baqueano.identify.residuals.motion import motion_rows, open_loop
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

SCALES = [SCALE_INDEX, SCALE_INDEX + 1]  # of speed and yaw rate
MAX_SPEED_PER_GYRO_SCALE = 10.0  # a larger c belongs to a model that diverged
SCALES_INCLUDED = (
    "identifiability.accelerometer-scale"  # note of a fit whose errors contain those of the scales
)


def with_speed_error(ekf: AugmentedEkf, fit: "Fit", runs: Sequence[Run]) -> AugmentedEkf:
    """Return the filter with the lasting error of the model's speed. Without free parameters of the model, or with a
    sensor of the speed, it is unchanged."""
    entries = [k for k, n in enumerate(fit.names) if n.startswith("model.") and np.isfinite(fit.sd[k])]
    if layout(ekf).speed_is_measured or not entries:
        return ekf
    paths, P = tuple(fit.names[k] for k in entries), fit.cov[np.ix_(entries, entries)]
    kernel, theta = open_loop(fit.blocks.model, paths, lambda motion: motion.nu[:1], fit.backend)
    outputs = [kernel.sensitivities(motion_rows(record_of(run, {})), theta) for run in runs]
    nu_x, derivatives = (np.concatenate(columns)[:, 0] for columns in zip(*outputs, strict=True))
    moving = np.abs(nu_x) > MIN_SPEED_M_S
    C, c, modelled_sum, total = np.zeros((2, 2)), 0.0, 0.0, 0.0
    for direction in (1.0, -1.0):
        rows = moving & (np.sign(nu_x) == direction) & np.isfinite(derivatives).all(axis=1)
        if rows.any():
            X = np.stack([np.abs(nu_x[rows]), np.ones(rows.sum())], axis=1)
            D = direction * derivatives[rows]
            B = np.linalg.lstsq(X, D, rcond=None)[0]
            weight = rows.sum() / moving.sum()
            C += weight * (B @ P @ B.T)
            c += weight * float(B[0] @ fit.gyro_shift[entries])
            modelled_sum += np.einsum("ni,ij,nj->", X @ B, P, X @ B)
            total += np.einsum("ni,ij,nj->", D, P, D)
    C *= total / modelled_sum if modelled_sum > 0.0 else 1.0
    if any(message.code == SCALES_INCLUDED for message in fit.always_unobservable):
        c = 0.0
    else:
        speed_var, gyro_var = start_std(replace(ekf, speed_error_std=np.zeros(2)))[SCALES] ** 2
        C[0, 0] += speed_var if c == 0.0 else max(speed_var - gyro_var, 0.0)
    least = float(np.clip(-C[0, 1] / C[0, 0], -100.0, 100.0)) if C[0, 0] > 0.0 else 0.0
    std = np.sqrt(np.maximum([C[1, 1] + least * C[0, 1], C[0, 0]], 0.0))  # C_bb − C_ab²/C_aa
    if not (np.isfinite(std).all() and abs(c) < MAX_SPEED_PER_GYRO_SCALE):
        return ekf
    return replace(ekf, speed_error_std=std, least_error_speed_m_s=least, speed_per_gyro_scale=c)
