"""Simulate a vehicle with its sensors, as a world of the loop and as one pure step.

  state, truth, slots = world_step(vehicle, sensors, state, u, dt_s, noise)                              (1)

The same step runs in a kernel (simulate/) and here tick by tick, with the same noise. With the same seed and commands,
tick k of a simulated world equals tick k of a simulated run. A tick that is too long for the integrator
(vehicles/rk4.py) is divided into rows, as in a fit, each with separate noise. The last measurement of a sensor in a
tick is used.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks, World
from baqueano.contracts.values import Tree, Value
from baqueano.signals import NANOSECONDS, ByName, Command, Motion, Slot, Tick, sensor_slots
from baqueano.symbolic import function
from baqueano.vehicles.rk4 import row_counts
from baqueano.vehicles.state import Vehicle, VehicleState
from baqueano.worlds.noise import PROCESS_STREAM, random_stream, sensor_stream

BATCH_ROWS = 256  # rows of noise that are drawn at a time
MAX_KEPT_TRUTHS = 10_000  # number of truths that are stored if new_truths is not called


class WorldState(NamedTuple):
    """State of a simulated world: the states of the vehicle and of its sensors."""

    vehicle: VehicleState
    sensors: tuple[Tree, ...]  # one state per sensor, in their order


class DrawnNoise(NamedTuple):
    """Standard normals for one tick; if the tick is divided, the first axis of each array is the row."""

    vehicle: np.ndarray  # (3,)
    sensors: tuple[np.ndarray, ...]  # (noise_size,) per sensor

    def row(self, k: int) -> "DrawnNoise":
        """Return the standard normals of row `k` of the tick."""
        return DrawnNoise(self.vehicle[k], tuple(draw[k] for draw in self.sensors))


def world_init(vehicle: Vehicle, sensors: SensorBlocks, eta0: np.ndarray | None = None) -> WorldState:
    """Return the state before the first tick, at the pose `eta0` (3,) and at rest, or at a pose and velocity (6,)."""
    start = () if eta0 is None else (eta0[:3],) if len(eta0) == 3 else (eta0[:3], eta0[3:])
    return WorldState(vehicle.init(*start), tuple(sensor.init() for sensor in sensors))


def world_step(
    vehicle: Vehicle, sensors: SensorBlocks, state: WorldState, u: np.ndarray, dt_s: float, noise: DrawnNoise
) -> tuple[WorldState, Motion, ByName[Slot]]:
    """Return the state, the true motion and the readings after a tick with the command `u` (n,).  (1)"""
    return advance_rows(
        lambda state, row_s, unit: _advance_row(vehicle, sensors, state, u, row_s, unit), state, dt_s, noise
    )


def _advance_row(
    vehicle: Vehicle, sensors: SensorBlocks, state: WorldState, u: np.ndarray, dt_s: float, noise: DrawnNoise
) -> tuple[WorldState, Motion, ByName[Slot]]:
    """Return the state, the true motion and the readings after `dt_s`: a tick, or one row of a divided tick."""
    vehicle_state, motion = vehicle.step(state.vehicle, u, dt_s, noise.vehicle)
    readings = [
        s.step(x, motion, dt_s, w) for s, x, w in zip(sensors, state.sensors, noise.sensors, strict=True)
    ]
    slots = sensor_slots(tuple(sensors._fields))(*(slot for _, slot in readings))
    return WorldState(vehicle_state, tuple(x for x, _ in readings)), motion._replace(tick=None), slots


Advance = Callable[[WorldState, float, DrawnNoise], tuple[WorldState, Motion, ByName[Slot]]]


def advance_rows(
    advance: Advance, state: WorldState, dt_s: float, noise: DrawnNoise
) -> tuple[WorldState, Motion, Tree]:
    """Return the state, the true motion and the last readings after a tick, with one row per row of `noise`."""
    if noise.vehicle.ndim == 1:
        return advance(state, dt_s, noise)
    rows = noise.vehicle.shape[0]
    row_s = dt_s / rows
    state, truth, slots = advance(state, row_s, noise.row(0))
    for k in range(1, rows):
        state, truth, row_slots = advance(state, row_s, noise.row(k))
        slots = type(row_slots)(*(_last_reading(a, b, row_s) for a, b in zip(slots, row_slots, strict=True)))
    return state, truth, slots


def step_vehicle(
    vehicle: Vehicle, state: VehicleState, u: np.ndarray, dt_s: float, noise: np.ndarray
) -> tuple[VehicleState, Motion]:
    """Return the state and the true motion after a tick with one row per row of `noise` (r, 3)."""
    row_s = dt_s / len(noise)
    state, motion = vehicle.step(state, u, row_s, noise[0])
    for k in range(1, len(noise)):
        state, motion = vehicle.step(state, u, row_s, noise[k])
    return state, motion


def _last_reading(previous: Slot, slot: Slot, row_s: float) -> Slot:
    """Return the reading of this row, or, without one, the reading of an earlier row with its age plus `row_s`."""
    has_reading = slot.is_new > 0.0
    is_new: Value = np.where(has_reading, slot.is_new, previous.is_new)
    age_s: Value = np.where(has_reading, slot.age_s, previous.age_s + row_s)
    return Slot(is_new, np.where(has_reading, slot.z, previous.z), age_s)


def tick_row_count(dt_s: float) -> int:
    """Return the number of rows into which a tick of `dt_s` [s] is divided."""
    return int(row_counts(np.array(dt_s)))


def no_noise(sensors: SensorBlocks, row_count: int = 1) -> DrawnNoise:
    """Return zeros instead of standard normals, as constants, so that tracing removes the noise."""
    leading_shape = () if row_count == 1 else (row_count,)
    return DrawnNoise(
        np.zeros((*leading_shape, 3)), tuple(np.zeros((*leading_shape, s.noise_size)) for s in sensors)
    )


class _EquippedVehicle(NamedTuple):
    """A vehicle and its sensors as one block, for the engine."""

    vehicle: Vehicle
    sensors: SensorBlocks

    def step(
        self, state: WorldState, u: np.ndarray, dt_s: float, noise: DrawnNoise
    ) -> tuple[WorldState, Motion, Tree]:
        return world_step(self.vehicle, self.sensors, state, u, dt_s, noise)


class SimulatedWorld(World):
    """A simulated vehicle as a world of the loop.

    Parameters
    ----------
    vehicle : Vehicle
        The vehicle.
    sensors : NamedTuple of Sensor
        The sensors of the vehicle, by name.
    rate_hz : float
        Ticks per second.
    seed : int
        Seed of the noise.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map; (6,) for pose and body velocity.
    backend : str
        "auto", "c", "python" or "numpy".

    Notes
    -----
    Equation (1) of the module.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> world = SimulatedWorld(robot.vehicle, robot.sensors, robot.rate_hz)
    >>> world.write(Command(0, np.array([0.5, 0.0, 0.0])))
    >>> [tick.t_ns for tick in world.read(t_ns=30_000_000)]
    [10000000, 20000000, 30000000]
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensors: SensorBlocks,
        rate_hz: float = 100.0,
        seed: int = 0,
        eta0: np.ndarray | None = None,
        backend: str = "auto",
    ) -> None:
        self.commands: int = vehicle.commands
        self._state = world_init(vehicle, sensors, eta0)
        start = self._state.vehicle
        # at the last tick
        self.truth = Motion(start.eta, start.nu, start.nu_dot, vehicle.gravity(start.eta[2]))
        self._truths: deque[tuple[int, Motion]] = deque(maxlen=MAX_KEPT_TRUTHS)
        self._rate_hz, self._rows = rate_hz, tick_row_count(1.0 / rate_hz)
        self._u = np.zeros(vehicle.commands)
        self._tick = 0
        self._sizes = [3, *(s.noise_size for s in sensors)]
        self._streams = [
            random_stream(seed, PROCESS_STREAM),
            *(random_stream(seed, sensor_stream(name)) for name in sensors._fields),
        ]
        self._draws: list[np.ndarray] = []

        step = _EquippedVehicle(vehicle, sensors).step
        example = (self._state, self._u, 1.0 / rate_hz, no_noise(sensors, self._rows))
        self._step = step if backend == "numpy" else function(step, *example, backend=backend)

    def read(self, t_ns: int) -> list[Tick]:
        """Return all new ticks up to `t_ns`; their times are whole multiples of the world's period."""
        ticks = []
        while (next_ns := round((self._tick + 1) * NANOSECONDS / self._rate_hz)) <= t_ns:
            slots = self._advance(1.0 / self._rate_hz)
            ticks.append(Tick(next_ns, self._u, slots))
            self._truths.append((next_ns, self.truth))
            self._tick += 1
        return ticks

    def write(self, command: Command) -> None:
        """Set the command for the following ticks."""
        self._u = np.array(command.u, dtype=float)

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the time [ns] and the true motion of every tick since the last call."""
        truths = list(self._truths)
        self._truths.clear()
        return truths

    def _advance(self, dt_s: float) -> ByName[Slot]:
        """Advance the world by a tick and return its readings."""
        self._state, self.truth, slots = self._step(self._state, self._u, dt_s, self._noise())
        return slots

    def _noise(self) -> DrawnNoise:
        row = self._tick % BATCH_ROWS
        if row == 0:
            leading_shape = (BATCH_ROWS,) if self._rows == 1 else (BATCH_ROWS, self._rows)
            pairs = zip(self._streams, self._sizes, strict=True)
            self._draws = [generator.standard_normal((*leading_shape, size)) for generator, size in pairs]
        return DrawnNoise(self._draws[0], tuple(self._draws[1:])).row(row)
