"""Store the memory of the monitor for each channel between ticks, and its time limits."""

from typing import NamedTuple

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedBelief

EVENT_S, DEGRADED_S = 0.5, 2.0  # of sustained disagreement
FROZEN_S = 0.3  # duration of exactly the same value
MIN_LENGTHENING = 3.0  # factor on the longest earlier duration of the same value
MIN_CHANGES = 50  # changes of a reading before a constant one is suspect


class Memory(NamedTuple):
    """The memory of the monitor: an array (m,) for each quantity, with an entry for each channel."""

    doubt_s: np.ndarray
    evidence: np.ndarray  # log odds: above 0 the sensor is wrong, below 0 the model
    silent_s: np.ndarray  # since the last reading
    last_reading: np.ndarray  # reading
    unchanged_s: np.ndarray  # since the reading changed
    longest_unchanged_s: np.ndarray  # longest earlier time without a change
    change_count: np.ndarray  # count of changes
    is_broken: np.ndarray  # 1: the last reading was not finite or at the end of its range
    bias: np.ndarray  # estimated at rest
    bias_var: np.ndarray
    predicted_reading: np.ndarray  # h(x̂) + b
    # decaying sums of s², s s', s'²; s' is the measured signal, s the expected one
    expected_squares: np.ndarray
    cross_products: np.ndarray
    measured_squares: np.ndarray


class MonitorState(NamedTuple):
    """The state of the monitor between two ticks."""

    model: AugmentedBelief  # belief of the model, from the commands only
    memory: np.ndarray  # (14, m): a Memory


def is_stuck(memory: Memory) -> np.ndarray:
    """Return a mask (m,): True if a reading stays exactly equal for far longer than before. Noise would prevent this.

    The mask is False for a reading that has changed fewer than MIN_CHANGES times.
    """
    return (memory.unchanged_s >= FROZEN_S + MIN_LENGTHENING * memory.longest_unchanged_s) & (
        memory.change_count >= MIN_CHANGES
    )
