"""The correction of augmented_ekf.py: predict each channel of a sensor, test it against a gate, and use it.

A channel beyond `gate_sigma` loses its weight; the other channels keep theirs. An exception is a channel whose
previous innovation was similar: an outlier is a single reading, but a turn that the model did not predict lasts. With
the whitened innovation e, the previous innovation e₋, and the limit l of the gate, the weight w is

    w = 1/(1 + (a/l)⁸),   a = max(min(|e|, |e − e₋|/√2), |e|/MAX_GATE_RATIO)                                      (1)

place_gate.py tests the sensors that measure the pose. augmented/state.py defines which states a channel may correct. In
motion, an inertial channel that repeats its last reading is not used (repetition.py).
"""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Value
from baqueano.estimators.augmented.motion import disturbance_acceleration
from baqueano.estimators.augmented.noise_levels import (
    InnovationSquares,
    NoiseLevels,
    file_innovation_cov,
    next_levels,
)
from baqueano.estimators.augmented.state import BIAS_INDEX, SCALE_INDEX, Layout, layout, start_std
from baqueano.estimators.covariance import block_diagonal, mirror_upper
from baqueano.estimators.kalman import Correction, Gaussian, boxplus, correct
from baqueano.estimators.readings.place_gate import (
    TURN_STD,
    PoseChannels,
    PoseMemory,
    empty_memory,
    gate_decision,
    growth_factors,
)
from baqueano.estimators.readings.repetition import RepeatedReadings, next_repetition, no_repetition
from baqueano.estimators.readings.sensor_numbers import age_s, past_motion
from baqueano.parameter import INF
from baqueano.sensors.sampling import difference, mistake_corrections
from baqueano.signals import Slot, Tick
from baqueano.symbolic import jacobian, value_at_path, with_value
from baqueano.vehicles.effort import Effort

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedEkf

MAX_GATE_RATIO = 1.5  # times the gate: a channel beyond this always gets a weight below 0.5
CONTRADICTION_SIGMA = 2.5  # a reading of the pose beyond this contradicts P: by chance 1 %
TINY_WEIGHT = 1e-9  # of a rejected reading, whose gains are 0
USABLE_RANGE = 0.9999  # of a sensor's full scale: a reading above this is not used


class ReadingMemory(NamedTuple):
    """The state of the checks of the readings, between two rows."""

    last_innovations: np.ndarray  # (m,) the last innovation of each channel
    repetition: np.ndarray  # (5, m) the fields of RepeatedReadings, of each channel
    pose: PoseMemory  # of the sensors that measure the pose
    noise_levels: np.ndarray  # (m + 2,) NoiseLevels of this run, relative to the vehicle file
    # (2, 2) of speed and yaw rate: absolute value and duration, see inconsistency.py
    inconsistency: np.ndarray
    mean_checks: np.ndarray  # (k,) rad/s, mean differences between wheels and estimate, see inconsistency.py
    dispute_cov: np.ndarray  # W (3, 3) of the pose, see inconsistency.py


def empty_reading_memory(states: Layout) -> ReadingMemory:
    """Return the memory before the first reading."""
    m = states.channels
    return ReadingMemory(
        np.zeros(m), np.array(no_repetition(m)), empty_memory(states.pose_groups, m), np.ones(m + 2), np.zeros((2, 2)),
        np.zeros(len(states.yaw_rate_checks)), np.zeros((3, 3)),
    )  # fmt: skip


class Innovations(NamedTuple):
    """The measured channels of a tick, compared with their prediction."""

    arrived_mask: np.ndarray  # (m,) 1 if a reading arrived, usable or not
    repeated_mask: np.ndarray  # (m,) 1 if an inertial sensor repeats its reading
    memory: ReadingMemory  # after the readings of this tick
    rejected_count: Value  # number of channels with a weight below 0.5
    y: np.ndarray  # (m,) innovations; NaN for a channel without a measurement
    S: np.ndarray  # (m, m)
    weight: np.ndarray  # (m,) weights; NaN for a channel without a measurement
    file_S: np.ndarray  # (m, m) S with the noise of the vehicle file
    update: Correction
    growth_factors: np.ndarray  # (n,) D of place_gate.py, before the update


