"""Store the memory of the monitor for each channel between ticks, and its time limits."""

from typing import NamedTuple

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedBelief
from baqueano.estimators.readings.repetition import RepeatedReadings

EVENT_S, DEGRADED_S = 0.5, 2.0  # of sustained disagreement
FROZEN_S = 0.3  # duration of exactly the same value


class Memory(NamedTuple):
    """The memory of the monitor: an array (m,) for each quantity, with an entry for each channel."""

    doubt_s: np.ndarray
    evidence: np.ndarray  # log odds: above 0 the sensor is wrong, below 0 the model
    silent_s: np.ndarray  # since the last reading
    unchanged_s: np.ndarray  # since the reading changed
    # a RepeatedReadings
    last_reading: np.ndarray
    repeat_count: np.ndarray
    longest_count: np.ndarray
    last_change: np.ndarray
    reversal_count: np.ndarray
    is_broken: np.ndarray  # 1: the last reading was not finite or at the end of its range
    bias: np.ndarray  # estimated at rest
    bias_var: np.ndarray
    predicted_reading: np.ndarray  # h(x̂) + b
    # decaying sums of s², s s', s'²; s' is the measured signal, s the expected one
    expected_squares: np.ndarray
    cross_products: np.ndarray
    measured_squares: np.ndarray

    @property
    def repetition(self) -> RepeatedReadings:
        """Return the repeats of each channel."""
        return RepeatedReadings(*(getattr(self, name) for name in RepeatedReadings._fields))


class MonitorState(NamedTuple):
    """The state of the monitor between two ticks."""

    model: AugmentedBelief  # belief of the model, from the commands only
    memory: np.ndarray  # (16, m): a Memory
