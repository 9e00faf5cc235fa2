"""A search does not step to where a model runs away, though its robust cost be finite there."""

import numpy as np

from baqueano.identify.solve.least_squares import Evaluation, minimise


def test_slopes_that_are_not_finite_are_no_place_to_go():
    def evaluate(theta):
        x = theta[0]
        if x > 2.0:  # beyond, the cost is lower and has no slope
            return Evaluation(-1.0, np.array([np.nan]), np.array([[np.inf]]))
        return Evaluation(float((x - 1.9) ** 2), np.array([2.0 * (x - 1.9)]), np.array([[0.5]]))

    found = minimise(evaluate, np.array([-5.0]), np.array([-10.0]), np.array([10.0]))
    assert found.converged
    assert abs(found.theta[0] - 1.9) < 1e-3
    nowhere = minimise(evaluate, np.array([3.0]), np.array([-10.0]), np.array([10.0]))
    assert not nowhere.converged
