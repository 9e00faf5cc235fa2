"""The controller of a first drive: it sends growing pulses, and adapts them to the response of the vehicle."""

from dataclasses import dataclass
from typing import ClassVar

from baqueano.contracts.values import Tree
from baqueano.signals import Command, Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class PulseController:
    """Controller that sends the pulses of a first drive.

    Parameters
    ----------
    pulses : object
        An object with init() → state, and advance(state, estimate) → (state, u (n,), True after the last pulse).

    Examples
    --------
    `first_drive` builds this controller. Its command is the command of the pulses.

    >>> from baqueano.signals import Estimate
    >>> class Still:
    ...     def init(self): return 0
    ...     def advance(self, state, estimate): return state + 1, np.zeros(2), state > 9
    >>> state, command = PulseController(Still()).step(0, None, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))
    >>> command.u
    array([0., 0.])
    """

    is_interpreted: ClassVar[bool] = True

    pulses: Tree

    def init(self) -> Tree:
        """Return the state of a vehicle at rest."""
        return self.pulses.init()

    def step(self, state: Tree, reference: Reference, estimate: Estimate) -> tuple[Tree, Command]:
        """Return the state and the command (n,) of this tick."""
        state, u, _ = self.pulses.advance(state, estimate)
        return state, Command(estimate.t_ns, u)
