"""The guide of a first drive: it stays where the vehicle is until the pulses are over."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.signals import Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class CarefulGuide:
    """Says when the pulses are over; asks for nothing else."""

    as_written: ClassVar[bool] = True

    pulses: Tree  # init(), and advance(state, estimate) -> (state, u (n,), over)

    def init(self) -> Tree:
        """Standing."""
        return self.pulses.init()

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Here, at rest."""
        state, _, over = self.pulses.advance(state, estimate)
        return state, Reference(estimate.t_ns, estimate.eta, np.zeros(3), float(over))