def correct_tick(
    estimator: "AugmentedEkf",
    x: Gaussian,
    memory: ReadingMemory,
    effort: Effort,
    nu_dot: Value,
    tick: Tick,
    corrected_mask: np.ndarray,
    at_rest: bool,
    dt_s: Value,
) -> tuple[Gaussian, Innovations]:
    """Return the state after the measurements that arrived, and the innovations.

    `nu_dot` (3,) is the acceleration of a kinematic model, and None for a dynamic model. `corrected_mask`
    (m, n) selects the states that each channel may correct.
    """
    states, n = layout(estimator), len(x.mean)
    last_innovations, levels = memory.last_innovations, NoiseLevels.from_row(memory.noise_levels)
    if not len(states.moving_mask):
        no_innovations, no_rows, no_cov = last_innovations, np.zeros((0, n)), np.zeros((0, 0))
        update = Correction(
            np.zeros(n), x.cov, no_innovations, no_innovations, no_innovations, no_rows, no_rows
        )
        return x, Innovations(
            no_innovations,
            no_innovations,
            memory,
            0.0,
            no_innovations,
            no_cov,
            no_innovations,
            no_cov,
            update,
            np.ones(n),
        )
    y, H, file_cov, mask, corrections, z, arrived_mask = _compared_channels(
        estimator, x, effort, nu_dot, tick
    )
    repetition = next_repetition(RepeatedReadings(*memory.repetition), z, mask > 0.0)
    repeated_mask = np.where(repetition.is_longest & states.is_inertial & (not at_rest), 1.0, 0.0)
    if not at_rest:
        H = H * states.moving_jacobian_factor
    Q = levels.sensor_cov(file_cov)
    present_H = H * mask[:, None]
    x, dispute_cov = _with_dispute_cov(states, x, memory.dispute_cov, y * mask, present_H, Q)
    channels = PoseChannels(y * mask, present_H @ x.cov @ present_H.T + Q, mask, corrections)
    decision = gate_decision(states.pose_groups, channels, memory.pose, dt_s, estimator.gate_sigma)
    D = np.ones(n)
    if states.pose_groups:
        D = growth_factors(
            decision.growth_factor, np.sqrt(np.diag(x.cov)), _max_std(estimator), states.pose_error_mask
        )
        x = x._replace(cov=mirror_upper(x.cov * np.outer(D, D)))

    def weight(c: int, e: Value, s: Value) -> Value:
        if c in decision.weights:
            return decision.weights[c]
        limit = estimator.gate_sigma * np.sqrt((Q[c, c] + states.gate_factors[c] ** 2 * (s - Q[c, c])) / s)
        least_error = np.minimum(np.abs(e), np.abs(e - last_innovations[c] / np.sqrt(s)) / np.sqrt(2.0))
        w = 1.0 / (1.0 + (np.maximum(least_error, np.abs(e) / MAX_GATE_RATIO) / limit) ** 8)
        return w * (1.0 - repeated_mask[c])

    update = correct(x.cov, y, H, Q, corrected_mask, weight, mask)
    w = update.weight
    rejected_count = np.sum(np.where(w < 0.5, mask, 0.0))
    latest_innovations = np.where(mask > 0.0, update.e * np.sqrt(update.s), last_innovations)
    S = mirror_upper(H @ x.cov @ H.T + Q)
    is_within_gate = last_innovations**2 <= estimator.gate_sigma**2 * np.diag(S)
    counts = np.where((w >= 0.5) & is_within_gate, mask, 0.0)
    squares = InnovationSquares(y, last_innovations, S, Q, counts)
    file_S = file_innovation_cov(levels, squares, states)
    if not at_rest:
        levels = next_levels(levels, squares, states, estimator.noise_gain)
    x = Gaussian(boxplus(x.mean, update.mean_change), update.cov)
    y, w = (np.where(mask > 0.0, values, np.nan) for values in (y, w))
    memory = memory._replace(
        last_innovations=latest_innovations,
        repetition=np.array(repetition),
        pose=decision.memory,
        noise_levels=np.concatenate(levels),
        dispute_cov=_next_dispute_cov(states, dispute_cov, update),
    )
    return x, Innovations(arrived_mask, repeated_mask, memory, rejected_count, y, S, w, file_S, update, D)


def _with_dispute_cov(
    states: Layout, x: Gaussian, W: np.ndarray, y: np.ndarray, H: np.ndarray, Q: np.ndarray
) -> tuple[Gaussian, np.ndarray]:
    """Return the state and W (3, 3): P contains W if a reading of the pose contradicts P.  (5) of inconsistency.py

    `y` (m,) and `H` (m, n) are 0 for a channel without a measurement.
    """
    if not (pose_channels := [c for group in states.pose_groups for c in group]):
        return x, W
    S = H @ x.cov @ H.T + Q
    contradictions = [y[c] ** 2 > CONTRADICTION_SIGMA**2 * S[c, c] for c in pose_channels]
    share = np.where(reduce(or_, contradictions), 1.0, 0.0)
    wide_cov = block_diagonal([share * W, np.zeros((len(x.mean) - 3,) * 2)])
    return x._replace(cov=x.cov + wide_cov), (1.0 - share) * W


