"""Recognise an inertial sensor that repeats its last reading: the noise of a sound sensor prevents this.

A sound sensor repeats a reading with a probability p, because of its resolution, or because a log contains each reading
several times. After N ≥ MIN_CHANGES readings the longest earlier run of repeats L has p^L ≈ 1/N. So a longer run

    n ≥ MIN_REPEATS + LENGTHENING L                                                                         (1)

has a probability of about N^−LENGTHENING p^MIN_REPEATS at each reading: below 1e-6. At rest a reading may be constant.
"""

from typing import NamedTuple

import numpy as np

MIN_REPEATS, LENGTHENING = 4.0, 3.0
MIN_CHANGES = 50  # changes of a reading before a constant one is suspect


class RepeatedReadings(NamedTuple):
    """The repeats of each of m channels."""

    last_reading: np.ndarray  # (m,)
    repeat_count: np.ndarray  # (m,) of the last reading
    longest_count: np.ndarray  # (m,) of an earlier reading
    change_count: np.ndarray  # (m,)

    @property
    def is_longest(self) -> np.ndarray:
        """Return a mask (m,): True if a reading is repeated for longer than ever before. A filter can omit it: among
        N readings of a sound sensor, about log N are so."""
        return (self.repeat_count > self.longest_count) & (self.change_count >= MIN_CHANGES)

    @property
    def is_stuck(self) -> np.ndarray:
        """Return a mask (m,): True if a reading is repeated for far longer than before.  (1)"""
        return (self.repeat_count >= MIN_REPEATS + LENGTHENING * self.longest_count) & (
            self.change_count >= MIN_CHANGES
        )


def no_repetition(m: int) -> RepeatedReadings:
    """Return the repeats of m channels before their first reading."""
    return RepeatedReadings(*np.zeros((4, m)))


def repetition_after(before: RepeatedReadings, z: np.ndarray, is_arrived: np.ndarray) -> RepeatedReadings:
    """Return the repeats after the readings z (m,); `is_arrived` (m,) is False for a channel without a reading."""
    is_changed = is_arrived & ~(z == before.last_reading)
    is_repeated = is_arrived & ~is_changed
    return RepeatedReadings(
        np.where(is_arrived, z, before.last_reading),
        np.where(is_changed, 0.0, before.repeat_count + np.where(is_repeated, 1.0, 0.0)),
        np.where(is_changed, np.maximum(before.longest_count, before.repeat_count), before.longest_count),
        before.change_count + np.where(is_changed, 1.0, 0.0),
    )
