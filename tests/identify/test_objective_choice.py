"""The choice of the cost function, and the reason with its figures."""

import numpy as np
import pytest

from baqueano.identify.covariance.information import Information
from baqueano.identify.estimation.prediction_error import FilterNoise, MaximumLikelihood
from baqueano.identify.result.objective_choice import LeaveOneOutComparison, choose_objective
from baqueano.numerics.least_squares import Evaluation, Solution

QUIET = np.ones(1)


def likelihood_fit(ratio, autocorrelated=False, floor=(0.04, 0.0)):
    none = np.zeros((1, 1))
    info = Information(none, none, none, autocorrelated, np.zeros(1), 100)
    solution = Solution(np.zeros(1), Evaluation(0.0, none[0], none), True, 0.0, 1, np.zeros(1))
    noise = FilterNoise(np.array(floor), np.zeros(1))
    return MaximumLikelihood(solution, np.zeros(1), noise, np.array([0.008, np.nan]), info, ratio, 1)


def pair(*shifts, extra=-1.0, scatter=1.0, n=31):
    """Return n omitted blocks with `extra` as mean difference, and two fits this many standard errors apart."""
    blocks = extra + scatter * np.linspace(-1.0, 1.0, n)
    return LeaveOneOutComparison(
        blocks, 1000.0, np.array(shifts), [f"model.mass_kg{k}" for k in range(len(shifts))]
    )


def test_the_simulation_cost_is_chosen_without_floor_noise():
    choice = choose_objective(likelihood_fit(3.0), (0, 2), pair(0.1, 0.2), QUIET)
    assert (choice.cost, choice.is_explained, choice.is_contradicted) == ("simulation", False, False)
    assert choice.reason.code == "cost.floor-still"
    assert (choice.reason.figures["ratio"], choice.reason.figures["chance"]) == (3.0, "0.22")


def test_innovations_are_chosen_if_consistent_and_better_on_unseen_segments():
    choice = choose_objective(likelihood_fit(400.0), (0, 2), pair(0.1, 1.5), QUIET)
    assert (choice.cost, choice.is_explained, choice.is_contradicted) == ("innovations", True, False)
    figures = choice.reason.figures
    assert (figures["floor"], figures["chance"], figures["difference"]) == ("0.2 ± 0.02 m/s", "< 1e-6", 1.5)
    assert figures["open_loop"].code == "cost.smaller"
    assert figures["open_loop"].figures["percent"] == pytest.approx(3.1)


def test_an_insignificantly_larger_error_does_not_change_the_choice():
    choice = choose_objective(likelihood_fit(400.0), (0, 2), pair(0.1, extra=0.05), QUIET)
    assert (choice.cost, choice.is_explained, choice.is_contradicted) == ("simulation", True, False)


@pytest.mark.parametrize("floor", [pair(0.1, extra=1.0), pair(0.1, 5.0), pair(0.1, extra=np.nan)])
def test_a_larger_error_and_different_estimates_indicate_a_missing_model_term(floor):
    choice = choose_objective(likelihood_fit(400.0), (0, 2), floor, QUIET)
    assert (choice.cost, choice.is_explained, choice.is_contradicted) == ("simulation", False, True)
    assert choice.reason.code == "cost.neither"


def test_autocorrelation_or_excess_sensor_noise_is_not_attributed_to_the_floor():
    assert not choose_objective(
        likelihood_fit(400.0, autocorrelated=True), (0, 2), pair(0.1), QUIET
    ).is_explained
    assert not choose_objective(likelihood_fit(400.0), (0, 2), pair(0.1), 4.0 * QUIET).is_explained


def test_the_simulation_cost_is_chosen_for_a_short_run():
    choice = choose_objective(likelihood_fit(400.0), (0, 2), None, QUIET)
    assert (choice.cost, choice.is_explained, choice.is_contradicted) == ("simulation", False, False)


def test_the_allowed_difference_of_two_fits_grows_with_parameter_count():
    assert pair(0.0).limit == pytest.approx(2.750, abs=1e-3)  # of Student's t with 30 degrees
    assert pair(*np.zeros(20)).limit > 3.5
    assert pair().largest_change == (0.0, "")
