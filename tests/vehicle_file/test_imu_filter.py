"""The filter setting of the chip determines the low-pass of h, in the file and in the simulated vehicle."""

from itertools import product

import numpy as np
import pytest

from baqueano.errors import FileError
from baqueano.geometry import axes_rotation
from baqueano.robot.imu.chips import CHIPS
from baqueano.sensors.imu_filter import low_pass_hz
from baqueano.simulate.open_loop import simulate
from baqueano.vehicle_file import load, parse
from tests.codes import refused

SETTING, KEY = "robot.imu_filter", "sensors.imu.low_pass_hz"


@pytest.mark.parametrize("setting", range(1, 7))
def test_the_modelled_low_pass_has_the_delay_of_the_chip(setting):
    imu = load("small").with_values({SETTING: setting}).sensors.imu
    assert imu.low_pass_hz == low_pass_hz(setting)
    tau_s = CHIPS[0x68].filter_bands[setting].gyro_delay_s
    assert 0.5 / (np.pi * imu.low_pass_hz) == pytest.approx(tau_s)


def test_an_explicit_low_pass_has_priority_over_the_chip_setting():
    small = load("small")
    assert not small.sensors.imu.has_low_pass
    assert not parse(f"{small.text}\n[robot]\nimu_bus = 1\n", "wired").sensors.imu.has_low_pass
    file = small.with_values({SETTING: 3, KEY: 44.0})
    assert file.sensors.imu.low_pass_hz == 44.0
    assert not file.with_values({KEY: np.inf}).sensors.imu.has_low_pass


@pytest.mark.parametrize("truth_name", ["garage", "beside"])
def test_a_simulation_applies_the_imu_filter_of_the_file(truth_name, tmp_path):
    truth = "small" if truth_name == "garage" else "body.toml"
    if truth_name == "beside":
        load("small").save(tmp_path / truth)
    load("small").with_values({SETTING: 5, "simulation.truth": truth}).save(tmp_path / "mine.toml")
    file = load(tmp_path / "mine.toml")
    assert file.truth.sensors.imu.low_pass_hz == file.sensors.imu.low_pass_hz == low_pass_hz(5)
    u = np.zeros((100, 3))
    u[50:, 2] = 0.8
    slow = simulate(file.truth, u).sensors["imu"].z
    np.testing.assert_array_equal(slow, simulate(load("small").with_values({SETTING: 5}), u).sensors["imu"].z)
    assert slow[60, 2] < 0.9 * simulate(load("small"), u).sensors["imu"].z[60, 2]


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("imu_filter", "3.5", "vehicle.no-choice"),
        ("imu_accel_range_g", "3", "vehicle.no-choice"),
        ("imu_gyro_range_dps", "300", "vehicle.no-choice"),
        ("imu_axes", '["x", "y", "-z"]', "vehicle.imu-axes"),
        ("imu_axes", '["x", "x", "z"]', "vehicle.imu-axes"),
        ("imu_axes", '["x", "y"]', "vehicle.imu-axes"),
        ("imu_axes", '["x", "-w", "z"]', "vehicle.imu-axes"),
    ],
)
def test_imu_settings_that_no_chip_supports_are_refused_when_the_file_is_read(key, value, code):
    with refused(code, FileError) as error:
        parse(f"{load('small').text}\n[robot]\n{key} = {value}\n", "mine.toml")
    assert f"[robot] {key}" in str(error.value)


def test_all_24_mounts_of_an_imu_are_accepted():
    axes = ("x", "-x", "y", "-y", "z", "-z")
    mounts = [names for names in product(axes, repeat=3) if axes_rotation(names) is not None]
    assert len(mounts) == 24
    for names in mounts:
        rotation = axes_rotation(names)
        np.testing.assert_array_equal(rotation @ rotation.T, np.eye(3))
        assert (
            parse(f"{load('small').text}\n[robot]\nimu_axes = {list(names)}\n", "mine.toml").robot.imu_axes
            == names
        )
