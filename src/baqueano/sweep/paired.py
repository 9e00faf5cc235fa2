"""The ratio of two cells on the same drives, with an interval that knows what is not independent.

    ratio = √(Σ_b e_b² / Σ_b ẽ_b²),   its interval by drawing whole blocks b with replacement             (1)

Samples that follow one another are alike, and spans of a relative error overlap: no block ends between them. With
FEWEST drives or more a block is a drive, of which each has its own noise. Of fewer drives, blocks are pieces of 10 s:
their interval holds for these drives, not for others.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify.noise.speed_channels import FEWEST, ratio_of_blocks
from baqueano.sweep.figures import Pieces


class PairedDifference(NamedTuple):
    """A figure of a cell in parts of that of another one.

    Attributes
    ----------
    ratio : float
        Below 1: smaller than the other's.
    low, high : float
        Its interval of 95 %; NaN of few blocks.
    blocks : int
        What was drawn from.
    of_drives : bool
        True where a block is a drive.

    Examples
    --------
    >>> ones, twos = Pieces((1.0,) * 6, (1.0,) * 6), Pieces((4.0,) * 6, (1.0,) * 6)
    >>> paired([ones], [twos]).ratio
    0.5
    """

    ratio: float
    low: float
    high: float
    blocks: int
    of_drives: bool

    @property
    def significant(self) -> bool:
        """Return True where the interval does not hold 1."""
        return bool(self.low > 1.0 or self.high < 1.0)


UNKNOWN = PairedDifference(float("nan"), float("nan"), float("nan"), 0, False)


def paired(ours: Sequence[Pieces], others: Sequence[Pieces]) -> PairedDifference:
    """Return the ratio of two cells; drive k of `ours` and of `others` is the same drive.  (1)"""
    both = [(a, b) for a, b in zip(ours, others, strict=True) if a.samples and b.samples]
    of_drives = len(both) >= FEWEST
    if of_drives:
        means = [(a.rms**2, b.rms**2) for a, b in both]
    else:
        means = [
            (x / n, y / m)
            for a, b in both
            for x, n, y, m in zip(a.squares, a.samples, b.squares, b.samples, strict=False)
            if n and m
        ]
    a, b = (
        (np.array(column, dtype=float) for column in zip(*means, strict=True))
        if means
        else (np.zeros(0),) * 2
    )
    known = np.isfinite(a) & np.isfinite(b)
    if not np.sum(b[known]) > 0.0:
        return UNKNOWN
    return PairedDifference(*ratio_of_blocks(a[known], b[known]), int(np.sum(known)), of_drives)
