"""The augmented state of augmented_ekf.py, and the entries of it that each channel of a sensor may correct.

    x = (x, y, ψ | ν_x, ν_y, ν_ψ | d_x, d_ψ | κ_v, κ_ψ, β, γ, w | biases | φ_x, φ_y)                       (1)

If every channel corrects every state, a gyro that disagrees with the model changes the speed. On real cars these
couplings had larger errors than the sensors. So each measured quantity corrects only these states:

    the pose                all states
    ν_x, not inertial       position, ν_x, ν_y, d_x; also the turning states if no channel measures only ν_ψ
    only ν_ψ (a gyro)       ψ, ν_y, ν_ψ, d_ψ; at rest also its bias
    other inertial channel  its bias at rest; if in `speed_from` its bias, position, ν_x, ν_y, d_x at any time (2)

After MAX_SILENT_S without a gyro, the wheels also correct the turning states (3). A channel whose bias walks is
inertial. A model error looks like a bias, so in motion no inertial reading corrects another bias; a pose sensor does.
A model that was fitted with a gyro has the error of its bias: an innovation shows a part p of it (4).
"""

from collections.abc import Sequence
from dataclasses import fields
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.estimators.readings.inconsistency import SPEED_AND_YAW_RATE, YawRateCheck
from baqueano.estimators.readings.sensor_numbers import (
    UncertainParameter,
    channel_indices,
    has_speed_scale,
    measurement_jacobian,
    relative_speed_variance,
    scale_std,
    split_use,
    uncertain_parameters,
)

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedEkf

SCALE_INDEX, BIAS_INDEX = 8, 13  # index of the first of κ, β, γ, w, and of the first bias
SIDESLIP_INDEX = 11  # index of γ
SLOPE_STATES = 2  # φ_x, φ_y: the last states
# index of w, the bend of the position's region at a large heading variance; w is not estimated
BEND_INDEX = 12
POSITION_STATES, TURNING_STATES, FORWARD_STATES = (0, 1), (2, 4, 5, 7), (3, 4, 6)  # entries of x
SIDEWAYS = [0, 1, 4]  # of (η, ν): position, ν_y; an accelerometer shows only the fast part of ν_y
MIN_SIDEWAYS_SLOPE = 0.5  # a sensor that is turned by a few degrees has a smaller one
MAX_SILENT_S = 0.2  # without a reading of the yaw rate for longer, other sensors and the model replace it
# factor on the model's part of the gate of a gyro, because no model predicts each turn
LEADING_GYRO_FACTOR = 2.5


class Layout(NamedTuple):
    """The states of a filter for its sensors, and the states that each channel of a sensor may correct."""

    names: tuple[str, ...]  # the sensors
    entries: tuple[tuple[int, ...], ...]  # the channels of each sensor that correct the state
    biases: tuple[UncertainParameter, ...]
    moving_mask: np.ndarray  # (m, n) E of kalman.py for each channel, while the vehicle drives  (2)
    resting_mask: np.ndarray  # (m, n) the same at rest
    replacement_mask: np.ndarray  # (m, n) the turning states, for the channels that replace a gyro  (3)
    is_inertial: np.ndarray  # (m,) bool: the channel has a bias that walks
    gate_factors: np.ndarray  # (m,) factor on the model's part of the gate of each channel
    # (n,) derivative of the estimated yaw rate by each state: 0 except for the biases of gyros  (4)
    yaw_rate_by_bias: np.ndarray
    # (m, n) factor on H while the vehicle drives: p for the bias of a gyro in its own reading, else 1  (4)
    moving_jacobian_factor: np.ndarray
    # (m, 2) derivative of each channel by speed and yaw rate; 0 if it must not correct them
    rest_jacobian: np.ndarray
    # (m,) bool: the channel corrects ν_y, and depends on ν_y or its integral
    measures_sideways: np.ndarray
    # the channels of each sensor that measures the pose: place_gate.py
    pose_groups: tuple[tuple[int, ...], ...]
    speed_is_measured: bool  # True if a channel has its own scale of the speed
    has_slope: bool  # True if x contains φ, the error of the speed on a slope
    yaw_rate_checks: tuple[YawRateCheck, ...]

    @property
    def pose_error_mask(self) -> np.ndarray:
        """Return a mask (n,): 1 for η, κ, β and b, the states that can be wrong if the pose is wrong."""
        mask = np.ones(self.size)
        mask[[*range(3, SCALE_INDEX), BEND_INDEX]] = 0.0
        return mask

    @property
    def corrects_motion(self) -> np.ndarray:
        """Return a mask (m,) of the channels that correct any state while the vehicle drives."""
        return np.any(self.moving_mask > 0.0, axis=1)

    def driving_mask(self, silent_s: np.ndarray) -> np.ndarray:
        """Return E (m, n) while the vehicle drives; `silent_s` (2,) is the time without a correction."""
        return self.moving_mask + np.where(silent_s[1] > MAX_SILENT_S, self.replacement_mask, 0.0)

    def correction_mask(self, state: int) -> np.ndarray:
        """Return a mask (m,) of the channels that correct one entry of x while the vehicle drives."""
        return self.moving_mask[:, state] > 0.0

    def corrected_rates(self, is_used: np.ndarray) -> np.ndarray:
        """Return a mask (2,): True for speed and yaw rate if a used channel corrects it; `is_used` is (m,)."""
        if not self.channels:
            return np.zeros(2) > 0.0
        counts = np.where(is_used, 1.0, 0.0)[:, None] * self.moving_mask[:, SPEED_AND_YAW_RATE]
        return np.sum(counts, axis=0) > 0.0

    @property
    def channels(self) -> int:
        """Return the number m of channels."""
        return len(self.moving_mask)

    @property
    def channel_entries(self) -> list[tuple[str, int]]:
        """Return the sensor and the entry of each channel (m,)."""
        return [(name, i) for name, rows in zip(self.names, self.entries, strict=True) for i in rows]

    @property
    def size(self) -> int:
        """Return the number n of states."""
        return BIAS_INDEX + len(self.biases) + SLOPE_STATES * self.has_slope


