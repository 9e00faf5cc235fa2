"""Widen the covariance during a lasting disagreement; the gate and most corrections do not use the wider one.

Speed ν_x and yaw rate ν_ψ have an inconsistency a: |y / h'| while a channel with innovation y and derivative h' is
rejected; |Δ|, Δ = ν − ν of the model, while d² > gate_sigma² v or |d̄| > gate_sigma σ_d, v = var d without readings.
After MIN_INCONSISTENT_S, with the rotation J, the axis g of ν, the row δ, and the duration t of the inconsistency:

    in the estimate only:   var ν ← var ν + a²,   var η ← P_ηη + W,   W ← G W Gᵀ + J g (2 a² t δ) gᵀ Jᵀ     (1)
    wheels contradict a gyro:  e² > gate_sigma² (p wᵀ S w + σ² ν_x²)   for e = wᵀ y and for its mean        (2)
    a_ψ = |e|  if |e + Δ_ψ| < |Δ_ψ|: the gyro is wrong;   else a_x = |Δ_x|: the speed follows wrong wheels  (3)
    a_ψ = σ |ν_x|  while the wheels replace a gyro                                                          (4)
    a reading of the pose that contradicts P:   P_ηη ← P_ηη + W,   W ← 0                                    (5)
    another one:   W ← P₂ − P₁ + c cᵀ,   c = Δ₂ − Δ₁     P_i, Δ_i: pose of the correction of P, and of P + W (6)

w, σ: yaw-rate row of the wheels' inverse, their slip and scale; p: 1, or for a mean over MEAN_S g/(2 − g), g = 1 −
exp(−δ/MEAN_S). The model decides between wheels and gyro. The region contains the truth if either of them is correct.
"""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.estimators.pauses import MAX_POSE_VARIANCE
from baqueano.geometry import map_from_body

if TYPE_CHECKING:
    from baqueano.estimators.augmented.state import Layout

MIN_INCONSISTENT_S = 0.5
MEAN_S = 0.5  # time constant of the mean of (2)
SPEED_AND_YAW_RATE = (3, 5)  # of a state (η, ν, …)
# when readings agree again, the duration of an inconsistency falls to MAX_MEMORY_S, then by FADING_RATE seconds per
# second
MAX_MEMORY_S, FADING_RATE = 1.0, 2.0


class YawRateCheck(NamedTuple):
    """A yaw rate of the wheels that corrects no state."""

    weights: np.ndarray  # w (m,) of the innovations
    relative_std: float  # σ: standard deviation due to slip and scale, relative to the speed [rad/m]


class RejectedReadings(NamedTuple):
    """The readings of a row that measure speed or yaw rate."""

    size: Value  # largest |y / h'| of the rejected readings, 0 without one
    has_reading: Value  # True if a reading arrived, rejected or not


class WheelCheck(NamedTuple):
    """The comparison of the wheels with the gyro in a row."""

    mean: Value  # exponential mean of e [rad/s]
    gyro_error: Value  # a_ψ [rad/s], 0 if the gyro is not wrong
    wheels_are_wrong: Value  # True if the model agrees with the gyro


class InconsistencyUpdate(NamedTuple):
    """The inconsistency after a row, and its contributions to the covariances of pose and velocity."""

    # (2, 2) of speed and yaw rate: absolute value of the last rejected innovations, and duration [s]
    inconsistency: np.ndarray
    mean_checks: np.ndarray  # e (k,) of the yaw-rate checks
    pose_cov: np.ndarray  # (3, 3) what W gains
    nu_cov: np.ndarray  # (3, 3)


def update_inconsistency(
    previous: tuple[np.ndarray, np.ndarray],
    states: "Layout",
    innovations: Value,
    model_deviation: np.ndarray,
    is_followed: np.ndarray,
    replaces_gyro: Value,
    pose_nu: np.ndarray,
    dt_s: Value,
    gate_sigma: float,
) -> InconsistencyUpdate:
    """Return the inconsistency of speed and yaw rate after a row of `dt_s`, and its additions to the covariances.

    `innovations` contains y (m,), NaN for a channel without a usable measurement, S (m, m) and the weights (m,).
    `model_deviation` (2,) is the estimate minus that of the model. `is_followed` (2,) is True while the filter follows
    a channel, `replaces_gyro` while the wheels determine the yaw rate. `previous` is the inconsistency and the means of
    the checks, `pose_nu` the state (η, ν).
    """
    inconsistency, means = previous
    speed, yaw_rate = (_rejected_readings(h, innovations) for h in states.rest_jacobian.T)
    checks = [
        _check_wheels(check, mean, innovations, model_deviation[1], pose_nu[3], dt_s, gate_sigma)
        for mean, check in zip(means, states.yaw_rate_checks, strict=True)
    ]
    replaced_gyro = [
        np.where(replaces_gyro, check.relative_std * np.abs(pose_nu[3]), 0.0)  # (4)
        for check in states.yaw_rate_checks
    ]
    yaw_size = reduce(np.maximum, [*(check.gyro_error for check in checks), *replaced_gyro], yaw_rate.size)
    has_yaw_rate = yaw_rate.has_reading | replaces_gyro if checks else yaw_rate.has_reading
    follows_speed = reduce(or_, [check.wheels_are_wrong for check in checks], is_followed[0])
    model_error = np.where(np.array([follows_speed, is_followed[1]]), np.abs(model_deviation), 0.0)
    current = track_inconsistency(
        inconsistency,
        np.array([speed.size, yaw_size]),
        model_error,
        np.array([speed.has_reading, has_yaw_rate]),
        dt_s,
    )
    size = np.maximum(current[0], model_error)
    covariances = added_covariances(size, inconsistency[1], current[1], pose_nu[2], dt_s)
    means = np.array([check.mean for check in checks]) if checks else means
    return InconsistencyUpdate(current, means, *covariances)


