"""Squared, normalised errors lie in their χ² bands when the covariance is right, else outside."""

import builtins

import numpy as np
import pytest

from baqueano.compare import consistency
from baqueano.errors import UsageError

P = np.array([[4.0, 0.3, 0.0], [0.3, 0.09, 0.001], [0.0, 0.001, 1e-4]])


def draws(n, cov=P, seed=1):
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov, n)


def test_right_covariance_lies_in_the_band_as_often_as_it_should():
    """False alarm: 200 bands at 5 % leave 181 to 198 inside with probability 0.9987 (binomial)."""
    inside = 0
    for seed in range(200):
        squared = consistency.nees(draws(300, seed=seed), np.tile(P, (300, 1, 1)))
        band = consistency._band(squared, np.full(300, 3), 300.0)
        inside += band.low < band.mean < band.high
    assert 180 < inside < 199


def test_too_small_a_covariance_is_too_sure_and_too_large_a_one_too_cautious():
    e = draws(2000)
    assert consistency.band_of_run(consistency.nees(e, np.tile(P / 2, (2000, 1, 1))), 3).verdict == "too sure"
    assert (
        consistency.band_of_run(consistency.nees(e, np.tile(P * 2, (2000, 1, 1))), 3).verdict
        == "too cautious"
    )
    assert consistency.band_of_run(consistency.nees(e, np.tile(P, (2000, 1, 1))), 3).verdict == "consistent"


def test_units_do_not_matter():
    scale = np.diag([1e6, 1e-6, 1.0])
    e = draws(50)
    a = consistency.nees(e, np.tile(P, (50, 1, 1)))
    b = consistency.nees(e @ scale, np.tile(scale @ P @ scale, (50, 1, 1)))
    np.testing.assert_allclose(a, b, rtol=1e-9)


def test_a_singular_or_unknown_covariance_is_not_judged():
    cov = np.stack([P, np.zeros((3, 3)), np.full((3, 3), np.nan), -P])
    squared = consistency.nees(np.ones((4, 3)), cov)
    assert np.isfinite(squared).tolist() == [True, False, False, False]


def test_a_silent_sensor_is_left_out_of_the_innovations():
    y, S = draws(400), np.tile(P, (400, 1, 1))
    y[::2, 2] = np.nan  # a sensor at half the rate
    y[5] = np.nan
    value, freedom = consistency.nis(y, S)
    assert freedom[5] == 0
    assert np.isnan(value[5])
    np.testing.assert_allclose(value[0], y[0, :2] @ np.linalg.solve(P[:2, :2], y[0, :2]))
    assert set(freedom.tolist()) == {0, 2, 3}
    assert consistency.band_of_innovations(value, freedom).verdict == "consistent"


def test_correlated_samples_count_for_less():
    """x_t = ρ x_{t−1} + w is worth N (1 − ρ)/(1 + ρ) samples; the estimate scatters by some %."""
    w, x = np.random.default_rng(0).standard_normal(40_000), np.zeros(40_000)
    for k in range(1, len(x)):
        x[k] = 0.9 * x[k - 1] + w[k]
    assert consistency.independent(x) == pytest.approx(40_000 * 0.1 / 1.9, rel=0.25)
    assert consistency.independent(w) == pytest.approx(40_000, rel=0.1)


def test_over_many_runs_the_band_is_exact_at_each_time():
    """False alarm: the share of 400 times inside a 95 % band is 0.91 to 0.985 but once in 1 000."""
    squared = np.stack([consistency.nees(draws(400, seed=s), np.tile(P, (400, 1, 1))) for s in range(20)])
    mean, band = consistency.band_over_runs(squared, 3)
    assert band.samples == 20
    assert 0.91 < np.mean((mean > band.low) & (mean < band.high)) < 0.985


def test_white_innovations_are_white_and_slow_ones_are_not():
    y = draws(5000)
    slow = np.cumsum(y, axis=0)[:, :1] * [1.0, 1.0, 1.0]
    S = np.tile(P, (5000, 1, 1))
    assert np.all(np.abs(consistency.whiteness(y, S)) < 3.9 / np.sqrt(5000))  # 3.9 σ: 3 in 10 000
    assert np.all(consistency.whiteness(slow, S) > 0.9)


def test_without_scipy_the_message_says_what_to_type(monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.startswith("scipy"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match=r'pip install "baqueano\[lab\]"'):
        consistency._limits(10.0, 0.05)
