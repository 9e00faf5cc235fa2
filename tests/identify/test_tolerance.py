"""The tolerance of a scale is given on the command line, in Python or in the file; a tolerance without effect is
refused."""

import numpy as np
import pytest

from baqueano.calibration.tolerances import scale_stds, with_tolerance
from baqueano.cli import main
from baqueano.errors import UsageError
from baqueano.estimators.readings.sensor_numbers import ACCEL_SCALE_STD
from baqueano.identify.identifiability import SCALE_STD
from baqueano.vehicle_file import load
from tests.codes import of_code


@pytest.mark.parametrize(
    ("tolerance", "parts"),
    [
        ({"sensors.imu.gyro_scale": 0.01}, (0.03, 0.03, 0.01)),
        ({"sensors.imu.accel_scale": 0.05}, (0.05, 0.05, 0.03)),
        ({"sensors.imu.gyro_scale": 0.2, "sensors.imu.accel_scale": 0.0}, (0.0, 0.0, 0.2)),
        ({}, (0.03, 0.03, 0.03)),
    ],
)
def test_a_tolerance_replaces_that_of_the_data_sheet(tolerance, parts):
    car = with_tolerance(load("car").with_values({"sensors.imu.gyro_scale": 1.035}), tolerance)
    np.testing.assert_allclose(scale_stds(car, "imu"), np.array(parts) / np.sqrt(3.0), rtol=5e-3)


def test_scales_without_calibration_have_the_tolerance_of_the_data_sheet_in_every_room():
    single = 0.03 / np.sqrt(3.0)  # PS-MPU-6000A: initial tolerance of accelerometers and gyro
    np.testing.assert_allclose(scale_stds(load("car"), "imu"), single)
    assert pytest.approx(single) == ACCEL_SCALE_STD == SCALE_STD


def test_a_given_tolerance_is_written_with_its_provenance():
    provenance = with_tolerance(load("car"), {"sensors.imu.gyro_scale": 0.01}).provenance[
        "sensors.imu.gyro_scale"
    ]
    assert provenance.run == "stated, ± 1 %"
    assert provenance.std == pytest.approx(0.01 / np.sqrt(3.0) * load("car").sensors.imu.gyro_scale, rel=5e-3)


@pytest.mark.parametrize(
    ("tolerance", "code"),
    [
        ({"sensors.imu.gyr": 0.01}, "tolerance.no-scale"),
        ({"sensors.odometer.scale": 0.01}, "tolerance.no-scale"),
        ({"sensors.imu.gyro_scale": 3.0}, "tolerance.no-part"),
        ({"sensors.imu.gyro_scale": -0.01}, "tolerance.no-part"),
    ],
)
def test_a_tolerance_of_a_parameter_that_is_not_a_scale_is_refused(tolerance, code):
    with pytest.raises(UsageError, check=of_code(code)):
        with_tolerance(load("car"), tolerance)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--use imu --tolerance sensors.imu.gyro_scale", "expected KEY=FRACTION"),
        (
            "--use imu --segment 2 --tolerance sensors.imu.gyro_scale=0.01",
            "cannot be combined with --segment: it is for a car",
        ),
        (
            "--use odometer --tolerance sensors.imu.gyro_scale=0.01",
            "is for a car that is fitted only with its IMU. Remove the option",
        ),
    ],
)
def test_a_tolerance_without_effect_is_refused(tmp_path, monkeypatch, capsys, line, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["simulate", "--vehicle", "car", "--seconds", "2", "-o", "car.mcap"])
    with pytest.raises(SystemExit) as end:
        main(["identify", "car.mcap", "--vehicle", "car", *line.split()])
    assert end.value.code == 2
    assert message in capsys.readouterr().err
