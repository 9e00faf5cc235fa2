"""The Allan deviation compared with a public implementation, and its coefficients with synthetic noise.

Seeds are fixed. Of 8 × 40 intervals of 95 %, 287 to 317 contain the truth, at four standard deviations of the count.
"""

import numpy as np
import pytest
from scipy.stats import chi2

from baqueano.calibration.at_rest import allan_deviation, coefficients
from baqueano.errors import UsageError
from baqueano.numerics.statistics import chi_square
from tests.codes import of_code

RATE = 100.0


def noise_of(white, flicker, walk, seed, n=60_000):
    """Return white noise and a random walk per √Hz and s^1.5, and flicker from shaped white noise."""
    rng = np.random.default_rng(seed)
    y = white * np.sqrt(RATE) * rng.normal(size=n)
    y += walk / np.sqrt(RATE) * np.cumsum(rng.normal(size=n))
    f = np.fft.rfftfreq(n, 1.0 / RATE)
    shape = np.zeros_like(f)
    shape[1:] = flicker / np.sqrt(2.0 * np.pi * f[1:]) * np.sqrt(RATE / 2.0) * np.sqrt(2.0)
    return y + np.fft.irfft(np.fft.rfft(rng.normal(size=n)) * shape, n)


# allantools 2024.6: oadev(y, rate=100.0, data_type="freq", taus=2**np.arange(11) / 100.0)[1]
ALLANTOOLS = [
    0.2949107567, 0.20200493794, 0.139320028489, 0.0973583787462, 0.0714019842891, 0.0503015610065,
    0.0352481981143, 0.0252894129456, 0.0259408280835, 0.0391396800641, 0.0770833679725,
]  # fmt: skip


def test_the_allan_deviation_equals_the_result_of_allantools():
    k = np.arange(4096)
    y = ((k * k * 7919) % 10007) / 10007.0 + 1e-4 * k
    np.testing.assert_allclose(allan_deviation(y, RATE, 2 ** np.arange(11)).deviation, ALLANTOOLS, rtol=1e-10)


def test_a_bias_does_not_change_the_allan_deviation():
    y = noise_of(1e-3, 0.0, 0.0, 1)
    np.testing.assert_allclose(
        allan_deviation(y + 7.0, RATE).deviation, allan_deviation(y, RATE).deviation, rtol=1e-9
    )


def test_intervals_of_the_allan_deviation_cover_white_noise():
    count = 0
    for seed in range(40):
        curve = allan_deviation(noise_of(1e-3, 0.0, 0.0, seed, 4096), RATE)
        truth = 1e-3 / np.sqrt(curve.tau_s)
        count += int(np.sum((curve.low <= truth) & (truth <= curve.high))[()]) * 8 / len(truth)
    assert 287 <= count <= 317


@pytest.mark.parametrize(
    ("truth", "part"), [((1e-3, 0.0, 0.0), 0), ((1e-3, 0.0, 5e-4), 2), ((1e-4, 1e-3, 0.0), 1)]
)
def test_each_noise_coefficient_is_estimated_within_15_percent(truth, part):
    fits = [coefficients(allan_deviation(noise_of(*truth, seed), RATE)) for seed in range(8)]
    value = np.median([c.value[part] for c in fits])
    assert value == pytest.approx(truth[part], rel=0.15)
    assert all(c.is_measurable[part] for c in fits)


def test_noise_terms_that_are_absent_are_seldom_reported():
    fits = [coefficients(allan_deviation(noise_of(1e-3, 0.0, 0.0, seed), RATE)) for seed in range(10)]
    assert sum(c.is_measurable[1:].any() for c in fits) <= 2


def test_the_chi_square_quantile_approximates_scipy():
    nu = np.array([4.0, 10.0, 30.0, 1000.0])
    for normal, part in ((-1.959964, 0.025), (1.959964, 0.975)):
        np.testing.assert_allclose(chi_square(nu, normal), chi2.ppf(part, nu), rtol=0.08)


@pytest.mark.parametrize(
    ("y", "rate", "n", "code"),
    [
        (np.zeros(3), 100.0, None, "allan.numbers"),
        (np.full(50, np.nan), 100.0, None, "allan.numbers"),
        (np.zeros(50), 0.0, None, "allan.rate"),
        (np.zeros(50), 100.0, np.array([40]), "allan.averages"),
    ],
)
def test_a_signal_without_an_allan_deviation_is_refused(y, rate, n, code):
    with pytest.raises(UsageError, check=of_code(code)):
        allan_deviation(y, rate, n)