@lru_cache(maxsize=256)
def layout(estimator: "AugmentedEkf") -> Layout:
    """Return the layout for `sensors`, `use` and `speed_from` of an estimator."""
    sensors, channel_choices = estimator.sensors, estimator.use
    names = tuple(split_use(use)[0] for use in channel_choices)
    entries = tuple(channel_indices(sensors, use) for use in channel_choices)
    used_channels = list(zip(names, entries, strict=True))
    channels = [(name, i) for name, rows in used_channels for i in rows]
    biases = tuple(bias for name, rows in used_channels for bias in _walking(sensors, name, rows))
    bias_states = [
        [BIAS_INDEX + biases.index(b) for b in _walking(sensors, name, (i,))] for name, i in channels
    ]
    signals = {name: _dependencies(getattr(sensors, name)) for name in names}
    dependencies = [signals[name][i] for name, i in channels]
    reliable = {(split_use(use)[0], i) for use in estimator.speed_from for i in channel_indices(sensors, use)}
    speed_is_measured = has_speed_scale(sensors, dict(used_channels))
    has_slope = bool(estimator.slope_speed_std_m_s > 0.0) and not speed_is_measured
    later_states = len(biases) + SLOPE_STATES * has_slope
    moving_mask = _moving_mask(dependencies, bias_states, [c in reliable for c in channels], later_states)
    resting_mask, gyro_mask = moving_mask.copy(), np.zeros(moving_mask.shape)
    for k, states in enumerate(bias_states):
        resting_mask[k, states] = 1.0
        gyro_mask[k, states] = float(dependencies[k].is_turn_only)
    bias_share = np.ones(BIAS_INDEX + later_states)
    bias_share[BIAS_INDEX : BIAS_INDEX + len(biases)] = [_visible_bias_share(sensors, b) for b in biases]
    at_rest = {name: measurement_jacobian(getattr(sensors, name), np.zeros(9)) for name in names}
    slopes = np.array([at_rest[name][i, SPEED_AND_YAW_RATE] for name, i in channels]).reshape(-1, 2)
    sideways = np.array([np.max(np.abs(at_rest[name][i, SIDEWAYS])) for name, i in channels])
    # several gyros share the yaw rate
    yaw_slopes = np.where(gyro_mask.any(axis=1), slopes[:, 1], 1.0)[:, None] * max(1.0, np.sum(gyro_mask))
    groups = (
        tuple(
            k
            for k, (sensor_of_entry, _) in enumerate(channels)
            if sensor_of_entry == name and dependencies[k].pose
        )
        for name in dict.fromkeys(names)
    )
    return Layout(
        names,
        entries,
        biases,
        moving_mask,
        resting_mask,
        _turning_mask(dependencies, moving_mask),
        np.array([bool(states) for states in bias_states], dtype=bool),
        np.where([d.is_turn_only for d in dependencies], LEADING_GYRO_FACTOR, 1.0),
        -(1.0 - bias_share) * np.sum(gyro_mask / yaw_slopes, axis=0),
        1.0 - (1.0 - bias_share) * gyro_mask,
        slopes * moving_mask[:, SPEED_AND_YAW_RATE],
        (moving_mask[:, SIDEWAYS[2]] > 0.0) & (sideways > MIN_SIDEWAYS_SLOPE),
        tuple(group for group in groups if group),
        speed_is_measured,
        has_slope,
        _yaw_rate_checks(sensors, channels, slopes, moving_mask[:, SPEED_AND_YAW_RATE[1]]),
    )


