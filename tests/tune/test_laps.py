"""Simulated laps for the page: the cost equals that of `tune`, and the gradient matches finite differences."""

import numpy as np
import pytest

from baqueano.guides.shapes import circle
from baqueano.tune.laps import simulated_laps
from baqueano.tune.objective import tuning_objective
from baqueano.tune.search import descend
from baqueano.vehicle_file import load

ROUTE = circle(0.3, 0.2)


@pytest.fixture(scope="module")
def laps():
    return simulated_laps(load("small"), ROUTE)


def test_the_cost_of_a_lap_equals_the_cost_in_tune(laps):
    gains = laps.space.file_gains
    lap, rehearsal = laps.lap(gains), tuning_objective(load("small"), ROUTE)
    assert lap.path_cost + 0.1 * lap.jerk_cost == pytest.approx(rehearsal.cost(gains), rel=1e-9)
    assert lap.distance_rms_m == pytest.approx(rehearsal.drive_errors(gains).distance_rms_m, rel=1e-9)
    assert laps.costs(np.array([gains, gains]))[1] == pytest.approx([lap.path_cost, lap.jerk_cost])


@pytest.mark.parametrize("price", [0.0, 0.1, 1.0])
def test_the_gradient_of_a_lap_matches_finite_differences(laps, price):
    gains, (p, step) = laps.space.file_gains, (1, 1e-5)
    slope = laps.cost_and_gradient(gains, price)[1]
    sides = [laps.lap(gains + sign * step * np.eye(len(gains))[p]) for sign in (1, -1)]
    costs = [lap.path_cost + price * lap.jerk_cost for lap in sides]
    assert slope[p] == pytest.approx((costs[0] - costs[1]) / (2 * step), rel=1e-4)


def test_each_step_of_a_descent_lowers_the_cost_and_respects_bounds(laps):
    space = laps.space
    start = space.low + 0.05 * (space.high - space.low)
    descent = descend(lambda g: laps.cost_and_gradient(g, 0.1), start, space.low, space.high)
    costs = [laps.cost_and_gradient(g, 0.1)[0] for g in descent.path]
    assert np.all(np.diff(costs) <= 1e-12)
    assert costs[0] == pytest.approx(descent.costs[0])
    assert costs[-1] == pytest.approx(descent.cost)
    assert np.all(descent.gains >= space.low)
    assert np.all(descent.gains <= space.high)


def test_the_gains_of_the_selected_controller_are_tuned():
    assert simulated_laps(load("small"), ROUTE, "kanayama").space.names[-3:] == ("k_x", "k_y", "k_theta")
