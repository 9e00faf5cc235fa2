"""A repeated evaluation of a problem uses the cache while the cached value is valid."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import FitOptions, fit as module, identify
from baqueano.identify.diagnostics.residual_checks import fit_residuals


@pytest.fixture
def end(case, case_run):
    """Return a finished search, a new one for each test."""
    return fit_at_rest(case_run(0, 6.0), case)


def fit_at_rest(run, case):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "fit_by_simulation", lambda task: task)
        return identify(run, case, options=FitOptions(at_rest=True))


def test_residuals_and_predictions_are_cached_for_one_point_and_noise(end):
    problem, theta = end.task.problem, end.search.solution.theta
    for score_test in (problem.residuals, problem.predictions):
        assert score_test(theta)[0] is score_test(theta.copy())[0]
        assert not np.array_equal(score_test(theta)[0], score_test(1.01 * theta)[0])
    r, h = problem.residuals(theta)[0], problem.predictions(theta)[0]
    problem = problem.weight(2.0 * problem.sigma)
    np.testing.assert_allclose(problem.residuals(theta)[0], 0.5 * r, rtol=1e-12)
    np.testing.assert_array_equal(problem.predictions(theta)[0], h)
    np.testing.assert_allclose(h, predictions(problem, theta), atol=1e-9)


def predictions(problem, theta):
    """Return the kernel predictions for the first segment, for every reading."""
    rows = problem.rows[0].copy()
    rows[:, problem._weights] = 1.0
    return problem.z[0] - np.asarray(problem.scan.run(rows, theta)[1])


def test_predictions_are_computed_at_ticks_without_a_reading_too(end, case, case_run):
    run = case_run(0, 6.0)
    z = run.sensors["imu"].z.copy()
    z[100:200, 1] = np.nan
    short_run = replace(run, sensors={"imu": run.sensors["imu"]._replace(z=z)})
    problem, theta = fit_at_rest(short_run, case).task.problem, end.search.solution.theta
    assert not problem.masks[0].all()
    np.testing.assert_allclose(problem.predictions(theta)[0], predictions(problem, theta), atol=1e-9)
    np.testing.assert_allclose(
        problem.predictions(theta)[0], end.task.problem.predictions(theta)[0], atol=1e-9
    )


def test_a_caller_that_overwrites_derivatives_does_not_change_the_cache(end):
    problem, theta = end.task.problem, end.search.solution.theta
    (_, d, _), before = problem.sensitivities(theta)[0], problem.sensitivities(theta)[0][1].copy()
    assert problem.sensitivities(theta)[0][1] is d
    fit_residuals(problem, theta, np.ones(problem.size, bool))  # overwrites the derivatives
    np.testing.assert_array_equal(problem.sensitivities(theta)[0][1], before)
    problem = problem.weight(2.0 * problem.sigma)
    np.testing.assert_allclose(problem.sensitivities(theta)[0][1], 0.5 * before, rtol=1e-12)
