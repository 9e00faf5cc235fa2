"""The spread of residuals is that of the noise while something happens."""

import numpy as np
import pytest

from baqueano.identify.huber import spread


def test_rows_in_which_an_encoder_stands_do_not_make_the_noise_small():
    """Two thirds of the rows are 0 exactly, as of a vehicle that waits for its command."""
    noise = np.random.default_rng(0).normal(scale=0.05, size=(3000, 1))
    waited = noise.copy()
    waited[:2000] = 0.0
    has = [np.ones((3000, 1))]
    alone = spread([noise[2000:]], [np.ones((1000, 1))], np.zeros(1))
    assert spread([waited], has, np.zeros(1)) == pytest.approx(alone)
    assert alone == pytest.approx(0.05, rel=0.1)  # 4.6 standard errors of a median of 1,000


def test_residuals_that_are_all_nothing_have_the_least_spread():
    assert spread([np.zeros((50, 1))], [np.ones((50, 1))], np.array([1e-7])) == pytest.approx(1e-7)
