"""A robot of the independent truth whose tyres slip six times less than those of its model: no gyro shows it."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.estimators.augmented.motion import SIDESLIP_ERROR_S
from baqueano.estimators.augmented.state import SIDESLIP_INDEX
from baqueano.identify.noise.filter_noise import SIDEWAYS_NOISE, _free_noise
from baqueano.runs.run import Channel
from baqueano.signals import Tick, empty_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, robot_file, vehicle_run
from baqueano.study.identification.trials import draw_robot, quantised_commands
from baqueano.symbolic import compile_block
from baqueano.vehicle_file import load, parse

CAMERA = '\n[sensors.camera]\nkind = "pose"\nrate_hz = 20.0\nnoise_std = [0.002, 0.002, 0.01]\n'
NOISE = np.array([0.002, 0.002, 0.01])
WALKS = {"estimator.disturbance_std": [0.2, 0.5], "estimator.velocity_walk_std": [0.02, 0.01, 0.05]}


def estimated(use):
    """Return the errors of the sideways velocity (N,) and their variances, from the third second on."""
    robot, t_s = draw_robot(0), np.arange(2000) * 0.01
    u = quantised_commands(np.stack([0.6 + 0.0 * t_s, 0.0 * t_s, 0.2 * np.sign(np.sin(t_s))], axis=1))
    file = parse(robot_file(robot).text + CAMERA, "robot.toml").with_values(WALKS | {"estimator.use": use})
    grippy = robot.with_parameters(viscous=robot.viscous * np.array([1.0, 6.0, 1.0]))
    motion = drive_group(grippy, u[:, None], [1], tick_times(len(u), file.rate_hz), 5e-3)
    run = vehicle_run(motion, 0, u, file, "grippy", 1)
    k, white = np.arange(0, len(u), 5), np.random.default_rng(1).standard_normal((400, 3))
    camera = Channel(run.t_ns[k], run.t_ns[k], motion.truth[k, 0, :3] + NOISE * white)
    run, estimator = replace(run, sensors=run.sensors | {"camera": camera}), compile_block(file.estimator())
    belief, estimates = estimator.init(), []
    for tick in run.ticks():
        belief, estimate = estimator.step(belief, tick)
        estimates.append((estimate.nu[1], estimate.cov[4, 4]))
    nu_y, variance = np.array(estimates).T
    return (nu_y - motion.truth[: len(nu_y), 0, 4])[300:], variance[300:]


@pytest.mark.parametrize("use", [["imu"], ["imu", "camera"]])
def test_the_sideways_velocity_is_as_uncertain_as_it_is_wrong(use):
    error, variance = estimated(use)
    assert np.mean(error**2 / variance) < 1.5


def test_a_camera_estimates_the_sideslip():
    by_gyro, by_camera = (np.sqrt(np.mean(estimated(use)[0] ** 2)) for use in (["imu"], ["imu", "camera"]))
    assert by_camera < 0.3 * by_gyro


@pytest.mark.parametrize(("use", "is_shown"), [(["imu"], False), (["imu", "camera"], True)])
def test_the_walk_of_the_sideways_velocity_is_free_if_a_sensor_shows_it(use, is_shown):
    file = parse(robot_file(draw_robot(0)).text + CAMERA, "robot.toml").with_values({"estimator.use": use})
    free = _free_noise(file.estimator(), {"imu"}, {}, {"imu": 4000, "camera": 400})
    assert (SIDEWAYS_NOISE[0] in [parameter.path for parameter in free]) is is_shown


def test_a_known_sideslip_error_becomes_as_uncertain_as_before():
    """σ² = σ₀² (1 − e^(−2t/T)) of a variable that decays with T, after 4 s."""
    estimator = compile_block(load("small").estimator())
    belief, is_other = estimator.init(), 1.0 - np.eye(len(estimator.init().mean))[SIDESLIP_INDEX]
    belief = belief._replace(cov=belief.cov * np.outer(is_other, is_other))
    for k in range(401):
        belief, _ = estimator.step(belief, Tick((k + 1) * 10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    expected = 1.0 - np.exp(-2.0 * 4.01 / SIDESLIP_ERROR_S)
    assert np.asarray(belief.cov)[SIDESLIP_INDEX, SIDESLIP_INDEX] == pytest.approx(expected, rel=0.01)
