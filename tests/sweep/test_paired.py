"""Intervals of a ratio have their nominal coverage: with few drives, few segments or correlated errors; otherwise they
are NaN."""

import numpy as np
import pytest
from scipy.signal import lfilter

from baqueano.sweep.error_segments import ErrorSegments, correlation_time, error_segments
from baqueano.sweep.paired import UNKNOWN, paired_difference

DT_S = 0.1


def lasting(rng, time_s: float, length_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times [ns] and an error whose correlation falls to 1/e in `time_s`."""
    n, keep = round(length_s / DT_S), np.exp(-DT_S / time_s)
    new = rng.standard_normal(n) * np.sqrt(1.0 - keep**2)
    new[0] = rng.standard_normal()
    return np.arange(n) * round(DT_S * 1e9), lfilter([1.0], [1.0, -keep], new)


@pytest.mark.parametrize("spread", [0.3, 1.0])
@pytest.mark.parametrize("drives", [5, 8, 10])
def test_an_interval_of_few_drives_has_its_nominal_coverage(drives, spread):
    """The drives differ by e^± `spread`, and two combinations are equally good on them. Bootstrap percentiles
    covered 85 % with 5 drives."""
    rng, count = np.random.default_rng(drives), 0
    for _ in range(2000):
        level = np.exp(spread * rng.standard_normal(drives))
        cells = [level * np.exp(0.3 * rng.standard_normal(drives)) for _cell in range(2)]
        difference = paired_difference(
            *([ErrorSegments((1000.0 * x,) * 3, (1000.0,) * 3) for x in cell] for cell in cells)
        )
        assert (difference.blocks, difference.is_by_drives) == (drives, True)
        count += difference.low <= 1.0 <= difference.high
    assert 0.935 <= count / 2000 <= 0.965


def trials(time_s: float, count: int = 500) -> tuple[float, float]:
    """Return the share of drives of 6 segments with an interval, and the share of these intervals that contain 1."""
    rng, differences = np.random.default_rng(7), []
    for _ in range(count):
        differences.append(
            paired_difference(*([error_segments(*lasting(rng, time_s, 60.0))] for _cell in range(2)))
        )
    finite = [difference for difference in differences if np.isfinite(difference.low)]
    return len(finite) / count, sum(difference.low <= 1.0 <= difference.high for difference in finite) / max(
        len(finite), 1
    )


def test_an_interval_of_six_segments_has_its_nominal_coverage():
    finite, count = trials(0.5)
    assert finite > 0.98
    assert 0.92 <= count <= 0.98


def test_six_segments_with_errors_correlated_for_5_s_give_no_interval():
    """Bootstrap percentiles covered 76 % here. A drive whose errors seem uncorrelated is the exception."""
    finite, count = trials(5.0)
    assert finite < 0.15
    assert finite * (1.0 - count) < 0.02  # wrong claims
    rng = np.random.default_rng(3)
    comparison = paired_difference(*([error_segments(*lasting(rng, 5.0, 60.0))] for _cell in range(2)))
    assert comparison.ratio > 0.0
    assert not comparison.significant


def test_a_long_drive_with_correlated_errors_gets_longer_blocks():
    rng = np.random.default_rng(5)
    a, b = (error_segments(*lasting(rng, 5.0, 600.0)) for _ in range(2))
    difference = paired_difference([a], [b])
    assert a.length_s == 10.0
    assert 4.0 * max(a.correlation_s, b.correlation_s) <= 600.0 / difference.blocks
    assert 5 <= difference.blocks < 60
    assert difference.low < difference.ratio < difference.high


@pytest.mark.parametrize("time_s", [0.5, 2.0, 5.0])
def test_the_correlation_time_is_estimated_from_squared_errors(time_s):
    """A Gauss-Markov error with correlation e^(−t/T) has squares with e^(−2t/T): their time, 2 ∫ ρ dt, is T."""
    rng = np.random.default_rng(0)
    t_ns, e = lasting(rng, time_s, 20_000.0)
    assert correlation_time(t_ns, e**2) == pytest.approx(time_s, rel=0.15)
    assert correlation_time(t_ns, np.ones(len(t_ns))) == 0.0


def test_a_sample_that_spans_two_segments_is_not_counted():
    t_ns = np.arange(201) * 100_000_000  # 20 s
    segments = error_segments(t_ns[:191], np.ones(191), span_s=1.0)  # intervals that begin at 0.0 … 19.0
    assert segments.samples == (91.0, 91.0)  # each within 0 … 10 s, or within 10 … 20 s
    assert error_segments(t_ns, np.ones(201)).samples == (100.0, 101.0)
    assert error_segments(t_ns, np.ones(201), span_s=5.0).length_s == 20.0


def test_a_short_remainder_is_added_to_the_previous_segment():
    t_ns = np.arange(250) * 100_000_000
    assert error_segments(t_ns, np.ones(250)).samples == (100.0, 150.0)


@pytest.mark.parametrize(
    "pair",
    [
        # no segment is in both drives
        (ErrorSegments((1.0, 0.0), (5.0, 0.0)), ErrorSegments((0.0, 1.0), (0.0, 5.0))),
        # one drive ended before the other had an error
        (ErrorSegments((0.0, 1.0), (5.0, 5.0)), ErrorSegments((1.0,), (5.0,))),
    ],
)
def test_drives_without_common_errors_are_left_out(pair):
    assert paired_difference([pair[0]], [pair[1]]) == UNKNOWN
    full = ErrorSegments((1.0,), (1.0,)), ErrorSegments((4.0,), (1.0,))
    assert paired_difference([pair[0], full[0]], [pair[1], full[1]]).ratio == 0.5


def test_few_drives_are_compared_by_segments():
    rng = np.random.default_rng(1)
    estimate, reference = (
        ErrorSegments(tuple(rng.uniform(1.0, 2.0, 12) * s), (1.0,) * 12) for s in (4.0, 1.0)
    )
    difference = paired_difference([estimate], [reference])
    assert (difference.blocks, difference.is_by_drives, difference.significant) == (12, False, True)
    assert difference.low < difference.ratio < difference.high
    comparison = paired_difference([ErrorSegments((4.0,), (1.0,))], [ErrorSegments((1.0,), (1.0,))])
    assert comparison.ratio == 2.0
    assert np.isnan(comparison.low)


def test_a_drive_with_only_one_segment_gives_a_nan_interval():
    """The scatter of its ratio is unknown."""
    rng = np.random.default_rng(2)
    long, short = (ErrorSegments(tuple(rng.uniform(1.0, 2.0, n)), (1.0,) * n) for n in (12, 1))
    assert np.isnan(paired_difference([long, short], [long, short]).low)
    assert np.isfinite(paired_difference([long, long], [long, long]).low)


def test_the_ratio_is_the_geometric_mean_of_the_drives():
    fours, ones = ErrorSegments((4.0,), (1.0,)), ErrorSegments((1.0,), (1.0,))
    assert paired_difference([fours, ones], [ones, fours]).ratio == pytest.approx(1.0)
    assert paired_difference([fours, fours], [ones, fours]).ratio == pytest.approx(np.sqrt(2.0))
    assert np.isnan(paired_difference([ErrorSegments((0.0,), (1.0,))], [ones]).ratio)
