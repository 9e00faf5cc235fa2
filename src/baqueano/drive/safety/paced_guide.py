"""Change the pace of a guide between two ticks, for `Caution` and for the driver; the slowest request is used."""

from dataclasses import replace

from baqueano.contracts.values import Tree
from baqueano.guides import DriveTo, GuideAtPace
from baqueano.signals import Estimate, Reference
from baqueano.supervisor import with_guarded_parts


class PacedGuide:
    """A wrapper of a guide. The reference advances at the slowest of the requested paces.

    `lead_in` contains the limits of the path from a vehicle that was moved in a pause to its route.

    >>> from baqueano.guides import Idle
    >>> guide = PacedGuide(Idle(2.0))
    >>> guide.set_pace("caution", 0.5)
    >>> guide.set_pace("holder", 0.8)
    >>> guide.pace
    0.5
    """

    def __init__(self, guide: Tree, lead_in: DriveTo | None = None) -> None:
        self.block = with_guarded_parts("guide", GuideAtPace(guide, lead_in=lead_in), 0)
        self._paces: dict[str, float] = {}

    @property
    def pace(self) -> float:
        """Return the pace that the guide reaches at the end of its ramp."""
        return self.block.pace

    def set_pace(self, source: str, pace: float) -> None:
        """Set the pace that `source` requests from the next tick on. Raise ValueError if it is not in [0, 1]."""
        if self._paces.get(source) == pace:  # almost every tick: a new block would check its bounds again
            return
        replace(self.block, pace=pace)
        self._paces[source] = pace
        if (min_pace := min(self._paces.values())) != self.block.pace:
            self.block = replace(self.block, pace=min_pace)

    def init(self) -> Tree:
        """Return the initial state of the guide."""
        return self.block.init()

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the new state and the reference of the guide at its pace."""
        return self.block.step(state, estimate)
