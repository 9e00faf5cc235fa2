"""A run as a world of the loop: it says again what it said, whatever is commanded.

The blocks see the ticks of the run, with the commands that reached the motors then. So estimates are
comparable between estimators, and the same blocks give the same numbers, bit for bit.
"""

from collections.abc import Iterable

from baqueano.signals import Command, Tick


class Replayed:
    """A world of the loop made of recorded ticks."""

    def __init__(self, ticks: Iterable[Tick]) -> None:
        self._ticks = list(ticks)
        if not self._ticks:
            raise ValueError("no tick to replay: the run is empty.")
        self._next = 0
        self.commands: int = len(self._ticks[0].u)

    @property
    def times(self) -> list[int]:
        """The clock of this world: the times of its ticks [ns]."""
        return [tick.t_ns for tick in self._ticks]

    def read(self, t_ns: int) -> list[Tick]:
        """The recorded ticks after the last one, up to `t_ns`."""
        first = self._next
        while self._next < len(self._ticks) and self._ticks[self._next].t_ns <= t_ns:
            self._next += 1
        return self._ticks[first : self._next]

    def write(self, command: Command) -> None:
        """Moves nothing: what happened has happened."""
