"""Wheels and gyro show the track of a vehicle; a fit compares it with the file."""

import numpy as np
import pytest

from baqueano.identify import identify, random_steps
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, parse

TRACK_M = 0.12


def file_with_track(track_m):
    wheels = f'kind = "wheels"\ntrack_m = {track_m}\nnoise_std = 0.01\n'
    return parse(f"{load('small').text}\n[sensors.wheels]\n{wheels}", "small.toml")


@pytest.fixture(scope="module")
def run():
    file = file_with_track(TRACK_M)
    return simulate(file, random_steps(file.command.limit, 30.0, file.rate_hz, 5), 5)


def track_of(run, track_m, *free):
    """Return the findings about the track; few free parameters are sufficient, and their kernels are small."""
    findings = identify(run, file_with_track(track_m), ["model.mass_kg", *free]).findings
    return [finding for finding in findings if finding.code == "file.track"]


@pytest.mark.parametrize("track_m", [0.06, 0.2])
def test_a_wrong_track_is_named_with_its_value(run, track_m):
    (finding,) = track_of(run, track_m)
    assert finding.severity == "warning"
    assert finding.figures["track_m"] == pytest.approx(TRACK_M, rel=0.05)
    assert finding.fix == "--free +sensors.wheels.track_m"


def test_a_track_within_the_scales_or_a_fitted_track_is_accepted(run):
    assert track_of(run, 1.08 * TRACK_M) == []
    assert track_of(run, 0.2, "sensors.wheels.track_m") == []


def test_noise_of_the_wheel_speeds_does_not_change_the_estimated_track(run):
    z = run.sensors["wheels"].z + np.random.default_rng(0).normal(0.0, 0.08, run.sensors["wheels"].z.shape)
    noisy = {**run.sensors, "wheels": run.sensors["wheels"]._replace(z=z)}
    assert track_of(type(run)(run.name, None, run.t_ns, run.applied_commands, sensors=noisy), TRACK_M) == []


@pytest.mark.parametrize(("guess", "finds"), [(10.0, True), (60.0, False)])
def test_a_sideways_friction_too_small_for_tyres_is_reported_with_a_typical_value(guess, finds):
    """The gyro of a vehicle with its mass on the axle does not show how it stops sideways."""
    small = load("small").with_values({"model.centre_of_mass_x_m": 0.0})
    gyro_run = simulate(small, random_steps(small.command.limit, 20.0, small.rate_hz, 5), 5)
    guessed_file = small.with_values({"model.friction.linear": [3.3, guess, 0.0115]})
    findings = [
        f for f in identify(gyro_run, guessed_file, use=["imu[2]"]).findings if f.code == "file.slides"
    ]
    assert len(findings) == finds
    for finding in findings:
        assert finding.subject == "model.friction.linear[1]"
        turned_rad_s = np.sqrt(np.mean(gyro_run.sensors["imu"].z[:, 2] ** 2))
        assert finding.figures["degrees"] == pytest.approx(np.degrees(0.61 * turned_rad_s / guess), rel=0.1)
        stiff = finding.figures["stiff"]
        guessed_file.with_values({"model.friction.linear": [3.3, stiff, 0.0115]})  # can be simulated
        assert 0.61 * turned_rad_s / stiff < 0.04
