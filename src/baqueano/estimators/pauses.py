"""Split a long tick, or a pause between two ticks, into rows: a fixed-step integrator of a stiff model diverges.

    dt ≤ longest           one row, the tick itself                                                       (1)
    dt ≤ MAX_PREDICTION_S  equal rows of about a row period: silent rows, then the tick with its measurements  (2)
    dt > MAX_PREDICTION_S  silent rows over MAX_PREDICTION_S − longest, then the tick: the prediction stops there    (3)

dt is the time since the previous tick, or a period of the ticks before the first tick. A row period is a period of the
ticks, or an equal part of it if the period is too long for the integrator (vehicles/rk4.py). The time `longest` is
MAX_ROW_S, or 1.25 row periods if that is longer. So jitter of the clock does not split a tick. A silent row is a tick
without measurements. A delay line contains one command per row period, so a pause does not shorten a delay.
"""

from collections.abc import Sequence
from math import ceil
from typing import NamedTuple, TypeVar

import numpy as np

from baqueano.contracts.values import Tree, Value
from baqueano.signals import NANOSECONDS, Estimate, Slot, Tick, seconds
from baqueano.symbolic import branch
from baqueano.vehicles.drivetrain import DrivetrainState
from baqueano.vehicles.effort import Effort
from baqueano.vehicles.rk4 import MAX_ROW_S, row_rate_hz
from baqueano.vehicles.state import Vehicle, tick_effort

MAX_ROW_NS = round(MAX_ROW_S * NANOSECONDS)
MAX_PREDICTION_S = 1.0  # longest prediction without a tick; after it the position is too uncertain to predict
JITTER_PERIODS = 1.25  # longest row in row periods
# m², rad²: beyond this a pose is unknown, and rounding would destroy the smaller variances of the matrix
MAX_POSE_VARIANCE = 1e6
Belief = TypeVar("Belief")
INTEGER_TYPES = (int, np.integer)  # types of a time with a known value, in contrast to a traced time


def max_row_s(rate_hz: float) -> float:
    """Return the longest row [s] of a filter with ticks at `rate_hz`.  (1)"""
    return max(MAX_ROW_S, JITTER_PERIODS / row_rate_hz(rate_hz))


