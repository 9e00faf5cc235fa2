"""Simulate a model row by row: its start, the readings of its sensors, its motion without residuals, its kernels."""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.identify.data.added_channels import VOLTAGE_KEY
from baqueano.identify.data.averaging import AveragedSignal, average_step, instant_weights
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.free import substitute, value
from baqueano.identify.parameters.theta import START_NAMES, ThetaShape
from baqueano.sensors.sampling import constant_signal, step_signal
from baqueano.signals import ByName, Motion, sensor_slots
from baqueano.symbolic import scan, with_value, with_values
from baqueano.symbolic.scan import Scan

CACHED_KERNELS = 24  # kernels in the cache
_kernels: "OrderedDict[Any, Any]" = OrderedDict()
K = TypeVar("K")


def make_row_blocks(
    blocks: FittedBlocks, shape: ThetaShape, theta: np.ndarray, row: np.ndarray
) -> FittedBlocks:
    """Return the blocks with the parameters of θ, and with the voltage at the end of the row if it was logged."""
    blocks = substitute(blocks, shape.paths, theta)
    return with_value(blocks, "model.drivetrain.battery_v", row[-1]) if shape.has_voltage else blocks


def example(blocks: FittedBlocks, shape: ThetaShape) -> np.ndarray:
    """Return θ (p,) with the present values of the blocks."""
    values = [value(blocks, path) for path in shape.paths]
    return np.array([*values, *np.zeros(shape.size - len(values))])


def initial_state(
    blocks: FittedBlocks, shape: ThetaShape
) -> Callable[[np.ndarray], tuple[Any, tuple[Tree, ...]]]:
    """Return the function θ → (vehicle at the start of a segment, constant signal of each sensor before it)."""

    def start(theta: np.ndarray) -> tuple[Any, tuple[Tree, ...]]:
        tick_blocks, at_start = substitute(blocks, shape.paths, theta), np.zeros(len(START_NAMES))
        for k, i in enumerate(shape.start):
            at_start = at_start + theta[shape.size - len(shape.start) + k] * np.eye(len(START_NAMES))[i]
        nu = at_start[:3] if any(i < 3 for i in shape.start) else None
        eta = at_start[3:] if any(i >= 3 for i in shape.start) else None
        vehicle = tick_blocks.model.init(eta, nu)
        motion = Motion(vehicle.eta, vehicle.nu, vehicle.nu_dot, tick_blocks.model.gravity(vehicle.eta[2]))
        signals: list[Tree] = []
        for name, sensor in zip(blocks.sensors._fields, tick_blocks.sensors, strict=True):
            h = sensor.h(motion)
            signal = constant_signal(sensor, h)
            is_mean = name in shape.means or name in shape.clock_means
            signals.append(AveragedSignal(*signal, np.zeros(len(h)), h) if is_mean else signal)
        return vehicle, tuple(signals)

    return start


def read_sensor(
    sensor: Tree, signal: Tree, motion: Motion, dt_s: Value, weights: np.ndarray | None
) -> tuple[Tree, np.ndarray]:
    """Return the signal of a sensor and h (m,): a mean by its `weights`, or h at the end of the row without them."""
    if weights is None:
        return step_signal(sensor, signal, motion, dt_s)
    return average_step(sensor, signal, motion, dt_s, weights)


def read_sensors(
    sensors: ByName[Tree],
    signals: tuple[Tree, ...],
    motion: Motion,
    dt_s: Value,
    weights: Sequence[np.ndarray | None],
) -> tuple[list[np.ndarray], tuple[Tree, ...]]:
    """Return h (m,) of each sensor as `read_sensor` does, and the signals."""
    rows = zip(sensors, signals, weights, strict=True)
    readings = [read_sensor(sensor, signal, motion, dt_s, w) for sensor, signal, w in rows]
    return [h for _, h in readings], tuple(signal for signal, _ in readings)


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
        tick_blocks = make_row_blocks(blocks, shape, theta, row)
        vehicle, motion = tick_blocks.model.step(state.vehicle, row[1 : 1 + n], row[0], np.zeros(3))
        readings, signals = read_sensors(tick_blocks.sensors, state.signals, motion, row[0], at_end)
        return MotionState(vehicle, signals), Motions(np.concatenate(readings), motion.nu, motion.nu_dot)

    return scan(step, start, np.zeros(1 + n + shape.has_voltage), example(blocks, shape), backend=backend)


def open_loop(
    model: Tree, paths: Sequence[str], output: Callable[[Motion], np.ndarray], backend: str = "auto",
    volts: bool = False,
) -> tuple[Scan, np.ndarray]:  # fmt: skip
    """Return the scan from rows (dt, u, voltage if `volts`) to `output` from rest, and θ (p,) at `paths`."""
    blocks, n = FittedBlocks(model, sensor_slots(())()), 1 + model.commands

    def start(theta: np.ndarray) -> Tree:
        return substitute(blocks, paths, theta).model.init()

    def step(theta: np.ndarray, state: Tree, row: np.ndarray) -> tuple[Tree, np.ndarray]:
        row_blocks = substitute(blocks, paths, theta)
        row_blocks = with_value(row_blocks, "model.drivetrain.battery_v", row[-1]) if volts else row_blocks
        state, motion = row_blocks.model.step(state, row[1:n], row[0], np.zeros(3))
        return state, output(motion)

    theta = np.array([value(blocks, path) for path in paths])
    return scan(step, start, np.zeros(n + volts), theta, backend=backend), theta


def cached_kernel(
    blocks: FittedBlocks, shape: ThetaShape, backend: str, trace: Callable[..., K], *arguments: Any
) -> K:
    """Return `trace(blocks, shape, backend, *arguments)`, cached for fits with the same structure and fixed numbers."""
    shape_blocks = with_values(blocks, [(path, 0.0) for path in shape.paths])
    key = (trace, arguments, _fingerprint(shape_blocks), shape, backend)
    if key not in _kernels:
        _kernels[key] = trace(blocks, shape, backend, *arguments)
        if len(_kernels) > CACHED_KERNELS:
            _kernels.popitem(last=False)
    _kernels.move_to_end(key)
    return _kernels[key]


def _fingerprint(tree: Any) -> Any:
    """Return a hashable copy of all numbers in a tree of blocks. Two trees with the same copy give the same trace."""
    if isinstance(tree, float):
        return tree
    if isinstance(tree, np.ndarray):
        return (tree.shape, tree.tobytes())
    if isinstance(tree, tuple | list):
        return (type(tree), *map(_fingerprint, tree))
    if isinstance(tree, dict):
        return tuple((k, _fingerprint(v)) for k, v in tree.items())
    if is_dataclass(tree) and not isinstance(tree, type):
        return (type(tree), *(_fingerprint(getattr(tree, f.name)) for f in fields(tree)))
    return id(tree) if isinstance(tree, Callable) else tree
