"""What a vehicle was driven with while it was fitted, and which runs go beyond.

    low_j ≤ u_j ≤ high_j   command by command, over the ticks of the runs of the fit                      (1)
    beyond: a command outside (1) by more than MARGIN (high_j − low_j)                                    (2)

A model is a fit to what was seen: motors saturate, tyres slip and batteries sag where nobody looked.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.runs.run import Run

MARGIN = 0.1
SHOWN = 0.01  # part of the ticks beyond (2) that is worth a word


class Envelope(NamedTuple):
    """The range of each command."""

    names: tuple[str, ...]  # (n,)
    low: np.ndarray  # (n,)
    high: np.ndarray  # (n,)

    @property
    def sentence(self) -> str:
        """ "throttle from -0.41 to 0.57, servo from …", of the commands that moved."""
        moved = [k for k in range(len(self.names)) if self.high[k] > self.low[k] or self.high[k] != 0.0]
        return ", ".join(f"{self.names[k]} from {self.low[k]:.2g} to {self.high[k]:.2g}" for k in moved)

    def beyond(self, run: Run) -> np.ndarray:
        """(n,) part of the ticks of a run in which each command leaves the envelope.  (2)"""
        if run.applied.shape[1] != len(self.names):
            raise UsageError(
                f"{run.name} was driven with {run.applied.shape[1]} commands, and the fit with "
                f"{', '.join(self.names)}: expected a run of the same kind of vehicle."
            )
        room = MARGIN * (self.high - self.low)
        with np.errstate(invalid="ignore"):
            out = (run.applied < self.low - room) | (run.applied > self.high + room)
        return np.asarray(np.mean(out, axis=0))

    def flags(self, run: Run) -> tuple[str, ...]:
        """A sentence for each command that leaves the envelope; none for a run that stays in it."""
        out = []
        for k, part in enumerate(self.beyond(run)):
            if part > SHOWN:
                least, most = np.nanmin(run.applied[:, k]), np.nanmax(run.applied[:, k])
                out.append(
                    f"{run.name} leaves the envelope of the fit: {self.names[k]} goes from {least:.2g} to "
                    f"{most:.2g}, {100.0 * part:.0f} % of the time beyond {self.low[k]:.2g} to {self.high[k]:.2g}, "
                    "which the model was fitted to"
                )
        return tuple(out)


def envelope_of(runs: Run | Sequence[Run], names: Sequence[str]) -> Envelope:
    """The envelope of the commands, called `names`, of one or more runs."""
    runs = [runs] if isinstance(runs, Run) else list(runs)
    u = np.concatenate([run.applied for run in runs])
    u = u[np.isfinite(u).all(axis=1)]
    if not len(u):
        raise UsageError("no run holds a command: an envelope needs what reached the motors.")
    return Envelope(tuple(names), u.min(axis=0), u.max(axis=0))
