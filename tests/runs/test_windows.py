"""Means over time windows of the measurements in each window."""

import numpy as np

from baqueano.runs.interpolation import window_means
from baqueano.runs.run import Channel
from baqueano.signals import NANOSECONDS


def test_empty_windows_are_omitted_and_missing_values_are_ignored():
    t_ns = (np.array([0.0, 0.1, 0.2, 0.3, 1.0, 1.1]) * NANOSECONDS).astype(np.int64)
    z = np.array([[1.0, 5.0], [3.0, np.nan], [4.0, 2.0], [8.0, 4.0], [7.0, np.nan], [9.0, np.nan]])
    numbers, mean = window_means(Channel(t_ns, t_ns, z), 0, 0.2)
    assert numbers.tolist() == [0, 1, 5]
    np.testing.assert_array_equal(mean, [[2.0, 5.0], [6.0, 3.0], [8.0, np.nan]])


def test_two_channels_with_the_same_time_origin_have_the_same_windows():
    t_ns = (np.arange(20) * NANOSECONDS // 10).astype(np.int64)
    later_ns = t_ns + NANOSECONDS // 20
    first, second = (window_means(Channel(t, t, t[:, None] * 1.0), 0, 0.5)[0] for t in (t_ns, later_ns))
    np.testing.assert_array_equal(first, second)
