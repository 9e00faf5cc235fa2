"""Compute the rate of a column from its rows, as a speed from the counts of an encoder, and the times of its readings.

    r_k = (x_k − x_{k−1}) / h_k,   h_k = t_k − t_{k−1}: the mean over the time between two rows            (1)
    ẋ_k = (r_k h_{k+1} + r_{k+1} h_k) / (h_k + h_{k+1}): the parabola through a row and its neighbours      (2)

A signal of rates only contains means (1). They have the middle of both rows as timestamp, and arrive with the later
row. In a signal with other quantities, which have the time of their row, a rate is (2). It arrives with the next row.

A counter begins again after N counts if steps of more than N/2 are usual steps after a turn of ± N.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import note
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.maps.columns import ColumnSignal
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.runs.importing.sources import Source


COUNTER_PERIODS = (2**8, 2**16, 2**32)
MIN_ROWS = 20  # rows of a counter


def rates(step: np.ndarray, dt_s: np.ndarray, are_means: bool) -> np.ndarray:
    """Return (1) or (2) (rows,) of the steps x_k − x_{k−1} (rows − 1,) and the times `dt_s` [s] between the rows. Rows
    without a neighbour have NaN.
    """
    mean = step / dt_s
    if are_means:
        return np.concatenate([[np.nan], mean])
    row_rates = (mean[:-1] * dt_s[1:] + mean[1:] * dt_s[:-1]) / (dt_s[:-1] + dt_s[1:])
    return np.concatenate([[np.nan], row_rates, [np.nan]])[: len(step) + 1]


def times_ns(signal: ColumnSignal, source: "Source") -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the arrivals (rows,) [ns] of a signal."""
    t_ns = source.t_ns + round(signal.mount.shift_s * NANOSECONDS)
    if signal.is_rate:
        return np.asarray(t_ns - np.diff(t_ns, prepend=t_ns[:1]) // 2), t_ns
    if any(entry.derivative for entry in signal.entries):
        return t_ns, np.append(t_ns[1:], t_ns[-1:])
    return t_ns, t_ns


def counter_period(counts: np.ndarray) -> int:
    """Return N, if a counter of 8, 16 or 32 bits begins again in `counts` (rows,), else 0.

    >>> counter_period(np.arange(65000, 67000, 10) % 65536), counter_period(np.arange(0, 70000, 10))
    (65536, 0)
    """
    finite_counts = counts[np.isfinite(counts)]
    if len(finite_counts) < MIN_ROWS or not np.all(finite_counts == np.round(finite_counts)):
        return 0
    step = np.diff(finite_counts)
    for period in COUNTER_PERIODS:
        is_jump = np.abs(step) > 0.5 * period
        max_step = float(np.max(np.abs(step[~is_jump]), initial=1.0))
        rest = step[is_jump] - period * np.sign(step[is_jump])
        if (
            is_jump.any()
            and np.ptp(finite_counts) < period
            and max_step < 0.25 * period
            and np.all(np.abs(rest) <= 2.0 * max_step)
        ):
            return period
    return 0


def counter_findings(signal: ColumnSignal, source: "Source") -> list[ImportFinding]:
    """Return a finding for each counter that begins again without `wraps` in the map."""
    findings = []
    for entry in signal.entries:
        is_counter = entry.derivative and entry.wraps is None and entry.column is not None
        if is_counter and (period := counter_period(source.table.numbers(entry.column or ""))):
            reason = note("recording.counter-wraps", key=entry.key, column=entry.column, counts=period)
            line = note("recording.write", line=f"wraps = {period}")
            findings.append(ImportFinding("counter", "error", reason, line))
    return findings


def is_wrapped_angle(angle: np.ndarray) -> bool:
    """Return True if an angle wraps after each turn; the angle of a wheel can continue beyond one turn."""
    finite_values = angle[np.isfinite(angle)]
    return len(finite_values) > 0 and float(np.ptp(np.quantile(finite_values, (0.01, 0.99)))) < 2.01 * np.pi
