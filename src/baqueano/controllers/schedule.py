"""Send commands from a list, each at its time, for an experiment or from a recording.

`Schedule` replaces the controller in the loop. So an experiment has the same loop, the same supervisor and the same
kind of run as any other drive.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.signals import NANOSECONDS, Command, Estimate, Reference

TOLERANCE_NS = 1000  # tick times are rounded to whole nanoseconds


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

    as_written: ClassVar[bool] = True

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
        k = int(np.searchsorted(self.t_ns, estimate.t_ns - start + TOLERANCE_NS, side="right")) - 1
        return ScheduleState(start), Command(estimate.t_ns, self.u[max(k, 0)])
