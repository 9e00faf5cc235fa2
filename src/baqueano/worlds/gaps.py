"""A recording with holes, made one without: where ticks are missing, silent ones are put in.

An estimator steps a stiff model from tick to tick, and no integrator of fixed step survives a hole of
seconds. With silent ticks it predicts on at its own pace, and its covariance grows as it should. The
command in force is the one that the tick after the hole reports. A recording without holes comes out
untouched.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from baqueano.signals import NANOSECONDS, Slot, Tick

HOLE = 2.5  # periods from one tick to the next that make a hole
LONGEST_NS = 60 * NANOSECONDS  # a longer hole is another drive: only so much of it is filled


def period_ns(t_ns: np.ndarray) -> int:
    """The usual time between two ticks (N,) [ns]; 0 if there are fewer than two."""
    return int(np.median(np.diff(t_ns))) if len(t_ns) > 1 else 0


def filled(ticks: Iterable[Tick], period_ns: int) -> Iterator[Tick]:
    """The same ticks, with silent ones every period in the holes."""
    before: int | None = None
    for tick in ticks:
        if before is not None and 0 < HOLE * period_ns < tick.t_ns - before:
            quiet = type(tick.sensors)(*(Slot(0.0, np.zeros_like(slot.z)) for slot in tick.sensors))
            start = max(before, tick.t_ns - LONGEST_NS)
            for t_ns in range(start + period_ns, tick.t_ns - period_ns // 2, period_ns):
                yield Tick(t_ns, tick.u, quiet)
        before = tick.t_ns
        yield tick
