"""Number of independent pieces of motion in runs.

A command moves one way between two of its turning points; swings below SWING of its range are noise. A piece is such
a stretch of SHORT_S on average or more, some times the memory of a small vehicle:

    pieces = Σ_runs min(1 + turning points, max(1, T / SHORT_S))                                          (1)
    2^−pieces ≤ CHANCE  ⟺  pieces ≥ LEAST = 5                                                             (2)

Of K independent steps at most 2 (K − 2)/3 are turning points (Bienaymé 1874), so that (1) errs to the safe side. (2)
is the sign test: a model that fails in every second piece passes fewer than LEAST of them by chance too often.
"""

from collections.abc import Sequence

import numpy as np

from baqueano.identify.selection.held_out import SHORT_S
from baqueano.runs.run import Run

SWING = 0.1
CHANCE = 0.05
LEAST = int(np.ceil(-np.log2(CHANCE)))


def pieces_of(runs: Sequence[Run], command: int) -> float:
    """Independent pieces of motion of one command over all runs; 0 where it does not move.  (1)"""
    u = [run.applied[np.isfinite(run.applied[:, command]), command] for run in runs]
    every = np.concatenate([np.zeros(1), *u])
    swing = SWING * float(np.ptp(every))
    out = 0.0
    for run, x in zip(runs, u, strict=True):
        if np.any(x != 0.0):
            out += min(1.0 + turning_points(x, swing), max(1.0, _lasts(run) / SHORT_S))
    return out


def _lasts(run: Run) -> float:
    """Return the length of all its ticks [s], the first one too."""
    return run.duration_s * len(run.t_ns) / max(1, len(run.t_ns) - 1)


def turning_points(x: np.ndarray, swing: float) -> int:
    """Return the number of turning points of x (N,), without swings smaller than `swing`."""
    count, way, low, high = 0, 0, x[0], x[0]
    for value in x[np.flatnonzero(np.diff(x, prepend=np.nan) != 0.0)]:
        low, high = min(low, value), max(high, value)
        if way >= 0 and high - value > swing:
            count, way, low, high = count + (way > 0), -1, value, value
        elif way <= 0 and value - low > swing:
            count, way, low, high = count + (way < 0), 1, value, value
    return count
