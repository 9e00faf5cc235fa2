"""Meaning of θ for a piece of a run, and the beginning of its simulation."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import value, with_numbers
from baqueano.sensors.sampling import Signal, begun, shown
from baqueano.signals import ByName, Motion

STARTS = ("nu_x", "nu_y", "nu_psi", "x", "y", "psi")


class Shape(NamedTuple):
    """Meaning of θ for one piece of a run."""

    shared: tuple[str, ...]  # paths that all runs share
    own: tuple[str, ...]  # paths that each run has for itself: biases
    start: tuple[int, ...]  # entries of STARTS that are free
    early: tuple[bool, ...]  # per sensor, whether its stamps lie between ticks, or its clock is free
    clocks: tuple[str, ...] = ()  # sensors whose clock is free
    slots: int = 0  # rows before the newest that these need
    volts: bool = False  # whether rows end with the battery's voltage

    @property
    def by_run(self) -> tuple[str, ...]:
        """Names of what each run has for itself."""
        return (*self.own, *(f"clock.{name}" for name in self.clocks))

    @property
    def size(self) -> int:
        """Length of θ of one piece."""
        return len(self.shared) + len(self.by_run) + len(self.start)


def vehicle_at_start(blocks: FittedBlocks, shape: Shape) -> Callable[[np.ndarray], Tree]:
    """θ → the vehicle at the start of a piece."""
    paths = (*shape.shared, *shape.own)

    def start(theta: np.ndarray) -> Any:
        there = with_numbers(blocks, paths, theta)
        given = np.zeros(len(STARTS))
        for k, i in enumerate(shape.start):
            given = given + theta[shape.size - len(shape.start) + k] * np.eye(len(STARTS))[i]
        nu = given[:3] if any(i < 3 for i in shape.start) else None
        eta = given[3:] if any(i >= 3 for i in shape.start) else None
        return there.model.init(eta, nu)

    return start


def example(blocks: FittedBlocks, shape: Shape) -> np.ndarray:
    """Return θ (p,) of the blocks as they are."""
    paths = (*shape.shared, *shape.own)
    return np.array([*(value(blocks, path) for path in paths), *np.zeros(shape.size - len(paths))])


def beginning(blocks: FittedBlocks, shape: Shape) -> Callable[[np.ndarray], tuple[Any, tuple[Signal, ...]]]:
    """Return the function θ → (vehicle at the start of a piece, signal of each sensor until then)."""
    vehicle_at, paths = vehicle_at_start(blocks, shape), (*shape.shared, *shape.own)

    def start(theta: np.ndarray) -> tuple[Any, tuple[Signal, ...]]:
        there, vehicle = with_numbers(blocks, paths, theta), vehicle_at(theta)
        motion = Motion(vehicle.eta, vehicle.nu, vehicle.nu_dot, there.model.gravity(vehicle.eta[2]))
        return vehicle, tuple(begun(sensor, sensor.h(motion)) for sensor in there.sensors)

    return start


def shown_by(
    sensors: ByName[Tree], signals: tuple[Signal, ...], motion: Motion, dt_s: Value
) -> tuple[list[np.ndarray], tuple[Signal, ...]]:
    """Return h of each sensor at the end of a row (m,), and its signal."""
    both = [shown(sensor, signal, motion, dt_s) for sensor, signal in zip(sensors, signals, strict=True)]
    return [h for _, h in both], tuple(signal for signal, _ in both)
