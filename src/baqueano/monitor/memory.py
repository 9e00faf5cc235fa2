"""Memory of the monitor for each number between ticks, and for how long it counts."""

from typing import NamedTuple

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedBelief

EVENT_S, DEGRADED_S = 0.5, 2.0  # of sustained disagreement
FROZEN_S = 0.3  # the same number, bit by bit
LONGER = 3.0  # times the longest such run before
ALIVE = 50  # changes of a reading before it is known to change


class Memory(NamedTuple):
    """Memory of each number, (m,) each."""

    doubt_s: np.ndarray
    evidence: np.ndarray  # log odds: above 0 the sensor is off, below 0 the model
    silent_s: np.ndarray  # since the last reading
    last: np.ndarray  # reading
    same_s: np.ndarray  # since the reading changed
    longest_s: np.ndarray  # for which it stayed the same before
    changes: np.ndarray  # how often it changed
    broken: np.ndarray  # 1: the last reading was none
    bias: np.ndarray  # learned at rest
    bias_var: np.ndarray
    expected: np.ndarray  # h(x̂) + b
    ss: np.ndarray  # fading sums of s², s s', s'²; s' was read in place of s
    sz: np.ndarray
    zz: np.ndarray


class MonitorState(NamedTuple):
    """Between ticks."""

    model: AugmentedBelief  # by the commands alone
    memory: np.ndarray  # (14, m): a Memory


def stuck(memory: Memory) -> np.ndarray:
    """Return bool (m,): the same bits for far longer than ever before, which noise forbids."""
    return (memory.same_s >= FROZEN_S + LONGER * memory.longest_s) & (memory.changes >= ALIVE)
