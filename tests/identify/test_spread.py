"""The noise of a channel: from rows that inform, and growing with speed."""

import numpy as np
import pytest

from baqueano.identify import FitOptions
from baqueano.identify.residuals.informative_rows import informative_rows
from baqueano.numerics.noise_level import robust_sigma, speed_profile


def test_rows_with_an_encoder_at_rest_do_not_reduce_the_noise_estimate():
    """In two thirds of the rows measurement and model are 0, except for a remainder of the start."""
    rng = np.random.default_rng(0)
    noise = rng.normal(scale=0.05, size=(3000, 1))
    z, waiting = 1.0 + noise, noise.copy()
    z[:2000], waiting[:2000, 0] = 0.0, 1e-5 * rng.normal(size=2000)
    masks = [np.ones((3000, 1))]
    moving_only = robust_sigma([noise[2000:]], [np.ones((1000, 1))], np.zeros(1))
    assert robust_sigma([waiting], informative_rows([waiting], masks, [z]), np.zeros(1)) == pytest.approx(
        moving_only
    )
    assert robust_sigma([waiting], masks, np.zeros(1)) < 1e-4  # the expected spread
    assert moving_only == pytest.approx(0.05, rel=0.1)  # 4.6 standard errors of a median of 1,000


def test_a_model_that_moves_while_the_encoder_rests_is_reported():
    residuals, z = np.full((100, 1), -0.3), np.zeros((100, 1))
    z[50:] = 1.0
    assert informative_rows([residuals], [np.ones((100, 1))], [z])[0].all()


def test_all_rows_of_a_constant_channel_are_used():
    zero = np.zeros((50, 1))
    assert informative_rows([zero], [np.ones((50, 1))], [zero])[0].all()


def draw(kappa, seed, n=4000):
    rng = np.random.default_rng(seed)
    v = np.abs(rng.uniform(0.0, 2.0, n))
    truth = 0.3 * np.sqrt(1.0 + (kappa * v) ** 2)
    return rng.normal(size=n) * truth, v, truth


def test_growth_of_the_noise_with_speed_is_estimated_despite_outliers():
    r, v, truth = draw(1.5, 0)
    r[::20] += 30.0
    sigma, (profile,) = speed_profile([r[:, None]], [np.ones((len(r), 1))], [v], np.array([1e-9]))
    np.testing.assert_allclose(sigma[0] * profile[:, 0], truth, rtol=0.25)
    np.testing.assert_allclose(np.mean(profile**2), 1.0)


def test_constant_noise_is_recognised_in_19_of_20_runs():
    steady = 0
    for seed in range(20):
        r, v, _ = draw(0.0, seed)
        _, (profile,) = speed_profile([r[:, None]], [np.ones((len(r), 1))], [v], np.array([1e-9]))
        steady += np.ptp(profile) == 0.0
    assert steady >= 19


def test_a_fit_gives_fast_driving_less_weight_if_noise_grows_with_speed(small):
    from dataclasses import replace

    from baqueano.identify import identify, random_steps
    from baqueano.runs.run import Channel
    from baqueano.simulate import simulate

    u = random_steps(small.command.limit, 30.0, small.rate_hz, 2)
    run = simulate(small, u, 2)
    imu = run.sensors["imu"]
    index = np.searchsorted(run.t_ns, imu.t_ns)
    rng = np.random.default_rng(0)
    z = imu.z + rng.normal(size=imu.z.shape) * [3.0, 3.0, 0.3] * np.abs(run.truth.nu[index, :1])
    run = replace(run, sensors={"imu": Channel(imu.t_ns, imu.arrival_ns, z)})
    free = ["model.actuator_matrix[0,0]", "model.friction.linear[0]"]
    steady = identify(run, small, free)
    growing = identify(run, small, free, options=FitOptions(speed_noise=True))
    assert np.all(growing.std < 0.9 * steady.std)
    truth = np.array([small.value(name) for name in growing.names])
    assert np.max(np.abs(growing.estimate - truth) / growing.std) < 4.5
