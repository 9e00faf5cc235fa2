"""Recognise an inertial sensor that repeats its last reading: the noise of an intact sensor prevents this.

An intact sensor repeats a reading with a probability p, because of its resolution, or because a log contains each
reading several times. After N readings the longest earlier run of repeats L has p^L ≈ 1/N. So a longer run

    n ≥ MIN_REPEATS + MAX_LENGTH_RATIO L                                                                         (1)

has a probability of about N^−MAX_LENGTH_RATIO p^MIN_REPEATS at each reading: below 1e-6. At rest a reading may be
constant. A sensor without noise, in a simulation, also repeats its readings. Two successive changes of a reading have
opposite signs with probability 2/3 under white noise, but rarely without noise. So MIN_REVERSALS of them must come
first.
"""

from typing import NamedTuple

import numpy as np

MIN_REPEATS, MAX_LENGTH_RATIO = 4.0, 3.0
MIN_REVERSALS = 50  # before a constant reading is suspect
ROUNDING = 1e-6  # relative to the reading: a smaller change is rounding


class RepeatedReadings(NamedTuple):
    """The repeats of each of m channels."""

    last_reading: np.ndarray  # (m,)
    repeat_count: np.ndarray  # (m,) of the last reading
    longest_count: np.ndarray  # (m,) of an earlier reading
    last_change: np.ndarray  # (m,) difference of the last two readings that differ; 0 before the first change
    reversal_count: np.ndarray  # (m,) number of changes with the opposite sign of the previous one

    @property
    def is_longest(self) -> np.ndarray:
        """Return a mask (m,): True if a reading is repeated for longer than ever before. A filter can omit it:
        among N readings of an intact sensor, about log N are the longest so far."""
        return (self.repeat_count > self.longest_count) & (self.reversal_count >= MIN_REVERSALS)

    @property
    def is_stuck(self) -> np.ndarray:
        """Return a mask (m,): True if a reading is repeated for far longer than before.  (1)"""
        return (self.repeat_count >= MIN_REPEATS + MAX_LENGTH_RATIO * self.longest_count) & (
            self.reversal_count >= MIN_REVERSALS
        )


def no_repetition(m: int) -> RepeatedReadings:
    """Return the repeats of m channels before their first reading."""
    return RepeatedReadings(*np.zeros((5, m)))


def next_repetition(previous: RepeatedReadings, z: np.ndarray, is_arrived: np.ndarray) -> RepeatedReadings:
    """Return the repeats after the readings z (m,); `is_arrived` (m,) is False for a channel without a reading."""
    is_changed = is_arrived & ~(z == previous.last_reading)
    is_repeated, change = is_arrived & ~is_changed, z - previous.last_reading
    is_reversal = is_changed & (change * previous.last_change < 0.0) & (np.abs(change) > ROUNDING * np.abs(z))
    return RepeatedReadings(
        np.where(is_arrived, z, previous.last_reading),
        np.where(is_changed, 0.0, previous.repeat_count + np.where(is_repeated, 1.0, 0.0)),
        np.where(
            is_changed, np.maximum(previous.longest_count, previous.repeat_count), previous.longest_count
        ),
        np.where(is_changed, change, previous.last_change),
        previous.reversal_count + np.where(is_reversal, 1.0, 0.0),
    )
