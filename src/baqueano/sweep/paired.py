"""Compute the ratio of two combinations on the same drives, with an interval that accounts for dependent errors.

    θ = mean over drives d of ½ ln(E_d / Ẽ_d),   E_d = Σ_b S_b / Σ_b n_b,   ratio = exp θ                  (1)
    s² = Σ_d (n_d − 1) / n_d Σ_b (θ_{−b} − mean_b θ_{−b})²,   θ_{−b}: (1) without the block b of n_d         (2)
    interval = exp(θ ± t s),   t: Student's, with Σ_d (n_d − 1) degrees of freedom                         (3)

With MIN_BLOCKS drives or more, each drive is a block with independent noise: (2) is then the variance of a mean. With
fewer drives, blocks are segments of at least BLOCK_CORRELATION_TIMES correlation times, and the interval is valid
only for these drives. With fewer than MIN_BLOCKS blocks the interval is NaN. The interval of a bootstrap of so few
blocks is too narrow. Source of (2), the delete-one jackknife: Künsch, Annals of Statistics, 1989.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.numerics.statistics import student_quantile
from baqueano.sweep.error_segments import ErrorSegments

MIN_BLOCKS = 5  # blocks, for an interval
BLOCK_CORRELATION_TIMES = 4.0  # correlation times in a block
NAN = float("nan")


class PairedDifference(NamedTuple):
    """A result of a combination divided by the same result of another combination.

    Attributes
    ----------
    ratio : float
        Geometric mean over the drives; below 1 if the result of the first combination is smaller.
    low, high : float
        The 95 % interval of the ratio; NaN if there are too few blocks.
    blocks : int
        The number of independent blocks.
    is_by_drives : bool
        True if a block is a drive.

    Examples
    --------
    >>> ones, twos = ErrorSegments((1.0,) * 6, (1.0,) * 6), ErrorSegments((4.0,) * 6, (1.0,) * 6)
    >>> paired_difference([ones], [twos]).ratio
    0.5
    """

    ratio: float
    low: float
    high: float
    blocks: int
    is_by_drives: bool

    @property
    def significant(self) -> bool:
        """Return True if the interval does not contain 1."""
        return bool(self.low > 1.0 or self.high < 1.0)


UNKNOWN = PairedDifference(NAN, NAN, NAN, 0, is_by_drives=False)


def paired_difference(
    combination: Sequence[ErrorSegments], base: Sequence[ErrorSegments]
) -> PairedDifference:
    """Return the ratio of two combinations; drive k of `combination` and of `base` is the same drive.  (1)"""
    block_pairs = [_blocks(a, b) for a, b in zip(combination, base, strict=True)]
    block_pairs = [blocks for blocks in block_pairs if np.all(np.sum(blocks, axis=0) > 0.0)]
    if not block_pairs:
        return UNKNOWN
    logs = np.array([_log_ratio(np.sum(blocks_of_drive, axis=0)) for blocks_of_drive in block_pairs])
    n = len(block_pairs)
    theta, is_by_drives = float(np.mean(logs)), n >= MIN_BLOCKS
    blocks = n if is_by_drives else sum(map(len, block_pairs))
    freedom = n - 1 if is_by_drives else blocks - n
    if freedom < MIN_BLOCKS - 1 or not (is_by_drives or min(map(len, block_pairs)) > 1):
        return PairedDifference(float(np.exp(theta)), NAN, NAN, blocks, is_by_drives)
    variance = np.var(logs, ddof=1) / n if is_by_drives else sum(map(_jackknife, block_pairs)) / n**2
    half_width = student_quantile(0.975, freedom) * np.sqrt(variance)
    low, ratio, high = (float(np.exp(x)) for x in (theta - half_width, theta, theta + half_width))
    return PairedDifference(ratio, low, high, blocks, is_by_drives)


def _blocks(a: ErrorSegments, b: ErrorSegments) -> np.ndarray:
    """Return S, n, S̃, ñ (B, 4) of the blocks of a drive, each about BLOCK_CORRELATION_TIMES correlation times or
    longer.
    """
    rows = zip(a.squares, a.samples, b.squares, b.samples, strict=False)  # one of them can have been stopped
    valid_rows = np.array([row for row in rows if row[1] and row[3]]).reshape(-1, 4)
    block_size = max(
        1, int(np.ceil(BLOCK_CORRELATION_TIMES * max(a.correlation_s, b.correlation_s) / a.length_s))
    )
    groups = np.array_split(valid_rows, max(1, len(valid_rows) // block_size))
    return np.array([np.sum(group, axis=0) for group in groups])


def _log_ratio(sums: np.ndarray) -> np.ndarray:
    """Return ½ ln(E / Ẽ) from S, n, S̃, ñ (…, 4)."""
    S, n, S_other, n_other = np.moveaxis(sums, -1, 0)
    return 0.5 * np.log((S / n) / (S_other / n_other))


def _jackknife(blocks: np.ndarray) -> float:
    """Return the jackknife variance of the log ratio of a drive with the blocks (B, 4).  (2)"""
    n = len(blocks)
    left_out = _log_ratio(np.sum(blocks, axis=0) - blocks)
    return float((n - 1) / n * np.sum((left_out - np.mean(left_out)) ** 2))
