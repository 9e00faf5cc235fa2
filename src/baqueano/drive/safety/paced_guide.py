"""Change the pace of a guide between two ticks: for caution, and for the holder. The slowest request is in force."""

from dataclasses import replace

from baqueano.contracts.values import Tree
from baqueano.guides import AtPace
from baqueano.signals import Estimate, Reference
from baqueano.supervisor import guarded


class PacedGuide:
    """A guide, and the paces that are requested of it.

    >>> from baqueano.guides import Idle
    >>> guide = PacedGuide(Idle(2.0))
    >>> guide.want("caution", 0.5)
    >>> guide.want("holder", 0.8)
    >>> guide.pace
    0.5
    """

    def __init__(self, guide: Tree) -> None:
        self.block = AtPace(guarded("guide", guide))
        self._paces: dict[str, float] = {}

    @property
    def pace(self) -> float:
        """Return the pace that is in force once the ramp has reached it."""
        return self.block.pace

    def want(self, source: str, pace: float) -> None:
        """Set the pace that `source` requests from the next tick on. Raise ValueError outside of 0 to 1."""
        replace(self.block, pace=pace)
        self._paces[source] = pace
        if (slowest := min(self._paces.values())) != self.block.pace:
            self.block = replace(self.block, pace=slowest)

    def init(self) -> Tree:
        """Return the initial state of the guide."""
        return self.block.init()

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the guide's own step, at the pace."""
        return self.block.step(state, estimate)
