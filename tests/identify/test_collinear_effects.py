"""An effect that would be larger than the measured signal does not widen the intervals of the parameters."""

import numpy as np
import pytest
from scipy.optimize import minimize

from baqueano.numerics.score_test import bounded_test, score_test, score_test_residuals

ROWS = 1200


def residuals_and_effect(own_fraction):
    """Return a fit with a misfit, and an effect of which the free parameter explains all but `own_fraction`."""
    t = np.linspace(0.0, 60.0, ROWS)
    rng = np.random.default_rng(4)
    d = np.sin(2.0 * t)
    signal = np.cos(0.7 * t)
    signal -= d * (signal @ d) / (d @ d)
    signal *= np.linalg.norm(d) / np.linalg.norm(signal)
    misfit = 0.3 * signal + 0.5 * rng.standard_normal(ROWS)  # motion outside the model, below its noise
    mask, run, is_free = np.ones(ROWS, bool), np.zeros(ROWS, int), np.ones(1, bool)
    segments = [(misfit[:, None], -d[:, None, None])]
    fit = score_test_residuals(segments, mask, run, is_free, [], float(np.sum(d**2)))
    return fit, (np.sqrt(1.0 - own_fraction) * d + np.sqrt(own_fraction) * signal)[None, :, None]


def effect_on(own_fraction):
    return score_test(*residuals_and_effect(own_fraction))[0]


@pytest.mark.parametrize("own_fraction", [1e-5, 1e-4, 5e-3])
def test_a_collinear_effect_of_impossible_size_does_not_shift_a_parameter(own_fraction):
    assert np.all(effect_on(own_fraction).shift == 0.0)


def test_an_effect_with_a_part_of_its_own_shifts_the_parameter_by_its_size():
    test = effect_on(0.5)
    assert test.z > 4.6
    assert abs(test.shift[0]) == pytest.approx(0.3, rel=0.3)


@pytest.mark.parametrize("part", [0.0, 0.3, 2.0])
def test_an_effect_and_its_size_are_those_of_a_fit_with_the_bound_of_the_parameter(part):
    fit, D = residuals_and_effect(0.1)
    test = score_test(fit, D)[0]
    low, high = (np.array([x]) for x in sorted([part * test.shift[0], -9.0 * np.sign(test.shift[0])]))
    bounded_result = bounded_test(fit, test, low, high)

    d, D, w = fit.d[0], D[0, :, 0], fit.w
    signal = D - d * (D @ (w * d)) / (d @ (w * d))  # the score of θ is 0 at a minimum

    def cost(x):
        change = x[0] * d + x[1] * test.size * D
        return 0.5 * w @ change**2 - x[1] * test.size * (signal @ fit.clipped_residuals)

    best = minimize(cost, np.zeros(2), bounds=[(low[0], high[0]), (0.0, None)], tol=1e-12)
    assert [*bounded_result.shift, bounded_result.size / test.size] == pytest.approx(best.x, abs=1e-3)
