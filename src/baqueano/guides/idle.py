"""The guide of experiments and manual drives, which do not need a reference."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.signals import NANOSECONDS, TICK_TOLERANCE_NS, Estimate, Reference


class IdleState(NamedTuple):
    """State of an idle guide: the time of the first tick."""

    t_ns: int  # -1 before the first tick


@dataclass(frozen=True, slots=True, eq=False)
class Idle:
    """Guide without motion: the reference is the pose of the vehicle, at rest. The guide is done after `duration_s`.

    Parameters
    ----------
    duration_s : float
        Time from the first tick to the end.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> guide = Idle(2.0)
    >>> here = Estimate(0, np.array([1.0, 0.0, 0.0]), np.zeros(3), np.eye(6))
    >>> state, reference = guide.step(guide.init(), here)
    >>> print(reference.eta, guide.step(state, here._replace(t_ns=2_000_000_000))[1].at_end)
    [1. 0. 0.] 1.0
    """

    is_interpreted: ClassVar[bool] = True

    duration_s: float

    def init(self) -> IdleState:
        """Return the state before the first tick."""
        return IdleState(-1)

    def step(self, state: IdleState, estimate: Estimate) -> tuple[IdleState, Reference]:
        """Return the state, and the pose of the vehicle, at rest."""
        start_ns: Value = np.where(state.t_ns < 0, estimate.t_ns, state.t_ns)
        waited_ns = estimate.t_ns - start_ns + TICK_TOLERANCE_NS
        is_over: Value = np.where(waited_ns >= self.duration_s * NANOSECONDS, 1.0, 0.0)
        return IdleState(start_ns), Reference(estimate.t_ns, estimate.eta, np.zeros(3), is_over)
