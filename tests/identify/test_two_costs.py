"""Which cost is believed, and that the sentence says why with its figures."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify.answer.two_costs import Compared, long_colour, preferred
from baqueano.identify.by_innovations import checked
from baqueano.identify.solve.intervals import Information
from baqueano.identify.solve.least_squares import Evaluation, Solution
from baqueano.identify.solve.prediction import Likely, Noise


def likely(ratio, coloured=False, floor=(0.04, 0.0)):
    none = np.zeros((1, 1))
    info = Information(none, none, none, coloured, np.zeros(1), 100)
    solution = Solution(np.zeros(1), Evaluation(0.0, none[0], none), True, 0.0, 1, np.zeros(1))
    noise = Noise(np.array(floor), np.zeros(1))
    return Likely(solution, np.zeros(1), noise, np.array([0.008, np.nan]), info, ratio, 1)


def both(*apart):
    p = len(apart)
    names = [f"model.mass_kg{k}" for k in range(p)]
    return Compared(names, np.array(apart), np.ones(p), np.zeros(p), np.full(p, 0.5))


def test_over_a_still_floor_the_simulation_is_believed():
    said = preferred(likely(3.0), (0, 2), both(0.1, -0.2), 1.0, 0.5)
    assert said.cost == "simulation"
    assert "likelihood ratio 3.0, by chance 0.22" in said.why
    assert "0.2 standard errors apart" in said.why


def test_over_a_moving_floor_with_white_innovations_these_are_believed_and_the_floor_is_told_with_its_error():
    said = preferred(likely(400.0), (0, 2), both(0.1, 4.0), 30.0, 0.5)
    assert said.cost == "innovations"
    assert "0.2 ± 0.02 m/s in 1 s" in said.why
    assert "by chance less than 1e-6" in said.why
    assert "4.0 standard errors apart at most (mass_kg1); these are two answers: let a run" in said.why


def test_a_push_that_lasts_is_still_a_floor():
    said = preferred(likely(400.0, coloured=True), (0, 2), both(0.1, 1.0), 300.0, 20.0)
    assert said.cost == "innovations"
    assert "the push lasts, or a term is missing" in said.why


@pytest.mark.parametrize(("apart", "left"), [(5.0, 20.0), (1.0, 200.0)])
def test_what_the_model_lacks_is_not_taken_for_a_floor(apart, left):
    said = preferred(likely(400.0, coloured=True), (0, 2), both(0.1, apart), 300.0, left)
    assert said.cost == "simulation"
    assert "believe neither" in said.why
    assert "what the model lacks" in said.why


def test_the_more_parameters_the_further_apart_two_answers_may_be_by_chance():
    assert both(0.0).limit == pytest.approx(2.576, abs=1e-3)
    assert both(*np.zeros(20)).limit == pytest.approx(3.481, abs=1e-3)
    assert Compared([], *[np.zeros(0)] * 4).apart == (0.0, "")


def test_the_long_colour_of_white_residuals_is_one_number_of_a_standard_normal():
    rng = np.random.default_rng(0)
    said = [
        long_colour([rng.standard_normal((6000, 1))], [(rng.random((6000, 1)) < 0.8).astype(float)], 0.01)
        for _ in range(100)
    ]
    assert abs(np.mean(said)) < 0.45  # the mean is taken out: a little below 0
    assert np.std(said) == pytest.approx(1.0, abs=0.2)


def test_a_slow_walk_below_the_noise_is_seen_over_two_seconds():
    rng = np.random.default_rng(1)
    walk = np.zeros(6000)
    for k in range(1, 6000):
        walk[k] = 0.99 * walk[k - 1] + 0.03 * rng.standard_normal()
    residuals = rng.standard_normal((6000, 2))
    residuals[:, 1] += walk
    assert long_colour([residuals], [np.ones((6000, 2))], 0.01) > 5.0


def test_a_cost_that_does_not_exist_is_named():
    with pytest.raises(UsageError, match='cost = "both": expected simulation or innovations'):
        checked("both")
