"""The driver of the MPU-6050 reads every sample of the chip once, in order, in SI units, without blocking."""

import math
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")

from baqueano.errors import RobotUnreachable, UsageError
from baqueano.robot.imu import driver as imu
from tests.codes import refused
from tests.emulated.i2c_ioctl import loop, start
from tests.emulated.mpu import REST, STANDARD_GRAVITY

G = STANDARD_GRAVITY


def turning(t_ns: int):
    return (0.5, -0.25, G), (0.0, 0.0, 1.5)


def test_every_sample_is_read_once_and_in_order(start_imu):
    b, device = start_imu()
    count = len(b.chip.taken)
    samples = loop(b, device, 10.0)
    times = np.array([s.t_ns for s in samples])
    assert abs(len(samples) - (len(b.chip.taken) - count)) <= 2
    assert np.all(np.diff(times) > 0)
    assert np.max(np.abs(np.diff(times) / 5e6 - 1.0)[100:]) <= 0.101, (
        "the sample period is that of the chip and not of the calls"
    )
    assert device.counts.overflows == device.counts.restarts == device.counts.retries == 0
    assert device.events() == []


def test_a_read_needs_two_bus_transfers(start_imu):
    b, device = start_imu()
    before = b.bus.transfers
    loop(b, device, 0.5)
    assert b.bus.transfers - before <= 2 * 51 + 2


def test_samples_are_in_si_units(bench):
    b = bench(motion=turning)
    for settings in ({}, {"accel_range_g": 16, "gyro_range_dps": 250}):
        samples = loop(b, start(b, **settings), 2.0)
        assert np.mean([s.accel for s in samples], axis=0) == pytest.approx([0.5, -0.25, G], abs=0.02)
        assert np.mean([s.gyro for s in samples], axis=0) == pytest.approx([0.0, 0.0, 1.5], abs=0.002)
        assert samples[-1].temperature_c == pytest.approx(b.chip.temperature_c, abs=0.1)
        assert samples[0].accel.shape == samples[0].gyro.shape == (3,)


def test_readings_are_rotated_into_the_vehicle_axes(bench):
    b = bench(motion=lambda t_ns: ((1.0, 2.0, G), (0.1, 0.2, 0.3)))
    sample = loop(b, start(b, axes=("-y", "x", "z")), 0.5)
    assert np.mean([s.accel for s in sample], axis=0) == pytest.approx([-2.0, 1.0, G], abs=0.05)
    assert np.mean([s.gyro for s in sample], axis=0) == pytest.approx([-0.2, 0.1, 0.3], abs=0.005)


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("who_am_i", [0x68, 0x98])
def test_the_measured_delay_equals_the_delay_stated_by_the_driver(bench, number, who_am_i):
    start_ns = 1_000_000_000

    def ramp(t_ns):
        s = (t_ns - start_ns) * 1e-9
        return (s, 0.0, G), (0.0, 0.0, s)

    b = bench(motion=ramp, noise=0.0, who_am_i=who_am_i, clock_ppm=8000)
    device = start(b, filter=number, gyro_range_dps=250)
    samples = loop(b, device, 3.0)[-200:]
    late_accel = np.mean([(s.t_ns - start_ns) * 1e-9 - s.accel[0] for s in samples])
    late_gyro = np.mean([(s.t_ns - start_ns) * 1e-9 - s.gyro[2] for s in samples])
    # 0.2 ms during the fit of the clock, 0.1 ms because the chip latches the count before its answer
    assert (late_accel, late_gyro) == pytest.approx(device.delay_s, abs=3e-4)


@pytest.mark.parametrize("ppm", [-40_000, -12_000, 3_000, 40_000])
def test_the_real_rate_is_measured_and_timestamps_use_this_rate(start_imu, ppm):
    b, device = start_imu(clock_ppm=ppm)
    samples = loop(b, device, 10.0)
    rate = 200.0 * (1.0 + ppm * 1e-6)
    assert device.rate_hz == pytest.approx(rate, abs=device.clock.rate_error_hz + 0.01)
    assert device.rate_hz == pytest.approx(rate, rel=200e-6)
    sample_times = np.array(b.chip.taken)
    error = np.array([np.min(np.abs(sample_times - s.t_ns)) for s in samples[400:]])
    assert np.max(error) < 0.4e6, "ns; a tenth of a period and less"


