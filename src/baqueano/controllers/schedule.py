"""Send commands from a list, each at its time, for an experiment or from a recording.

`Schedule` replaces the controller in the loop. So an experiment has the same loop, the same supervisor and the same
kind of run as any other drive. `DelayedController` sends zero commands at first, and then runs a controller.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Controller
from baqueano.contracts.values import Tree
from baqueano.errors import UsageError
from baqueano.signals import NANOSECONDS, TICK_TOLERANCE_NS, Command, Estimate, Reference
from baqueano.symbolic import branch


class ScheduleState(NamedTuple):
    """State of a schedule: the time of the first tick."""

    t_ns: int  # -1 before the first tick


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """Controller that sends each command at its time and ignores the estimate; a command lasts until the next.

    Parameters
    ----------
    t_ns : ndarray (N,)
        Times since the first tick, int64, increasing from 0.
    u : ndarray (N, n) [unit of u]
        The commands.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> plan = Schedule.at_rate(np.array([[0.1, 0.0], [0.2, 0.0]]), rate_hz=50.0)
    >>> here = Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    >>> state, command = plan.step(plan.init(), None, here)
    >>> plan.step(state, None, here._replace(t_ns=20_000_000))[1].u
    array([0.2, 0. ])
    """

    is_interpreted: ClassVar[bool] = True

    t_ns: np.ndarray
    u: np.ndarray

    @classmethod
    def at_rate(cls, u: np.ndarray, rate_hz: float) -> "Schedule":
        """Return the schedule of the commands `u` (N, n) at the constant rate `rate_hz`."""
        return cls(
            np.round(np.arange(len(u)) * (NANOSECONDS / rate_hz)).astype(np.int64), np.array(u, dtype=float)
        )

    def init(self) -> ScheduleState:
        """Return the state before the first tick."""
        return ScheduleState(-1)

    def step(
        self, state: ScheduleState, reference: Reference, estimate: Estimate
    ) -> tuple[ScheduleState, Command]:
        """Return the state and the command (n,) for the time of the estimate."""
        start = estimate.t_ns if state.t_ns < 0 else state.t_ns
        k = int(np.searchsorted(self.t_ns, estimate.t_ns - start + TICK_TOLERANCE_NS, side="right")) - 1
        return ScheduleState(start), Command(estimate.t_ns, self.u[max(k, 0)])


class DelayedControllerState(NamedTuple):
    """State of a delayed controller: the time of the first tick, and the state of the inner controller."""

    t_ns: int  # -1 before the first tick
    controller: Tree


@dataclass(frozen=True, slots=True, eq=False)
class DelayedController:
    """Controller that sends zero commands for `rest_s`, and then runs another controller.

    Parameters
    ----------
    controller : Controller
        The controller that runs after the rest.
    rest_s : float
        Duration of the rest [s].
    commands : int
        Number n of commands.

    Notes
    -----
    At rest with commands of exactly zero, a filter measures the bias of the gyro.

    Examples
    --------
    >>> robot = bq.load("small")
    >>> resting = DelayedController(robot.controller(), 2.0, 3)
    >>> beside, start = Reference(0, np.ones(3), np.zeros(3), 0.0), Estimate(0, np.zeros(3), np.zeros(3), np.eye(6))
    >>> print(resting.step(resting.init(), beside, start)[1].u)
    [0. 0. 0.]
    """

    inner_blocks: ClassVar[tuple[str, ...]] = ("controller",)

    controller: Controller
    rest_s: float
    commands: int

    def init(self) -> DelayedControllerState:
        """Return the state before the first tick."""
        return DelayedControllerState(-1, self.controller.init())

    def step(self, state: Tree, reference: Reference, estimate: Estimate) -> tuple[Tree, Command]:
        """Return the state, and the command (n,)."""
        start_ns = branch(state.t_ns < 0, lambda: estimate.t_ns, lambda: state.t_ns)
        is_resting = estimate.t_ns - start_ns + TICK_TOLERANCE_NS < self.rest_s * NANOSECONDS
        inner_state, command = branch(
            is_resting,
            lambda: (state.controller, Command(estimate.t_ns, np.zeros(self.commands))),
            lambda: self.controller.step(state.controller, reference, estimate),
        )
        return DelayedControllerState(start_ns, inner_state), command


def script_commands(steps: Sequence[tuple[float, Sequence[float]]], n: int, rate_hz: float) -> np.ndarray:
    """Return the commands (N, n) of a script [(seconds, command), …], one row per tick.

    Raise UsageError for a malformed entry.
    """
    rows = []
    for k, step in enumerate(steps):
        try:
            duration_s, u = float(step[0]), np.array(step[1], dtype=float)
        except (TypeError, ValueError, IndexError) as error:
            raise UsageError.of("drive.step-pair", number=k + 1, value=repr(step)) from error
        if u.shape != (n,) or not (0.0 < duration_s < np.inf and np.all(np.isfinite(u))):
            raise UsageError.of("drive.step-numbers", number=k + 1, value=repr(step), commands=n)
        rows.append(np.tile(u, (max(1, round(duration_s * rate_hz)), 1)))
    if not rows:
        raise UsageError.of("drive.no-steps")
    return np.concatenate(rows)