def _rejected_readings(h: np.ndarray, innovations: Value) -> RejectedReadings:
    """Return the rejected readings of speed or yaw rate, of which the channels have the derivatives h' (m,)."""
    channels = np.flatnonzero(h)
    is_rejected = (innovations.weight < 0.5) & (innovations.repeated_mask < 0.5)
    sizes = [np.where(is_rejected[c], np.abs(innovations.y[c]) / abs(h[c]), 0.0) for c in channels]
    arrival_masks = [innovations.arrived_mask[c] for c in channels]
    return RejectedReadings(reduce(np.maximum, sizes, 0.0), reduce(np.maximum, arrival_masks, 0.0) > 0.0)


def _check_wheels(
    check: YawRateCheck,
    mean: Value,
    innovations: Value,
    turn_deviation: Value,
    speed: Value,
    dt_s: Value,
    gate_sigma: float,
) -> WheelCheck:
    """Compare the yaw rate of the wheels with that of the gyro.  (2), (3)"""
    channels, g = np.flatnonzero(check.weights), 1.0 - np.exp(-dt_s / MEAN_S)
    w = check.weights[channels]
    reading = np.sum(w * innovations.y[channels])
    reading = np.where(np.isfinite(reading), reading, mean)
    mean = mean + g * (reading - mean)
    variance = w @ innovations.file_S[channels][:, channels] @ w
    gyro_error, wheels_are_wrong = 0.0, np.zeros(()) > 0.0
    for e, variance_factor in ((reading, 1.0), (mean, g / (2.0 - g))):
        contradicts = e**2 > gate_sigma**2 * (variance_factor * variance + (check.relative_std * speed) ** 2)
        gyro_is_wrong = np.abs(e + turn_deviation) < np.abs(turn_deviation)
        gyro_error = np.maximum(gyro_error, np.where(contradicts & gyro_is_wrong, np.abs(e), 0.0))
        wheels_are_wrong = wheels_are_wrong | (contradicts & ~gyro_is_wrong)
    return WheelCheck(mean, gyro_error, wheels_are_wrong)


def track_inconsistency(
    inconsistency: np.ndarray,
    rejected_size: np.ndarray,
    model_error: np.ndarray,
    has_reading: np.ndarray,
    dt_s: Value,
) -> np.ndarray:
    """Return the inconsistency (2, 2) one row later: absolute value of the last rejected innovations, duration [s].

    `rejected_size` (2,) is the absolute value of the rejected innovations of this row, `model_error` (2,) that of the
    correction against the model; both are 0 if absent. `has_reading` (2,) is True if a reading arrived.
    """
    size = np.where(has_reading, rejected_size, inconsistency[0])
    shorter_s = np.maximum(np.minimum(inconsistency[1], MAX_MEMORY_S) - FADING_RATE * dt_s, 0.0)
    return np.stack([size, np.where(np.maximum(size, model_error) > 0.0, inconsistency[1] + dt_s, shorter_s)])


def added_covariances(
    size: np.ndarray, last_duration_s: np.ndarray, duration_s: np.ndarray, psi: Value, dt_s: Value
) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances of pose (3, 3) and velocity (3, 3) that an inconsistency `size` (2,) adds.  (1)

    `last_duration_s` and `duration_s` (2,) are its durations before and after this row of `dt_s`.
    """
    is_lasting, directions = duration_s >= MIN_INCONSISTENT_S, map_from_body(psi)[:, [0, 2]]
    is_growing = is_lasting & (duration_s > last_duration_s)
    growth_s2 = np.where(
        last_duration_s >= MIN_INCONSISTENT_S, dt_s * (2.0 * last_duration_s + dt_s), duration_s**2
    )
    added_variance = np.where(is_growing, np.minimum(size**2 * growth_s2, MAX_POSE_VARIANCE), 0.0)
    pose_cov = directions @ np.diag(added_variance) @ directions.T
    variances = np.where(is_lasting, size**2, 0.0)
    return pose_cov, np.diag(np.array([variances[0], 0.0, variances[1]]))
