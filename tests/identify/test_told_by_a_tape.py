"""A tape measurement that contradicts the model is reported with both values and does not count as sensor noise."""

import pytest

from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.noise.covariances import measure_noise
from baqueano.simulate import simulate

FREE = ["model.actuator_matrix[2,2]", "model.actuator_matrix[0,0]"]


@pytest.fixture(scope="module")
def runs(small):
    u = [random_steps(small.command.limit, 6.0, small.rate_hz, k) for k in (1, 2)]
    return [simulate(small, u[k], k, name=f"run {k}") for k in range(2)]


@pytest.fixture(scope="module")
def fit(small, runs):
    return identify(runs, small, free=FREE, options=FitOptions(measured=("run 1 end: 400 cm",)))


def test_a_wrong_tape_measurement_of_a_later_run_is_reported_in_metres(fit):
    far = [reason for reason in fit.reasons if reason.code == "residual.one-far"]
    assert len(far) == 1
    assert (far[0].subject, far[0].figures["measured"], far[0].figures["unit"]) == ("tape[0]", 4.0, "m")


def test_the_identified_noise_has_units_and_excludes_the_tape_measurement(fit, runs):
    noise = measure_noise(fit, runs)
    units = {row["name"]: row["unit"] for row in noise.rows()}
    assert [units[f"imu[{k}]"] for k in range(3)] == ["m/s²", "m/s²", "rad/s"]
    assert units["velocity_walk_std[2]"] == "rad/s^1.5"
    assert "tape[0]" not in units
    assert not any("tape" in note.subject for note in noise.notes)


def test_the_noise_of_each_channel_is_reported_with_its_unit(fit):
    lines = fit.table().splitlines()
    assert any(line.startswith("imu[2] of run 0: noise ") and " rad/s, the model" in line for line in lines)
