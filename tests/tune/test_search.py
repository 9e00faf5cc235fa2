"""The search finds the smallest cost within bounds, and reports a bound that limits the result."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from baqueano.errors import UsageError
from baqueano.numerics.quasi_newton import minimise
from baqueano.tune.gains import search_gains
from baqueano.tune.search import (
    DIVERGED_COST,
    Descent,
    at_limit,
    coordinates,
    descend,
    gain_derivative,
    gains,
    halton,
    search,
)
from baqueano.tune.search_space import SearchSpace
from tests.codes import refused

LOW, HIGH = np.array([0.0, 0.0, 1.0]), np.array([100.0, 10.0, 50.0])


def bowl(target):
    def f(g):
        d = (g - target) / HIGH
        return 1.0 + float(d @ d), 2 * d / HIGH

    return lambda g: f(g)[0], f


def test_the_search_reaches_the_minimum_from_every_start():
    target = np.array([7.0, 0.02, 20.0])
    descents = search(*bowl(target), LOW, HIGH, initial=[np.array([90.0, 9.0, 2.0])])
    assert len(descents) == 4
    for descent in descents:
        np.testing.assert_allclose(descent.gains, target, rtol=1e-3, atol=1e-3)
        assert descent.cost == pytest.approx(1.0, abs=1e-9)
        assert descent.cost == pytest.approx(min(descent.costs), abs=1e-9)
        assert descent.costs[0] == pytest.approx(bowl(target)[0](descent.start)), "it contains its start"


@pytest.mark.parametrize("seed", range(4))
def test_the_search_reaches_a_deep_minimum_beside_a_wide_one(seed):
    """The best points of the cube are all near the wide minimum."""
    rng = np.random.default_rng(seed)
    x_shallow, x_deep = (
        np.full(3, 0.25) + rng.uniform(-0.1, 0.1, 3),
        np.full(3, 0.75) + rng.uniform(-0.1, 0.1, 3),
    )

    def f(g):
        x = coordinates(g, LOW, HIGH)
        values = 1.0 + (x - x_shallow) @ (x - x_shallow), 0.8 + 20.0 * (x - x_deep) @ (x - x_deep)
        slope = 2.0 * (x - x_shallow) if values[0] < values[1] else 40.0 * (x - x_deep)
        return float(min(values)), slope / gain_derivative(x, LOW, HIGH)

    best = search(lambda g: f(g)[0], f, LOW, HIGH)[0]
    assert best.cost == pytest.approx(0.8, abs=1e-6)
    np.testing.assert_allclose(coordinates(best.gains, LOW, HIGH), x_deep, atol=1e-3)


def test_a_descent_ends_where_a_descent_before_it_ended():
    cost_and_gradient, start = bowl(np.array([7.0, 0.02, 20.0]))[1], np.array([1.0, 5.0, 40.0])
    first = descend(cost_and_gradient, np.array([90.0, 9.0, 2.0]), LOW, HIGH)
    separate_descent = descend(cost_and_gradient, start, LOW, HIGH)
    descent = descend(cost_and_gradient, start, LOW, HIGH, best_end=first)
    np.testing.assert_array_equal(descent.gains, first.gains)
    np.testing.assert_array_equal(descent.start, start)
    assert descent.cost == first.cost == descent.costs[-1]
    assert len(descent.costs) < len(separate_descent.costs)


def test_a_descent_passes_a_higher_minimum_that_is_known():
    """The cost of the known end is 1.1; this descent ends at 1."""
    cost_and_gradient = bowl(np.array([7.0, 0.02, 20.0]))[1]
    high_end = Descent(HIGH, np.array([38.0, 0.5, 25.0]), 1.1, np.array([1.1]), 0.0)
    descent = descend(cost_and_gradient, np.array([90.0, 9.0, 2.0]), LOW, HIGH, best_end=high_end)
    assert descent.cost == pytest.approx(1.0, abs=1e-9)


def test_a_slow_descent_above_a_known_minimum_ends_early():
    """Along the curved valley the cost decreases by small shares: alone, the descent goes on to its minimum of 1."""

    def valley(g):
        u, v = g[0] / HIGH[0], g[1] / HIGH[1]
        offset, rest = v - u * u, 0.9 - u
        slope = np.array([-2.0 * rest - 4e3 * u * offset, 2e3 * offset, 0.0])
        return 1.0 + 1e-3 * (rest**2 + 1e3 * offset**2), 1e-3 * slope / HIGH

    start, low_end = np.array([90.0, 9.0, 2.0]), Descent(HIGH, LOW, 0.9, np.array([0.9]), 0.0)
    single, second = (descend(valley, start, LOW, HIGH, best_end=end) for end in (None, low_end))
    assert len(second.costs) < len(single.costs)
    assert low_end.cost < single.cost <= second.cost < 1.001 * single.cost


def test_a_gain_with_its_optimum_beyond_a_bound_is_flagged():
    best = search(*bowl(np.array([200.0, -3.0, 20.0])), LOW, HIGH)[0]
    np.testing.assert_allclose(best.gains, [100.0, 0.0, 20.0], rtol=1e-4, atol=1e-6)
    assert at_limit(best.gains, LOW, HIGH).tolist() == [1, -1, 0]


def test_gains_that_only_act_together_stay_near_the_present_gains():
    """Only g0 + 10 g1 matters, and g2 has no effect: without a preference the descent stays at the bounds."""
    present = np.array([20.0, 3.0, 30.0])

    def f(g):
        d = (g[0] + 10.0 * g[1] - 40.0) / 40.0
        return 1.0 + d * d, np.array([2.0 * d / 40.0, 20.0 * d / 40.0, 0.0])

    at_bounds = np.array([0.0, 4.0, 50.0])
    end = descend(f, at_bounds, LOW, HIGH, present)
    assert end.cost == pytest.approx(1.0, abs=1e-4)
    assert 20.0 < end.gains[2] < 40.0
    assert not np.any(at_limit(end.gains, LOW, HIGH))
    np.testing.assert_allclose(descend(f, at_bounds, LOW, HIGH).gains, at_bounds, atol=1e-9)


@pytest.mark.parametrize("ripple", [0.0, 5e-4])
def test_gains_at_a_bound_for_a_negligible_advantage_are_moved_near_the_present_gains(ripple):
    """g0 falls to its bound, for 0.05 % of the cost; g1 ends inside. With ripples no descent left a bound."""
    present, slope = np.array([50.0, 2.0]), 1e-5

    def f(g):
        d = (g[1] - 3.0) / 3.0
        cost = 1.0 + d * d + slope * g[0] + ripple * np.sin(30.0 * g[0])
        return cost, np.array([slope + 30.0 * ripple * np.cos(30.0 * g[0]), 2.0 * d / 3.0])

    no_block: Any = None
    space = SearchSpace(("a", "b"), ("1", "1"), LOW[:2], HIGH[:2], LOW[:2], HIGH[:2], present, no_block)
    drives: Any = SimpleNamespace(space=space, cost=lambda g: f(g)[0], cost_and_gradient=f)
    plain = search(drives.cost, f, LOW[:2], HIGH[:2], [LOW[:2]], 0)[0]
    assert at_limit(plain.gains, LOW[:2], HIGH[:2]).tolist() == [-1, 0]
    best = search_gains(drives, [present, LOW[:2]], 0, False)[1][0]
    assert at_limit(best.gains, LOW[:2], HIGH[:2]).tolist() == [0, 0]
    assert best.gains[1] == pytest.approx(3.0, rel=1e-2)


def test_a_search_from_the_lower_bounds_reaches_the_minimum():
    best = search(*bowl(np.array([7.0, 5.0, 20.0])), LOW, HIGH, initial=[LOW], start_count=0)[0]
    np.testing.assert_allclose(best.gains, [7.0, 5.0, 20.0], rtol=1e-3)


def test_the_gain_scale_is_smooth_with_an_exact_derivative():
    x = np.array([0.0, 0.3, 1.0])
    np.testing.assert_allclose(coordinates(gains(x, LOW, HIGH), LOW, HIGH), x, atol=1e-12)
    d = 1e-6
    slope = (gains(x + d, LOW, HIGH) - gains(x - d, LOW, HIGH)) / (2 * d)
    np.testing.assert_allclose(gain_derivative(x, LOW, HIGH), slope, rtol=1e-8)


def test_nan_costs_of_unstable_gains_do_not_disturb_other_descents():
    _, cost = bowl(np.array([7.0, 1.0, 20.0]))

    def wild(g):
        return (float("nan"), np.full(3, np.nan)) if g[0] > 30 else cost(g)

    descents = search(lambda g: wild(g)[0], wild, LOW, HIGH, initial=[np.array([60.0, 5.0, 5.0])])
    assert descents[0].cost == pytest.approx(1.0, abs=1e-9)
    assert descents[-1].cost == DIVERGED_COST


@pytest.mark.parametrize("sign", [-1.0, 1.0, np.inf, np.nan])
def test_the_gradient_of_a_chaotic_drive_does_not_stop_a_descent(sign):
    _, result = bowl(np.array([7.0, 1.0, 20.0]))

    def chaotic(g):
        cost, gradient = result(g)
        return (
            (cost + 30.0, np.full(3, sign * 1e250)) if g[0] > 30 else (100.0 * cost - 99.0, 100.0 * gradient)
        )

    assert descend(chaotic, np.array([20.0, 3.0, 5.0]), LOW, HIGH).cost == pytest.approx(1.0, abs=1e-6)
    start = np.array([60.0, 5.0, 5.0])
    assert descend(chaotic, start, LOW, HIGH).cost == pytest.approx(chaotic(start)[0]), "not worse"


def test_a_descent_in_a_narrow_valley_ends_with_a_small_slope():
    def valley(g):
        d = (g - np.array([7.0, 1.0, 20.0])) / HIGH
        w = np.array([1.0, 1e4, 1e3])
        return 1.0 + float(w @ (d * d)), 2 * w * d / HIGH

    for start in np.array([[20.0, 3.0, 5.0], [1.0, 9.0, 45.0]]):
        assert descend(valley, start, LOW, HIGH).slope < 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_the_descent_ends_at_the_minimum_that_scipy_finds_on_the_bounds(seed):
    random = np.random.default_rng(seed)
    root, centre = random.normal(size=(5, 5)), random.uniform(-0.5, 1.5, 5)

    def f(x):
        d = root @ (x - centre)
        return 1.0 + float(d @ d), 2.0 * root.T @ d

    end = minimise(f, np.full(5, 0.4), 200, lambda x: False)
    exact = minimize(f, np.full(5, 0.4), jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * 5, tol=1e-14)
    assert end.value == pytest.approx(exact.fun, rel=1e-9)
    assert np.any((end.x == 0.0) | (end.x == 1.0))


def test_the_start_points_of_the_search_cover_the_space_evenly():
    x = halton(24, 3)
    assert x.min() > 0
    assert x.max() < 1
    counts, _ = np.histogramdd(x, bins=(2, 2, 2), range=[(0, 1)] * 3)
    assert counts.min() >= 2


def test_too_many_gains_are_refused():
    with refused("tune.too-many", UsageError, dimensions=13, maximum=12):
        halton(3, 13)


def test_a_missing_scipy_is_reported_with_the_install_command(without_scipy):
    with refused("lab.scipy-for-tuning", UsageError):
        search(*bowl(LOW), LOW, HIGH)


def test_the_minimum_of_a_rough_cost_is_reached_without_gradients():
    target = np.array([7.0, 0.5, 20.0])

    def g_cost(g):
        x = (coordinates(g, LOW, HIGH) - coordinates(target, LOW, HIGH)) * 20.0
        return 1.0 + float(np.sum(np.abs(x)) + 0.3 * np.sum(np.abs(np.sin(9.0 * x))))

    def f(g):
        d = 1e-6
        return g_cost(g), np.array([(g_cost(g + d * e) - g_cost(g - d * e)) / (2 * d) for e in np.eye(3)])

    result, polished_result = (search(g_cost, f, LOW, HIGH, polish=p)[0] for p in (False, True))
    assert polished_result.cost < result.cost
    assert len(polished_result.costs) > len(result.costs)
    assert polished_result.cost == pytest.approx(min(polished_result.costs))
