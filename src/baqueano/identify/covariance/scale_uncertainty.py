"""Add the effect of fixed scales and a fixed gyro bias to the covariance of a fit.

    θ̂(s (1 + ε)) = θ̂(s) − A⁻¹ g_s ε,   g_s = ∂g/∂ε                                                       (1)
    B ← B + Σ_c σ_c² g_c g_cᵀ                                                                             (2)
    cov ← cov + σ² v vᵀ,   v = A⁻¹ g,   g = Σ_t ψ'(r_t) W_t ∂r_t                                          (3)
    σ² = δ² + 1/P,   P = Σ_t ψ' W² − gᵀ v,   δ = Σ_t ψ(r_t) W_t / P                                       (4)

g is the gradient of the cost, A is the information. g_s is computed with measurements changed by ± RELATIVE_STEP, at
the θ of the fit. With (2) in place of B, A⁻¹ B A⁻¹ grows by the variance of (1) for each scale. (3) is for the
fixed zero of a car's gyro; W are the weights of its readings. σ is the standard error of the zero at rest if it was
measured. Otherwise σ is estimated from the run by (4), and is at most the value of the data sheet.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.tolerances import ZERO_RATE_RAD_S, measured_std_of_gyro_bias, std_of_tolerance
from baqueano.contracts.optional import has_field
from baqueano.identify.covariance.clusters import segment_derivatives
from baqueano.identify.covariance.information import Information
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.normal_equations import pseudo_inverse
from baqueano.numerics.statistics import HUBER

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

RELATIVE_STEP = 1e-3  # part of a reading, and of 1 rad/s
GYRO_CHANNEL = 2  # channel of an IMU


def gyro_bias_covariance(
    problem: Residuals,
    theta: np.ndarray,
    identifiable: np.ndarray,
    bread: np.ndarray,
    vehicle_file: "VehicleFile",
) -> np.ndarray:
    """Return the covariance (p, p) that fixed zeros of gyros add. `identifiable` (p,) is a mask of entries of θ, and
    `bread` (p, p) is the information. A zero that θ contains adds 0. (3), (4)"""
    cov, positions, end = np.zeros_like(bread), np.flatnonzero(identifiable), 0
    sensors = vehicle_file.sensors._asdict().items()
    gyros = [name for name, sensor in sensors if has_field(sensor, "gyro_bias")]
    for name, size in zip(problem.names, problem.sizes, strict=True):
        end += size
        if name not in gyros or f"sensors.{name}.gyro_bias" in problem.shape.paths or not len(positions):
            continue
        g, score, power = np.zeros(problem.size), 0.0, 0.0
        for (r, d, index), weight in zip(segment_derivatives(problem, theta), problem.weights, strict=True):
            r, W = r[:, end - 1], weight[:, end - 1]
            inlier_weight = W * (np.abs(r) < HUBER)
            g[index] += inlier_weight @ d[:, end - 1]
            score, power = score + float(np.clip(r, -HUBER, HUBER) @ W), power + float(inlier_weight @ W)
        A = bread[np.ix_(positions, positions)]
        if not (np.isfinite(g).all() and np.isfinite(A).all()):
            continue  # a model that diverged
        v, std = pseudo_inverse(A) @ g[positions], measured_std_of_gyro_bias(vehicle_file, name)
        if std is None:
            std = _unmeasured_std_of_gyro_bias(score, power - float(g[positions] @ v))
        cov[np.ix_(positions, positions)] += std**2 * np.outer(v, v)
    return cov


def _unmeasured_std_of_gyro_bias(score: float, power: float) -> float:
    """Return the standard deviation σ [rad/s] of a zero that was not measured.  (4)"""
    sheet_std = std_of_tolerance(ZERO_RATE_RAD_S)
    return min(sheet_std, float(np.hypot(score / power, power**-0.5))) if power > sheet_std**-2 else sheet_std


def with_systematic_errors(
    info: Information,
    gradient: Callable[[int, float, float], np.ndarray],
    scales: np.ndarray,
    gyro_bias_rad_s: float,
) -> Information:
    """Return `info` with the effect of errors in the scales and in the zero of the gyro. (2) `scales` (m,) and
    `gyro_bias_rad_s` [rad/s] are standard deviations. `gradient(c, scale, shift)` returns the gradient (p,) of the cost
    if channel c is divided by `scale` and `shift` is added to it."""
    steps = [(int(c), RELATIVE_STEP, 0.0, scales[c]) for c in np.flatnonzero(scales > 0.0)]
    steps += [(GYRO_CHANNEL, 0.0, RELATIVE_STEP, gyro_bias_rad_s)] if gyro_bias_rad_s > 0.0 else []
    meat = info.meat.copy()
    for c, scale, shift, std in steps:
        change = gradient(c, 1.0 + scale, shift) - gradient(c, 1.0 - scale, -shift)
        g = change / (2.0 * RELATIVE_STEP)
        meat += std**2 * np.outer(g, g)
    return info._replace(meat=meat)
