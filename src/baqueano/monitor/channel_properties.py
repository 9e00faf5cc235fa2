"""List the properties of each sensor channel: measured quantity, bias, range, and the channels that fail with it."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Tree
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import (
    PARAMETER_STEP,
    REST_MOTION,
    measurement_jacobian,
    uncertain_parameters,
)
from baqueano.symbolic import value_at_path, with_value


class ChannelProperties(NamedTuple):
    """Properties of m channels, in the order of a tick."""

    sensors: tuple[str, ...]
    names: tuple[str, ...]  # "imu[2]"
    is_pose: np.ndarray  # (m,) bool: it measures the pose, so (1) of agreement.py is not tested
    measures_turn: np.ndarray  # (m,) bool: it measures the yaw rate
    measures_speed: np.ndarray  # (m,) bool: it measures the speed
    measures_acceleration: np.ndarray  # (m,) bool
    is_inertial: np.ndarray  # (m,) bool: it has a bias that walks
    groups: tuple[tuple[int, ...], ...]  # for each channel, those that fail with it, itself first
    bias_std: np.ndarray  # (m,) standard deviation of the bias in the file
    bias_walk: np.ndarray  # (m,) random walk of the bias in 1 s
    reading_at_rest: np.ndarray  # (m,) reading at rest
    limit: np.ndarray  # (m,) end of the range
    noise_std: np.ndarray  # (m,) standard deviation of a reading
    period_s: np.ndarray  # (m,) time between two readings; inf for a sensor that measures only at some places


def sensor_name(channel_name: str) -> str:
    """Return the name of the sensor of a channel: "imu" of "imu[2]"."""
    return channel_name.partition("[")[0]


@lru_cache(maxsize=64)
def describe_channels(model: AugmentedEkf) -> ChannelProperties:
    """Return the properties of all channels of the sensors of a `model`."""
    sensors = model.sensors
    channels = [(name, i) for name in sensors._fields for i in range(getattr(sensors, name).size)]
    jacobian = np.concatenate([measurement_jacobian(getattr(sensors, name)) for name in sensors._fields])
    at_rest = np.concatenate(
        [measurement_jacobian(getattr(sensors, name), np.zeros(9)) for name in sensors._fields]
    )
    biases = np.array([_bias(sensors, name, i) for name, i in channels])
    inertial = biases[:, 1] >= 0.0
    # a gyro fails independently; the other channels of one sensor, such as accelerometers or wheels, fail together
    kinds = [(name, k if inertial[k] and at_rest[k, 5] else -1) for k, (name, _) in enumerate(channels)]
    groups = tuple(
        (k, *(j for j, kind_j in enumerate(kinds) if kind_j == kind and j != k))
        for k, kind in enumerate(kinds)
    )
    return ChannelProperties(
        sensors._fields, tuple(f"{name}[{i}]" for name, i in channels),
        np.any(jacobian[:, :3] != 0.0, axis=1), at_rest[:, 5] != 0.0, at_rest[:, 3] != 0.0,
        np.any(at_rest[:, 6:] != 0.0, axis=1), inertial, groups,
        biases[:, 0], np.maximum(biases[:, 1], 0.0),
        np.concatenate([sensor.h(REST_MOTION) for sensor in sensors]),
        np.concatenate([optional.attribute(sensor, "limit") * np.ones(sensor.size) for sensor in sensors]),
        np.concatenate([np.sqrt(np.diag(sensor.cov)) for sensor in sensors]),
        np.concatenate([_period_s(sensor) * np.ones(sensor.size) for sensor in sensors]),
    )  # fmt: skip


def _period_s(sensor: Tree) -> float:
    """Return the time [s] between two readings; inf without a rate, or if the sensor is silent at some places."""
    rate_hz = (
        optional.attribute(sensor, "rate_hz") if optional.attribute(sensor, "detects") is None else np.inf
    )
    return 1.0 / float(rate_hz)


def _bias(sensors: SensorBlocks, name: str, channel: int) -> tuple[float, float]:
    """Return standard deviation and random walk of the bias of a channel, or (0, −1) without a bias random walk."""
    sensor = getattr(sensors, name)
    biases = [bias for bias in uncertain_parameters(sensors, name, (channel,), np.zeros(3)) if bias.walk]
    derivative = [
        (
            with_value(sensor, bias.path, value_at_path(sensor, bias.path) + PARAMETER_STEP).h(REST_MOTION)
            - sensor.h(REST_MOTION)
        )[channel]
        / PARAMETER_STEP
        for bias in biases
    ]
    std, walk = (
        np.sqrt(
            sum(
                (s * float(bias.value_at(sensors, path(bias)))) ** 2
                for s, bias in zip(derivative, biases, strict=True)
            )
        )
        for path in (lambda bias: bias.std, lambda bias: bias.walk)
    )
    return float(std), float(walk) if biases else -1.0
