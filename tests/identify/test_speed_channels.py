"""Unseen runs decide which accelerometers may correct the speed."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.drive import experiment
from baqueano.identify import excitation, identify, measure_noise
from baqueano.identify.noise.speed_channels import ratio_of_blocks
from baqueano.vehicle_file import load

SMALL = load("small")
FREE = ["model.friction.linear[0]", "model.friction.linear[2]"]
HELD_S = 80.0


def drive_fit(file, seconds_, seed, **truth):
    u = excitation("random_steps", file.command.limit, seconds_, file.rate_hz, seed=seed)
    return experiment(file, u, truth=file.with_values(truth), seed=seed)


@pytest.fixture(scope="module")
def fit():
    return identify(run := drive_fit(SMALL, 30.0, 1), SMALL, FREE), run


def test_without_a_validation_run_no_speed_channel_is_chosen(fit):
    noise = measure_noise(*fit)
    assert noise.speed is not None
    assert not noise.speed.decided
    assert noise.speed.message.fix == "--held-out RUN"
    assert "speed_from" not in noise.updated_file(fit[0].vehicle_file).data["estimator"]
    blind = replace(drive_fit(SMALL, HELD_S, 2), truth=None)
    assert measure_noise(*fit, held_out=[blind]).speed == noise.speed


@pytest.mark.long
def test_accelerometers_that_help_on_an_unseen_run_correct_the_speed(fit):
    """The floor pushes the vehicle: no command explains this, but an accelerometer measures it."""
    pushes = {"model.process_noise_std": [0.2, 0.0, 0.2]}
    own_run, unseen_run = (
        drive_fit(SMALL, seconds_, seed, **pushes) for seconds_, seed in ((30.0, 1), (HELD_S, 2))
    )
    fit = identify(own_run, SMALL, FREE), own_run
    noise = measure_noise(*fit, held_out=[unseen_run])
    assert noise.speed is not None
    assert noise.speed.decided
    assert noise.speed.names
    assert "truth" in noise.speed.message.figures["by"]
    fitted_file = noise.updated_file(fit[0].vehicle_file)
    assert fitted_file.estimator().speed_from == noise.speed.names


def test_accelerometers_that_worsen_the_speed_are_not_used(fit):
    """The IMU was tilted by 3 degrees after the fit: a_x shows a slope that does not exist."""
    bias = SMALL.sensors.imu.accel_bias + np.array([0.5, 0.5])
    unseen_run = drive_fit(SMALL, HELD_S, 2, **{"sensors.imu.accel_bias": bias.tolist()})
    noise = measure_noise(*fit, held_out=[unseen_run])
    assert noise.speed is not None
    assert noise.speed.names == (), noise.speed.message


def test_with_too_few_segments_no_accelerometer_is_chosen(fit):
    noise = measure_noise(*fit, held_out=[drive_fit(SMALL, 20.0, 3)])
    assert noise.speed is not None
    assert noise.speed.names == ()
    assert noise.speed.message.code == "speed.too-short"


def test_the_error_ratio_over_blocks_is_computed_from_their_sums():
    rng = np.random.default_rng(0)
    block_sums, reference = rng.uniform(1.0, 2.0, 40), rng.uniform(4.0, 8.0, 40)
    ratio, low, high = ratio_of_blocks(block_sums, reference)
    assert ratio == pytest.approx(np.sqrt(block_sums.sum() / reference.sum()), rel=1e-12)
    assert low < ratio < high < 1.0
