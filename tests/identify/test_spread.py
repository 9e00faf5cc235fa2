"""The spread of residuals equals the noise during motion."""

import numpy as np
import pytest

from baqueano.identify.residuals.noise_level import informative_rows, robust_sigma


def test_rows_with_an_encoder_at_rest_do_not_reduce_the_noise_estimate():
    """In two thirds of the rows measurement and model are 0, except for a remainder of the start."""
    rng = np.random.default_rng(0)
    noise = rng.normal(scale=0.05, size=(3000, 1))
    z, waiting = 1.0 + noise, noise.copy()
    z[:2000], waiting[:2000, 0] = 0.0, 1e-5 * rng.normal(size=2000)
    has = [np.ones((3000, 1))]
    moving_only = robust_sigma([noise[2000:]], [np.ones((1000, 1))], np.zeros(1))
    assert robust_sigma([waiting], informative_rows([waiting], has, [z]), np.zeros(1)) == pytest.approx(
        moving_only
    )
    assert robust_sigma([waiting], has, np.zeros(1)) < 1e-4  # the expected spread
    assert moving_only == pytest.approx(0.05, rel=0.1)  # 4.6 standard errors of a median of 1,000


def test_a_model_that_moves_while_the_encoder_rests_is_reported():
    residuals, z = np.full((100, 1), -0.3), np.zeros((100, 1))
    z[50:] = 1.0
    assert informative_rows([residuals], [np.ones((100, 1))], [z])[0].all()


def test_all_rows_of_a_constant_channel_are_used():
    zero = np.zeros((50, 1))
    assert informative_rows([zero], [np.ones((50, 1))], [zero])[0].all()
