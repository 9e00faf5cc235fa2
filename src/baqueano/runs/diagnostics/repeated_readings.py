"""Find readings that repeat the previous reading: a driver that reads too fast, or the steps of an encoder.

A signal that moves by more than one level of its converter at a time does not repeat a value. So a value that repeats
between two such jumps was repeated by the driver. If a signal jumps only to the adjacent level, a value can repeat
because the signal moves by less than a step. If the wheel of an encoder rolls evenly, 1 to 4 % of the values between
jumps repeat. If a driver reads twice as fast as the chip measures, all of them repeat.
"""

from typing import NamedTuple

import numpy as np

MIN_VALUES = 50  # least number of values for a decision
MIN_REPEATED_SHARE = 0.4  # least share of these values that repeat


class Repeats(NamedTuple):
    """The repeated readings (M,) of a channel, and the duration of its values while it moves."""

    is_repeated: np.ndarray  # (M,) True if a reading repeats the previous one
    hold_counts: np.ndarray  # (K,) number of readings of each value between two jumps


def is_read_too_fast(hold_counts: np.ndarray) -> bool:
    """Return True if so many values repeat that the driver must be reading too fast. `hold_counts` (K,) is the number
    of readings for which each value lasts.
    """
    return len(hold_counts) >= MIN_VALUES and bool(np.mean(hold_counts > 1) > MIN_REPEATED_SHARE)


def find_repeats(x: np.ndarray) -> Repeats:
    """Return the repeats of a channel x (M,). A value that is not finite is not a repeat.

    >>> find_repeats(np.array([0.0, 0.0, 0.1, 0.1, 0.0, 0.1, 0.1, 2.0, 2.0, 5.0, 5.0, 3.0])).hold_counts
    array([2, 2, 1])
    """
    is_fresh = np.ones(len(x), bool)
    is_fresh[1:] = x[1:] != x[:-1]
    _, rank = np.unique(x[is_fresh], return_inverse=True)
    occurs_again = np.bincount(rank)[rank] > 1  # a level of a converter occurs more than once
    adjacent = np.zeros(len(rank) + 1, bool)
    adjacent[1:-1] = (np.abs(np.diff(rank)) == 1) & occurs_again[1:] & occurs_again[:-1]
    length = np.diff(np.concatenate([np.flatnonzero(is_fresh), [len(x)]]))
    return Repeats(~is_fresh, length[~(adjacent[1:] | adjacent[:-1])])
