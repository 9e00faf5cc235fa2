"""The hardware as a calibration opens it: the Uno over the real serial driver, the IMU with the axes asked for."""

from dataclasses import replace

import pytest

from baqueano import vehicle_file
from baqueano.robot import imu
from baqueano.robot.hands_on import opened
from baqueano.robot.imu_settings import Settings
from tests.emulated.hand import OnBus
from tests.emulated.realtime import on_pty


@pytest.mark.parametrize(("in_chip_axes", "axes"), [(True, ("x", "y", "z")), (False, ("-y", "x", "z"))])
def test_uno_and_imu_are_opened_as_the_vehicle_file_says_and_given_back(
    firmware, monkeypatch, in_chip_axes, axes
):
    asked = []

    class Chip:
        def close(self):
            asked.append("closed")

    def chip(bus, *, address, settings, say):
        asked.append((bus, address, settings.axes, settings.accel_range_g))
        return Chip()

    monkeypatch.setattr(imu, "open", chip)
    with on_pty(firmware) as live:
        hardware = replace(vehicle_file.load("small").robot, port=live.path, imu_axes=("-y", "x", "z"))
        with opened(hardware, print, in_chip_axes=in_chip_axes) as bench:
            assert bench.uno.info.protocol == 1
            assert bench.uno.settings().driver == 1
        assert not live.moving()
    assert asked == [(1, 104, axes, 4), "closed"]


def test_axes_that_were_found_turn_the_drivers_samples_into_the_vehicles(tmp_path, monkeypatch):
    """What `calibrate imu` writes is what the driver takes."""
    bus = OnBus(tmp_path, monkeypatch)
    bus.chip.motion = lambda t_ns: ((0.0, -1.0, 9.8), (0.0, 0.0, 0.3))
    turned = imu.open(
        str(tmp_path / "i2c-1"), settings=Settings(axes=("-y", "x", "z")), say=None,
        now_ns=lambda: bus.now_ns, sleep=bus.wait,
    )  # fmt: skip
    bus.wait(0.1)
    sample = turned.read()[-1]
    assert sample.accel[0] == pytest.approx(1.0, abs=0.2)
    assert sample.gyro[2] == pytest.approx(0.3, abs=0.05)
