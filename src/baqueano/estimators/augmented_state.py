"""The augmented state of augmented_ekf.py, and what each number of a sensor may correct in it.

    x = (x, y, ψ | ν_x, ν_y, ν_ψ | d_x, d_ψ | κ_v, κ_ψ | biases)                                           (1)

A filter that lets every number correct everything believes the couplings of its model: a gyro that disagrees with the
model about a turn then changes the speed, an odometer the heading. On real cars these couplings are off by more than
the sensors are, and the estimate is worse than the model alone. So, by what a number shows:

    the pose                x, all of it
    ν_x, not inertial       position, ν_x, ν_y, d_x; and what turns, if no number shows only that
    ν_ψ alone (a gyro)      ψ, ν_y, ν_ψ, d_ψ; at rest its bias
    inertial, else          nothing but, at rest, its bias; with `speed_from` ν_x, ν_y, d_x                 (2)

What a number shows is read off its h. Biases follow only at rest: while it drives, the misfit of the model looks like
one. A number is inertial if its sensor has a bias that it shows.
"""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baqueano.parameter import Parameter, parameters
from baqueano.signals import Motion
from baqueano.symbolic import get, put

SCALES, BIASES = 8, 10  # where κ and the biases begin
PLACE, TURNING, FORWARD = (0, 1), (2, 4, 5, 7), (3, 4, 6)  # entries of x
ACCEL_SCALE_STD = 0.02  # of an accelerometer by its data sheet: without a wheel, speed is a_y / ν_ψ
LEADING = (
    2.5  # times as far as any other number a gyro may be from the model: on real cars a turn is not foreseen
)
STEP = 0.1  # of a parameter or a state: does a number show it?


class Bias(NamedTuple):
    """A bias of a sensor that is part of the state."""

    sensor: str
    path: str  # in the sensor
    std: str  # path of its deviation at the start
    walk: str  # path of its random walk in 1 s


class Layout(NamedTuple):
    """What a filter with these sensors estimates."""

    names: tuple[str, ...]  # the sensors
    at: tuple[tuple[int, ...], ...]  # of each sensor the numbers that correct
    biases: tuple[Bias, ...]
    moving: np.ndarray  # (m, n) E of kalman.py for each number, while the vehicle drives  (2)
    resting: np.ndarray  # (m, n) at rest
    patience: np.ndarray  # (m,) of the gate, for each number

    @property
    def size(self) -> int:
        """n."""
        return BIASES + len(self.biases)


def split(use: str) -> tuple[str, tuple[int, ...] | None]:
    """Return the sensor and its numbers: "imu[1,2]" → ("imu", (1, 2)); None: all of them."""
    name, bracket, rest = use.partition("[")
    return name, tuple(int(i) for i in rest.rstrip("]").split(",")) if bracket else None


def rows_of(sensors: Any, use: str) -> tuple[int, ...]:
    """Return the numbers of a sensor that `use` names."""
    name, rows = split(use)
    return tuple(range(getattr(sensors, name).size)) if rows is None else rows


@lru_cache(maxsize=256)
def layout(estimator: Any) -> Layout:
    """Return the layout of an estimator with `sensors`, `use` and `speed_from`."""
    sensors, uses = estimator.sensors, estimator.use
    names, at = tuple(split(use)[0] for use in uses), tuple(rows_of(sensors, use) for use in uses)
    biases = tuple(
        Bias(
            name,
            field + index,
            *(_entry(getattr(sensors, name), one, index) for one in (known.std, known.walk)),
        )
        for name, rows in zip(names, at, strict=True)
        for field, index, known in _shown(getattr(sensors, name), rows, np.zeros(3))
        if known.walk
    )
    trusted = {(split(use)[0], i) for use in estimator.speed_from for i in rows_of(sensors, use)}
    numbers = [(name, i) for name, rows in zip(names, at, strict=True) for i in rows]
    shows = [_shows(getattr(sensors, name), i) for name, i in numbers]
    own = [_own(getattr(sensors, name), name, i, biases) for name, i in numbers]
    leads = [turning and not (pose or forward) for pose, forward, turning in shows]
    moving = np.zeros((len(numbers), BIASES + len(biases)))
    for k, (number, (pose, forward, turning)) in enumerate(zip(numbers, shows, strict=True)):
        if pose:
            moving[k] = 1.0
            continue
        if (forward and not own[k]) or number in trusted:
            moving[k, [*PLACE, *FORWARD]] = 1.0
        if turning and not (any(leads) and forward):
            moving[k, [*TURNING]] = 1.0
    if any(pose for pose, _, _ in shows):
        moving[:, BIASES:] = 1.0
    resting = moving.copy()
    for k, mine in enumerate(own):
        resting[k, [BIASES + j for j in mine]] = 1.0
    return Layout(names, at, biases, moving, resting, np.where(leads, LEADING, 1.0))


