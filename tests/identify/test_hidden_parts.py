"""Effects that a run shows and its file lacks: an IMU low-pass and duty steps, on the independent truth."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, excitation, identify
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, robot_file, robot_values, vehicle_run
from baqueano.study.identification.trials import draw_robot, quantised_commands
from baqueano.study.truth import merge

DELAY_PATH, LAG_PATH = "model.drivetrain.delay_s", "model.drivetrain.lag_s"
FREE = [f"+{DELAY_PATH}"]
LOW_PASS = "sensors.imu.low_pass_hz"
SECONDS, SEED, HZ = 10.0, 5, 44.0


@pytest.fixture(scope="module")
def logs():
    """Return a robot with quiet sensors, its file, and its logs. One log has the counts of the timer, one has the
    requested commands. The others have the counts and an IMU behind a low-pass, or behind a low-pass and a delay.
    This delay looks like a delay of the motors."""
    robot = draw_robot(SEED)
    robot = robot.with_parameters(imu=robot.imu.with_parameters(noise=0.2 * robot.imu.noise))
    filtered_robot = robot.with_parameters(
        imu=robot.imu.with_parameters(low_pass_s=np.full(1, 0.5 / np.pi / HZ))
    )
    chip = filtered_robot.with_parameters(delay_s=filtered_robot.delay_s + 4.8e-3 - 0.5 / np.pi / HZ)
    file = robot_file(robot)
    signal = excitation(
        "random_steps", file.command.limit, SECONDS, file.rate_hz, SEED, rest_s=1.0, hold_s=0.4
    )
    sent_u = quantised_commands(signal)
    commands = np.stack([sent_u] * 3, axis=1)
    motion = drive_group(
        merge([robot, filtered_robot, chip]), commands, [SEED] * 3, tick_times(len(sent_u), file.rate_hz)
    )
    kinds = {"counts": (0, sent_u), "asked": (0, signal), "filtered": (1, sent_u), "chip": (2, sent_u)}
    runs = {name: vehicle_run(motion, k, u, file, name, SEED) for name, (k, u) in kinds.items()}
    return robot, file, runs


def error_of(fit, q, name):
    """Return the deviation of the parameter `name` from the truth, in standard errors."""
    return abs(fit.value(name) - float(robot_values(q)[name][0])) / fit.std[fit.names.index(name)]


def test_an_undeclared_low_pass_gives_a_warning_and_a_remedy(logs):
    q, file, runs = logs
    fit = identify(runs["filtered"], file, FREE)
    assert fit.verdict == "WARN"
    assert f"--free +{LOW_PASS}" in [reason.fix for reason in fit.reasons]
    assert ("delay.sum", "imu") in [(note.code, note.subject) for note in fit.notes]
    # the fit mistook the filter for a delay
    assert fit.value(DELAY_PATH) - q.delay_s[0] > 0.5 * 0.5 / np.pi / HZ
    assert error_of(fit, q, DELAY_PATH) < 4.0  # and the error bar includes this


def test_a_declared_low_pass_does_not_bias_the_delay_of_the_motors(logs):
    q, file, runs = logs
    fit = identify(runs["filtered"], file.with_values({LOW_PASS: HZ}), FREE)
    assert not {"residual.missing-free", "delay.sum"} & {finding.code for finding in fit.findings}
    assert error_of(fit, q, DELAY_PATH) < 3.0
    assert error_of(fit, q, LAG_PATH) < 3.0


def test_the_chip_setting_determines_the_lag_and_delay_of_its_filter(logs):
    """A lag of 44 Hz and a pure delay together have the 4.8 ms that the data sheet states for setting 3."""
    q, file, runs = logs
    fit, set_up = (
        identify(runs["chip"], f, FREE, options=FitOptions(diagnose=False))
        for f in (file, file.with_values({"robot.imu_filter": 3}))
    )
    assert fit.value(DELAY_PATH) - q.delay_s[0] > 0.003
    assert abs(set_up.value(DELAY_PATH) - q.delay_s[0]) < 5e-4
    assert abs(set_up.value(LAG_PATH) - q.lag_s[0]) < 5e-4


def test_only_the_sum_of_tilt_and_bias_is_identified_by_default(logs):
    _, file, runs = logs
    names = ["model.friction.linear[0]", "model.actuator_matrix[0,0]"]
    single, joint = (
        identify(runs["counts"], file, free, options=FitOptions(diagnose=False))
        for free in (names, [*names, "sensors.imu.tilt_rad"])
    )
    assert ("bias.tilt-sum", "imu") in [(note.code, note.subject) for note in single.notes]
    assert "bias.tilt-sum" not in [finding.code for finding in joint.findings]


def test_a_low_pass_can_be_fitted(logs):
    q, file, runs = logs
    fit = identify(runs["filtered"], file, [*FREE, f"+{LOW_PASS}"], options=FitOptions(diagnose=False))
    assert abs(fit.value(LOW_PASS) - HZ) < 4.0 * fit.std[fit.names.index(LOW_PASS)]
    assert error_of(fit, q, DELAY_PATH) < 3.0


def test_unlogged_duty_steps_are_added_to_the_model(logs):
    q, file, runs = logs
    fit = identify(runs["asked"], file, FREE, options=FitOptions(diagnose=False))
    assert fit.vehicle_file.value("model.drivetrain.duty_step") == pytest.approx(1.0 / 255.0)
    assert [note.figures["steps"] for note in fit.notes if note.code == "fit.duty-step"] == [255]
    assert error_of(fit, q, DELAY_PATH) < 4.0


def test_no_duty_step_is_added_if_the_log_contains_quantised_commands(logs):
    _, file, runs = logs
    fit = identify(runs["counts"], file, FREE, options=FitOptions(diagnose=False))
    assert fit.vehicle_file.value("model.drivetrain.duty_step") == 0.0
