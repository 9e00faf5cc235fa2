"""A run that begins in motion: earlier commands are unknown and are not taken as zero."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.theta import make_records
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

LATE = 20  # ticks
STILL = {
    "model.process_noise_std": [0.0, 0.0, 0.0],
    "model.drivetrain.delay_s": LATE / 50.0,
    "model.quadratic_drag": 0.0,
}
FREE = ("model.throttle_gain", "model.linear_drag", "model.steering_gain")


@pytest.fixture(scope="module")
def moving_run():
    """Return a car whose commands are delayed, and a drive of it."""
    file, rng = load("car").with_values(STILL), np.random.default_rng(0)
    u = np.stack([np.repeat(rng.uniform(0.1, 0.6, 8), 50), np.repeat(rng.uniform(-0.5, 0.5, 8), 50)], axis=1)
    u[:5] = 0.0
    return file, simulate(file, u, 0)


def rows_of(file, run, at_rest=False):
    options, names = FitOptions(biases=False, at_rest=at_rest), file.sensors
    return (
        make_records([run], FittedBlocks(file.vehicle, names), {}, options)[0].sensors["odometer"].mask[:, 0]
    )


def test_rows_before_the_first_command_are_ignored_if_a_run_begins_in_motion(moving_run):
    file, run = moving_run
    part = run.cut(4.2)
    mask = rows_of(file, part)
    assert not mask[:LATE].any()
    assert mask[LATE + 1 :].all()


def test_in_short_runs_and_runs_from_rest_all_rows_count(moving_run):
    file, run = moving_run
    assert rows_of(file, run)[1:5].all()
    assert rows_of(file, run.cut(4.2), at_rest=True)[1:LATE].all()
    assert rows_of(file, run.cut(4.2, 4.2 + 1.5 * LATE / 50.0))[1:LATE].all()


def test_a_run_that_begins_in_motion_identifies_the_true_parameters(moving_run):
    file, run = moving_run
    fit = identify(run.cut(4.2), file, FREE, use=("odometer", "imu[2]"), options=FitOptions(diagnose=False))
    truth = np.array([file.value(name) for name in fit.names])
    assert np.all(np.abs(fit.estimate - truth) < 4.0 * fit.std)
    np.testing.assert_allclose(fit.estimate, truth, rtol=0.1)  # the gain was 1.4 times as large
