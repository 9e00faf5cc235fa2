"""Before a drive, the user learns which sensors of position and speed the estimator ignores."""

import pytest

import baqueano as bq
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


def codes(run):
    return [e.diagnostic.code for e in run.events if e.level == "warning" and e.diagnostic is not None]


@pytest.mark.parametrize("kind", SENSORS)
def test_a_sensor_of_the_position_that_the_estimator_ignores_is_named_once(kind):
    run = bq.repeat(with_sensor(kind), circle(0.3, 0.2), duration_s=1.0, check=False)
    assert codes(run).count("drive.sensor-ignored") == 1
    (warning,) = [
        e.diagnostic for e in run.events if "sensor-ignored" in str(getattr(e.diagnostic, "code", ""))
    ]
    assert (warning.figures["sensors"], warning.fix) == ("other", '[estimator] use = ["imu", "other"]')
    assert "drive.sensor-ignored" in codes(bq.replay(run))


@pytest.mark.parametrize("kind", SENSORS)
def test_a_sensor_of_the_position_that_the_estimator_uses_is_not_named(kind):
    run = bq.repeat(with_sensor(kind, ["imu", "other"]), circle(0.3, 0.2), duration_s=1.0, check=False)
    assert "drive.sensor-ignored" not in codes(run)
