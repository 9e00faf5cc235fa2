"""Compute the rate of a column from its rows, as a speed from the counts of an encoder, and the times of its readings.

    r_k = (x_k − x_{k−1}) / h_k,   h_k = t_k − t_{k−1}: the mean over the time between two rows            (1)
    ẋ_k = (r_k h_{k+1} + r_{k+1} h_k) / (h_k + h_{k+1}): the parabola through a row and its neighbours      (2)

A signal of rates only contains means (1). They have the middle of both rows as timestamp, and arrive with the later
row. In a signal with other quantities, which have the time of their row, a rate is (2). It arrives with the next row.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.runs.importing.sources import Source
    from baqueano.runs.maps.columns import ColumnSignal


def rates(step: np.ndarray, dt_s: np.ndarray, are_means: bool) -> np.ndarray:
    """Return (1) or (2) (rows,) of the steps x_k − x_{k−1} (rows − 1,) and the times `dt_s` [s] between the rows. Rows
    without a neighbour have NaN.
    """
    mean = step / dt_s
    if are_means:
        return np.concatenate([[np.nan], mean])
    at_row = (mean[:-1] * dt_s[1:] + mean[1:] * dt_s[:-1]) / (dt_s[:-1] + dt_s[1:])
    return np.concatenate([[np.nan], at_row, [np.nan]])[: len(step) + 1]


def times_ns(signal: "ColumnSignal", source: "Source") -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the arrivals (rows,) [ns] of a signal."""
    t_ns = source.t_ns + round(signal.mount.shift_s * NANOSECONDS)
    if signal.is_rate:
        return np.asarray(t_ns - np.diff(t_ns, prepend=t_ns[:1]) // 2), t_ns
    if any(entry.derivative for entry in signal.entries):
        return t_ns, np.append(t_ns[1:], t_ns[-1:])
    return t_ns, t_ns


def wraps_each_turn(angle: np.ndarray) -> bool:
    """Return True if an angle wraps after each turn; the angle of a wheel can continue beyond one turn."""
    finite_values = angle[np.isfinite(angle)]
    return len(finite_values) > 0 and float(np.ptp(np.quantile(finite_values, (0.01, 0.99)))) < 2.01 * np.pi
