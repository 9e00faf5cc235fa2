"""The damped Gauss-Newton search on problems with a known minimum, and with a model that diverges."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from baqueano.identify.covariance.information import information
from baqueano.numerics.least_squares import minimise
from baqueano.numerics.normal_equations import Evaluation


def cost_of(residuals, slopes):
    """Return the evaluation of a function θ → r (n,), ∂r (n, p)."""

    def evaluate(theta):
        with np.errstate(all="ignore"):
            r, d = residuals(theta), slopes(theta)
            return Evaluation(float(0.5 * r @ r), d.T @ r, d.T @ d)

    return evaluate


T = np.linspace(0.0, 4.0, 80)
TRUE = np.array([2.0, 1.5])
Z = TRUE[0] * np.exp(-TRUE[1] * T)
DECAY = cost_of(
    lambda x: x[0] * np.exp(-x[1] * T) - Z,
    lambda x: np.stack([np.exp(-x[1] * T), -x[0] * T * np.exp(-x[1] * T)], axis=1),
)
FREE = np.full(2, -np.inf), np.full(2, np.inf)


@given(x=st.tuples(st.floats(0.2, 10.0), st.floats(0.3, 7.5)))
def test_a_decay_is_identified_from_starts_wrong_by_a_factor_of_five(x):
    minimum = minimise(DECAY, np.array(x), *FREE, tolerance=1e-20)
    assert minimum.converged
    np.testing.assert_allclose(minimum.theta, TRUE, rtol=1e-6)


@given(scale=st.floats(-9.0, 9.0))
def test_the_unit_of_a_parameter_does_not_change_the_search(scale):
    unit = np.array([1.0, 10.0**scale])
    scaled_cost = cost_of(
        lambda x: x[0] * np.exp(-x[1] / unit[1] * T) - Z,
        lambda x: np.stack(
            [np.exp(-x[1] / unit[1] * T), -x[0] * T / unit[1] * np.exp(-x[1] / unit[1] * T)], axis=1
        ),
    )
    a = minimise(DECAY, np.array([1.0, 1.0]), *FREE)
    b = minimise(scaled_cost, np.array([1.0, 1.0]) * unit, *FREE)
    assert a.evaluations == b.evaluations
    np.testing.assert_allclose(b.theta / unit, a.theta, rtol=1e-6)


def test_a_minimum_beyond_a_bound_ends_on_the_bound_with_a_flag():
    minimum = minimise(DECAY, np.array([1.0, 0.5]), np.array([0.0, 0.0]), np.array([np.inf, 1.0]))
    assert minimum.converged
    assert minimum.theta[1] == 1.0
    assert minimum.bound.tolist() == [0, 1]
    free = minimise(DECAY, np.array([1.0, 1.0]), *FREE, is_fixed=np.array([False, True]))
    np.testing.assert_allclose(minimum.theta, free.theta, rtol=1e-3)  # the other parameters are optimal there


def test_a_search_from_a_bound_reaches_a_minimum_inside_the_bounds():
    minimum = minimise(DECAY, np.array([1.0, 0.0]), np.zeros(2), np.full(2, np.inf))
    np.testing.assert_allclose(minimum.theta, TRUE, rtol=1e-3)


@settings(max_examples=30)
@example(seed=2257)  # a step to a bound ends one rounding error before it
@given(seed=st.integers(0, 10**6))
def test_bounded_linear_problems_satisfy_the_kkt_conditions(seed):
    rng = np.random.default_rng(seed)
    A, z = rng.normal(size=(30, 5)), rng.normal(size=30)
    low, high = -rng.uniform(0.0, 0.3, 5), rng.uniform(0.0, 0.3, 5)
    minimum = minimise(cost_of(lambda x: A @ x - z, lambda x: A), np.zeros(5), low, high, tolerance=1e-18)
    assert minimum.converged
    g = minimum.evaluation.gradient
    assert np.all(g[minimum.bound == -1] >= -1e-9)
    assert np.all(g[minimum.bound == 1] <= 1e-9)
    assert np.all(np.abs(g[minimum.bound == 0]) < 1e-6)


def test_a_parameter_without_effect_does_not_change():
    minimum = minimise(
        cost_of(lambda x: x[:1] - 3.0, lambda x: np.array([[1.0, 0.0]])), np.array([0.0, 7.0]), *FREE
    )
    assert minimum.converged
    assert minimum.theta.tolist() == pytest.approx([3.0, 7.0], abs=1e-3)


def test_the_search_avoids_a_region_of_nan():
    wall = cost_of(lambda x: np.log(x) - np.log(2.0), lambda x: 1.0 / x[:, None])
    minimum = minimise(wall, np.array([40.0]), np.array([-np.inf]), np.array([np.inf]))
    assert minimum.theta[0] == pytest.approx(2.0, rel=1e-3)


def test_a_search_from_a_start_with_nan_cost_does_not_report_convergence():
    wall = cost_of(lambda x: np.log(x), lambda x: 1.0 / x[:, None])
    assert not minimise(wall, np.array([-1.0]), np.array([-np.inf]), np.array([np.inf])).converged


def test_a_search_that_exhausts_its_evaluations_is_not_converged():
    minimum = minimise(DECAY, np.array([10.0, 7.5]), *FREE, max_evaluations=2)
    assert not minimum.converged
    assert minimum.evaluations == 2


def test_a_kink_in_one_parameter_does_not_stop_the_search_of_others():
    """At a delay or a dead zone the cost rises in both directions, with a different slope in each."""

    def evaluate(theta):
        x, y = theta
        kink = 30.0 * abs(x - 0.3)
        cost = kink + 0.5 * 100.0 * (x - 0.4) ** 2 + 0.5 * 400.0 * (y - 2.0 * x) ** 2
        slope = 30.0 if x >= 0.3 else -30.0
        d = np.array([[100.0 + 1600.0, -800.0], [-800.0, 400.0]])
        g = np.array([slope + 100.0 * (x - 0.4) - 800.0 * (y - 2.0 * x), 400.0 * (y - 2.0 * x)])
        return Evaluation(cost, g, d)

    minimum = minimise(evaluate, np.array([1.0, -1.0]), np.full(2, -10.0), np.full(2, 10.0), tolerance=1e-7)
    np.testing.assert_allclose(minimum.theta, [0.3, 0.6], atol=1e-3)
    assert minimum.converged
    assert minimum.decrement < 1e-7


def test_two_equivalent_parameters_do_not_crash_the_search():
    """A short run has many free numbers: after many good steps the damping is below the float resolution."""
    joint = cost_of(
        lambda x: x[0] * np.exp(-(x[1] + x[2]) * T) - Z,
        lambda x: np.stack(
            [np.exp(-(x[1] + x[2]) * T), *2 * [-x[0] * T * np.exp(-(x[1] + x[2]) * T)]], axis=1
        ),
    )
    start, bounds = np.array([1.8, 1.0, 0.4]), np.full(3, np.inf)
    minimum = minimise(joint, start, -bounds, bounds, damping=1e-18, tolerance=1e-20)
    assert minimum.theta[0] == pytest.approx(2.0, rel=1e-6)
    assert minimum.theta[1] + minimum.theta[2] == pytest.approx(1.5, rel=1e-6)


def test_the_search_rejects_a_point_with_infinite_derivatives():
    def evaluate(theta):
        x = theta[0]
        if x > 2.0:  # beyond, the cost is lower and its slope is not finite
            return Evaluation(-1.0, np.array([np.nan]), np.array([[np.inf]]))
        return Evaluation(float((x - 1.9) ** 2), np.array([2.0 * (x - 1.9)]), np.array([[0.5]]))

    minimum = minimise(evaluate, np.array([-5.0]), np.array([-10.0]), np.array([10.0]))
    assert minimum.converged
    assert abs(minimum.theta[0] - 1.9) < 1e-3
    nowhere = minimise(evaluate, np.array([3.0]), np.array([-10.0]), np.array([10.0]))
    assert not nowhere.converged


@pytest.mark.parametrize("distance", [np.nan, np.inf, -np.inf, 1e200, -1e200])
def test_id12_a_diverged_segment_adds_no_information(distance):
    rng = np.random.default_rng(0)
    r, d = rng.standard_normal((100, 2)), rng.standard_normal((100, 2, 3))
    far_rows = np.where(np.arange(100)[:, None, None] > 50, distance, d)

    def cost_of(*slopes):
        problem = SimpleNamespace(
            size=3,
            layout=SimpleNamespace(first_start=0, runs=list(range(len(slopes))), has_split_runs=False),
            sigma=np.ones(2),
            masks=[np.ones((100, 2)) for _ in slopes],
            counts=np.full(2, 100.0 * len(slopes)),
            records=[SimpleNamespace(dt_s=np.full(100, 0.01), lead=0) for _ in slopes],
            prior=np.zeros(3),
            sensitivities=lambda theta: [(r, slope, np.arange(3)) for slope in slopes],
        )
        return information(problem, np.zeros(3))  # pyright: ignore[reportArgumentType]

    single, joint = cost_of(d), cost_of(d, far_rows)
    assert np.array_equal(joint.bread, single.bread)
    assert np.array_equal(joint.meat, single.meat)
    assert not cost_of(far_rows).bread.any()
