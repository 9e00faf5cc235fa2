"""Compute means over time windows, to compare channels of different rates, or to remove vibration from a channel."""

import numpy as np

from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS


def window_means(channel: Channel, origin_ns: int, width_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (W,) of the windows that contain rows, counted from `origin_ns`, and their means (W, m).
    A mean includes only finite entries; it is NaN without a finite entry.
    """
    window_numbers = ((channel.t_ns - origin_ns) / NANOSECONDS / width_s).astype(np.int64)
    windows, row = np.unique(window_numbers, return_inverse=True)
    is_known = np.isfinite(channel.z)
    sums, counts = np.zeros((len(windows), channel.z.shape[1])), np.zeros((len(windows), channel.z.shape[1]))
    np.add.at(sums, row, np.where(is_known, channel.z, 0.0))
    np.add.at(counts, row, is_known)
    return windows, np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan)
