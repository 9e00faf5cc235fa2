"""The augmented state of augmented_ekf.py, and what each number of a sensor may correct in it.

    x = (x, y, ψ | ν_x, ν_y, ν_ψ | d_x, d_ψ | κ_v, κ_ψ, β, w | biases)                                     (1)

A filter that lets every number correct everything believes the couplings of its model: a gyro that disagrees with the
model about a turn then changes the speed, an odometer the heading. On real cars these couplings are off by more than
the sensors are, and the estimate is worse than the model alone. So, by what a number shows:

    the pose                x, all of it
    ν_x, not inertial       position, ν_x, ν_y, d_x; and what turns, if no number shows only that
    ν_ψ alone (a gyro)      ψ, ν_y, ν_ψ, d_ψ; at rest its bias
    inertial, else          nothing but, at rest, its bias; with `speed_from` ν_x, ν_y, d_x and its bias    (2)

What a number shows is read from its h (sensor_numbers.py). A number is inertial if its sensor has a bias that it shows.
Other biases follow only at rest: while it drives, the misfit of the model looks like one.
"""

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor
from baqueano.estimators.readings.doubt import AXES
from baqueano.estimators.readings.sensor_numbers import (
    UncertainNumber,
    rows_of,
    scale_std,
    slopes,
    split,
    uncertain,
)

if TYPE_CHECKING:
    from baqueano.estimators.augmented_ekf import AugmentedEkf

SCALES, BIASES = 8, 12  # where κ, β, w and the biases begin
BEND = 11  # w: how a wide spread of the heading bends the region of the position. Nothing estimates it
PLACE, TURNING, FORWARD = (0, 1), (2, 4, 5, 7), (3, 4, 6)  # entries of x
LEADING = 2.5  # times as far as any other number a gyro may be from the model: no model foresees each turn


class Layout(NamedTuple):
    """Layout of the state of a filter with these sensors."""

    names: tuple[str, ...]  # the sensors
    at: tuple[tuple[int, ...], ...]  # of each sensor the numbers that correct
    biases: tuple[UncertainNumber, ...]
    moving: np.ndarray  # (m, n) E of kalman.py for each number, while the vehicle drives  (2)
    resting: np.ndarray  # (m, n) at rest
    patience: np.ndarray  # (m,) of the gate, for each number
    slope: np.ndarray  # (m, 2) of each number by the speed and the yaw rate that it may correct; 0: not that
    places: tuple[tuple[int, ...], ...]  # the numbers of each sensor that shows the pose: place_gate.py

    @property
    def doubted(self) -> np.ndarray:
        """1 (n,) for what may be wrong where the pose is: (η, κ, β, b)."""
        mask = np.ones(self.size)
        mask[[*range(3, SCALES), BEND]] = 0.0
        return mask

    @property
    def size(self) -> int:
        """n."""
        return BIASES + len(self.biases)


@lru_cache(maxsize=256)
def layout(estimator: "AugmentedEkf") -> Layout:
    """Return the layout of an estimator with `sensors`, `use` and `speed_from`."""
    sensors, uses = estimator.sensors, estimator.use
    names, at = tuple(split(use)[0] for use in uses), tuple(rows_of(sensors, use) for use in uses)
    biases = tuple(
        bias
        for name, rows in zip(names, at, strict=True)
        for bias in uncertain(sensors, name, rows, np.zeros(3))
        if bias.walk
    )
    reliable = {(split(use)[0], i) for use in estimator.speed_from for i in rows_of(sensors, use)}
    numbers = [(name, i) for name, rows in zip(names, at, strict=True) for i in rows]
    signals = {name: _shows(getattr(sensors, name)) for name in names}
    shows = [signals[name][i] for name, i in numbers]
    own = [
        [biases.index(bias) for bias in uncertain(sensors, name, (i,), np.zeros(3)) if bias.walk]
        for name, i in numbers
    ]
    leads = [turning and not (pose or forward) for pose, forward, turning in shows]
    moving = np.zeros((len(numbers), BIASES + len(biases)))
    for k, (number, (pose, forward, turning)) in enumerate(zip(numbers, shows, strict=True)):
        if pose:
            moving[k] = 1.0
            continue
        if (forward and not own[k]) or number in reliable:
            moving[k, [*PLACE, *FORWARD]] = 1.0
        if number in reliable:
            moving[k, [BIASES + j for j in own[k]]] = 1.0
        if turning and not (any(leads) and forward):
            moving[k, [*TURNING]] = 1.0
    if any(pose for pose, _, _ in shows):
        moving[:, BIASES:] = 1.0
    moving[:, BEND] = 0.0
    resting = moving.copy()
    for k, own_biases in enumerate(own):
        resting[k, [BIASES + j for j in own_biases]] = 1.0
    at_rest = {name: slopes(getattr(sensors, name), np.zeros(9)) for name in names}
    slope = np.array([at_rest[name][i, AXES] for name, i in numbers]).reshape(-1, 2) * moving[:, AXES]
    places = tuple(
        group
        for name in dict.fromkeys(names)
        if (group := tuple(k for k, (name_k, _) in enumerate(numbers) if name_k == name and shows[k][0]))
    )
    return Layout(names, at, biases, moving, resting, np.where(leads, LEADING, 1.0), slope, places)


def start_std(estimator: "AugmentedEkf") -> np.ndarray:
    """Return the standard deviations (n,) at the start."""
    its = layout(estimator)
    biases = np.array([bias.of(estimator.sensors, bias.std) for bias in its.biases])
    scales = scale_std(estimator.sensors, dict(zip(its.names, its.at, strict=True)))
    course = np.array([estimator.course_std, 1.0])
    return np.concatenate([estimator.initial_std, estimator.disturbance_std, scales, course, biases])


def _shows(sensor: Sensor) -> list[tuple[bool, bool, bool]]:
    """If each number of a sensor shows the pose anywhere; at rest the speed ahead, the yaw rate."""
    return [
        (bool(np.any(anywhere[:3])), bool(at_rest[3] != 0.0), bool(at_rest[5] != 0.0))
        for anywhere, at_rest in zip(slopes(sensor), slopes(sensor, np.zeros(9)), strict=True)
    ]
