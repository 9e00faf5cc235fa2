"""A vehicle of the truth as a world of the loop: it receives commands and returns ticks with its IMU."""

from collections.abc import Sequence

import numpy as np

from baqueano.contracts import blocks as protocols
from baqueano.signals import NANOSECONDS, Command, Motion, Slot, Tick, sensor_slots
from baqueano.study.truth import Cars, Robots, TruthWorld
from baqueano.symbolic import function

# of Runge-Kutta: a third of the shortest time constant (tyres at rest)
ROBOT_STEP_S, CAR_STEP_S = 5e-3, 1e-3
# vehicles; NumPy takes as long for one as for fifty, and more of them give a long code to compile
MAX_COMPILED_VEHICLES = 12


def make_world(
    vehicles: Robots | Cars, seeds: Sequence[int], step_s: float | None = None, eta: np.ndarray | None = None
) -> TruthWorld:
    """Return a world of the `vehicles`, at rest at the poses `eta` (n, 3) or at the origin.

    The default `step_s` is short enough to be exact. A small group is compiled.
    """
    if step_s is None:
        step_s = ROBOT_STEP_S if isinstance(vehicles, Robots) else CAR_STEP_S
    fast = function if len(seeds) <= MAX_COMPILED_VEHICLES else lambda f, *examples: f
    return TruthWorld(vehicles, seeds, eta, step_s, fast)


class LoopWorld(protocols.World):
    """A vehicle, initially at rest at the origin, with an IMU that is read `rate_hz` times per second.

    A command is applied from the next tick on; before the first one it is zero.
    """

    def __init__(self, vehicle: Robots | Cars, seed: int, rate_hz: float) -> None:
        self.commands: int = vehicle.commands
        self._world, self._rate_hz = make_world(vehicle, [seed]), rate_hz
        self._slots = sensor_slots(("imu",))
        self._u, self._count = np.zeros(vehicle.commands), 0
        self._truths: list[tuple[int, Motion]] = []
        self.motion = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))  # of the last tick

    def read(self, t_ns: int) -> list[Tick]:
        """Return all ticks up to `t_ns` that were not read yet."""
        ticks = []
        while (next_ns := round((self._count + 1) * NANOSECONDS / self._rate_hz)) <= t_ns:
            z = self._world.tick(self._u[None], 1.0 / self._rate_hz)[0]
            ticks.append(Tick(next_ns, self._u, self._slots(Slot(1.0, z))))
            eta, nu, nu_dot = (x[0] for x in self._world.truth)
            downhill = self._world.physics.gravity(eta[None, 2])[0]
            self.motion = Motion(eta, nu, nu_dot, downhill)
            self._truths.append((next_ns, self.motion))
            self._count += 1
        return ticks

    def write(self, command: Command) -> None:
        """Set the command for the following ticks."""
        self._u = np.array(command.u, dtype=float)

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return time [ns] and motion of every tick since the previous call."""
        truths, self._truths = self._truths, []
        return truths
