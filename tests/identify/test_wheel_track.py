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


def track_of(run, track_m, free=None):
    findings = identify(run, file_with_track(track_m), free).findings
    return [finding for finding in findings if finding.code == "file.track"]


@pytest.mark.parametrize("track_m", [0.06, 0.2])
def test_a_wrong_track_is_named_with_its_value(run, track_m):
    (finding,) = track_of(run, track_m)
    assert finding.severity == "warning"
    assert finding.figures["track_m"] == pytest.approx(TRACK_M, rel=0.05)
    assert finding.fix == "--free +sensors.wheels.track_m"


def test_a_track_within_the_scales_or_a_fitted_track_is_accepted(run):
    assert track_of(run, 1.08 * TRACK_M) == []
    assert track_of(run, 0.2, ["+sensors.wheels.track_m"]) == []


def test_noisy_wheels_do_not_look_further_apart(run):
    z = run.sensors["wheels"].z + np.random.default_rng(0).normal(0.0, 0.08, run.sensors["wheels"].z.shape)
    noisy = {**run.sensors, "wheels": run.sensors["wheels"]._replace(z=z)}
    assert track_of(type(run)(run.name, None, run.t_ns, run.applied_commands, sensors=noisy), TRACK_M) == []
