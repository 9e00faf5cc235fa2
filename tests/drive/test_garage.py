"""All vehicles of the garage drive with the same commands: the two-wheeled vehicle, the vehicle of the paper, and a
car.
"""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.drive import drive_stop_reason, experiment, repeat, replay, teach
from baqueano.drive.session import example_tick
from baqueano.guides.shapes import circle
from baqueano.symbolic import compile_block, value_at_path, with_value
from baqueano.vehicle_file import load


@pytest.mark.parametrize(("name", "radius_m", "speed_m_s"), [("small", 0.5, 0.25), ("car", 1.5, 1.0)])
def test_a_circle_is_taught_repeated_and_replayed(name, radius_m, speed_m_s):
    file = load(name)
    lesson = teach(file, circle(radius_m, speed_m_s), seed=1)
    assert drive_stop_reason(lesson.run) is None
    run = repeat(file, lesson.route, seed=2)
    assert drive_stop_reason(run) is None
    assert run.reference.at_end[-1] == 1.0
    # the lap was completed, although the gains are untuned
    assert np.ptp(run.truth.eta[:, 1]) > 0.5 * radius_m
    replayed_run = replay(run, file)
    assert np.array_equal(replayed_run.estimate.eta, run.estimate.eta)
    assert np.array_equal(replayed_run.estimate.cov, run.estimate.cov)
    assert np.array_equal(replayed_run.requested_commands, run.requested_commands)


WRONG = {
    "small": {"actuator_matrix": 1.08, "friction.linear": 0.9},
    "car": {"throttle_gain": 1.08, "linear_drag": 0.9, "steering_gain": 1.05},
}


@pytest.mark.parametrize("speed_from", [(), ("imu[0]", "imu[1]")], ids=["gyro", "accelerometers"])
@pytest.mark.parametrize("name", WRONG)
def test_the_filter_is_better_than_a_model_with_10_percent_error(name, speed_from):
    """Speed and yaw rate over 20 s of random steps are compared with the same filter without its sensors."""
    file, rng = load(name), np.random.default_rng(5)
    steps = rng.uniform(-1, 1, (40, file.vehicle.commands)) * file.command.limit * 0.8
    run = experiment(file, np.repeat(steps, round(file.rate_hz / 2), axis=0), seed=6)
    assert drive_stop_reason(run) is None
    vehicle = file.vehicle
    for path, factor in WRONG[name].items():
        vehicle = with_value(vehicle, path, value_at_path(vehicle, path) * factor)
    block = replace(
        file.estimator(), vehicle=vehicle, disturbance_std=np.array([0.3, 3.0]), speed_from=speed_from
    )
    ekf = compile_block(block)
    silent = example_tick(file).sensors
    with_sensors, blind = ekf.init(), ekf.init()
    errors = []
    for tick, truth in zip(run.ticks(), run.truth.nu, strict=True):
        with_sensors, a = ekf.step(with_sensors, tick)
        blind, b = ekf.step(blind, tick._replace(sensors=silent))
        errors.append([a.nu - truth, b.nu - truth])
    filter_error, model = np.sqrt(np.mean(np.array(errors) ** 2, axis=0))
    assert filter_error[0] < (0.7 if "odometer" in block.use or speed_from else 1.01) * model[0]
    assert filter_error[2] < 0.3 * model[2]
