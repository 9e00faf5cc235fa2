"""A search does not step to a diverging model, even if its robust cost is finite; such a model adds no information."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.identify.covariance.information import information
from baqueano.identify.data.segments import Evaluation
from baqueano.identify.estimation.least_squares import minimise


def test_the_search_rejects_a_point_with_infinite_derivatives():
    def evaluate(theta):
        x = theta[0]
        if x > 2.0:  # beyond, the cost is lower and has no slope
            return Evaluation(-1.0, np.array([np.nan]), np.array([[np.inf]]))
        return Evaluation(float((x - 1.9) ** 2), np.array([2.0 * (x - 1.9)]), np.array([[0.5]]))

    minimum = minimise(evaluate, np.array([-5.0]), np.array([-10.0]), np.array([10.0]))
    assert minimum.converged
    assert abs(minimum.theta[0] - 1.9) < 1e-3
    nowhere = minimise(evaluate, np.array([3.0]), np.array([-10.0]), np.array([10.0]))
    assert not nowhere.converged


@pytest.mark.parametrize("far", [np.nan, np.inf, -np.inf, 1e200, -1e200])
def test_id12_a_diverged_segment_adds_no_information(far):
    rng = np.random.default_rng(0)
    r, d = rng.standard_normal((100, 2)), rng.standard_normal((100, 2, 3))
    away = np.where(np.arange(100)[:, None, None] > 50, far, d)

    def of(*slopes):
        problem = SimpleNamespace(
            size=3,
            layout=SimpleNamespace(first_start=0, runs=list(range(len(slopes)))),
            sigma=np.ones(2),
            has=[np.ones((100, 2)) for _ in slopes],
            records=[SimpleNamespace(dt_s=np.full(100, 0.01)) for _ in slopes],
            sensitivities=lambda theta: [(r, slope, np.arange(3)) for slope in slopes],
        )
        return information(problem, np.zeros(3))  # pyright: ignore[reportArgumentType]

    single, both = of(d), of(d, away)
    assert np.array_equal(both.bread, single.bread)
    assert np.array_equal(both.meat, single.meat)
    assert not of(away).bread.any()
