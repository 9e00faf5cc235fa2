"""The controller of a first drive: it plays growing pulses by what the vehicle answers."""

from dataclasses import dataclass
from typing import ClassVar

from baqueano.contracts.values import Tree
from baqueano.signals import Command, Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class CarefulController:
    """Plays the pulses."""

    as_written: ClassVar[bool] = True

    pulses: Tree  # init(), and advance(state, estimate) -> (state, u (n,), over)

    def init(self) -> Tree:
        """Standing."""
        return self.pulses.init()

    def step(self, state: Tree, reference: Reference, estimate: Estimate) -> tuple[Tree, Command]:
        """The command (n,) of this tick."""
        state, u, _ = self.pulses.advance(state, estimate)
        return state, Command(estimate.t_ns, u)
