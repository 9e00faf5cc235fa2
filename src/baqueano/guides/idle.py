"""The guide of experiments and drives by hand, which do not need a reference."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.signals import NANOSECONDS, Estimate, Reference

TOLERANCE_NS = 1000  # tick times are rounded to whole nanoseconds


class IdleState(NamedTuple):
    """The time of its first tick."""

    t_ns: int  # -1 before the first tick


@dataclass(frozen=True, slots=True, eq=False)
class Idle:
    """Ask for no motion: the reference is where the vehicle is. Done after `duration_s`."""

    as_written: ClassVar[bool] = True

    duration_s: float

    def init(self) -> IdleState:
        """Return the state before the first tick."""
        return IdleState(-1)

    def step(self, state: IdleState, estimate: Estimate) -> tuple[IdleState, Reference]:
        """Return the pose of the vehicle, at rest."""
        start = estimate.t_ns if state.t_ns < 0 else state.t_ns
        done = estimate.t_ns - start + TOLERANCE_NS >= self.duration_s * NANOSECONDS
        return IdleState(start), Reference(estimate.t_ns, estimate.eta, np.zeros(3), float(done))
