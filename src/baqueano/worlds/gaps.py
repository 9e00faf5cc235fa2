"""Fill the gaps of a recording: insert silent ticks where ticks are missing.

An estimator integrates a stiff model from tick to tick, and an integrator with a fixed step is not stable over a gap of
seconds. With silent ticks the estimator continues to predict at its rate, and its covariance grows correctly. The
silent ticks have the command of the tick after the gap. A recording without gaps is unchanged.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from baqueano.signals import NANOSECONDS, Slot, Tick

HOLE = 2.5  # periods from one tick to the next that make a hole
LONGEST_NS = 60 * NANOSECONDS  # of a longer hole, which separates two drives, only this much is filled


def period_ns(t_ns: np.ndarray) -> int:
    """Return the median time [ns] between ticks at `t_ns` (N,), or 0 for fewer than two ticks."""
    return int(np.median(np.diff(t_ns))) if len(t_ns) > 1 else 0


def fill_gaps(ticks: Iterable[Tick], period_ns: int) -> Iterator[Tick]:
    """Yield the same ticks, with a silent tick every `period_ns` in gaps that are longer than HOLE periods.
    In a gap longer than LONGEST_NS, only the last LONGEST_NS before the next tick are filled.
    """
    before: int | None = None
    for tick in ticks:
        if before is not None and 0 < HOLE * period_ns < tick.t_ns - before:
            quiet = type(tick.sensors)(*(Slot(0.0, np.zeros_like(slot.z)) for slot in tick.sensors))
            start = max(before, tick.t_ns - LONGEST_NS)
            for t_ns in range(start + period_ns, tick.t_ns - period_ns // 2, period_ns):
                yield Tick(t_ns, tick.u, quiet)
        before = tick.t_ns
        yield tick