def _yaw_rate_checks(
    sensors: SensorBlocks, entries: Sequence[tuple[str, int]], slopes: np.ndarray, correction_mask: np.ndarray
) -> tuple[YawRateCheck, ...]:
    """Return the check of each sensor that measures speed and yaw rate, but corrects only the speed."""
    checks = []
    for name in dict.fromkeys(name for name, _ in entries):
        channels = (
            np.array([sensor_of_entry == name for sensor_of_entry, _ in entries])
            & (np.abs(slopes).sum(axis=1) > 0.0)
            & (correction_mask == 0.0)
        )
        if np.linalg.matrix_rank(slopes[channels]) == len(SPEED_AND_YAW_RATE):
            weights = np.zeros(len(entries))
            weights[channels] = np.linalg.pinv(slopes[channels])[1]
            variances = [
                w**2 * relative_speed_variance(sensors, *entries[k]) for k, w in enumerate(weights) if w
            ]
            checks.append(YawRateCheck(weights, float(np.sqrt(sum(variances)))))
    return tuple(checks)


class _Dependencies(NamedTuple):
    """The signals on which a channel depends, at rest."""

    pose: bool
    speed: bool  # ν_x
    yaw_rate: bool

    @property
    def is_turn_only(self) -> bool:
        """Return True for a channel of the yaw rate alone, such as a gyro: it determines the turning states."""
        return self.yaw_rate and not (self.pose or self.speed)


def _moving_mask(
    dependencies: Sequence[_Dependencies],
    bias_states: Sequence[Sequence[int]],
    is_reliable: Sequence[bool],
    later_states: int,
) -> np.ndarray:
    """Return E (m, n) of each channel while the vehicle drives.  (2)"""
    mask = np.zeros((len(dependencies), BIAS_INDEX + later_states))
    has_gyro = any(d.is_turn_only for d in dependencies)
    for k, channel in enumerate(dependencies):
        if channel.pose:
            mask[k] = 1.0
            continue
        if (channel.speed and not bias_states[k]) or is_reliable[k]:
            mask[k, [*POSITION_STATES, *FORWARD_STATES]] = 1.0
        if is_reliable[k]:
            mask[k, bias_states[k]] = 1.0
        if channel.yaw_rate and not (has_gyro and channel.speed):
            mask[k, [*TURNING_STATES]] = 1.0
    mask[:, BEND_INDEX] = 0.0
    return mask


def _turning_mask(dependencies: Sequence[_Dependencies], moving_mask: np.ndarray) -> np.ndarray:
    """Return a mask (m, n) of the turning states, for the channels of the yaw rate that do not correct them.  (3)"""
    mask = np.zeros(moving_mask.shape)
    for k, channel in enumerate(dependencies):
        mask[k, [*TURNING_STATES]] = float(channel.yaw_rate and channel.speed)
    return mask * (moving_mask == 0.0)


def _walking(sensors: SensorBlocks, name: str, rows: tuple[int, ...]) -> list[UncertainParameter]:
    """Return the biases of the channels `rows` of a sensor that are a random walk."""
    return [bias for bias in uncertain_parameters(sensors, name, rows, np.zeros(3)) if bias.walk]


def _visible_bias_share(sensors: SensorBlocks, bias: UncertainParameter) -> float:
    """Return p of a bias: 1 for a standard deviation up to the default, which is that of another day.  (4)"""
    std = bias.value_at(sensors, bias.std)
    defaults = {field.name: field.default for field in fields(type(getattr(sensors, bias.sensor)))}
    default_std = defaults.get(bias.std)
    return min(1.0, (default_std / std) ** 2) if isinstance(default_std, float) and std > 0.0 else 1.0


def start_std(estimator: "AugmentedEkf") -> np.ndarray:
    """Return the standard deviations (n,) of the state at the start."""
    states = layout(estimator)
    biases = np.array([bias.value_at(estimator.sensors, bias.std) for bias in states.biases])
    scales = scale_std(estimator.sensors, *(_channels_correcting(states, k) for k in SPEED_AND_YAW_RATE))
    if not states.speed_is_measured and estimator.speed_error_std[1] > 0.0:
        scales[0] = estimator.speed_error_std[1]
    course = np.array([estimator.course_std, estimator.sideslip_error_std, 1.0])
    slope = np.full(SLOPE_STATES * states.has_slope, estimator.slope_speed_std_m_s)
    return np.concatenate([estimator.initial_std, estimator.disturbance_std, scales, course, biases, slope])


def _channels_correcting(states: Layout, state: int) -> dict[str, tuple[int, ...]]:
    """Return the channels that correct one entry of x, by sensor."""
    correction_mask = iter(states.correction_mask(state).tolist())
    by_sensor = zip(states.names, states.entries, strict=True)
    return {name: tuple(i for i in entries if next(correction_mask)) for name, entries in by_sensor}


def _dependencies(sensor: Sensor) -> list[_Dependencies]:
    """Return what each channel of a sensor depends on."""
    rows = zip(measurement_jacobian(sensor), measurement_jacobian(sensor, np.zeros(9)), strict=True)
    return [
        _Dependencies(bool(np.any(row[:3])), bool(at_rest[3] != 0.0), bool(at_rest[5] != 0.0))
        for row, at_rest in rows
    ]
