"""Add the effect of fixed scales and a fixed gyro bias to the covariance of a fit.

    θ̂(s (1 + ε)) = θ̂(s) − A⁻¹ g_s ε,   g_s = ∂g/∂ε                                                       (1)
    B ← B + Σ_c σ_c² g_c g_cᵀ                                                                             (2)
    cov ← cov + σ² v vᵀ,   v = A⁻¹ g,   g = Σ_t ψ'(r_t) W_t ∂r_t                                          (3)
    σ² = δ² + 1/P,   P = Σ_t ψ' W² − gᵀ v,   δ = Σ_t ψ(r_t) W_t / P                                       (4)

g is the gradient of the cost, A is the information. g_s is computed with measurements changed by ± RELATIVE_STEP, at
the θ of the fit. With (2) in place of B, A⁻¹ B A⁻¹ grows by the variance of (1) for each scale. A data sheet's
tolerance ± a is a uniform distribution, σ = a/√3 (Guide to the expression of uncertainty in measurement, 4.3.7). (3)
is for the fixed zero of a car's gyro; W are the weights of its readings. σ is the standard error of the zero at rest
if it was measured. Otherwise σ is estimated from the run by (4), and is at most the value of the data sheet.
"""

from collections.abc import Callable, Mapping
from datetime import date
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.covariance.clusters import segment_derivatives
from baqueano.identify.covariance.information import Information
from baqueano.identify.data.segments import pseudo_inverse
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.statistics import HUBER
from baqueano.sensors.imu import SCALE_TOLERANCE
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

RELATIVE_STEP = 1e-3  # part of a reading, and of 1 rad/s
ZERO_RATE_RAD_S = np.radians(20.0)  # ±, the zero-rate output of the MPU-6050's data sheet
GYRO_CHANNEL = 2  # channel of an IMU
DATA_SHEET_TOLERANCES = {"accel": SCALE_TOLERANCE, "gyro": SCALE_TOLERANCE}
CHANNELS = (("accel", "accel_scale", 0), ("accel", "accel_scale", 1), ("gyro", "gyro_scale", 0))


def std_of_tolerance(tolerance: float) -> float:
    """Return the standard deviation of a value that lies within ± `tolerance`."""
    return tolerance / np.sqrt(3.0)


def scale_stds(
    vehicle_file: "VehicleFile", imu: str, tolerance: Mapping[str, float] | None = None
) -> np.ndarray:
    """Return the relative standard deviations (3,) of the scales of an IMU. They are computed from `tolerance` (keys
    "accel", "gyro"). Otherwise the standard error in the file is used, or the tolerance of a data sheet. Raise
    UsageError for an unknown key, or a tolerance outside 0 to 1."""
    tolerances, stds = dict(tolerance or {}), []
    is_valid = all(kind in DATA_SHEET_TOLERANCES and 0.0 <= x < 1.0 for kind, x in tolerances.items())
    if not is_valid:
        raise UsageError(fault("tolerance.keys", given=tolerances, keys=DATA_SHEET_TOLERANCES))
    for kind, field, entry in CHANNELS:
        std = _measured_relative_std(vehicle_file, f"sensors.{imu}.{field}", entry)
        if std is None or kind in tolerances:
            std = std_of_tolerance(tolerances.get(kind, DATA_SHEET_TOLERANCES[kind]))
        stds.append(std)
    return np.array(stds)


def with_tolerance(vehicle_file: "VehicleFile", tolerance: Mapping[str, float]) -> "VehicleFile":
    """Return the file with standard deviations of scales: {"sensors.imu.gyro_scale": 0.01} means ± 1 % of the value.
    Raise UsageError for a path that is not a scale of an IMU in the file, and for a tolerance outside 0 to 1."""
    from baqueano.vehicle_file import Provenance

    scale_paths = [
        f"sensors.{name}.{field}"
        for name, sensor in vehicle_file.sensors._asdict().items()
        for field in ("gyro_scale", "accel_scale")
        if has_field(sensor, field)
    ]
    values, origins = {}, {}
    for path, relative_tolerance in tolerance.items():
        if path not in scale_paths:
            name = vehicle_file.name
            raise UsageError(fault("tolerance.no-scale", path=path, vehicle=name, valid=scale_paths))
        if not 0.0 < relative_tolerance < 1.0:
            raise UsageError(fault("tolerance.no-part", path=path, part=relative_tolerance))
        value = np.asarray(value_at_path(vehicle_file, path), float)
        std = np.abs(value) * std_of_tolerance(relative_tolerance)
        values[path] = value.tolist()
        origins[path] = Provenance(f"stated, ± {100.0 * relative_tolerance:g} %", date.today(), std.tolist())
    return vehicle_file.with_values(values, origins) if values else vehicle_file


def _measured_relative_std(vehicle_file: "VehicleFile", path: str, entry: int) -> float | None:
    """Return the relative standard error of a scale, or None if it was not measured."""
    origin = vehicle_file.provenance.get(path)
    if origin is None or origin.sd is None:
        return None
    std, value = (np.ravel(np.asarray(x, float)) for x in (origin.sd, value_at_path(vehicle_file, path)))
    relative = float(std[min(entry, len(std) - 1)] / abs(value[min(entry, len(value) - 1)]))
    return relative if np.isfinite(relative) else None


def std_of_gyro_bias(vehicle_file: "VehicleFile", imu: str) -> float:
    """Return the standard deviation of a gyro's zero [rad/s], from the file if measured, else from a data sheet."""
    std_rad_s = _measured_std_of_gyro_bias(vehicle_file, imu)
    return std_of_tolerance(ZERO_RATE_RAD_S) if std_rad_s is None else std_rad_s


def _measured_std_of_gyro_bias(vehicle_file: "VehicleFile", imu: str) -> float | None:
    origin = vehicle_file.provenance.get(f"sensors.{imu}.gyro_bias")
    std_rad_s = np.nan if origin is None or origin.sd is None else float(np.ravel(origin.sd)[0])
    return std_rad_s if np.isfinite(std_rad_s) else None


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
        v, std = pseudo_inverse(A) @ g[positions], _measured_std_of_gyro_bias(vehicle_file, name)
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
