"""Normalised squared errors lie in their χ² bands if the covariance is correct, otherwise outside."""

import sys

import numpy as np
import pytest
from scipy import special
from scipy.signal import lfilter

from baqueano.compare import consistency
from baqueano.errors import UsageError
from tests.codes import refused

P = np.array([[4.0, 0.3, 0.0], [0.3, 0.09, 0.001], [0.0, 0.001, 1e-4]])


def draws(n, cov=P, seed=1):
    return np.random.default_rng(seed).multivariate_normal(np.zeros(len(cov)), cov, n)


def whitened(e, cov):
    return consistency.whiten(e, np.tile(cov, (len(e), 1, 1)))


def test_a_correct_covariance_is_consistent_at_the_nominal_rate():
    """Of 200 bands at 5 %, 181 to 198 contain the value with probability 0.9987 (binomial). The band is the wider of
    two, so all may contain the value."""
    bands = [consistency.band(whitened(draws(300, seed=seed), P)) for seed in range(200)]
    assert sum(band.low < band.mean < band.high for band in bands) > 180
    assert np.mean([band.high - band.low for band in bands]) < 1.25 * 4 * np.sqrt(2 / 900)


def test_a_wrong_covariance_is_called_too_sure_or_too_cautious():
    e = draws(2000)
    for factor, word in ((0.5, "too sure"), (2.0, "too cautious"), (1.0, "consistent"), (0.95, "consistent")):
        assert consistency.band(whitened(e, factor * P)).verdict == word
    assert consistency.band(whitened(e[:5], P)).verdict == "cannot tell"


def filtered(rng, count):
    """Return whitened errors and innovations of a steady Kalman filter of d copies of x_t = a x_{t−1} + w, z = x +
    v. The filter assumes 1/κ of the variances, so its gain is correct. Also return κ and the number of independent
    samples of the slower signal."""
    d, a, r = rng.integers(1, 4), rng.choice([0.0, 0.5, 0.9, 0.97, 0.99]), 10 ** rng.uniform(-2.0, 1.0)
    kappa = rng.choice([0.25, 0.5, 1.0, 1.0, 1.0, 2.0, 4.0])
    n = int(10 ** rng.uniform(2.0, 3.0 if count else 4.0))
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
    errors = [e[300:] * np.sqrt(kappa / p), y * np.sqrt(kappa / (before + r))]
    return errors, kappa, n * (1.0 - c * c) / (1.0 + c * c)


def sentences(count, seed, small_sample=False):
    """Return the share of wrong verdicts, and the share with a verdict among cases with 100 independent samples."""
    rng, false_alarms, decisions = np.random.default_rng(seed), [], []
    right = {
        "too sure": lambda k: k > 1.0,
        "too cautious": lambda k: k < 1.0,
        "consistent": lambda k: k == 1.0,
    }
    for _ in range(count):
        errors, kappa, samples = filtered(rng, small_sample)
        for w in errors:
            word = consistency.band(w).verdict
            false_alarms.append(not right.get(word, lambda k: True)(kappa))
            decisions += [word != "cannot tell"] if samples >= 100 else []
    return float(np.mean(false_alarms)), float(np.mean(decisions))


def test_the_verdict_is_seldom_wrong_and_seldom_missing():
    """NEES and NIS of 250 filters. Of 6,000 such verdicts 0.95 % are wrong, and 99.9 % of the possible verdicts are
    given. By chance, 500 verdicts have more than 2.2 % wrong once in 100."""
    errors, speaks = sentences(250, 1)
    assert errors <= 0.03
    assert speaks >= 0.95


def test_short_runs_of_slow_errors_are_seldom_judged_wrongly():
    assert sentences(150, 2, small_sample=True)[0] <= 0.05


def test_a_random_walk_of_the_error_gives_no_verdict():
    """A random walk with a correct variance is a single draw of a slow error."""
    words = []
    for seed in range(200):
        walk = np.cumsum(np.random.default_rng(seed).standard_normal((2000, 3)), axis=0)
        words.append(consistency.band(walk / np.sqrt(np.arange(1, 2001))[:, None]).verdict)
    assert words.count("cannot tell") >= 190