def test_a_backlog_is_read_in_limited_parts_without_losing_a_sample(start_imu):
    b, device = start_imu(read_s=1.0)
    b.clock.sleep(0.3)
    lengths, samples = [], []
    for _ in range(8):
        before = b.clock.now
        samples += device.read()
        lengths.append(b.clock.now - before)
        b.clock.sleep(0.002)
    assert max(lengths) < 7_000_000
    assert len(samples) >= 60
    assert np.all(np.abs(np.diff([s.t_ns for s in samples]) / 5e6 - 1.0) < 0.11)
    assert device.counts.overflows == 0


def test_opening_reports_the_chip_and_its_settings(start_imu):
    b, device = start_imu()
    text = "\n".join(b.printed)
    for part in ("MPU-6050", "0x68", "200 Hz; ±4 g", "44 Hz, delay 4.9 ms", "kHz or more", "°C"):
        assert part in text
    assert device.identity.accel_ms2 == pytest.approx(G, abs=0.1)
    assert device.identity.bus_hz == pytest.approx(400e3, rel=0.1)
    assert device.identity.warnings == ()


def test_opening_a_moving_chip_gives_a_warning(bench):
    b = bench(motion=lambda t_ns: ((0.0, 0.0, 1.3 * G), (0.0, 0.0, 1.0)))
    start(b)
    assert "measures 12.75 m/s²" in b.printed[-2]
    assert "turns at 57" in b.printed[-1]


def test_close_puts_the_chip_to_sleep(start_imu):
    b, device = start_imu()
    device.close()
    assert b.chip.regs[0x6B] == 0x40
    assert loop(b, device, 1.0) == [], "no transfer may wake the chip"
    assert b.chip.regs[0x6B] == 0x40


def test_the_driver_reports_that_i2c_needs_linux(monkeypatch):
    monkeypatch.setitem(sys.modules, "smbus2", None)
    with refused("imu.no-smbus", UsageError):
        imu.open_imu()


def test_the_driver_can_be_imported_without_linux_modules():
    code = """
import sys
for name in ("fcntl", "termios", "smbus2", "resource"):
    sys.modules[name] = None
from baqueano.robot.imu import chips
from baqueano.robot.imu import i2c
from baqueano.robot.imu import driver as imu
from baqueano.robot.imu import self_test as imu_self_test
from baqueano.robot.imu import settings as imu_settings
from baqueano.robot.imu import watch as imu_watch
from baqueano.robot.imu import mpu6050
from baqueano.robot.imu import sample_clock
from baqueano.errors import UsageError
try:
    imu.open_imu()
except UsageError as error:
    print(error)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "needs Linux and smbus2" in result.stdout


def test_a_missing_bus_is_reported_with_its_remedy(tmp_path):
    with refused("imu.no-bus", RobotUnreachable):
        imu.open_imu(str(tmp_path / "i2c-7"))


def test_a_missing_bus_permission_is_reported_with_its_group(bench, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    b = bench()
    monkeypatch.setattr("smbus2.smbus2.os.open", refuse)
    with refused("imu.bus-not-allowed", RobotUnreachable):
        imu.open_imu(b.path)


def test_a_bus_without_answers_is_reported_with_the_wiring(bench):
    b = bench()
    b.bus.devices.clear()
    with refused("imu.no-answer", RobotUnreachable, address_range="0x68 and 0x69"):
        start(b)


def test_a_chip_with_ad0_high_is_detected(bench):
    b = bench()
    b.bus.devices[0x69] = b.bus.devices.pop(0x68)
    assert start(b).identity.address == 0x69


def test_a_chip_without_samples_is_reported(bench):
    b = bench()
    b.chip._write = lambda value: None  # it ignores all writes, so it stays asleep
    with refused("imu.too-few-samples", RobotUnreachable, count=0, limit_s=2):
        start(b)


def test_an_imu_at_rest_measures_one_g_upward(bench):
    assert REST[0] == (0.0, 0.0, G)
    assert math.isclose(G, 9.80665)
