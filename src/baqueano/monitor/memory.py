"""Store the memory of the monitor for each channel between ticks, and its time limits.

    missing:  silent_s > MISSING_INTERVALS max(interval_s, period_s),   MIN_MISSING_S                     (1)

A sensor is silent since silent_s, its last interval was interval_s, the file states period_s. For a sensor of the pose
(1) counts after REGULAR_S of motion with readings: a camera above a gate sees the vehicle only for a moment.
"""

from typing import NamedTuple

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedBelief
from baqueano.estimators.readings.repetition import RepeatedReadings
from baqueano.monitor.fit_errors import ModelMotion

EVENT_S, DEGRADED_S = 0.5, 2.0  # of sustained disagreement
FROZEN_S = 0.3  # duration of exactly the same value
MISSING_INTERVALS, MIN_MISSING_S = 3.0, 0.1  # of silence
REGULAR_S = 5.0
SUMS = ("duration_s", "residuals", "residual_squares", "cross_products", "signal_squares")


class Memory(NamedTuple):
    """The memory of the monitor: an array (m,) for each quantity, with an entry for each channel."""

    disagreement_s: np.ndarray
    evidence: np.ndarray  # log odds: above 0 the sensor is wrong, below 0 the model
    silent_s: np.ndarray  # since the last reading
    interval_s: np.ndarray  # between the last two readings; 0 before the first
    motion_s: np.ndarray  # in motion, since the last missing reading
    constant_s: np.ndarray  # since the reading changed
    # a RepeatedReadings
    last_reading: np.ndarray
    repeat_count: np.ndarray
    longest_count: np.ndarray
    last_change: np.ndarray
    reversal_count: np.ndarray
    is_unusable: np.ndarray  # 1: the last reading was not finite or at the end of its range
    bias: np.ndarray  # estimated at rest
    bias_var: np.ndarray
    predicted_reading: np.ndarray  # h(x̂) + b
    # decaying sums of 1, r, r², s r, s² since the disagreement began; s is the expected signal, r the residual
    duration_s: np.ndarray
    residuals: np.ndarray
    residual_squares: np.ndarray
    cross_products: np.ndarray
    signal_squares: np.ndarray

    @property
    def repetition(self) -> RepeatedReadings:
        """Return the repeats of each channel."""
        return RepeatedReadings(*(getattr(self, name) for name in RepeatedReadings._fields))


def is_missing(memory: Memory, period_s: np.ndarray) -> np.ndarray:
    """Return a mask (m,): True if a reading is missing from a channel with the usual period `period_s`.  (1)"""
    longest_s = MISSING_INTERVALS * np.maximum(memory.interval_s, period_s)
    return memory.silent_s > np.maximum(longest_s, MIN_MISSING_S)


class MonitorState(NamedTuple):
    """The state of the monitor between two ticks."""

    model: AugmentedBelief  # belief of the model, from the commands only
    memory: np.ndarray  # (20, m): a Memory
    motions: tuple[ModelMotion, ...]  # of the alternative models