def test_units_do_not_change_the_verdict():
    scale = np.diag([1e6, 1e-6, 1.0])
    e = draws(50)
    a, b = (
        consistency.normalised_squared_error(pair)
        for pair in (whitened(e, P), whitened(e @ scale, scale @ P @ scale))
    )
    np.testing.assert_allclose(a, b, rtol=1e-9)


def test_a_singular_or_unknown_covariance_is_not_judged():
    cov = np.stack([P, np.zeros((3, 3)), np.full((3, 3), np.nan), -P])
    squares = consistency.normalised_squared_error(consistency.whiten(np.ones((4, 3)), cov))
    assert np.isfinite(squares).tolist() == [True, False, False, False]


def test_a_silent_sensor_is_excluded_from_the_innovations():
    y, S = draws(400), np.tile(P, (400, 1, 1))
    y[::2, 2] = np.nan  # a sensor at half the rate
    y[5] = np.nan
    w = consistency.whiten(y, S)
    value = consistency.normalised_squared_error(w)
    assert np.isnan(value[5])
    np.testing.assert_allclose(value[0], y[0, :2] @ np.linalg.solve(P[:2, :2], y[0, :2]))
    assert set(np.sum(np.isfinite(w), axis=1).tolist()) == {0, 2, 3}
    assert consistency.band(w).verdict == "consistent"


def test_correlated_errors_have_a_lower_weight():
    """x_t = a x_{t−1} + w has a correlation of squares a^(2k): it is worth N (1 − a²)/(1 + a²) samples."""
    w = np.random.default_rng(0).standard_normal((40_000, 2))
    x = lfilter([1.0], [1.0, -0.9], w, axis=0)
    assert consistency.degrees_of_freedom(x) == pytest.approx(2 * 40_000 * 0.19 / 1.81, rel=0.1)
    assert consistency.degrees_of_freedom(w) == pytest.approx(2 * 40_000, rel=0.05)
    assert consistency.degrees_of_freedom(w + 5.0) < 3.0  # an error that lasts


def with_a_bias(rng, kappa, share):
    """Return errors (N, d) with κ times the claimed variance; a share of the variance is one draw for the whole
    drive."""
    n, d = int(rng.integers(1000, 6000)), int(rng.integers(1, 4))
    return np.sqrt(kappa) * (
        np.sqrt(share) * rng.standard_normal(d) + np.sqrt(1.0 - share) * rng.standard_normal((n, d))
    )


def test_a_random_bias_does_not_make_a_correct_filter_inconsistent():
    """In 400 correct filters half of the variance is a bias. The false-alarm rate is 5 %: more than 33 alarms occur
    once in 1,000."""
    rng = np.random.default_rng(5)
    words = [consistency.band(with_a_bias(rng, 1.0, 0.5)).verdict for _ in range(400)]
    assert words.count("too sure") + words.count("too cautious") <= 33


def test_a_cautious_filter_without_a_bias_is_called_too_cautious():
    rng = np.random.default_rng(6)
    assert {consistency.band(with_a_bias(rng, 0.5, 0.0)).verdict for _ in range(50)} == {"too cautious"}


def test_only_white_innovations_are_called_white():
    y = draws(5000)
    slow = np.cumsum(y, axis=0)[:, :1] * [1.0, 1.0, 1.0]
    S = np.tile(P, (5000, 1, 1))
    assert np.all(np.abs(consistency.whiteness(y, S)) < 3.9 / np.sqrt(5000))  # 3.9 σ: 3 in 10 000
    assert np.all(consistency.whiteness(slow, S) > 0.9)


def test_a_missing_scipy_is_reported_with_the_install_command(without_scipy):
    with refused("lab.scipy-for-bands", UsageError):
        consistency._limits(10.0, 0.05)


def test_limits_have_their_probability_and_do_not_need_the_slow_import_of_scipy_stats(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.stats", None)
    for freedom in (1.0, 7.3, 5e4):
        limits = freedom * np.array(consistency._limits(freedom, 0.05))
        np.testing.assert_allclose(special.chdtr(freedom, limits), [0.025, 0.975], rtol=1e-9)
