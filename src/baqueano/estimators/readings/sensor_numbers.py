"""Channels of sensors: the measured velocities, the age, and the uncertainty of the calibration.

All this follows from h and the parameters. The module does not depend on the kinds of sensors, so your own sensors work
too.

    ∂h/∂(η, ν, ν̇)  at rest          which velocities a channel measures, to first order                   (1)
    h(θ + PARAMETER_STEP) ≠ h(θ)               which parameters θ it depends on                                      (2)
    h(η − d R(ψ − d ν_ψ/2) ν, ν − d ν̇, ν̇)     the reading at the tick, which was measured d before         (3)

A parameter with a `std` in its metadata is uncertain. If it also has a `walk`, it is a bias, else a scale. `slip` is
the standard deviation of a temporary error of a scale, which decays (Ornstein-Uhlenbeck process).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.contracts.values import Value
from baqueano.errors import Invalid
from baqueano.geometry import map_from_body
from baqueano.parameter import Parameter, parameters
from baqueano.sensors.imu import SCALE_TOLERANCE
from baqueano.sensors.sampling import low_pass_s
from baqueano.signals import Motion, Slot
from baqueano.symbolic import jacobian, value_at_path, with_value
from baqueano.vehicles.state import Vehicle

REST_MOTION = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
# (η, ν, ν̇) at which no term of h vanishes
GENERAL_MOTION = np.array([0.3, -0.2, 0.7, 0.5, 0.1, 0.9, 0.2, 0.1, -0.4])
FORWARD_NU, TURNING_NU = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])  # ν
PARAMETER_STEP = 0.1  # change of a parameter in (2)
# uniform within its data sheet; without a wheel, the speed follows from a_y / ν_ψ
ACCEL_SCALE_STD = SCALE_TOLERANCE / np.sqrt(3.0)


class UncertainParameter(NamedTuple):
    """A parameter of a sensor that is not known exactly."""

    sensor: str
    path: str  # in the sensor
    std: str  # path of its standard deviation
    walk: str  # path of its random walk in 1 s; "" for a constant

    def value_at(self, sensors: SensorBlocks, path: str) -> Value:
        """Return the value at `path` of the sensor; `path` is one of the paths of this parameter."""
        return value_at_path(getattr(sensors, self.sensor), path)


def split_use(use: str) -> tuple[str, tuple[int, ...] | None]:
    """Return the sensor and the indices of its channels: "imu[1,2]" → ("imu", (1, 2)). None means all channels."""
    name, bracket, indices_text = use.partition("[")
    return name, tuple(int(i) for i in indices_text.rstrip("]").split(",")) if bracket else None


def channel_indices(sensors: SensorBlocks, use: str) -> tuple[int, ...]:
    """Return the indices of the channels of a sensor that `use` selects."""
    name, rows = split_use(use)
    return tuple(range(getattr(sensors, name).size)) if rows is None else rows


def check_use(sensors: SensorBlocks, use: tuple[str, ...], allow_channels: bool = False) -> None:
    """Raise Invalid if `use` names a sensor that the vehicle does not have; `allow_channels` allows "imu[2]"."""
    names = getattr(sensors, "_fields", ())
    for entry in use:
        if (split_use(entry)[0] if allow_channels else entry) not in names:
            raise Invalid.of("field.use", value=entry, valid=names)


def measured_channels(sensor: Sensor, slot: Slot) -> np.ndarray:
    """Return 1 (m,) for each channel with a finite measurement, else 0."""
    return np.where((slot.is_new > 0.0) & np.isfinite(slot.z), 1.0, 0.0) * np.ones(sensor.size)


def age_s(sensor: Sensor, slot: Slot) -> Value:
    """Return the age of a measurement at the tick [s], from its timestamp, its delay and its low-pass."""
    delay_s = sensor.delay_s if optional.attribute(sensor, "delay_slots") > 0 else 0.0
    return slot.age_s + delay_s + low_pass_s(sensor)


def past_motion(
    vehicle: Vehicle, eta: np.ndarray, nu: np.ndarray, nu_dot: np.ndarray, elapsed_s: Value
) -> Motion:
    """Return the motion `elapsed_s` before the tick, extrapolated to first order from η, ν, ν̇ (3,) at the tick.  (3)"""
    if not (isinstance(elapsed_s, float) and elapsed_s == 0.0):
        turn = elapsed_s * nu[2]
        displacement = map_from_body(eta[2] - 0.5 * turn) @ (elapsed_s * nu)
        eta = np.array([eta[0] - displacement[0], eta[1] - displacement[1], eta[2] - turn])
        nu = nu - elapsed_s * nu_dot
    return Motion(eta, nu, nu_dot, vehicle.gravity(eta[2]))


def measurement_jacobian(sensor: Sensor, points: np.ndarray = GENERAL_MOTION) -> np.ndarray:
    """Return ∂h/∂(η, ν, ν̇) (m, 9) at a motion (9,).  (1)"""
    return jacobian(lambda x: sensor.h(Motion(x[:3], x[3:6], x[6:], np.zeros(2))))(points)


def uncertain_parameters(
    sensors: SensorBlocks, name: str, rows: tuple[int, ...], nu: np.ndarray
) -> tuple[UncertainParameter, ...]:
    """Return the uncertain parameters that change these channels of a sensor at the velocity `nu` (3,).  (2)"""
    sensor = getattr(sensors, name)
    return tuple(
        UncertainParameter(
            name,
            path,
            *(
                _entry_path(sensor, std_path, path[len(path.partition("[")[0]) :])
                for std_path in (derivative.std, derivative.walk)
            ),
        )
        for path, derivative in _acting_parameters(sensor, rows, nu)
    )


def slip_statistics(
    sensors: SensorBlocks, used_channels: dict[str, tuple[int, ...]]
) -> tuple[Value, Value, Value]:
    """Return the variance of the mean slip relative to ν_x², its decay time [s], and the time between readings [s].

    The mean is over the sensors in use that measure the speed and slip; their slips are independent. Without such
    sensors, return 0, 1 and 0.
    """
    entries = [
        (value_at_path(sensor, parameter.slip), value_at_path(sensor, parameter.fade), 1.0 / sensor.rate_hz)
        for name, rows in used_channels.items()
        for sensor in [getattr(sensors, name)]
        for _, parameter in _acting_parameters(sensor, rows, FORWARD_NU)
        if parameter.slip and value_at_path(sensor, parameter.slip) > 0.0
    ]
    if not entries:
        return 0.0, 1.0, 0.0
    std, fade_s, period_s = np.array(entries).T
    return np.sum(std**2) / len(entries) ** 2, np.mean(fade_s), np.mean(period_s)


def relative_speed_variance(sensors: SensorBlocks, name: str, row: int) -> float:
    """Return the variance, relative to ν_x², of the slip and of the scale of a channel that measures the speed."""
    sensor, total = getattr(sensors, name), 0.0
    for path, parameter in _acting_parameters(sensor, (row,), FORWARD_NU):
        index = path[len(path.partition("[")[0]) :]
        fields = [field for field in (parameter.std, parameter.slip) if field and not parameter.walk]
        total += sum(float(value_at_path(sensor, _entry_path(sensor, field, index))) ** 2 for field in fields)
    return total


def scale_std(
    sensors: SensorBlocks,
    speed_channels: dict[str, tuple[int, ...]],
    turn_channels: dict[str, tuple[int, ...]],
) -> np.ndarray:
    """Return the standard deviations (2,) of the scales of speed and yaw rate.

    `speed_channels` and `turn_channels` are the channels that determine the speed and the yaw rate of the estimate, by
    sensor. If no channel measures the speed, the speed has the scale error of the model, which was identified with gyro
    and accelerometer.
    """
    turning_std = min(_scale_stds(sensors, turn_channels, TURNING_NU), default=0.0)
    model_std = np.hypot(turning_std, ACCEL_SCALE_STD)
    return np.array([min(_scale_stds(sensors, speed_channels, FORWARD_NU), default=model_std), turning_std])


def has_speed_scale(sensors: SensorBlocks, used_channels: dict[str, tuple[int, ...]]) -> bool:
    """Return True if one of these channels measures the speed with its own scale."""
    return bool(_scale_stds(sensors, used_channels, FORWARD_NU))


def _scale_stds(
    sensors: SensorBlocks, used_channels: dict[str, tuple[int, ...]], nu: np.ndarray
) -> list[float]:
    """Return the standard deviation of each scale that changes these channels at the velocity `nu` (3,)."""
    return [
        float(parameter.value_at(sensors, parameter.std))
        for name, rows in used_channels.items()
        for parameter in uncertain_parameters(sensors, name, rows, nu)
        if not parameter.walk
    ]


def _acting_parameters(
    sensor: Sensor, rows: tuple[int, ...], nu: np.ndarray
) -> Iterator[tuple[str, Parameter]]:
    """Yield path and Parameter of each uncertain parameter that changes these channels at `nu` (3,).  (2)"""
    motion, indices = REST_MOTION._replace(nu=nu), list(rows)
    for field, parameter in parameters(sensor) if rows else ():
        for index in [f"[{i}]" for i in range(parameter.shape[0])] if parameter.shape else [""]:
            shifted_sensor = (
                with_value(sensor, field + index, value_at_path(sensor, field + index) + PARAMETER_STEP)
                if parameter.std
                else sensor
            )
            if parameter.std and np.any(shifted_sensor.h(motion)[indices] != sensor.h(motion)[indices]):
                yield field + index, parameter


def _entry_path(sensor: Sensor, field: str, index: str) -> str:
    """Return the path of the entry `index` of a field; the path of the field if one value serves all entries."""
    return field + (index if field and np.ndim(getattr(sensor, field)) else "")