def scale_std(estimator: Any) -> np.ndarray:
    """Return the deviations of κ (2,): those of the sensors that the model was identified with."""
    forward, turning = (
        _least_std(estimator, nu) for nu in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    )
    return np.array(
        [np.hypot(turning or 0.0, ACCEL_SCALE_STD) if forward is None else forward, turning or 0.0]
    )


def _shows(sensor: Any, number: int) -> tuple[bool, bool, bool]:
    """Whether a number shows the pose, the speed ahead on the straight, the yaw rate without a speed."""
    zero, turn = np.zeros(3), np.array([0.0, 0.0, STEP])
    still = sensor.h(_motion(zero, zero))[number]
    poses = (np.array([STEP, 0.0, 0.0]), np.array([0.0, STEP, 0.0]), turn)
    pose = any(sensor.h(_motion(eta, zero))[number] != still for eta in poses)
    forward = sensor.h(_motion(zero, np.array([STEP, 0.0, 0.0])))[number] != still
    way, back = (sensor.h(_motion(zero, one))[number] - still for one in (turn, -turn))
    return pose, bool(forward), bool(abs(way - back) > STEP * abs(way))  # what turns shows it in its sign


def _own(sensor: Any, name: str, number: int, biases: tuple[Bias, ...]) -> list[int]:
    """The biases that a number shows."""
    still = _motion(np.zeros(3), np.zeros(3))
    return [
        j
        for j, bias in enumerate(biases)
        if bias.sensor == name and _stepped(sensor, bias.path).h(still)[number] != sensor.h(still)[number]
    ]


def _shown(sensor: Any, rows: tuple[int, ...], nu: np.ndarray) -> Iterator[tuple[str, str, Parameter]]:
    """(field, index, Parameter) of what has a deviation and changes these numbers at the velocity `nu` (3,)."""
    motion, at = _motion(np.zeros(3), nu), list(rows)
    for field, known in parameters(sensor):
        for index in [f"[{i}]" for i in range(known.shape[0])] if known.shape else [""]:
            if known.std and np.any(_stepped(sensor, field + index).h(motion)[at] != sensor.h(motion)[at]):
                yield field, index, known


def _least_std(estimator: Any, nu: np.ndarray) -> float | None:
    """The least deviation of a scale that shows at the velocity `nu` (3,); None where none does."""
    each = layout(estimator)
    found = [
        float(np.max(getattr(sensor, known.std)))
        for sensor, rows in (
            (getattr(estimator.sensors, n), at) for n, at in zip(each.names, each.at, strict=True)
        )
        for _, _, known in _shown(sensor, rows, nu)
        if not known.walk
    ]
    return min(found, default=None)


def _motion(eta: np.ndarray, nu: np.ndarray) -> Motion:
    return Motion(eta, nu, np.zeros(3), np.zeros(2))


def _stepped(sensor: Any, path: str) -> Any:
    return put(sensor, path, get(sensor, path) + STEP)


def _entry(sensor: Any, field: str, index: str) -> str:
    """The path of an entry of a field that has one number for all, or one for each."""
    return field + (index if np.ndim(getattr(sensor, field)) else "")