def silent_times(last_ns: int, t_ns: int, rate_hz: float) -> list[int]:
    """Return the times [ns] of the silent rows between two ticks; empty after a short pause.  (1)-(3)

    `last_ns` is negative before the first tick.
    """
    max_time_ns, max_pause_ns = round(max_row_s(rate_hz) * NANOSECONDS), round(MAX_PREDICTION_S * NANOSECONDS)
    last_ns = last_ns if last_ns >= 0 else t_ns - round(NANOSECONDS / rate_hz)
    pause_ns, rate_hz = t_ns - last_ns, row_rate_hz(rate_hz)
    if pause_ns <= max_time_ns:
        return []
    is_limited = pause_ns > max_pause_ns
    span_ns = max_pause_ns - max_time_ns if is_limited else pause_ns
    count = max(int(span_ns * 1e-9 * rate_hz * (1.0 + 1e-6)), ceil(span_ns / max_time_ns))
    return [last_ns + span_ns * k // count for k in range(1, count + is_limited)]


def silent_rows(last_ns: Value, tick: Tick, rate_hz: float) -> list[Tick]:
    """Return the silent rows between `last_ns` and a tick; each has the command of the tick.  (1)-(3)

    While a step is traced, the times are not known, and a tick has as many rows as a period.
    """
    silent_slots = type(tick.sensors)(*(Slot(0.0, np.zeros(np.shape(slot.z))) for slot in tick.sensors))
    if isinstance(tick.t_ns, INTEGER_TYPES) and isinstance(last_ns, INTEGER_TYPES):
        times: Sequence[Value] = silent_times(int(last_ns), int(tick.t_ns), rate_hz)
    else:
        count = round(row_rate_hz(rate_hz) / rate_hz)
        last_ns = np.where(last_ns >= 0, last_ns, tick.t_ns - round(NANOSECONDS / rate_hz))
        times = [last_ns + np.floor((tick.t_ns - last_ns) * k / count) for k in range(1, count)]
    return [Tick(t_ns, tick.u, silent_slots) for t_ns in times]


def limit_covariance(cov: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n). A standard deviation of x, y or ψ is halved if its variance is too large.

    The limit is MAX_POSE_VARIANCE. Rounding of a larger variance would make the other entries inaccurate.
    """
    D = limiting_factors(cov)
    return np.where(np.min(D) < 1.0, cov * np.outer(D, D), cov)


def limiting_factors(cov: np.ndarray) -> np.ndarray:
    """Return the factors (n,) by which `limit_covariance` multiplies the standard deviations."""
    is_too_large = np.diag(cov)[:3] > MAX_POSE_VARIANCE
    return np.concatenate([np.where(is_too_large, 0.5, 1.0), np.ones(cov.shape[0] - 3)])


def split_ticks(ticks: Tick, rate_hz: float) -> tuple[Tick, np.ndarray]:
    """Return the rows of N ticks, and the index (N,) of the row of each tick. Leaves begin with an axis N.  (1)-(3)"""
    t_ns = np.asarray(ticks.t_ns)
    last_ns = np.concatenate([[-1], t_ns[:-1]])
    can_be_long = (last_ns < 0) | (t_ns - last_ns > round(max_row_s(rate_hz) * NANOSECONDS))
    gaps = {k: silent_times(int(last_ns[k]), int(t_ns[k]), rate_hz) for k in np.flatnonzero(can_be_long)}
    counts = np.ones(len(t_ns), dtype=np.int64)
    counts[list(gaps)] += [len(times) for times in gaps.values()]
    tick_indices = np.cumsum(counts) - 1
    row_times = np.repeat(t_ns, counts)
    has_reading = np.zeros(len(row_times))
    has_reading[tick_indices] = 1.0
    row_times[has_reading == 0.0] = [t for times in gaps.values() for t in times]

    def repeat(x: Value) -> Value:
        return np.repeat(np.broadcast_to(x, (len(t_ns), *np.shape(x)[1:])), counts, axis=0)

    slots = (
        Slot(
            has_reading * repeat(slot.is_new),
            has_reading[:, None] * repeat(slot.z),
            has_reading * repeat(slot.age_s),
        )
        for slot in ticks.sensors
    )
    columns: Value = (row_times, repeat(ticks.u), type(ticks.sensors)(*slots))
    return Tick(*columns), tick_indices


class FilterRow(NamedTuple):
    """A row of the filter: its duration and its command."""

    is_new: Value  # True if the row is newer than the last row; else it is ignored
    dt_s: Value  # duration of the row; a row period for the first row
    predicted_s: Value  # the predicted part of the duration: at most that of the longest row
    u: np.ndarray  # (n,) the command; 0 for an entry that is not finite


def filter_row(last_ns: Value, tick: Tick, rate_hz: float) -> FilterRow:
    """Return the duration and the command of the row that ends with this tick."""
    is_new = tick.t_ns > last_ns
    dt_s = np.where(is_new & (last_ns >= 0), seconds(tick.t_ns, last_ns), 1.0 / row_rate_hz(rate_hz))
    u = np.where(np.isfinite(tick.u), tick.u, 0.0)
    return FilterRow(is_new, dt_s, np.minimum(dt_s, max_row_s(rate_hz)), u)


def row_effort(vehicle: Vehicle, belief: Tree, row: FilterRow) -> tuple[DrivetrainState, Effort]:
    """Return the state of the motors after a row, and the effort during that row.
    A vehicle that moves before its first tick already had a command, which is unknown. The command of the first tick is
    used instead.
    """
    is_first_while_moving = (belief.t_ns < 0) & (np.sum(np.abs(belief.mean[3:6])) > 0.0)
    state = branch(
        is_first_while_moving, lambda: vehicle.drivetrain.steady_state(row.u), lambda: belief.drivetrain
    )
    return tick_effort(vehicle, state, belief.mean[2], belief.mean[3:6], row.u, row.predicted_s)


def unpredicted_cov(row: FilterRow, mean: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return the covariance (3, 3) that the pose gains in the part of a row that is not predicted.

    `mean` (n,) and `cov` (n, n) are those of the state (η, ν, …); they give the velocity in that part.
    """
    squared_displacement = (row.dt_s - row.predicted_s) ** 2 * (mean[3:6] ** 2 + np.diag(cov)[3:6])
    square_distance = squared_displacement[0] + squared_displacement[1]
    variances = np.array([square_distance, square_distance, squared_displacement[2]])
    return np.diag(np.minimum(variances, MAX_POSE_VARIANCE))


def step_rows(block: Tree, belief: Belief, tick: Tick) -> tuple[Belief, Estimate]:
    """Return the belief and the estimate after a tick: predict, then correct with the measurements that arrived.

    A tick that is not newer than the last tick is ignored. A tick after a pause is split into rows.
    """
    for silent_tick in block.rows_before(belief, tick):
        belief, _ = block.row(belief, silent_tick)
    return block.row(belief, tick)


def rows_before(block: Tree, belief: Tree, tick: Tick) -> Sequence[Tick]:
    """Return the rows without measurements that fill a pause before this tick; empty without a pause."""
    last_ns, t_ns = belief.t_ns, tick.t_ns
    if isinstance(t_ns, int) and isinstance(last_ns, int) and 0 <= t_ns - last_ns <= MAX_ROW_NS:
        return ()  # a fast path, because it is called at each tick
    return silent_rows(last_ns, tick, block.rate_hz)
