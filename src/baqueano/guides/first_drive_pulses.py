"""The guide of a first drive: it stays at the pose of the vehicle until the pulses are over."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.signals import Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class PulseGuide:
    """Guide that reports the end of the pulses of a first drive; the reference is the pose of the vehicle.

    Parameters
    ----------
    pulses : object
        An object with init() → state, and advance(state, estimate) → (state, u (n,), True after the last pulse).

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> class Still:
    ...     def init(self): return 0
    ...     def advance(self, state, estimate): return state + 1, np.zeros(2), state > 9
    >>> PulseGuide(Still()).step(10, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))[1].at_end
    1.0
    """

    is_interpreted: ClassVar[bool] = True

    pulses: Tree

    def init(self) -> Tree:
        """Return the state of a vehicle at rest."""
        return self.pulses.init()

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the pose of the vehicle, at rest."""
        state, _, is_over = self.pulses.advance(state, estimate)
        return state, Reference(estimate.t_ns, estimate.eta, np.zeros(3), float(is_over))
