"""Readings that repeat the one before: held by a driver that reads too fast, or the steps of an encoder.

A signal that moves by more than one level of its converter at a time does not repeat a value: what repeats between
two such jumps was held. What repeats beside a jump to the next level moves by less than a step. Of an encoder whose
wheel rolls evenly 1 to 4 % of such values last. Of a driver that reads twice as fast as the chip measures, all of them
do.
"""

from typing import NamedTuple

import numpy as np

ENOUGH = 50  # values
HELD = 0.4  # of them


class Repeats(NamedTuple):
    """The readings (M,) of a channel that repeat, and how its values last while it moves."""

    same: np.ndarray  # (M,) True where a reading repeats the one before
    lasting: np.ndarray  # (K,) readings that each value lasts which lies between two jumps


def are_held(lasting: np.ndarray) -> bool:
    """Of values between two jumps that last so many readings (K,): as many last as a driver that is too fast makes."""
    return len(lasting) >= ENOUGH and bool(np.mean(lasting > 1) > HELD)


def repeats(x: np.ndarray) -> Repeats:
    """The repeats of a channel x (M,); what is not finite repeats nothing.

    >>> repeats(np.array([0.0, 0.0, 0.1, 0.1, 0.0, 0.1, 0.1, 2.0, 2.0, 5.0, 5.0, 3.0])).lasting
    array([2, 2, 1])
    """
    fresh = np.ones(len(x), bool)
    fresh[1:] = x[1:] != x[:-1]
    _, rank = np.unique(x[fresh], return_inverse=True)
    repeated = np.bincount(rank)[rank] > 1  # a level of a converter is met more than once
    adjacent = np.zeros(len(rank) + 1, bool)
    adjacent[1:-1] = (np.abs(np.diff(rank)) == 1) & repeated[1:] & repeated[:-1]
    length = np.diff(np.concatenate([np.flatnonzero(fresh), [len(x)]]))
    return Repeats(~fresh, length[~(adjacent[1:] | adjacent[:-1])])
