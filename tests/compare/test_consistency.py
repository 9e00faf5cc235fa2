"""Squared, normalised errors lie in their χ² bands when the covariance is right, else outside."""

import numpy as np
import pytest
from scipy.signal import lfilter

from baqueano.compare import consistency
from baqueano.errors import UsageError
from tests.codes import refused

P = np.array([[4.0, 0.3, 0.0], [0.3, 0.09, 0.001], [0.0, 0.001, 1e-4]])


def draws(n, cov=P, seed=1):
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov, n)


def nees_of(e, cov):
    return consistency.nees(e, np.tile(cov, (len(e), 1, 1)))


def test_right_covariance_lies_in_the_band_as_often_as_it_should():
    """False alarm: 200 bands at 5 % leave 181 to 198 inside with probability 0.9987 (binomial); the band is the wider
    of two, so all may be inside."""
    bands = [consistency.band(nees_of(draws(300, seed=seed), P), 3) for seed in range(200)]
    assert sum(band.low < band.mean < band.high for band in bands) > 180
    assert np.mean([band.high - band.low for band in bands]) < 1.25 * 4 * np.sqrt(2 / 900)


def test_too_small_a_covariance_is_too_sure_and_too_large_a_one_too_cautious():
    e = draws(2000)
    for factor, word in ((0.5, "too sure"), (2.0, "too cautious"), (1.0, "consistent"), (0.95, "consistent")):
        assert consistency.band(nees_of(e, factor * P), 3).verdict == word
    assert consistency.band(nees_of(e[:5], P), 3).verdict == "cannot tell"


def filtered(rng, few):
    """NEES and NIS of a steady Kalman filter of d copies of x_t = a x_{t−1} + w, z = x + v, that believes in 1/κ of
    the variances: its gain is right, its errors are κ times what it says. Also κ, d, and independent samples of the
    slower of both."""
    d, a, r = rng.integers(1, 4), rng.choice([0.0, 0.5, 0.9, 0.97, 0.99]), 10 ** rng.uniform(-2.0, 1.0)
    kappa, n = (
        rng.choice([0.25, 0.5, 1.0, 1.0, 1.0, 2.0, 4.0]),
        int(10 ** rng.uniform(2.0, 3.0 if few else 4.0)),
    )
    q = 1.0 - a * a
    p = 1.0
    for _ in range(200):
        before = a * a * p + q
        p = before * r / (before + r)
    gain = before / (before + r)
    w, v = np.sqrt(q) * rng.standard_normal((n + 300, d)), np.sqrt(r) * rng.standard_normal((n + 300, d))
    c = (1.0 - gain) * a
    e = lfilter([1.0], [1.0, -c], gain * v - (1.0 - gain) * w, axis=0)  # x̂ − x
    y = w[300:] + v[300:] - a * e[299:-1]
    squared = [np.sum(e[300:] ** 2, axis=1) * kappa / p, np.sum(y**2, axis=1) * kappa / (before + r)]
    return squared, kappa, d, n * (1.0 - c * c) / (1.0 + c * c)


def sentences(count, seed, few=False):
    """Share of wrong verdicts, and of those that speak where 100 independent samples are."""
    rng, wrong, spoken = np.random.default_rng(seed), [], []
    right = {
        "too sure": lambda k: k > 1.0,
        "too cautious": lambda k: k < 1.0,
        "consistent": lambda k: k == 1.0,
    }
    for _ in range(count):
        squared, kappa, d, samples = filtered(rng, few)
        for series in squared:
            word = consistency.band(series, d).verdict
            wrong.append(not right.get(word, lambda k: True)(kappa))
            spoken += [word != "cannot tell"] if samples >= 100 else []
    return float(np.mean(wrong)), float(np.mean(spoken))


def test_the_verdict_is_seldom_wrong_and_speaks_where_it_can():
    """NEES and NIS of 250 filters. Of 6,000 such verdicts 0.95 % are wrong, and 99.9 % of those that can speak do; by
    chance 500 have more than 2.2 % wrong once in 100."""
    wrong, speaks = sentences(250, 1)
    assert wrong <= 0.03
    assert speaks >= 0.95


def test_short_runs_of_slow_errors_are_seldom_judged_wrongly():
    assert sentences(150, 2, few=True)[0] <= 0.05


def test_a_pose_that_nothing_bounds_has_too_few_samples_to_be_judged():
    """A random walk whose variance is right: a single draw of a slow error."""
    words = []
    for seed in range(200):
        walk = np.cumsum(np.random.default_rng(seed).standard_normal((2000, 3)), axis=0)
        words.append(consistency.band(np.sum(walk**2, axis=1) / np.arange(1, 2001), 3).verdict)
    assert words.count("cannot tell") >= 190


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
    assert consistency.band(value, freedom).verdict == "consistent"


def test_correlated_samples_count_for_less():
    """x_t = ρ x_{t−1} + w is worth N (1 − ρ)/(1 + ρ) samples; the estimate scatters by some %."""
    w, x = np.random.default_rng(0).standard_normal(40_000), np.zeros(40_000)
    for k in range(1, len(x)):
        x[k] = 0.9 * x[k - 1] + w[k]
    assert consistency.independent(x) == pytest.approx(40_000 * 0.1 / 1.9, rel=0.25)
    assert consistency.independent(w) == pytest.approx(40_000, rel=0.1)
    assert consistency.independent(x + 5.0, 0.0) < 100.0  # its mean is not what it is to be


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


def test_without_scipy_the_message_gives_the_command_to_type(without_scipy):
    with refused("lab.scipy-for-bands", UsageError):
        consistency._limits(10.0, 0.05)
