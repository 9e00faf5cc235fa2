"""Blocks that play what was decided before: a signal, a recording, a hand on the keys.

They stand in a loop where the paper's guide and controller would: an experiment and a drive by hand run
through the same loop, the same supervisor and into the same run as everything else.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.drive.careful import CarefulController, CarefulGuide, Feel
from baqueano.drive.heading_hold import HeadingHold
from baqueano.errors import FromOutside
from baqueano.signals import NANOSECONDS, Command, Estimate, Reference

TOLERANCE_NS = 1000  # tick times are rounded to whole nanoseconds


class Start(NamedTuple):
    """When it began."""

    t_ns: int  # -1 before the first tick


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """A controller that plays commands in time, whatever is estimated; each holds until the next one's
    time."""

    t_ns: np.ndarray  # (N,) int64, from 0 at the first tick, increasing
    u: np.ndarray  # (N, n)

    @classmethod
    def at_rate(cls, u: np.ndarray, rate_hz: float) -> "Schedule":
        """One command per tick."""
        return cls(
            np.round(np.arange(len(u)) * (NANOSECONDS / rate_hz)).astype(np.int64), np.array(u, dtype=float)
        )

    def init(self) -> Start:
        """Not begun."""
        return Start(-1)

    def step(self, state: Start, reference: Reference, estimate: Estimate) -> tuple[Start, Command]:
        """The command (n,) of this time."""
        start = estimate.t_ns if state.t_ns < 0 else state.t_ns
        k = int(np.searchsorted(self.t_ns, estimate.t_ns - start + TOLERANCE_NS, side="right")) - 1
        return Start(start), Command(estimate.t_ns, self.u[max(k, 0)])


@dataclass(frozen=True, slots=True, eq=False)
class Idle:
    """A guide that asks for nothing: the reference is where the vehicle is. Done after `duration_s`."""

    duration_s: float

    def init(self) -> Start:
        """Not begun."""
        return Start(-1)

    def step(self, state: Start, estimate: Estimate) -> tuple[Start, Reference]:
        """Here, at rest."""
        start = estimate.t_ns if state.t_ns < 0 else state.t_ns
        done = estimate.t_ns - start + TOLERANCE_NS >= self.duration_s * NANOSECONDS
        return Start(start), Reference(estimate.t_ns, estimate.eta, np.zeros(3), float(done))


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A guide that says again, bit for bit, what a guide said in a run."""

    t_ns: np.ndarray  # (N,) int64
    eta: np.ndarray  # (N, 3)
    nu: np.ndarray  # (N, 3)
    done: np.ndarray  # (N,)

    def init(self) -> None:
        """Nothing to remember."""

    def step(self, state: None, estimate: Estimate) -> tuple[None, Reference]:
        """What was said at this time."""
        k = max(int(np.searchsorted(self.t_ns, estimate.t_ns, side="right")) - 1, 0)
        return None, Reference(estimate.t_ns, self.eta[k], self.nu[k], float(self.done[k]))


class Ended(FromOutside, KeyboardInterrupt):
    """A person who drives ended the drive."""


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """A controller that asks a person. It is the one block that is not pure: a run of it is replayed from the
    commands that were recorded."""

    ask: Callable[[], Any]  # the command (n,) that is wanted now; KeyboardInterrupt ends the drive

    def init(self) -> None:
        """Nothing to remember."""

    def step(self, state: None, reference: Reference, estimate: Estimate) -> tuple[None, Command]:
        """What the person wants."""
        try:
            return None, Command(estimate.t_ns, np.array(self.ask(), dtype=float))
        except KeyboardInterrupt as end:
            raise Ended from end


Scripted = (  # these run as they are written
    Schedule | Idle | Recorded | Hand | HeadingHold | Feel | CarefulGuide | CarefulController
)
