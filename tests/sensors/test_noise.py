"""Noise is tested by its statistics, with fixed seeds.

A correct sensor fails each bound at one seed in 10⁴, and all bounds together (about 30 numbers) at one seed in 300.
"""

import numpy as np
import pytest

from baqueano.sensors import Imu
from baqueano.signals import Motion

STILL = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
N = 4000
NORMAL_1E_4 = 3.89  # two-sided quantile of the normal at 10⁻⁴


def record(imu: Imu, seed: int, ticks: int = N, dt_s: float = 0.01) -> np.ndarray:
    state, rows = imu.init(), []
    for noise in np.random.default_rng(seed).standard_normal((ticks, imu.noise_size)):
        state, slot = imu.step(state, STILL, dt_s, noise)
        rows.append(slot.z)
    return np.array(rows)


@pytest.fixture(scope="module")
def white() -> np.ndarray:
    """Return 4000 readings over their std; the false-alarm rate is 10⁻⁴ per channel in each test that uses them."""
    imu = Imu(accel_noise_std=np.array([0.15, 0.2]), gyro_noise_std=0.005)
    return record(imu, seed=1) / np.array([0.15, 0.2, 0.005])


def test_white_noise_has_zero_mean(white):
    assert np.all(np.abs(white.mean(0)) * np.sqrt(N) < NORMAL_1E_4)


def test_white_noise_has_the_given_std(white):
    """Σ z² is χ² with N degrees: normal within 3.89 √(2N) of N at N = 4000."""
    assert np.all(np.abs(np.square(white).sum(0) - N) < NORMAL_1E_4 * np.sqrt(2 * N))


def test_white_noise_has_no_autocorrelation(white):
    r = (white[1:] * white[:-1]).mean(0)
    assert np.all(np.abs(r) * np.sqrt(N - 1) < NORMAL_1E_4)


def test_noise_channels_are_uncorrelated(white):
    r = np.array([(white[:, i] * white[:, j]).mean() for i, j in ((0, 1), (0, 2), (1, 2))])
    assert np.all(np.abs(r) * np.sqrt(N) < NORMAL_1E_4)


def test_white_noise_is_normal(white):
    """Kurtosis 3 ± 3.89 √(24/N)."""
    assert np.all(np.abs((white**4).mean(0) - 3.0) < NORMAL_1E_4 * np.sqrt(96.0 / N))


@pytest.mark.parametrize("dt_s", [0.01, 0.04])
def test_a_bias_walk_grows_with_the_root_of_time_for_any_ticks(dt_s):
    """The N steps, each divided by σ √δ, are white: χ² with N degrees; false-alarm rate 10⁻⁴ per channel."""
    imu = Imu(accel_bias_walk=0.02, gyro_bias_walk=0.003, rate_hz=1.0 / dt_s)
    walk = record(imu, seed=2, dt_s=dt_s)
    steps = np.diff(walk, axis=0, prepend=0.0) / (np.array([0.02, 0.02, 0.003]) * np.sqrt(dt_s))
    assert np.all(np.abs(np.square(steps).sum(0) - N) < NORMAL_1E_4 * np.sqrt(2 * N))
    assert np.all(np.abs((steps[1:] * steps[:-1]).mean(0)) * np.sqrt(N - 1) < NORMAL_1E_4)


def test_averaging_reduces_white_noise_until_the_bias_walk_dominates():
    """As in an Allan plot, the mean of n readings of white noise has σ/√n and grows under the bias walk.

    400 blocks of 10 readings have bounds at 10⁻⁴ from χ² with 399 degrees. In 10 blocks of 400 the walk has 365
    times the variance of the noise (false-alarm rate of the factor 3 below 10⁻⁴).
    """
    resting = record(Imu(gyro_noise_std=0.01), seed=3)[:, 2]
    means = resting.reshape(-1, 10).mean(1)
    assert 0.72 < np.var(means) / (0.01**2 / 10) < 1.30
    walking = record(Imu(gyro_noise_std=0.01, gyro_bias_walk=0.05), seed=3)[:, 2]
    assert np.std(walking.reshape(-1, 400).mean(1)) > 3.0 * np.std(resting.reshape(-1, 400).mean(1))


def test_rounding_adds_a_twelfth_of_a_step_squared():
    """Sheppard: with noise of a step the error of rounding is even in ± step/2; the mean square of 4000
    errors is within 3.89 √(1/180/N) of step²/12."""
    fine = record(Imu(gyro_noise_std=0.01), seed=4)[:, 2]
    rounded_rate = record(Imu(gyro_noise_std=0.01, gyro_step=0.01), seed=4)[:, 2]
    error = (rounded_rate - fine) / 0.01
    assert np.max(np.abs(error)) <= 0.5 + 1e-9
    assert abs(np.mean(error**2) - 1.0 / 12.0) < NORMAL_1E_4 * np.sqrt(1.0 / 180.0 / N)
