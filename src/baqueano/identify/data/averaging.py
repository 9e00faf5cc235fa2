"""Compare a reading that is a mean over an interval, as a rate from two counts, with the mean of h over that interval.

    h̄ = 1/(e − b) ∫ h dt from b to e                                                                      (1)
    ∫ h dt over the part [p, q] of a row = w · (h at its begin, middle and end),   w exact for a parabola  (2)
    h̄ = a s + w_c · h,    s ← (1 − a) s + w_n · h                                                         (3)

s sums the rows of an interval before its last row, in which the reading ends (a = 1, else 0). w_c is the part of this
reading in the row, w_n the part of the next reading, both divided by e − b. An interval is centred at the timestamp. An
imported rate arrives with its later count, at e. The intervals of other readings touch, so each lasts as long as the
shorter step to its neighbours. In a row without a reading h̄ is h at its end. A sensor with a delay line has one value
per row in it, the mean of the row.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.values import Tree, Value
from baqueano.runs.run import MEANS_KEY, Run
from baqueano.sensors.sampling import delayed_signal
from baqueano.signals import Motion, seconds
from baqueano.vehicles.delay import delayed_value

SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0
END_WEIGHT = np.array([0.0, 0.0, 1.0])
WEIGHT_COLUMNS = 7  # w_c, w_n and a of (3)
ROW_MEAN = np.append(SIMPSON, np.zeros(WEIGHT_COLUMNS - 3))  # the weights of the mean over a whole row
INTERVAL_TOLERANCE_S = 1e-7  # rounding of timestamps to whole nanoseconds


class AveragedSignal(NamedTuple):
    """State of a sensor of means between two rows: the fields of `Signal`, and two more."""

    past_values: np.ndarray  # (delay_slots, m) means of the previous rows, newest first
    steps_s: np.ndarray  # (delay_slots,)
    low_passed: np.ndarray  # (0,)
    total: np.ndarray  # s (m,)
    previous_h: np.ndarray  # (m,) h at the end of the previous row


def is_average(run: Run, name: str, sensor: Tree) -> bool:
    """Return True if the readings of this sensor are means: rates that the import derived, or a block of counts."""
    return optional.attribute(sensor, "averages") or name in _imported_means(run)


def _imported_means(run: Run) -> list[str]:
    return run.metadata.get(MEANS_KEY, "").split(", ")


def durations_s(run: Run, name: str) -> np.ndarray:
    """Return the duration (M,) [s] of the interval of each reading of a sensor, in order of time; M > 1."""
    channel = run.sensors[name]
    half_s = seconds(channel.arrival_ns, channel.t_ns)
    if name in _imported_means(run) and np.all(half_s > 0.0):
        return 2.0 * half_s
    steps = seconds(np.diff(channel.t_ns))
    return np.minimum(np.append(steps, steps[-1]), np.append(steps[0], steps))


def averaged_readings(
    t_s: np.ndarray, duration_s: np.ndarray, row_end_s: np.ndarray, dt_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the indices (K,) of the readings with an interval inside the rows, the row (K,) in which each ends, and
    the weights (N, WEIGHT_COLUMNS). `t_s` (M,) are the centres of intervals of `duration_s` (M,). Of several readings
    in a row, the last one is used.
    """
    begin_s = row_end_s - dt_s
    b, e = t_s - 0.5 * duration_s, t_s + 0.5 * duration_s
    is_inside = (
        (b >= begin_s[0] - INTERVAL_TOLERANCE_S) & (e <= row_end_s[-1] + INTERVAL_TOLERANCE_S) & (e > b)
    )
    used_rows = np.flatnonzero(is_inside)
    rows = np.minimum(np.searchsorted(row_end_s, e[used_rows] - INTERVAL_TOLERANCE_S), len(dt_s) - 1)
    is_last = np.append(np.diff(rows) > 0, True)[: len(rows)]
    used_rows, rows = used_rows[is_last], rows[is_last]
    weights = np.zeros((len(dt_s), WEIGHT_COLUMNS))
    weights[:, :3] = END_WEIGHT
    if not len(used_rows):
        return used_rows, rows, weights
    b, e = b[used_rows], e[used_rows]
    weights[rows, :3] = _row_weights(b, e, begin_s[rows], dt_s[rows])
    next_rows = np.searchsorted(rows, np.arange(len(dt_s)), side="right")
    early_indices = np.flatnonzero(next_rows < len(rows))
    j = next_rows[early_indices]
    weights[early_indices, 3:6] = _row_weights(b[j], e[j], begin_s[early_indices], dt_s[early_indices])
    weights[rows, 6] = 1.0
    return used_rows, rows, weights


