"""Promises of the blocks to each other, and of the world to the loop. What travels between them is in signals.py.

No block derives from these: a class of yours with the methods named here is served as ours are. What a block may leave
out besides is in optional.py, with the value that stands for it. A vehicle's promise is `vehicles.Vehicle`.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.signals import ByName, Command, Estimate, Motion, Reference, Slot, Tick


class Block(Protocol):
    """Any block: a state, and a step from one tick to the next.

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
        """The state before the first tick."""
        ...

    @property
    def step(self) -> Callable[..., Tree]:
        """Return (the next state, the output) of a tick."""
        ...


OwnBlock: TypeAlias = str | type | Block  # a kind or "file.py:Class", a class, or the block itself


class Sensor(Protocol):
    """A sensor, as the world, the estimators and the fit use it. m = `size`.

    Examples
    --------
    >>> gyro: Sensor = bq.sensors.Imu()
    >>> gyro.size, gyro.rate_hz
    (3, 100.0)
    """

    @property
    def size(self) -> int:
        """m, the length of a measurement."""
        ...

    @property
    def noise_size(self) -> int:
        """Unit normals that `step` takes."""
        ...

    @property
    def rate_hz(self) -> float:
        """Measurements a second."""
        ...

    @property
    def delay_s(self) -> float:
        """Age of the signal when it is read."""
        ...

    @property
    def cov(self) -> np.ndarray:
        """Q (m, m): the covariance of one measurement."""
        ...

    def h(self, motion: Motion) -> np.ndarray:
        """The measurement (m,) without noise: what estimators and the fit believe."""
        ...

    def init(self) -> Tree:
        """A sensor just switched on."""
        ...

    def step(self, state: Tree, motion: Motion, dt_s: float, noise: np.ndarray) -> tuple[Tree, Slot]:
        """Return the reading at the end of a tick; `noise` (noise_size,) are unit normals."""
        ...


SensorBlocks: TypeAlias = ByName[Sensor]  # the sensors of a vehicle


class Estimator(Protocol):
    """Measurements → estimate.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> estimator: Estimator = robot.estimator()
    >>> belief = estimator.init(np.array([1.0, 0.0, 0.0]))
    """

    @property
    def init(self) -> Callable[..., Tree]:
        """`init()` or `init(eta)` or `init(eta, nu)`: the belief before the first tick, from the pose and the velocity
        (3,) at the start where it takes them."""
        ...

    def step(self, belief: Tree, tick: Tick, /) -> tuple[Tree, Estimate]:
        """Return the next belief, and η, ν (3,) with their covariance (6, 6)."""
        ...


@runtime_checkable
class Guide(Protocol):
    """Estimate → reference.

    Examples
    --------
    >>> guide: Guide = bq.guides.Idle(duration_s=2.0)
    >>> state, reference = guide.step(guide.init(), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> reference.nu
    array([0., 0., 0.])
    """

    def init(self) -> Tree:
        """The state before the first tick."""
        ...

    def step(self, state: Tree, estimate: Estimate, /) -> tuple[Tree, Reference]:
        """Return the next state, and the wanted pose and velocity, (3,) each."""
        ...


class Controller(Protocol):
    """Reference → command.

    Examples
    --------
    >>> law: Controller = bq.controllers.Pd(alpha=4.0, beta=1.0)
    >>> here = Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    >>> state, command = law.step(law.init(), Reference(0, np.array([0.1, 0.0, 0.0]), np.zeros(3), 0.0), here)
    >>> print(command.u)
    [0.4 0.  0. ]
    """

    def init(self) -> Tree:
        """The state before the first tick."""
        ...

    def step(self, state: Tree, reference: Reference, estimate: Estimate, /) -> tuple[Tree, Command]:
        """Return the next state, and u (n,) with the stamp of the estimate."""
        ...


class Supervision(Protocol):
    """The block that decides last before the motors; `supervisor.Supervisor` is ours.

    Examples
    --------
    >>> stop: Supervision = bq.load("small").supervisor()
    >>> state = stop.init()
    """

    def init(self) -> Tree:
        """Not stopped."""
        ...

    def step(self, state: Tree, command: Command, tick: Tick, estimate: Estimate, /) -> tuple[Tree, Command]:
        """Return the next state, and the command (n,) that may reach the motors."""
        ...


class World(Protocol):
    """A world in which the loop runs: simulated, replayed, or the real robot.

    The defaults stand for a world that does not measure or count these things.

    Examples
    --------
    >>> world: World = bq.worlds.SimulatedWorld(bq.load("small").vehicle, bq.load("small").sensors, 100.0)
    >>> world.commands
    3
    """

    commands: int  # n, the length of a command
    notes: Sequence[Diagnostic | str] = ()  # for the beginning of a run

    def read(self, t_ns: int) -> list[Tick]:
        """Return the ticks since the last call, in order; the last one is stamped `t_ns`."""
        ...

    def write(self, command: Command) -> None:
        """Sends a command to the motors."""
        ...

    def new_truths(self) -> list[tuple[int, Motion]]:
        """Time [ns] and motion, as far as this world knows it, since this was last asked."""
        return []

    def new_channels(self) -> list[tuple[str, int, np.ndarray]]:
        """Name, time [ns] and value of what no sensor of the vehicle holds, since this was last asked."""
        return []

    def new_events(self) -> list[tuple[int, Diagnostic | str]]:
        """Time [ns] of what happened, and what, to the hardware, since this was last asked."""
        return []
