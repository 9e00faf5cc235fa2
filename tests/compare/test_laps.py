"""Laps of a drive end only at the end of the route."""

import numpy as np
import pytest

from baqueano.compare.laps import _end_passages, run_laps
from baqueano.guides.shapes import circle, eight, line
from baqueano.simulate import simulate_loop
from baqueano.vehicle_file import load

SMALL = load("small")


@pytest.mark.parametrize("route", [circle(0.5, 0.2), eight(0.6, 0.2)], ids=["circle", "eight"])
def test_each_lap_has_a_duration_and_a_distance(route):
    run = simulate_loop(SMALL, route, laps=3, perfect=True)
    laps = run_laps(run)
    assert [lap.number for lap in laps] == [1, 2, 3]
    for lap in laps:
        ramp_s = 0.0 if lap is laps[1] else 0.5 * 0.2 / 0.3
        assert lap.duration_s == pytest.approx(route.t_s[-1] + ramp_s, abs=0.03)
        assert 0.0 < lap.rms_m <= lap.max_m < 0.02
        assert lap.gap_m < 0.05
    assert sum(lap.duration_s for lap in laps) == pytest.approx(run.duration_s, abs=0.03)


def test_the_largest_distance_is_taken_over_the_whole_drive():
    from baqueano.compare import compare

    run = simulate_loop(SMALL, circle(0.5, 0.2), laps=2)
    comparison = compare(run)
    (judgement,) = comparison.runs
    assert max(lap.max_m for lap in judgement.laps) == pytest.approx(judgement.across_true.max_m)
    assert [row["lap"] for row in comparison.laps()] == [1, 2]
    assert comparison.rows()[0]["laps"] == 2
    assert "2 laps" in judgement.sentences[0]


def test_an_open_route_has_no_laps():
    assert run_laps(simulate_loop(SMALL, line(1.0, 0.2), perfect=True)) == ()


def test_a_reference_that_returns_at_the_lap_end_counts_once():
    route = circle(0.5, 0.2)
    reverse = route.eta[1380:][::-1]
    eta = np.concatenate([route.eta, reverse, route.eta[1380:], np.tile(route.eta[-1], (50, 1)), route.eta])
    assert len(_end_passages(eta, True)) == 3  # begin, end of the first lap, end of the second


def test_the_end_of_each_lap_is_detected_after_a_lead_in():
    route = eight(0.6, 0.2)
    shifted_poses = route.eta[200:] + np.where(np.arange(1241)[:, None] < 100, [0.0, 0.1, 0.0], 0.0)
    assert _end_passages(np.concatenate([shifted_poses, route.eta[1:]]), True) == [1240, 2680]


@pytest.mark.parametrize("ticks", [1, 50])
@pytest.mark.parametrize("start", [5, 300, 1000])
def test_a_jump_of_the_reference_is_not_a_lap(start, ticks):
    """Before, a jump of 2 m made every pose within 4 m of the end a passage, and one lap was reported as two."""
    eta = circle(0.5, 0.2).eta.copy()
    eta[start : start + ticks, 0] += 2.0
    assert _end_passages(eta, True) == [0, len(eta) - 1]
