"""Chips sold as an MPU-6050 that are clones: each has its own filter, temperature scale and self-test."""

import numpy as np
import pytest

pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")

from baqueano.errors import AnswerNo, RobotUnreachable
from baqueano.robot.imu.chips import CHIPS, lookup_chip
from baqueano.robot.imu.self_test import factory_trims, self_test
from tests.codes import refused
from tests.emulated.i2c_ioctl import loop, start
from tests.emulated.mpu import STANDARD_GRAVITY

G = STANDARD_GRAVITY


@pytest.mark.parametrize(("who_am_i", "fifo_bytes"), [(0x68, 1024), (0x70, 512), (0x98, 512)])
def test_each_kind_of_chip_is_read_with_its_scales_and_filter(bench, who_am_i, fifo_bytes):
    b = bench(who_am_i=who_am_i, ambient_c=31.0, motion=lambda t: ((1.0, 0.0, G), (0.0, 0.0, -2.0)))
    device = start(b, filter=4)
    samples = loop(b, device, 2.0)
    assert np.mean([s.accel for s in samples], axis=0) == pytest.approx([1.0, 0.0, G], abs=0.02)
    assert np.mean([s.gyro[2] for s in samples]) == pytest.approx(-2.0, abs=0.004)
    assert samples[-1].temperature_c == pytest.approx(b.chip.temperature_c, abs=0.1)
    assert device.chip.fifo_bytes == fifo_bytes
    assert b.chip.regs[0x1D] == (0 if who_am_i == 0x68 else 4), (
        "the 6500 has a filter of its own for accelerations"
    )
    assert f"0x{who_am_i:02X}" in b.printed[0]


def test_without_register_0x1d_a_clone_does_not_filter_its_accelerometer(bench):
    """This shows why the table is needed: without register 0x1D a 6500 at 5 Hz has the noise of 460 Hz."""
    b = bench(who_am_i=0x70)
    device = start(b, filter=6)
    noise = np.std([s.accel[0] for s in loop(b, device, 3.0)][100:])
    b.chip.regs[0x1D] = 0
    b.chip._set_filters()
    device._check_at = 10**18
    noise_2 = np.std([s.accel[0] for s in loop(b, device, 2.0)])
    assert noise_2 > 3.0 * noise


@pytest.mark.parametrize("who_am_i", [0x72, 0x75])
def test_a_clone_without_a_register_map_has_an_unknown_temperature(start_imu, who_am_i):
    b, device = start_imu(who_am_i=who_am_i)
    assert np.isnan(loop(b, device, 0.1)[0].temperature_c)
    assert "°C" not in b.printed[0]
    assert device.identity.warnings == ()


def test_an_unknown_chip_runs_with_a_warning(start_imu):
    b, device = start_imu(who_am_i=0x33)
    assert not device.chip.is_listed
    assert "WHO_AM_I 0x33 is not known: the chip is used as an MPU-6500" in b.printed[-1]
    assert len(loop(b, device, 1.0)) > 190


@pytest.mark.parametrize("motion", [((0.0, 0.0, 2.0 * G), (0.0, 0.0, 0.0)), ((0.0, 0.0, G), (0.6, 0.0, 0.0))])
def test_an_unknown_chip_with_impossible_readings_is_refused(bench, motion):
    with refused("imu.unknown-chip", RobotUnreachable):
        start(bench(who_am_i=0x33, motion=lambda t: motion))


@pytest.mark.parametrize("who_am_i", [0x00, 0xFF])
def test_a_bus_without_a_chip_is_not_an_unknown_chip(bench, who_am_i):
    with refused("imu.no-chip", RobotUnreachable):
        start(bench(who_am_i=who_am_i))


def test_every_chip_has_six_filters_and_a_plausible_temperature_scale():
    for who_am_i, chip in CHIPS.items():
        assert lookup_chip(who_am_i) is chip
        assert sorted(chip.filter_bands) == [1, 2, 3, 4, 5, 6]
        widths = [chip.filter_bands[n].accel_hz for n in range(1, 7)]
        delays = [chip.filter_bands[n].gyro_delay_s for n in range(1, 7)]
        assert widths == sorted(widths, reverse=True)
        assert delays == sorted(delays)
    assert lookup_chip(0x68).celsius(-521) == pytest.approx(35.0, abs=0.01), "data sheet: -521 at 35 °C"
    assert lookup_chip(0x70).celsius(0) == pytest.approx(21.0, abs=0.01), "data sheet: 0 at 21 °C"
    assert lookup_chip(0x98).celsius(0) == pytest.approx(25.0, abs=0.01), "data sheet: 0 at 25 °C"


@pytest.mark.parametrize("who_am_i", [0x68, 0x98])
def test_a_good_chip_passes_its_self_test_and_continues(start_imu, who_am_i):
    b, device = start_imu(who_am_i=who_am_i, self_test_error=0.05)
    result = self_test(device, b.clock.sleep)
    assert result.has_passed
    for axis in result.axes:
        assert axis.response / axis.trim == pytest.approx(1.05, abs=0.02)
    assert result.table().count("passed") == 6
    samples = loop(b, device, 1.0)
    assert len(samples) > 100
    assert np.mean([s.accel[2] for s in samples]) == pytest.approx(G, abs=0.02), "the ranges must be restored"


@pytest.mark.parametrize(("who_am_i", "error"), [(0x68, 0.2), (0x68, -0.2), (0x70, -0.6)])
def test_a_chip_that_differs_from_its_factory_code_fails_the_self_test(bench, who_am_i, error):
    b = bench(who_am_i=who_am_i, self_test_error=error)
    result = self_test(start(b), b.clock.sleep)
    assert not result.has_passed
    assert result.table().count("FAILED") == 6


def test_an_axis_without_a_factory_code_has_no_verdict(start_imu):
    b, device = start_imu()
    b.chip.regs[0x0D] &= 0xE0  # no code for gyro x
    result = self_test(device, b.clock.sleep)
    assert result.axes[3].has_passed is None
    assert result.has_passed
    assert "no factory code" in result.table()


def test_a_moving_vehicle_is_not_self_tested(bench):
    b = bench(motion=lambda t: ((0.0, 0.0, G), (0.0, 0.0, 3.0 * np.sin(t * 2e-8))))
    with refused("imu.self-test-moved", AnswerNo, axis="gyro z"):
        self_test(start(b), b.clock.sleep)


def test_a_bus_fault_ends_the_self_test_and_the_chip_continues(start_imu):
    b, device = start_imu()
    b.bus.fail(121)
    with refused("imu.self-test-broke-off", AnswerNo):
        self_test(device, b.clock.sleep)
    assert len(loop(b, device, 1.0)) > 100


def test_factory_codes_are_converted_as_in_the_register_map():
    """Code 1 is the smallest response, 31 the largest: 0.34 and 0.92 g, 25 and 25 · 1.046³⁰ = 96.4 °/s."""
    low, high = factory_trims((1,) * 6, False), factory_trims((31,) * 6, False)
    assert low == pytest.approx((0.34, 0.34, 0.34, 25.0, -25.0, 25.0))
    assert high == pytest.approx((0.92, 0.92, 0.92, 96.4, -96.4, 96.4), abs=0.1)
    assert factory_trims((1,) * 6, True) == pytest.approx((2620 / 16384,) * 3 + (20.0,) * 3)
