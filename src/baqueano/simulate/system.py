"""Combine a vehicle, its sensors and the blocks of its loop into one tree of parameters, and advance it by a tick.

The fields have the names of the tables of the vehicle file. A path of the file ("model.friction.linear",
"sensors.imu.gyro_bias", "controller.alpha") is therefore a path into the tree. `with_parameters` replaces the values at
some paths by a flat vector θ: paths in their order, arrays row by row.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano import loop
from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Tree, Value
from baqueano.errors import UsageError, error_cause
from baqueano.signals import Motion, Tick
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicles.state import Vehicle
from baqueano.worlds import world_init, world_step
from baqueano.worlds.simulated import DrawnNoise, WorldState, no_noise, tick_row_count


class System(NamedTuple):
    """All blocks, with the names of the tables of the vehicle file; None for a block that is not used."""

    model: Vehicle
    sensors: SensorBlocks  # NamedTuple of sensor blocks, by name
    estimator: Tree = None
    guide: Tree = None
    controller: Tree = None
    supervisor: Tree = None

    @property
    def blocks(self) -> loop.Blocks:
        """Return the four blocks of the loop."""
        return loop.Blocks(self.estimator, self.guide, self.controller, self.supervisor)


class Input(NamedTuple):
    """The inputs of one tick of a simulated loop: its time and the noise."""

    t_ns: Value  # the end of the tick, int; (N,) for a whole run
    noise: DrawnNoise | None  # standard normals; None: without noise


class SystemState(NamedTuple):
    """State of a simulated loop: world, blocks, and the command that acts now."""

    world: WorldState
    blocks: loop.States
    u: np.ndarray  # (n,) the command that acts now


class LoopOutput(NamedTuple):
    """The outputs of a simulated loop at each tick."""

    record: loop.Record
    truth: Motion


def begin(system: System, eta0: np.ndarray | None = None) -> SystemState:
    """Return the state at rest at the pose `eta0` (3,), which is also the start of the estimator."""
    world = world_init(system.model, system.sensors, eta0)
    return SystemState(world, loop.init(system.blocks, eta0), np.zeros(system.model.commands))


def advance(system: System, dt_s: float, state: SystemState, x: Input) -> tuple[SystemState, LoopOutput]:
    """Return the state and the output after a tick: the world moves with the present command, then the loop runs."""
    noise = no_noise(system.sensors, tick_row_count(dt_s)) if x.noise is None else x.noise
    world, truth, slots = world_step(system.model, system.sensors, state.world, state.u, dt_s, noise)
    states, record = loop.step(system.blocks, state.blocks, Tick(x.t_ns, state.u, slots))
    return SystemState(world, states, record.sent_command.u), LoopOutput(record, truth)


def value_at(system: System, path: str) -> np.ndarray:
    """Return the value or array of the system at `path`. Raise UsageError for a path without a numeric value."""
    try:
        array = np.asarray(value_at_path(system, path), dtype=float)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        raise UsageError.of("simulate.no-number", path=path, cause=error_cause(error)) from error
    return array


def parameter_vector(system: System, paths: Sequence[str]) -> np.ndarray:
    """Return θ (p,), the values of the system at `paths`, arrays row by row."""
    return np.concatenate([value_at(system, path).ravel() for path in paths]) if paths else np.zeros(0)


def parameter_labels(system: System, paths: Sequence[str]) -> list[str]:
    """Return a name for each entry of θ: "model.friction.linear[0]"."""
    labels = []
    for path in paths:
        shape = value_at(system, path).shape
        indices = (
            ["".join(f"[{','.join(map(str, index))}]") for index in np.ndindex(shape)] if shape else [""]
        )
        labels += [path + mark for mark in indices]
    return labels


def with_parameters(system: System, paths: Sequence[str], theta: Tree) -> System:
    """Return the system with θ (p,) at `paths`; θ can be traced. The bounds of the parameters are not checked here."""
    offset = 0
    for path in paths:
        shape = value_at(system, path).shape
        size = int(np.prod(shape))
        piece = theta[offset] if shape == () else theta[offset : offset + size].reshape(shape)
        system = with_value(system, path, piece)
        offset += size
    return system
