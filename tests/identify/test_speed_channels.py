"""Which accelerometers correct the speed, and which part of the error of the wheels they also measure."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from baqueano.estimators.augmented.state import layout
from baqueano.identify import excitation, identify, measure_noise
from baqueano.identify.noise.held_out import speed_channels
from baqueano.identify.noise.speed_error import MIN_SHARE, accelerometer_share
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.numerics.statistics import block_ratio
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, parse

SMALL = load("small")
FREE = ["model.friction.linear[0]", "model.friction.linear[2]"]
TEST_DRIVE_S = 80.0


def drive_fit(file, seconds_, seed, **truth):
    u = excitation("random_steps", file.command.limit, seconds_, file.rate_hz, seed=seed)
    return simulate(file.with_values(truth), u, seed)


@pytest.fixture(scope="module")
def fit():
    return identify(run := drive_fit(SMALL, 30.0, 1), SMALL, FREE), run


def test_without_a_validation_run_no_speed_channel_is_chosen(fit):
    noise = measure_noise(*fit)
    assert noise.speed is not None
    assert not noise.speed.is_from_held_out
    assert noise.speed.message.fix == "--held-out RUN"
    assert "speed_from" not in noise.updated_file(fit[0].vehicle_file).data["estimator"]
    blind = replace(drive_fit(SMALL, 20.0, 2), truth=None)
    assert measure_noise(*fit, held_out=[blind]).speed == noise.speed


def test_the_sensor_that_measures_the_speed_is_named():
    text = load("small").text + '\n[sensors.wheels]\nkind = "wheels"\ntrack_m = 0.12\nnoise_std = 0.01\n'
    for use, code in ((("imu",), "speed.of-the-model"), (("imu", "wheels"), "speed.of-sensors")):
        ekf = parse(text, "small").estimator(use=use)
        speed = speed_channels(lambda names, ekf=ekf: ekf, (), [])
        assert speed.message.code == "speed.by-the-model"
        assert speed.message.figures["origin"].code == code


@pytest.mark.long
def test_accelerometers_that_help_on_an_unseen_run_correct_the_speed(fit):
    """The floor pushes the vehicle: no command explains this, but an accelerometer measures it."""
    pushes = {"model.process_noise_std": [0.2, 0.0, 0.2]}
    own_run, unseen_run = (
        drive_fit(SMALL, seconds_, seed, **pushes) for seconds_, seed in ((30.0, 1), (TEST_DRIVE_S, 2))
    )
    fit = identify(own_run, SMALL, FREE), own_run
    noise = measure_noise(*fit, held_out=[unseen_run])
    assert noise.speed is not None
    assert noise.speed.is_from_held_out
    assert noise.speed.names
    assert "truth" in noise.speed.message.figures["reference"]
    fitted_file = noise.updated_file(fit[0].vehicle_file)
    assert fitted_file.estimator().speed_from == noise.speed.names


def test_accelerometers_that_worsen_the_speed_are_not_used(fit):
    """The IMU was tilted by 3 degrees after the fit: a_x shows a slope that does not exist."""
    bias = SMALL.sensors.imu.accel_bias + np.array([0.5, 0.5])
    unseen_run = drive_fit(SMALL, TEST_DRIVE_S, 2, **{"sensors.imu.accel_bias": bias.tolist()})
    noise = measure_noise(*fit, held_out=[unseen_run])
    assert noise.speed is not None
    assert noise.speed.names == (), noise.speed.message


def test_too_few_segments_do_not_change_the_choice_in_the_file():
    ekf, file_names = SMALL.estimator(), ("imu[0]",)
    speed = speed_channels(
        lambda names: replace(ekf, speed_from=names), file_names, [drive_fit(SMALL, 20.0, 3)]
    )
    assert (speed.names, speed.message.code) == (file_names, "speed.too-short")
    assert not speed.is_from_held_out


def test_the_error_ratio_over_blocks_is_computed_from_their_sums():
    rng = np.random.default_rng(0)
    block_sums, reference = rng.uniform(1.0, 2.0, 40), rng.uniform(4.0, 8.0, 40)
    ratio, low, high = block_ratio(block_sums, reference)
    assert ratio == pytest.approx(np.sqrt(block_sums.sum() / reference.sum()), rel=1e-12)
    assert low < ratio < high < 1.0


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
        ChannelFit("a", name, k, T_S[:n], x[:n], (0.0 * x + h)[:n], 1.0, 0.0, 0.0)
        for (name, k), x, h in numbers
    ]
    assert layout(ekf).names == ("imu", "odometer")
    return accelerometer_share(
        ekf, SimpleNamespace(vehicle_file=CAR, runs=("a",), channels_by_run=[channels]), {"imu"}
    )


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
