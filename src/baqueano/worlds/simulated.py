"""Simulate a vehicle with its sensors, as a world of the loop and as one pure step.

  state, truth, slots = world_step(vehicle, sensors, state, u, dt_s, noise)                              (1)

The same step runs in a kernel (simulate/) and here tick by tick, with the same noise: tick k of a simulated world and
tick k of a simulated run with the same seed and commands have the same numbers.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from baqueano.contracts.blocks import SensorBlocks, World
from baqueano.contracts.values import Tree
from baqueano.signals import NANOSECONDS, ByName, Command, Motion, Slot, Tick, sensor_slots
from baqueano.symbolic import function
from baqueano.vehicles.state import Vehicle, VehicleState
from baqueano.worlds.noise import PROCESS, sensor_stream, stream

BATCH = 256  # rows of noise drawn at a time
UNASKED = 10_000  # truths that are kept if new_truths is not called


class WorldState(NamedTuple):
    """State of a simulated world."""

    vehicle: VehicleState
    sensors: tuple[Tree, ...]  # one state per sensor, in their order


class DrawnNoise(NamedTuple):
    """Unit normals for one tick."""

    vehicle: np.ndarray  # (3,)
    sensors: tuple[np.ndarray, ...]  # (noise_size,) per sensor


def world_init(vehicle: Vehicle, sensors: SensorBlocks, eta0: np.ndarray | None = None) -> WorldState:
    """Return the state of a vehicle at rest at the pose `eta0` (3,), with sensors just switched on."""
    return WorldState(vehicle.init(eta0), tuple(sensor.init() for sensor in sensors))


def world_step(
    vehicle: Vehicle,
    sensors: SensorBlocks,
    state: WorldState,
    u: np.ndarray,
    dt_s: float,
    noise: DrawnNoise,
) -> tuple[WorldState, Motion, ByName[Slot]]:
    """Advance by a tick under the command `u` (n,); return state, truth, and the readings at its end.  (1)"""
    body, motion = vehicle.step(state.vehicle, u, dt_s, noise.vehicle)
    readings = [
        s.step(x, motion, dt_s, w) for s, x, w in zip(sensors, state.sensors, noise.sensors, strict=True)
    ]
    slots = sensor_slots(tuple(sensors._fields))(*(slot for _, slot in readings))
    return WorldState(body, tuple(x for x, _ in readings)), motion._replace(tick=None), slots


def no_noise(sensors: SensorBlocks) -> DrawnNoise:
    """Return zeros in place of unit normals."""
    return DrawnNoise(np.zeros(3), tuple(np.zeros(s.noise_size) for s in sensors))


class _VehicleWithSensors(NamedTuple):
    """A vehicle and its sensors as one block."""

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
        Ticks a second.
    seed : int
        Seed of the noise.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map.
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
        start = vehicle.init(eta0)
        self.truth = Motion(
            start.eta, start.nu, start.nu_dot, vehicle.gravity(start.eta[2])
        )  # at the last tick
        self._truths: deque[tuple[int, Motion]] = deque(maxlen=UNASKED)
        self._rate_hz = rate_hz
        self._state = world_init(vehicle, sensors, eta0)
        self._u = np.zeros(vehicle.commands)
        self._tick = 0
        self._sizes = [3, *(s.noise_size for s in sensors)]
        self._streams = [
            stream(seed, PROCESS),
            *(stream(seed, sensor_stream(name)) for name in sensors._fields),
        ]
        self._draws: list[np.ndarray] = []

        step = _VehicleWithSensors(vehicle, sensors).step
        example = (self._state, self._u, 1.0 / rate_hz, no_noise(sensors))
        self._step = step if backend == "numpy" else function(step, *example, backend=backend)

    def read(self, t_ns: int) -> list[Tick]:
        """Return all ticks up to `t_ns`; their times are whole multiples of the world's own period."""
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
        """Return time [ns] and truth of every tick since the last call."""
        truths = list(self._truths)
        self._truths.clear()
        return truths

    def _advance(self, dt_s: float) -> ByName[Slot]:
        """Advance by a tick and return its readings."""
        self._state, self.truth, slots = self._step(self._state, self._u, dt_s, self._noise())
        return slots

    def _noise(self) -> DrawnNoise:
        row = self._tick % BATCH
        if row == 0:
            pairs = zip(self._streams, self._sizes, strict=True)
            self._draws = [generator.standard_normal((BATCH, size)) for generator, size in pairs]
        return DrawnNoise(self._draws[0][row], tuple(draw[row] for draw in self._draws[1:]))
