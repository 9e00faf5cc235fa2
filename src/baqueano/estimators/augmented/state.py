"""The augmented state of augmented_ekf.py, and its entries that each channel of a sensor may correct.

    x = (x, y, ψ | ν_x, ν_y, ν_ψ | d_x, d_ψ | κ_v, κ_ψ, β, w | biases)                                     (1)

A filter in which every channel corrects every state relies on the couplings of its model. Then a gyro that disagrees
with the model changes the speed, and an odometer changes the heading. On real cars these couplings had larger errors
than the sensors, and the estimate was worse than the model. So each channel corrects only, by the measured quantity:

    the pose                all states
    ν_x, not inertial       position, ν_x, ν_y, d_x; also the turning states if no channel measures only ν_ψ
    only ν_ψ (a gyro)       ψ, ν_y, ν_ψ, d_ψ; at rest also its bias
    other inertial channel  its bias at rest; if in `speed_from` its bias, position, ν_x, ν_y, d_x at any time (2)

h determines the measured quantity (sensor_numbers.py). A channel whose bias walks is inertial. A model error looks like
a bias: so biases outside `speed_from` are estimated only at rest. With a pose sensor, all channels correct all biases.
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

SCALES, BIASES = 8, 12  # index of the first of κ, β, w, and of the first bias
BEND = 11  # index of w: a large variance of the heading bends the region of the position; w is not estimated
PLACE, TURNING, FORWARD = (0, 1), (2, 4, 5, 7), (3, 4, 6)  # entries of x
LEADING = 2.5  # factor on the model's part of the gate of a gyro, because no model predicts each turn


class Layout(NamedTuple):
    """The states of a filter for its sensors, and the states that each channel of a sensor may correct."""

    names: tuple[str, ...]  # the sensors
    entries: tuple[tuple[int, ...], ...]  # the numbers of each sensor that correct the state
    biases: tuple[UncertainNumber, ...]
    moving: np.ndarray  # (m, n) E of kalman.py for each number, while the vehicle drives  (2)
    resting: np.ndarray  # (m, n) at rest
    patience: np.ndarray  # (m,) factor on the model's part of the gate of each number
    slope: np.ndarray  # (m, 2) derivative of each channel by speed and yaw rate; 0 if it may not correct them
    places: tuple[tuple[int, ...], ...]  # the numbers of each sensor that measures the pose: place_gate.py

    @property
    def doubt_mask(self) -> np.ndarray:
        """Return a mask (n,): 1 for η, κ, β and b, the states that may be wrong if the pose is wrong."""
        mask = np.ones(self.size)
        mask[[*range(3, SCALES), BEND]] = 0.0
        return mask

    @property
    def size(self) -> int:
        """Return the number n of states."""
        return BIASES + len(self.biases)


@lru_cache(maxsize=256)
def layout(estimator: "AugmentedEkf") -> Layout:
    """Return the layout for `sensors`, `use` and `speed_from` of an estimator."""
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
    """Return the standard deviations (n,) of the state at the start."""
    its = layout(estimator)
    biases = np.array([bias.of(estimator.sensors, bias.std) for bias in its.biases])
    scales = scale_std(estimator.sensors, dict(zip(its.names, its.entries, strict=True)))
    course = np.array([estimator.course_std, 1.0])
    return np.concatenate([estimator.initial_std, estimator.disturbance_std, scales, course, biases])


def _shows(sensor: Sensor) -> list[tuple[bool, bool, bool]]:
    """Return three booleans for each channel of a sensor: it depends on the pose; on ν_x at rest; on ν_ψ at rest."""
    return [
        (bool(np.any(anywhere[:3])), bool(at_rest[3] != 0.0), bool(at_rest[5] != 0.0))
        for anywhere, at_rest in zip(slopes(sensor), slopes(sensor, np.zeros(9)), strict=True)
    ]
