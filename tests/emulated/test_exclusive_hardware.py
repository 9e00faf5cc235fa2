"""The hardware as a calibration opens it: the Uno over the real serial driver, the IMU with the requested axes."""

import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from baqueano import vehicle_file
from baqueano.errors import RobotUnreachable
from baqueano.robot.imu import driver as imu
from baqueano.robot.imu.settings import ImuSettings
from baqueano.robot.uno.frames import Settings as Kept, WheelCurve
from baqueano.robot.uno.serial_port import open_uno
from baqueano.robot.workshop import doctor
from baqueano.robot.workshop.exclusive_hardware import open_hardware
from tests.emulated.hand import OnBus
from tests.emulated.realtime import on_pty


@pytest.mark.parametrize(("in_chip_axes", "axes"), [(True, ("x", "y", "z")), (False, ("-y", "x", "z"))])
def test_uno_and_imu_are_opened_from_the_vehicle_file_and_closed(firmware, monkeypatch, in_chip_axes, axes):
    calls = []

    class Chip:
        def close(self):
            calls.append("closed")

    def chip(bus, *, address, settings, notify):
        calls.append((bus, address, settings.axes, settings.accel_range_g))
        return Chip()

    monkeypatch.setattr(imu, "open_imu", chip)
    with on_pty(firmware) as live:
        hardware = replace(vehicle_file.load("small").robot, port=live.path, imu_axes=("-y", "x", "z"))
        with open_hardware(hardware, print, in_chip_axes=in_chip_axes) as bench:
            assert bench.uno.info.protocol == 1
            assert bench.uno.settings().driver == 1
        assert not live.moving()
    assert calls == [(1, 104, axes, 4), "closed"]


def test_service_calibration_and_doctor_open_the_same_imu(tmp_path, monkeypatch):
    """Range and filter are those of the drive, although the driver has other defaults."""
    hardware = replace(
        vehicle_file.load("small").robot, imu_bus=7.0, imu_address=105.0, imu_axes=("-y", "x", "z"),
        imu_accel_range_g=16.0, imu_gyro_range_dps=500.0, imu_filter=5.0,
    )  # fmt: skip
    calls = []

    def chip(bus, *, address, settings, notify):
        calls.append((bus, address, settings))
        raise RobotUnreachable("it is only looked at")

    monkeypatch.setattr(imu, "open_imu", chip)
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/i2c-7").touch()
    (check,) = doctor.check_imu(hardware, tmp_path)
    assert check.remedy == "it is only looked at"
    with pytest.raises(RobotUnreachable):
        open_hardware(hardware, print, motors=False).__enter__()
    with pytest.raises(RobotUnreachable):
        imu.start_imu(hardware, print)
    settings = ImuSettings(filter=5, accel_range_g=16, gyro_range_dps=500, axes=("-y", "x", "z"))
    assert calls == [(7, 105, settings)] * 3


def test_calibrated_axes_rotate_the_samples_into_the_vehicle_frame(tmp_path, monkeypatch):
    """The driver uses the axes that `calibrate imu` writes."""
    bus = OnBus(tmp_path, monkeypatch)
    bus.chip.motion = lambda t_ns: ((0.0, -1.0, 9.8), (0.0, 0.0, 0.3))
    turned_imu = imu.open_imu(
        str(tmp_path / "i2c-1"), settings=ImuSettings(axes=("-y", "x", "z")), notify=None,
        now_ns=lambda: bus.now_ns, sleep=bus.wait,
    )  # fmt: skip
    bus.wait(0.1)
    sample = turned_imu.read()[-1]
    assert sample.accel[0] == pytest.approx(1.0, abs=0.2)
    assert sample.gyro[2] == pytest.approx(0.3, abs=0.05)


class Calibrating:
    """`calibrate motors` as a process that drives a motor, with heartbeats from this test, as over ssh."""

    def __init__(self, live):
        self.over = threading.Event()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.emulated.calibrating", live.path], cwd=Path(__file__).parents[2],
            stdin=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0,
        )  # fmt: skip
        self._beating = threading.Thread(target=self._beat, daemon=True)
        self._beating.start()
        end = time.monotonic() + 60.0
        while not live.moving():
            assert self.process.poll() is None, self.process.stderr.read().decode()
            assert time.monotonic() < end
            time.sleep(0.05)

    def _beat(self):
        while not self.over.wait(0.2):
            self.process.stdin.write(b"\n")

    def lets_go(self):
        self.over.set()
        self._beating.join()

    def close(self):
        self.lets_go()
        with self.process:
            self.process.kill()


@pytest.mark.parametrize("end_by", ["ssh ends", "Wi-Fi ends", signal.SIGHUP, signal.SIGTERM], ids=str)
def test_an_abandoned_motor_calibration_stops_motors_and_restores_settings(firmware, end_by):
    settings = Kept(curves=(WheelCurve(110, 900, 50), WheelCurve(120, 800, 60)) * 2, dither_permille=33)
    with on_pty(firmware) as live:
        with open_uno(live.path) as uno:
            uno.store_settings(settings)
        work = Calibrating(live)
        try:
            work.lets_go()
            if end_by == "ssh ends":
                work.process.stdin.close()
            elif end_by != "Wi-Fi ends":
                work.process.send_signal(end_by)
            output = work.process.stderr.read().decode()
            assert work.process.wait(60.0) == 130
        finally:
            work.close()
        assert not live.moving()
        assert "the Uno keeps its old settings" in output
        assert ("the connection to the user was lost" in output) == (end_by in ("ssh ends", "Wi-Fi ends"))
        with open_uno(live.path) as uno:
            assert uno.settings() == settings
