"""Before a drive, the user learns which sensors of position and speed the estimator ignores."""

import pytest

import baqueano as bq
from baqueano.drive.safety.sensor_notes import sensor_warnings
from baqueano.guides.shapes import circle
from baqueano.vehicle_file import parse

SENSORS = {
    "pose": 'kind = "pose"\nnoise_std = [0.01, 0.01, 0.02]\n',
    "mark": 'kind = "mark"\npoint_m = [0.0, 0.0]\nheading_rad = 1.57\nnoise_std = 0.005\n',
    "beacon": 'kind = "beacon"\npoint_m = [1.0, 0.5]\nnoise_std = 0.02\n',
    "rangefinder": 'kind = "rangefinder"\nwall_point_m = [1.0, 0.0]\nwall_heading_rad = 1.57\nnoise_std = 0.02\n',
    "compass": 'kind = "compass"\nnoise_std = 0.05\n',
    "wheels": 'kind = "wheels"\nnoise_std = 0.01\n',
    "odometer": 'kind = "odometer"\nnoise_std = 0.01\n',
}


def with_sensor(kind, use=None):
    file = parse(bq.load("small").text + f"\n[sensors.other]\n{SENSORS[kind]}", "vehicle.toml")
    return file if use is None else file.with_values({"estimator.use": use})


def ignored_sensors(file):
    """Return the figures and the remedy of each warning about ignored sensors."""
    warnings = sensor_warnings(file, file.estimator())
    return [(w.figures["sensors"], w.fix) for w in warnings if w.code == "drive.sensor-ignored"]


@pytest.mark.parametrize("kind", SENSORS)
def test_only_a_sensor_of_the_position_that_the_estimator_does_not_use_is_named(kind):
    assert ignored_sensors(with_sensor(kind)) == [("other", '[estimator] use = ["imu", "other"]')]
    assert ignored_sensors(with_sensor(kind, ["imu", "other"])) == []


def test_an_ignored_sensor_is_named_once_in_the_run_of_a_drive_and_of_its_replay():
    run = bq.repeat(with_sensor("pose"), circle(0.3, 0.2), duration_s=1.0, check=False)
    for checked_run in (run, bq.replay(run)):
        codes = [
            e.diagnostic.code for e in checked_run.events if e.level == "warning" and e.diagnostic is not None
        ]
        assert codes.count("drive.sensor-ignored") == 1