def longest_interval_s(weights: np.ndarray | None, dt_s: np.ndarray) -> float:
    """Return the duration [s] of the rows from the first to the last row of the longest interval; 0 without means."""
    if weights is None:
        return 0.0
    t_s = np.cumsum(dt_s)[weights[:, 6] > 0.0]
    return float(np.max(np.diff(t_s), initial=0.0))


def instant_weights(sample_fraction: np.ndarray) -> np.ndarray:
    """Return the weights (N, WEIGHT_COLUMNS) of instants that precede the end of their row by a part of it (N,)."""
    t = 1.0 - sample_fraction
    parabola = (1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)
    return np.column_stack([*parabola, np.zeros((len(t), WEIGHT_COLUMNS - 3))])


def _row_weights(b: np.ndarray, e: np.ndarray, begin_s: np.ndarray, dt_s: np.ndarray) -> np.ndarray:
    """Return w (K, 3) of the intervals from b to e in the rows that begin at `begin_s`.  (2)"""
    p, q = (np.clip((x - begin_s) / dt_s, 0.0, 1.0) for x in (b, e))

    def primitive(t: np.ndarray) -> np.ndarray:
        cube = 2.0 / 3.0 * t**3
        return np.column_stack([t - 1.5 * t**2 + cube, 2.0 * (t**2 - cube), cube - 0.5 * t**2])

    return (primitive(q) - primitive(p)) * (dt_s / (e - b))[:, None]


def averages(weights: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the means (N, m) of a signal x (N, m) that is given at the end of each row.  (3)"""
    previous_x = np.concatenate([x[:1], x[:-1]])
    nodes = np.stack([previous_x, 0.5 * (previous_x + x), x], axis=1)  # (N, 3, m)
    part, next_rows = (np.einsum("ni,nim->nm", weights[:, k : k + 3], nodes) for k in (0, 3))
    sums = np.cumsum(next_rows, axis=0)
    starts = np.maximum.accumulate(np.where(weights[:, 6] > 0.0, np.arange(len(x)), 0))
    total = np.zeros_like(x)
    total[1:] = sums[:-1] - (sums - next_rows)[starts[:-1]]
    return weights[:, 6:] * total + part


def average_step(
    sensor: Tree, state: AveragedSignal, motion: Motion, dt_s: Value, weights: np.ndarray
) -> tuple[AveragedSignal, np.ndarray]:
    """Return the state one row later, and h̄ (m,) of a reading with these weights.  (3)"""
    h = sensor.h(motion)
    if motion.tick is None:
        nodes = np.stack([state.previous_h, 0.5 * (state.previous_h + h), h])
    else:
        nodes = np.stack([sensor.h(sample) for sample in motion.tick])
    if state.past_values.shape[0]:
        state, row_mean = delayed_signal(sensor, state, SIMPSON @ nodes, dt_s)
        nodes = np.stack([row_mean, row_mean, row_mean])
    mean = weights[6] * state.total + weights[:3] @ nodes
    total = (1.0 - weights[6]) * state.total + weights[3:6] @ nodes
    return state._replace(total=total, previous_h=h), mean


def delayed_average(
    newest: np.ndarray, line: np.ndarray, steps_s: np.ndarray, age_s: Value, length_s: Value
) -> np.ndarray:
    """Return the mean (m,) of h over an interval of `length_s` centred `age_s` ago. `newest` (m,) is ∫ h dt up to now,
    and `line` (slots, m) its values before the steps `steps_s` (slots,).
    """
    end, begin = (delayed_value(newest, line, steps_s, age_s + half * length_s) for half in (-0.5, 0.5))
    return (end - begin) / length_s
