"""Fill the gaps of a recording: insert silent ticks instead of missing ticks.

An estimator integrates a stiff model from tick to tick, and an integrator with a fixed step is not stable over a gap of
seconds. With silent ticks the estimator continues to predict at its rate, and its covariance grows correctly. The
silent ticks have the command of the tick after the gap. A recording without gaps is unchanged.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from baqueano.signals import NANOSECONDS, Slot, Tick

MIN_GAP_PERIODS = 2.5  # a longer time between two ticks, in periods, is a gap
MAX_FILLED_NS = 60 * NANOSECONDS  # of a longer gap, which separates two drives, only this part is filled


def period_ns(t_ns: np.ndarray) -> int:
    """Return the median time [ns] between ticks at `t_ns` (N,), or 0 for fewer than two ticks."""
    return int(np.median(np.diff(t_ns))) if len(t_ns) > 1 else 0


def fill_gaps(ticks: Iterable[Tick], period_ns: int) -> Iterator[Tick]:
    """Yield the same ticks, with a silent tick every `period_ns` in gaps that are longer than MIN_GAP_PERIODS periods.
    In a gap longer than MAX_FILLED_NS, only the last MAX_FILLED_NS before the next tick are filled.
    """
    previous_ns: int | None = None
    for tick in ticks:
        if previous_ns is not None and 0 < MIN_GAP_PERIODS * period_ns < tick.t_ns - previous_ns:
            silent_slots = type(tick.sensors)(*(Slot(0.0, np.zeros_like(slot.z)) for slot in tick.sensors))
            start_ns = max(previous_ns, tick.t_ns - MAX_FILLED_NS)
            for t_ns in range(start_ns + period_ns, tick.t_ns - period_ns // 2, period_ns):
                yield Tick(t_ns, tick.u, silent_slots)
        previous_ns = tick.t_ns
        yield tick
