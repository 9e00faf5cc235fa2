"""A disturbance of the wheels is a misfit if the accelerometer measures it or the floor slopes, otherwise slip."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from baqueano.estimators.augmented.state import layout
from baqueano.identify.noise.accelerometer_misfit import MIN_SHARE, accelerometer_share
from baqueano.vehicle_file import load

DT, SECONDS, ODOMETER, ACCEL = 0.02, 60.0, 0.02, 0.6
CAR = load("car")
N = round(SECONDS / DT)
T_S = DT * np.arange(N)


def fading(rng, std, fade_s):
    keep = np.exp(-DT / fade_s)
    return std * np.sqrt(1.0 - keep**2) * lfilter([1.0], [1.0, -keep], rng.standard_normal(N))


def part_of(r_v, r_a, rate, seed=1, seconds=SECONDS):
    """Return φ of a fit with these residuals and noise under this yaw rate."""
    n, rng, ekf = round(seconds / DT), np.random.default_rng(seed), CAR.estimator(use=("imu", "odometer"))
    noisy = [r_v + ODOMETER * rng.standard_normal(N), r_a + ACCEL * rng.standard_normal(N), rate]
    numbers = zip((("odometer", 0), ("imu", 0), ("imu", 2)), noisy, (0.0, 0.0, rate), strict=True)
    channels = [
        SimpleNamespace(
            run="a", sensor=name, entry=k, t_s=T_S[:n], measured=x[:n], predicted=(0.0 * x + h)[:n]
        )
        for (name, k), x, h in numbers
    ]
    assert layout(ekf).names == ("imu", "odometer")
    return accelerometer_share(ekf, SimpleNamespace(runs=("a",), channels_by_run=[channels]), {"imu"})


@pytest.fixture
def rate():
    return fading(np.random.default_rng(0), 1.0, 1.0)


def test_a_push_measured_by_the_accelerometer_is_a_misfit(rate):
    push = fading(np.random.default_rng(2), 1.0, 0.5)
    assert part_of(np.cumsum(push) * DT, push, rate) > 0.9


def test_a_disturbance_that_only_the_wheels_measure_is_slip(rate):
    slip = fading(np.random.default_rng(3), 0.1, 0.5)
    assert part_of(slip, np.zeros(N), rate) < 0.1


def test_a_part_of_slip_with_a_simultaneous_push_counts_as_misfit(rate):
    push, slip = fading(np.random.default_rng(4), 1.0, 0.5), fading(np.random.default_rng(5), 0.1, 0.5)
    assert 0.2 < part_of(slip + np.cumsum(push) * DT, push, rate) <= 1.0


def test_a_sloping_floor_is_not_counted_as_slip(rate):
    """Gravity pushes the vehicle depending on its heading; model and accelerometer do not contain this force, and
    drag damps it."""
    push = 0.8 * np.cos(np.cumsum(rate) * DT)
    r_v = lfilter([DT], [1.0, DT / 0.4 - 1.0], push)
    assert part_of(r_v, -r_v / 0.4, rate) > 0.9


def test_slip_is_not_separated_from_misfit_in_a_short_or_consistent_run(rate):
    slip = fading(np.random.default_rng(3), 0.1, 0.5)
    assert part_of(slip, np.zeros(N), rate, seconds=8.0) == 1.0
    assert part_of(np.zeros(N), np.zeros(N), rate) > 10.0 * MIN_SHARE
