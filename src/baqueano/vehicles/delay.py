"""A signal that comes late: a line of its past values, read between two of them.

A value held over each tick of δ seconds, delayed by d, has over one tick the mean
    v = Σ_k max(0, 1 − |d/δ − k|) v_{t−k}                                                                 (1)
whatever fraction of a tick d is: exact for a held signal, linear interpolation for a sampled one, and
differentiable in d without a branch. A delay longer than the line is read at the end of the line.
"""

import numpy as np

SHORTEST_TICK_S = 1e-9  # one count of the clock: what a tick without duration is taken for


def delayed(
    past: np.ndarray, newest: np.ndarray, delay_s: float, dt_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """The line one tick on (slots, m), newest first, and the value `delay_s` late (m,).  (1)"""
    slots = past.shape[0]
    if slots == 0:
        return past, newest
    line = np.concatenate([newest[None, :], past])
    ticks = np.minimum(delay_s / np.maximum(dt_s, SHORTEST_TICK_S), slots)
    weights = np.maximum(0.0, 1.0 - np.abs(ticks - np.arange(slots + 1)))
    return line[:-1], weights @ line


def check_delay(name: str, delay_s: float, delay_slots: int) -> None:
    """Refuses a delay for which no past is kept."""
    if not isinstance(delay_slots, int) or isinstance(delay_slots, bool) or delay_slots < 0:
        raise ValueError(f"{name}.delay_slots = {delay_slots!r}: expected a whole number, 0 or more.")
    if delay_s > 0.0 and delay_slots == 0:
        raise ValueError(
            f"{name}.delay_s = {delay_s:g} s but delay_slots = 0, so no past is kept to read it from: "
            f"give delay_slots = delay_s · rate_hz rounded up, {int(np.ceil(delay_s * 100.0))} at 100 Hz."
        )
