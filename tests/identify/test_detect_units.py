"""Impossible units, axes and signs are reported before a fit is accepted."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import Severity
from baqueano.identify import identify
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.diagnostics.file_consistency import gain_findings


def with_imu(run, change):
    c = run.sensors["imu"]
    return replace(run, sensors={"imu": c._replace(z=change(c.z.copy()))})


def reasons(fit):
    return {reason.code: reason for reason in fit.reasons}


def guesses(fit):
    """The codes of the units that the reasons guess."""
    return {reason.figures["guess"].code for reason in fit.reasons if reason.figures.get("guess")}


def test_id2_a_gyro_in_degrees_is_refused(case_run, case):
    fit = identify(with_imu(case_run(0, 20.0), lambda z: z * [1.0, 1.0, 57.29578]), case)
    assert fit.verdict == "REFUSED"
    assert "gyro.too-fast" in reasons(fit) or "guess.degrees" in guesses(fit)


def test_gain_and_noise_reveal_a_gyro_in_degrees_during_slow_turns(case, case_run):
    slow = case.with_values({"command.limit": [20.0, 0.0, 6.0]})
    fit = identify(with_imu(case_run(0, 20.0, slow), lambda z: z * [1.0, 1.0, 57.29578]), case)
    assert fit.verdict == "REFUSED"
    assert "guess.degrees" in guesses(fit)
    assert {"file.gain", "file.far-gain"} & reasons(fit).keys()


def test_id2_an_accelerometer_in_g_gives_no_usable_fit(case_run, case):
    fit = identify(with_imu(case_run(0, 20.0), lambda z: z / [9.80665, 9.80665, 1.0]), case)
    assert fit.verdict != "USABLE"
    assert "guess.g" in guesses(fit)


@pytest.mark.parametrize(("factor", "guess"), [(255.0, "PWM (0 … 255)"), (8.4, "V")])
def test_a_command_beyond_its_limit_is_reported_as_a_wrong_unit(small, factor, guess):
    from baqueano.identify import random_steps
    from baqueano.simulate import simulate

    run = simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 0), 0)
    fit = identify(replace(run, applied_commands=run.applied_commands * factor), small)
    assert fit.verdict == "REFUSED"
    assert reasons(fit)["command.unit"].figures["guess"] == guess


def test_gravity_in_a_horizontal_axis_is_reported(case_run, case):
    def upright(z):
        z[:, 1] = 9.80665 + 0.05 * np.random.default_rng(0).standard_normal(len(z))
        return z

    fit = identify(with_imu(case_run(0, 20.0), upright), case)
    assert fit.verdict != "USABLE"
    (tilt_message,) = (
        reason for code, reason in reasons(fit).items() if code in ("gravity.at-rest", "gravity.all-the-time")
    )
    assert tilt_message.subject == "imu[1]"
    assert tilt_message.figures["error_m_s2"] == pytest.approx(9.8, abs=0.01)


@pytest.fixture(scope="module")
def turned_run(small):
    """A run of the small vehicle, whose accelerometer measures the turns."""
    from baqueano.identify import random_steps
    from baqueano.simulate import simulate

    return simulate(small, random_steps([1.0, 0.0, 1.0], 20.0, 100.0, 1), 1)


def test_swapped_axes_are_detected_because_each_fits_the_other_prediction(turned_run, small):
    fit = identify(with_imu(turned_run, lambda z: z[:, [1, 0, 2]]), small)
    assert fit.verdict == "REFUSED"
    swap = reasons(fit)["axes.swapped"]
    assert (swap.subject, swap.figures["channel"]) == ("imu[0]", "imu[1]")


def test_swapped_axes_without_turns_are_detected_by_the_gain_matrix(case):
    names = [f"model.actuator_matrix[{i},0]" for i in range(3)]
    blocks = FittedBlocks(case.vehicle, case.sensors)
    findings = gain_findings(blocks, names, np.array([0.01, 0.98, 0.0]), np.full(3, 1e-3))
    assert [(finding.code, finding.subject) for finding in findings] == [("file.swapped", "u[0]")]
    axes = [findings[0].figures[name].code for name in ("expected", "value")]
    assert axes == ["axis.forward", "axis.sideways"]


def test_an_inverted_accelerometer_contradicts_the_model(turned_run, small):
    fit = identify(with_imu(turned_run, lambda z: z * [1.0, -1.0, 1.0]), small)
    assert fit.verdict == "REFUSED"
    assert reasons(fit)["axes.inverted"].subject == "imu[1]"


def test_an_inverted_gyro_is_reported_by_gain_sign_or_accelerometer(turned_run, small):
    fit = identify(with_imu(turned_run, lambda z: z * [1.0, 1.0, -1.0]), small)
    assert fit.verdict != "USABLE"
    assert {"axes.inverted", "file.mirrored", "mount.third-inverted"} & reasons(fit).keys()


def test_an_inverted_gain_without_other_evidence_gives_a_warning(case):
    blocks, names = FittedBlocks(case.vehicle, case.sensors), ["model.actuator_matrix[2,2]"]
    findings = gain_findings(blocks, names, np.array([-29.9]), np.array([0.1]))
    assert (findings[0].code, findings[0].severity) == ("file.mirrored", Severity.WARNING)
    assert findings[0].subject == "model.actuator_matrix[2,2]"
    assert (findings[0].figures["value"], findings[0].figures["file_value"]) == (
        -29.9,
        pytest.approx(30.0, abs=0.1),
    )


def test_friction_guessed_by_a_factor_of_two_gives_a_usable_fit(case_run, case):
    guess = case.with_values({"model.friction.linear": [12.0, 4.0, 300.0]})
    assert identify(case_run(0, 20.0), guess).verdict == "USABLE"


@pytest.mark.parametrize(
    ("times", "codes"), [(0.48, []), (2.1, []), (3.6, ["file.gain"]), (1 / 3.6, ["file.gain"])]
)
def test_only_a_gain_far_from_the_file_gives_a_reason(case, times, codes):
    file_value = case.value("model.actuator_matrix[2,2]")
    findings = gain_findings(
        FittedBlocks(case.vehicle, case.sensors),
        ["model.actuator_matrix[2,2]"],
        np.array([times * file_value]),
        np.array([0.01]),
    )
    assert [finding.code for finding in findings] == codes


def test_id10_half_a_second_of_data_is_refused(case_run, case):
    fit = identify(case_run(0, 20.0).cut(2.0, 2.5), case)
    assert fit.verdict == "REFUSED"
