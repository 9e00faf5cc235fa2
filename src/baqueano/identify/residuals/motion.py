"""Simulate the motion of a model under the commands of a record, without residuals."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.data.added_channels import VOLTAGE_KEY
from baqueano.identify.data.averaging import instant_weights
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.free import substitute, value
from baqueano.identify.parameters.setup import (
    ThetaShape,
    blocks_in_row,
    example,
    initial_state,
    read_sensors,
)
from baqueano.signals import Motion, sensor_slots
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan


class MotionState(NamedTuple):
    """State of the simulation without its residuals."""

    vehicle: Tree
    signals: tuple[Tree, ...]


class Motions(NamedTuple):
    """Motion and predictions, row by row."""

    h: np.ndarray  # (N, m)
    nu: np.ndarray  # (N, 3)
    nu_dot: np.ndarray  # (N, 3)


def mean_columns(record: FitRecord, means: Sequence[str]) -> list[np.ndarray]:
    """Return the weights (N, 7) of each sensor of means; of an instant in a record without its intervals."""
    columns = []
    for name in means:
        readings = record.sensors[name]
        part = np.zeros(len(record.dt_s)) if readings.sample_fraction is None else readings.sample_fraction
        columns.append(instant_weights(part) if readings.mean_weights is None else readings.mean_weights)
    return columns


def motion_rows(record: FitRecord, *columns: np.ndarray) -> np.ndarray:
    """Return rows (N, q): dt, u, the columns `columns`, and the battery voltage if it is recorded."""
    voltage = [record.sensors[VOLTAGE_KEY].z] if VOLTAGE_KEY in record.sensors else []
    return np.concatenate([record.dt_s[:, None], record.u, *columns, *voltage], axis=1)


def motion_kernel(blocks: FittedBlocks, shape: ThetaShape, backend: str) -> Scan:
    """Return the scan from motion rows and θ to `Motions`."""
    n, begin = blocks.model.commands, initial_state(blocks, shape._replace(means=(), clock_means=()))
    at_end = [None] * len(blocks.sensors)

    def start(theta: np.ndarray) -> MotionState:
        return MotionState(*begin(theta))

    def step(theta: np.ndarray, state: MotionState, row: np.ndarray) -> tuple[MotionState, Motions]:
        blocks_at = blocks_in_row(blocks, shape, theta, row)
        vehicle, motion = blocks_at.model.step(state.vehicle, row[1 : 1 + n], row[0], np.zeros(3))
        readings, signals = read_sensors(blocks_at.sensors, state.signals, motion, row[0], at_end)
        return MotionState(vehicle, signals), Motions(np.concatenate(readings), motion.nu, motion.nu_dot)

    return scan(step, start, np.zeros(1 + n + shape.has_voltage), example(blocks, shape), backend=backend)


def open_loop(
    model: Tree, paths: Sequence[str], output: Callable[[Motion], np.ndarray], backend: str = "auto"
) -> tuple[Scan, np.ndarray]:
    """Return the scan from rows (dt, u) and θ to `output` of the motion from rest. Also return θ (p,), the values of
    the model at `paths`."""
    blocks = FittedBlocks(model, sensor_slots(())())

    def start(theta: np.ndarray) -> Tree:
        return substitute(blocks, paths, theta).model.init()

    def step(theta: np.ndarray, state: Tree, row: np.ndarray) -> tuple[Tree, np.ndarray]:
        state, motion = substitute(blocks, paths, theta).model.step(state, row[1:], row[0], np.zeros(3))
        return state, output(motion)

    theta = np.array([value(blocks, path) for path in paths])
    return scan(step, start, np.zeros(1 + model.commands), theta, backend=backend), theta
