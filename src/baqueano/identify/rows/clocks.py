"""A sensor whose clock is not the commands': what it showed at t happened at t + o.

    h(t + o) = h_0 + Σ_k (h_k − h_{k−1}) clip((a − a_{k−1}) / (a_k − a_{k−1}), 0, 1)                       (1)

h_0 is what the model shows at the end of the row, h_k what it showed k rows before, a_k their age, and a the
age of t + o: linear between rows, whatever their steps. A measurement is read CLOCK_S after its stamp, so that o
may have either sign: from −CLOCK_S to CLOCK_S. o is found run by run; it belongs to a recording, not to a
vehicle.
"""

from typing import Any

import numpy as np

CLOCK_S = 0.25  # the largest offset of a clock that a fit looks for


def slots_for(dt_s: np.ndarray) -> int:
    """Rows of the past that offsets of ± CLOCK_S need, with steps `dt_s` (N,)."""
    return int(np.ceil(2.0 * CLOCK_S / float(np.median(dt_s)))) + 2


def with_newest(line: np.ndarray, newest: Any) -> np.ndarray:
    """The line (slots, …) one row on, newest first."""
    if line.shape[0] == 0:
        return line
    first = np.stack([newest]) if line.ndim == 1 else newest[None, :]
    return np.concatenate([first, line[:-1]])


def shown_at(
    sensor: Any, newest: np.ndarray, line: np.ndarray, steps_s: np.ndarray, age_s: Any
) -> np.ndarray:
    """What the sensor showed `age_s` ago (m,); `line` (slots, m) of the rows before, `steps_s` (slots,) from
    each row to the one before it.  (1)"""
    shown, before, age = newest, newest, 0.0
    for k in range(line.shape[0]):
        step = np.maximum(steps_s[k], 1e-9)
        part = np.clip((age_s - age) / step, 0.0, 1.0)
        shown = shown + part * difference(sensor, line[k], before)
        before, age = line[k], age + step
    return shown


def difference(sensor: Any, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """z − h (m,); a sensor of angles brings its own."""
    return sensor.difference(z, expected) if hasattr(sensor, "difference") else z - expected
