"""Q and R of the recommended filter against robots of the independent truth, whose noise and floor are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.compare.filter_consistency import filter_consistency
from baqueano.drive import replay
from baqueano.identify import excitation, identify, measure_noise
from baqueano.identify.noise import filter_noise
from baqueano.numerics.quasi_newton import minimise_logarithms
from baqueano.study.corridor.vehicles import identify_vehicles, vehicles
from baqueano.study.counterpart import drive_runs, robot_file
from baqueano.study.counterpart.cars import ODOMETER_M_S
from baqueano.study.estimation.simulated import ODOMETER
from baqueano.study.identification.trials import FLOOR_NOISE, draw_robot, quantised_commands
from baqueano.vehicle_file import parse

pytestmark = pytest.mark.long

SENSOR, VELOCITY = 1.5, 2.0  # times, of a variance
SECONDS = 40.0


@pytest.fixture(scope="module", params=[1, 2])
def noise_case(request):
    """Return the true values of a robot on a rough floor, its file, and the noise that a fit of its friction
    identifies."""
    seed = request.param
    q = draw_robot(seed)
    q = q.with_parameters(floor=np.array([FLOOR_NOISE]))
    file = parse(robot_file(q).text + ODOMETER, "robot.toml").with_values(
        {"estimator.use": ["imu", "odometer"], "model.process_noise_std": [0.0, 0.0, 0.0]}
    )
    u = quantised_commands(
        excitation("random_steps", file.command.limit, SECONDS, file.rate_hz, seed, rest_s=0.0)
    )
    run = replace(drive_runs([q], [u], [seed], [file])[0], truth=None)
    return q, file, measure_noise(identify(run, file, ["model.friction.linear"]), run)


def within(value, truth, factor):
    return truth / factor <= value <= truth * factor


def test_the_identified_variance_of_each_channel_equals_the_true_variance(noise_case):
    q, _, noise = noise_case
    for k, truth in enumerate(q.imu.noise[0] ** 2):
        assert within(noise.in_motion["imu"][k, k], truth, SENSOR), f"imu[{k}]"
    assert within(noise.in_motion["odometer"][0, 0], ODOMETER_M_S**2, SENSOR)


def test_the_identified_velocity_walk_equals_the_true_floor_noise(noise_case):
    _, _, noise = noise_case
    for k in (0, 2):
        assert within(noise.fields["velocity_walk_std"][k] ** 2, FLOOR_NOISE[k] ** 2, VELOCITY), k


def test_the_noise_table_shows_the_values_written_to_the_file(noise_case):
    _, file, noise = noise_case
    written_data = noise.updated_file(file).data
    deviations = {row["name"]: row["std"] for row in noise.rows()}
    for name in ("imu", "odometer"):
        for k, variance in enumerate(np.diagonal(written_data["sensors"][name]["measurement_noise_cov"])):
            assert deviations[f"{name}[{k}]"] == pytest.approx(np.sqrt(variance))
    for name in ("disturbance_std", "disturbance_fade_s", "velocity_walk_std"):
        for k, value in enumerate(written_data["estimator"][name]):
            assert deviations[f"{name}[{k}]"] == pytest.approx(value)


def test_the_search_reaches_the_minimum_along_a_narrow_ridge():
    """On a ridge no change of a single parameter improves the cost."""
    for sign in (1.0, -1.0):
        estimate = minimise_logarithms(
            lambda x: 1e4 * (x[0] + sign * x[1]) ** 2 + (x[0] - 3.0) ** 2,  # noqa: B023  used at once
            np.zeros(2), np.full(2, -5.0), np.full(2, 5.0),
        )  # fmt: skip
        np.testing.assert_allclose(estimate, [3.0, -3.0 * sign], atol=0.05)


def _gyro_variance_range(residuals, rest_variance):
    channel = SimpleNamespace(sensor="imu", entry=2, residuals=residuals)
    return filter_noise._variance_range(
        SimpleNamespace(channels=(channel,)), "imu", 2, np.diag([1.0, 1.0, rest_variance]), 1.0
    )


def test_white_residuals_are_noise_of_the_gyro_even_if_the_model_turns_wrongly():
    """The motion of a wrong model is slow, so it does not make a gyro exact."""
    rng, t_s = np.random.default_rng(0), 0.02 * np.arange(5000)
    noise = 0.004 * rng.standard_normal(5000) * np.where(np.arange(5000) % 50 == 0, 20.0, 1.0)  # and outliers
    low, high = _gyro_variance_range(noise + 0.1 * np.sin(6.0 * t_s), 1e-6)
    assert high == pytest.approx(0.004**2, rel=0.15)
    assert low > 0.8 * high


@pytest.mark.parametrize(("rest_share", "is_limit"), [(0.5, True), (100.0, False)])
def test_a_rough_floor_is_not_noise_of_the_gyro_and_its_noise_at_rest_is_the_limit(rest_share, is_limit):
    walk = np.cumsum(0.004 * np.random.default_rng(0).standard_normal(5000))
    high = _gyro_variance_range(walk, np.inf)[1]
    low = _gyro_variance_range(walk, rest_share * high)[0]
    assert low == rest_share * high if is_limit else low < 0.3 * high


def test_a_motor_with_another_lag_does_not_make_the_gyro_too_cautious_in_a_calm_drive():
    """The current of the motors lags, not their voltage. Their commands change slowly, unlike those of the fit."""
    robots, t_s = vehicles([4]), np.arange(4000) * 0.01
    file = identify_vehicles(robots, [4], "auto")[0]
    u = np.stack([0.6 + 0.2 * np.sin(0.9 * t_s), 0.0 * t_s, 0.15 * np.sin(0.5 * t_s)], axis=1)
    replayed_run = replay(drive_runs([robots], [u], [5], [file])[0], file)
    assert 0.85 < filter_consistency(replayed_run).channels["imu[2]"].mean < 1.15  # 0.69 with one disturbance
