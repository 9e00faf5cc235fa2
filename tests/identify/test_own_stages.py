"""Stages of a fit can be replaced: a custom residual, a custom solver, and separately called stages."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baqueano.identify import (
    FitOptions,
    Residuals,
    conclude,
    dataset,
    identify,
    parameters_of,
    random_steps,
    solve,
)
from baqueano.identify.covariance.information import information
from baqueano.numerics.least_squares import MAX_EVALUATIONS, minimise
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

FREE = ["model.mass_kg", "model.friction.linear[0]", "model.actuator_matrix[0,0]"]


@pytest.fixture(scope="module")
def examples():
    sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
    try:
        import own_stages
    finally:
        sys.path.pop(0)
    return own_stages


@pytest.fixture(scope="module")
def small():
    return load("small")


@pytest.fixture(scope="module")
def run(small):
    return simulate(small, random_steps(small.command.limit, 20.0, small.rate_hz, 0), 0)


def test_separate_stages_give_the_same_result_as_the_fit(small, run):
    fit = identify(run, small, FREE)
    data = dataset([run], small)
    parameters = parameters_of(data, FREE)
    problem = Residuals.from_parameters(parameters)
    by_hand = conclude(data, parameters, *solve(problem, parameters))
    np.testing.assert_array_equal(by_hand.estimate, fit.estimate)
    np.testing.assert_array_equal(by_hand.cov, fit.cov)
    assert by_hand.verdict == fit.verdict == "USABLE"


def test_the_gradient_from_the_sensitivities_is_that_of_the_cost(small, run):
    parameters = parameters_of(dataset([run, run], small), FREE)
    problem = Residuals.from_parameters(parameters)
    evaluation = problem.evaluate(parameters.start)
    unit = np.sqrt(np.diagonal(evaluation.hessian))
    np.testing.assert_allclose(
        information(problem, parameters.start).gradient / unit, evaluation.gradient / unit, atol=1e-9
    )


def test_a_custom_solver_gives_the_same_estimate(small, run, examples):
    fit, own_fit = (identify(run, small, FREE, **options) for options in ({}, {"solver": examples.by_scipy}))
    assert own_fit.converged
    assert np.max(np.abs(own_fit.estimate - fit.estimate) / fit.std) < 0.02


def test_a_search_out_of_evaluations_continues_in_another_round(small, run):
    unfinished_problems = []

    def slow(*arguments, max_evaluations, **options):
        solution = minimise(*arguments, max_evaluations=max_evaluations, **options)
        if max_evaluations < MAX_EVALUATIONS or unfinished_problems:
            return solution
        unfinished_problems.append(solution)
        return solution._replace(converged=False, evaluations=max_evaluations)

    parameters = parameters_of(dataset([run], small), ["model.mass_kg"])
    end = solve(Residuals.from_parameters(parameters), parameters, solver=slow)[1]
    assert len(unfinished_problems) == 1
    assert end.solution.converged


def test_a_custom_residual_tolerates_disturbances_of_three_samples(small, run, examples):
    imu, rng = run.sensors["imu"], np.random.default_rng(0)
    z = imu.z.copy()
    for first in rng.choice(len(z) - 5, 80):
        z[first : first + 3, 0] += 4.0 * np.sign(z[first, 0])  # too long for a spike
    damaged_run = replace(run, sensors={"imu": imu._replace(z=z)})
    sound_fit, usual_fit = (
        identify(recording, small, FREE, options=FitOptions(diagnose=False))
        for recording in (run, damaged_run)
    )
    w = identify(damaged_run, small, FREE, residuals=examples.Compressed, options=FitOptions(diagnose=False))
    change, own_error = (np.abs(fit.estimate / sound_fit.estimate - 1.0).max() for fit in (usual_fit, w))
    assert own_error < 0.5 * change
    error = w.channels[0].measurements - w.channels[0].predictions
    assert np.nanmax(np.abs(error)) > 3.5  # a table shows readings with any residual
