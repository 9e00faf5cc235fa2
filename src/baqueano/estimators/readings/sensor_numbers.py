"""Channels of sensors: the measured velocities, the age, and the uncertainty of the calibration.

All this follows from h and the parameters. The module does not name kinds of sensors, so your own sensors work too.

    ∂h/∂(η, ν, ν̇)  at rest          which velocities a channel measures, to first order                   (1)
    h(θ + STEP) ≠ h(θ)               which parameters θ it depends on                                      (2)

A parameter with a `std` in its metadata is uncertain. If it also has a `walk`, it is a bias, else a scale. `slip` is
the standard deviation of a temporary error of a scale, which fades (Ornstein-Uhlenbeck).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.contracts.values import Value
from baqueano.diagnostics import fault
from baqueano.errors import Invalid
from baqueano.parameter import Parameter, parameters
from baqueano.sensors.sampling import low_pass_s
from baqueano.signals import Motion, Slot
from baqueano.symbolic import get, jacobian, put

REST = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
CURVE = np.array([0.3, -0.2, 0.7, 0.5, 0.1, 0.9, 0.2, 0.1, -0.4])  # (η, ν, ν̇) at which no term of h vanishes
AHEAD, TURNING = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])  # ν
STEP = 0.1  # of a parameter
# ± 2 % by its data sheet, uniform; without a wheel, the speed follows from a_y / ν_ψ
ACCEL_SCALE_STD = 0.02 / np.sqrt(3.0)


class UncertainNumber(NamedTuple):
    """A parameter of a sensor that is not known exactly."""

    sensor: str
    path: str  # in the sensor
    std: str  # path of its standard deviation
    walk: str  # path of its random walk in 1 s; "" for a constant

    def of(self, sensors: SensorBlocks, path: str) -> Value:
        """Return the value of the sensor at `path`: one of the paths of this parameter."""
        return get(getattr(sensors, self.sensor), path)


def split(use: str) -> tuple[str, tuple[int, ...] | None]:
    """Return the sensor and the indices of its channels: "imu[1,2]" → ("imu", (1, 2)). None means all channels."""
    name, bracket, rest = use.partition("[")
    return name, tuple(int(i) for i in rest.rstrip("]").split(",")) if bracket else None


def rows_of(sensors: SensorBlocks, use: str) -> tuple[int, ...]:
    """Return the indices of the channels of a sensor that `use` selects."""
    name, rows = split(use)
    return tuple(range(getattr(sensors, name).size)) if rows is None else rows


def check_use(sensors: SensorBlocks, use: tuple[str, ...], by_number: bool = False) -> None:
    """Raise ValueError if `use` names a sensor that the vehicle does not have; `by_number` allows "imu[2]"."""
    names = getattr(sensors, "_fields", ())
    for number in use:
        if (split(number)[0] if by_number else number) not in names:
            raise Invalid(fault("field.use", found=number, known=names))


def has_measurement(sensor: Sensor, slot: Slot) -> Value:
    """Return True if a measurement arrived and is finite."""
    return (slot.has > 0.0) & (np.sum(np.isfinite(slot.z)) == sensor.size)


def age_s(sensor: Sensor, slot: Slot) -> Value:
    """Return the age of a measurement at the tick [s], from its timestamp, its delay and its low-pass."""
    delay_s = sensor.delay_s if optional.of(sensor, "delay_slots") > 0 else 0.0
    return slot.age_s + delay_s + low_pass_s(sensor)


def slopes(sensor: Sensor, points: np.ndarray = CURVE) -> np.ndarray:
    """Return ∂h/∂(η, ν, ν̇) (m, 9) at a motion (9,).  (1)"""
    return jacobian(lambda x: sensor.h(Motion(x[:3], x[3:6], x[6:], np.zeros(2))))(points)


def uncertain(
    sensors: SensorBlocks, name: str, rows: tuple[int, ...], nu: np.ndarray
) -> tuple[UncertainNumber, ...]:
    """Return the uncertain parameters that change these channels of a sensor at the velocity `nu` (3,).  (2)"""
    sensor = getattr(sensors, name)
    return tuple(
        UncertainNumber(
            name,
            path,
            *(
                _entry(sensor, of, path[len(path.partition("[")[0]) :])
                for of in (derivative.std, derivative.walk)
            ),
        )
        for path, derivative in _bearing(sensor, rows, nu)
    )


def slips(sensors: SensorBlocks, used: dict[str, tuple[int, ...]]) -> tuple[Value, Value, Value]:
    """Return the variance of the mean slip relative to ν_x², its fading time [s], and the time between readings [s].

    The mean is over the sensors in use that measure the speed and slip; their slips are independent. Without such
    sensors, return 0, 1 and 0.
    """
    each = [
        (get(sensor, parameter.slip), get(sensor, parameter.fade), 1.0 / sensor.rate_hz)
        for name, rows in used.items()
        for sensor in [getattr(sensors, name)]
        for _, parameter in _bearing(sensor, rows, AHEAD)
        if parameter.slip and get(sensor, parameter.slip) > 0.0
    ]
    if not each:
        return 0.0, 1.0, 0.0
    std, fade_s, period_s = np.array(each).T
    return np.sum(std**2) / len(each) ** 2, np.mean(fade_s), np.mean(period_s)


def scale_std(sensors: SensorBlocks, used: dict[str, tuple[int, ...]]) -> np.ndarray:
    """Return the standard deviations (2,) of the scales of speed and yaw rate, for these channels in use.

    If no channel measures the speed, the speed has the scale error of the model, which was identified by gyro and
    accelerometer.
    """
    forward, turning = (
        [
            float(parameter.of(sensors, parameter.std))
            for name, rows in used.items()
            for parameter in uncertain(sensors, name, rows, nu)
            if not parameter.walk
        ]
        for nu in (AHEAD, TURNING)
    )
    turning_std = min(turning, default=0.0)
    return np.array([min(forward, default=np.hypot(turning_std, ACCEL_SCALE_STD)), turning_std])


def _bearing(sensor: Sensor, rows: tuple[int, ...], nu: np.ndarray) -> Iterator[tuple[str, Parameter]]:
    """Yield path and Parameter of each uncertain parameter that changes these channels at `nu` (3,).  (2)"""
    motion, at = REST._replace(nu=nu), list(rows)
    for field, one_field in parameters(sensor) if rows else ():
        for index in [f"[{i}]" for i in range(one_field.shape[0])] if one_field.shape else [""]:
            shifted_sensor = (
                put(sensor, field + index, get(sensor, field + index) + STEP) if one_field.std else sensor
            )
            if one_field.std and np.any(shifted_sensor.h(motion)[at] != sensor.h(motion)[at]):
                yield field + index, one_field


def _entry(sensor: Sensor, field: str, index: str) -> str:
    """Return the path of the entry `index` of a field; the path of the field if one value serves all entries."""
    return field + (index if field and np.ndim(getattr(sensor, field)) else "")
