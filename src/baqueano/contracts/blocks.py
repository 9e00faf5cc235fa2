"""Define the contracts between the blocks, and between the world and the loop. signals.py defines the signals.

Blocks do not derive from these classes: your own class with these methods works like a class of the package. Optional
attributes of a block are in optional.py, with their defaults. The contract of a vehicle is `vehicles.Vehicle`.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.signals import ByName, Command, Estimate, Motion, Reference, Slot, Tick


class Block(Protocol):
    """Protocol of any block: a state, and a step from one tick to the next.

    Examples
    --------
    >>> class Counter:
    ...     def init(self):
    ...         return 0
    ...     def step(self, state, *inputs):
    ...         return state + 1, state
    >>> block: Block = Counter()
    >>> block.step(block.init())
    (1, 0)
    """

    @property
    def init(self) -> Callable[..., Tree]:
        """Return the function that returns the state before the first tick."""
        ...

    @property
    def step(self) -> Callable[..., Tree]:
        """Return the function that computes the next state and the output of a tick."""
        ...


STEP_INPUTS = {  # role in the loop → inputs of its step, after the state
    "estimator": ("tick",),
    "guide": ("estimate",),
    "controller": ("reference", "estimate"),
    "supervisor": ("command", "tick", "estimate"),
}
OwnBlock: TypeAlias = str | type | Block  # a kind or "file.py:Class", a class, or the block itself


class Sensor(Protocol):
    """Protocol of a sensor for the world, the estimators and the fit. m = `size`.

    A fit writes the noise that it measures into the field `measurement_noise_cov` (m, m), and `cov` returns it.

    Examples
    --------
    >>> gyro: Sensor = bq.sensors.Imu()
    >>> gyro.size, gyro.rate_hz
    (3, 100.0)
    """

    @property
    def size(self) -> int:
        """Return m, the length of a measurement."""
        ...

    @property
    def noise_size(self) -> int:
        """Return the number of standard normals that `step` needs."""
        ...

    @property
    def rate_hz(self) -> float:
        """Return the rate of measurements [Hz]."""
        ...

    @property
    def delay_s(self) -> float:
        """Return the age [s] of the measured motion when the reading arrives."""
        ...

    @property
    def cov(self) -> np.ndarray:
        """Return Q (m, m), the covariance of one measurement."""
        ...

    def h(self, motion: Motion) -> np.ndarray:
        """Return the measurement (m,) without noise, as estimators and the fit model it."""
        ...

    def init(self) -> Tree:
        """Return the state before the first tick."""
        ...

    def step(self, state: Tree, motion: Motion, dt_s: float, noise: np.ndarray) -> tuple[Tree, Slot]:
        """Return the next state and the reading at the end of a tick; `noise` (noise_size,) is standard normal."""
        ...


SensorBlocks: TypeAlias = ByName[Sensor]  # the sensors of a vehicle


class Estimator(Protocol):
    """Protocol of an estimator, which computes an estimate from measurements.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> estimator: Estimator = robot.estimator()
    >>> belief = estimator.init(np.array([1.0, 0.0, 0.0]))
    """

    @property
    def init(self) -> Callable[..., Tree]:
        """Return the function that returns the belief before the first tick.

        The function can have the arguments `eta` (3,) and `nu` (3,): the pose in the map and the velocity in the
        body at the start.
        """
        ...

    def step(self, belief: Tree, tick: Tick, /) -> tuple[Tree, Estimate]:
        """Return the next belief, and the estimate: η (3,) in the map, ν (3,) in the body, and covariance (6, 6)."""
        ...


@runtime_checkable
class Guide(Protocol):
    """Protocol of a guide, which computes a reference from an estimate.

    Examples
    --------
    >>> guide: Guide = bq.guides.Idle(duration_s=2.0)
    >>> state, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> reference.nu
    array([0., 0., 0.])
    """

    def init(self) -> Tree:
        """Return the state before the first tick."""
        ...

    def step(self, state: Tree, estimate: Estimate, /) -> tuple[Tree, Reference]:
        """Return the next state, and the reference: the desired pose (3,) in the map and velocity (3,) in the body."""
        ...


class Controller(Protocol):
    """Protocol of a controller, which computes a command from a reference and an estimate.

    Examples
    --------
    >>> law: Controller = bq.controllers.Pd(alpha=4.0, beta=1.0)
    >>> here = Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    >>> state, command = law.step(law.init(), Reference(0, np.array([0.1, 0.0, 0.0]), np.zeros(3), 0.0), here)
    >>> print(command.u)
    [0.4 0.  0. ]
    """

    def init(self) -> Tree:
        """Return the state before the first tick."""
        ...

    def step(self, state: Tree, reference: Reference, estimate: Estimate, /) -> tuple[Tree, Command]:
        """Return the next state, and the command u (n,) with the timestamp of the estimate."""
        ...


class Supervision(Protocol):
    """Protocol of a supervisor, the last block before the motors; the package contains `supervisor.Supervisor`.

    Examples
    --------
    >>> stop: Supervision = bq.load("small").supervisor()
    >>> state = stop.init()
    """

    def init(self) -> Tree:
        """Return the state before the first tick: not stopped."""
        ...

    def step(self, state: Tree, command: Command, tick: Tick, estimate: Estimate, /) -> tuple[Tree, Command]:
        """Return the next state, and the command (n,) that is allowed to reach the motors."""
        ...


class World(Protocol):
    """Protocol of a world in which the loop runs: simulated, replayed, or the real robot.

    The defaults of attributes and methods are for a world without these quantities.

    Examples
    --------
    >>> world: World = bq.worlds.SimulatedWorld(bq.load("small").vehicle, bq.load("small").sensors, 100.0)
    >>> world.commands
    3
    """

    commands: int  # n, the length of a command
    notes: Sequence[Diagnostic | str] = ()  # messages for the beginning of a run

    def read(self, t_ns: int) -> list[Tick]:
        """Return the ticks since the last call, in order; the last one has the timestamp `t_ns`."""
        ...

    def write(self, command: Command) -> None:
        """Send a command to the motors."""
        ...

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Return the time [ns] and the true motion of each tick since the last call; empty if this is not available."""
        return []

    def new_channels(self) -> list[tuple[str, int, np.ndarray]]:
        """Return the name, time [ns] and value of quantities without a `Sensor` (a voltage) since the last call."""
        return []

    def new_events(self) -> list[tuple[int, Diagnostic | str]]:
        """Return the time [ns] and the message of the events of the hardware since the last call."""
        return []