def _next_dispute_cov(states: Layout, W: np.ndarray, update: Correction) -> np.ndarray:
    """Return W (3, 3) after the corrections of the pose.  (6) of inconsistency.py"""
    change = np.zeros(3)
    for c in [c for group in states.pose_groups for c in group]:
        w, s, h = update.weight[c], update.s[c], update.H[c, :3]
        K, Wh = update.gain[c, :3], W @ h
        innovation, wide_s = update.e[c] * np.sqrt(s), s + w * (h @ Wh)
        wide_K = (K * s + w * Wh) / wide_s
        change = change + wide_K * (innovation - h @ change) - K * innovation
        gain = np.outer(K, K) * s - np.outer(wide_K, wide_K) * wide_s
        W = mirror_upper(W + gain / np.maximum(w, TINY_WEIGHT))
    return W + np.outer(change, change)


class _ComparedChannels(NamedTuple):
    """The m channels that may correct the state, and their prediction."""

    y: np.ndarray  # (m,) innovations; 0 without a measurement
    H: np.ndarray  # (m, n)
    Q: np.ndarray  # (m, m)
    mask: np.ndarray  # (m,) 1 for a channel with a usable measurement, else 0
    corrections: list[np.ndarray]  # of each channel, for the known mistakes of its sensor
    z: np.ndarray  # (m,)
    arrived_mask: np.ndarray  # (m,) 1 if a reading arrived, usable or not


def _compared_channels(
    estimator: "AugmentedEkf", x: Gaussian, effort: Effort, nu_dot: Value, tick: Tick
) -> _ComparedChannels:
    """Return innovations, Jacobian and noise of the channels of a tick. A reading at the end of its range is unused."""
    states = layout(estimator)
    innovations, jacobians, noise, arrivals, corrections, readings, is_new = [], [], [], [], [], [], []
    for name, rows in zip(states.names, states.entries, strict=True):
        sensor, slot, indices = getattr(estimator.sensors, name), getattr(tick.sensors, name), np.array(rows)

        def h(mean: np.ndarray, name: str = name) -> np.ndarray:
            return predict_measurement(estimator, mean, name, effort, nu_dot, getattr(tick.sensors, name))

        is_within_range = np.abs(slot.z) < USABLE_RANGE * optional.attribute(sensor, "limit")
        predicted_measurement, mask = h(x.mean), (slot.is_new > 0.0) & np.isfinite(slot.z) & is_within_range
        z = np.where(mask, slot.z, predicted_measurement)
        innovations.append(difference(sensor, z, predicted_measurement)[indices])
        jacobians.append(jacobian(h)(x.mean)[indices])
        noise.append(sensor.cov[indices][:, indices])
        arrivals.append(np.where(mask, 1.0, 0.0)[indices])
        corrections += list(mistake_corrections(sensor, z).T[indices])
        readings.append(z[indices])
        is_new.append(np.where((slot.is_new > 0.0) & (slot.z == slot.z), 1.0, 0.0)[indices])
    y, H, mask, z = (np.concatenate(arrays) for arrays in (innovations, jacobians, arrivals, readings))
    return _ComparedChannels(y, H, block_diagonal(noise), mask, corrections, z, np.concatenate(is_new))


def predict_measurement(
    estimator: "AugmentedEkf", mean: np.ndarray, name: str, effort: Effort, nu_dot: Value, slot: Slot
) -> np.ndarray:
    """Return the predicted measurement (m,) of a sensor with its estimated biases, at its time of measurement."""
    sensor, eta, nu, d = getattr(estimator.sensors, name), mean[:3], mean[3:6], mean[6:SCALE_INDEX]
    for k, bias in enumerate(layout(estimator).biases):
        if bias.sensor == name:
            sensor = with_value(sensor, bias.path, value_at_path(sensor, bias.path) + mean[BIAS_INDEX + k])
    if nu_dot is None:
        nu_dot = estimator.vehicle.nu_dot(nu, effort.last, eta[2]) + disturbance_acceleration(
            estimator.vehicle, d
        )
    return sensor.h(past_motion(estimator.vehicle, eta, nu, nu_dot, age_s(sensor, slot)))


def _max_std(estimator: "AugmentedEkf") -> np.ndarray:
    """Return the standard deviations (n,) up to which rejected readings of the pose can increase the covariance."""
    return np.concatenate([np.array([INF, INF, TURN_STD]), start_std(estimator)[3:]])
