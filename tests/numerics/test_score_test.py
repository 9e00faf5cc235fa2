"""The consequences of an effect that a model lacks, compared with the regression that contains it."""

import numpy as np
import pytest

from baqueano.numerics.score_test import Nuisance, nuisance_shift, score_test, score_test_residuals

RUNS, ROWS, CHANNELS, SHARED, OWN = 3, 40, 2, 4, 2


@pytest.mark.parametrize("seed", range(3))
def test_an_effect_changes_parameters_and_entries_of_each_run_as_in_a_regression(seed):
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((RUNS, ROWS * CHANNELS, SHARED + OWN))
    blocks = np.zeros((RUNS, ROWS * CHANNELS, RUNS, OWN))
    blocks[np.arange(RUNS), :, np.arange(RUNS)] = slopes[:, :, SHARED:]
    X = np.concatenate([slopes[:, :, :SHARED], blocks.reshape(RUNS, -1, RUNS * OWN)], axis=2)
    is_fitted = np.ones(X.shape[2], bool)
    is_fitted[[1, SHARED + 3]] = False  # entries that the data do not determine
    X = X.reshape(-1, X.shape[2])[:, is_fitted]
    D, noise = rng.standard_normal((2, len(X)))
    r = noise - X @ np.linalg.lstsq(X, noise, rcond=None)[0]
    r *= 0.5 / np.max(np.abs(r))  # no outliers
    *changes, size = np.linalg.lstsq(np.column_stack([X, D]), r, rcond=None)[0]

    segments = [
        (r_k.reshape(ROWS, CHANNELS), -d.reshape(ROWS, CHANNELS, -1))
        for r_k, d in zip(r.reshape(RUNS, -1), slopes, strict=True)
    ]
    run = np.repeat(np.arange(RUNS), ROWS)
    own = is_fitted[SHARED:].reshape(RUNS, OWN)
    nuisances = [Nuisance(slice(k * ROWS, (k + 1) * ROWS), SHARED, own[k]) for k in range(RUNS)]
    residuals = score_test_residuals(segments, np.ones(len(r), bool), run, is_fitted[:SHARED], nuisances, 1e9)
    (test,) = score_test(residuals, D.reshape(1, -1, CHANNELS).copy())
    assert test.size == pytest.approx(size)
    np.testing.assert_allclose(test.shift, changes[: SHARED - 1], atol=1e-9)
    shift = nuisance_shift(residuals, test, RUNS)
    np.testing.assert_allclose(shift, changes[SHARED - 1 :], atol=1e-9)
    assert not nuisance_shift(residuals, test, 0).size
