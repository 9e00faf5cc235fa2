"""Faults of an I2C bus near motors: each is reported, and none gives a wrong sample or a long wait."""

import errno

import numpy as np
import pytest

pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")

from tests.codes import refused
from tests.emulated.i2c_ioctl import loop, start
from tests.emulated.mpu import STANDARD_GRAVITY

G = STANDARD_GRAVITY
NACK = errno.EREMOTEIO


def kinds(device) -> list[str]:
    return [event.message.code for event in device.events()]


def assert_sane(samples) -> None:
    """Check that each sample at rest is 1 g up without rotation; a misaligned word would differ by far."""
    for s in samples:
        assert s.accel == pytest.approx([0.0, 0.0, G], abs=0.3)
        assert s.gyro == pytest.approx([0.0, 0.0, 0.0], abs=0.02)


def gaps_s(samples) -> np.ndarray:
    return np.diff([s.t_ns for s in samples]) * 1e-9


@pytest.mark.parametrize("code", [NACK, errno.EIO])
def test_one_failed_transfer_loses_no_sample(start_imu, code):
    b, device = start_imu(read_s=1.0)
    samples, count = [], len(b.chip.taken)
    for _ in range(20):
        b.bus.fail(code)
        samples += loop(b, device, 0.05)
    assert_sane(samples)
    assert len(samples) == pytest.approx(len(b.chip.taken) - count, abs=2)
    assert device.counts.retries == 20
    assert device.counts.failures == device.counts.restarts == device.counts.overflows == 0
    assert device.events() == []


def test_an_interrupted_fifo_read_does_not_misalign_samples(start_imu):
    b, device = start_imu(read_s=1.0)
    samples = []
    for count in range(1, 28):
        b.clock.sleep(0.01)
        b.bus.faults.append(0)  # the count is read, then the data are interrupted
        b.bus.cut = None
        b.chip.run_until(b.clock.now)
        original = b.bus.transfer

        def second(address, messages, count=count, original=original):
            if messages[0][1][0] == 0x74:
                b.bus.cut, b.bus.transfer = count, original
            return original(address, messages)

        b.bus.transfer = second
        samples += loop(b, device, 0.1)
    assert_sane(samples)
    assert len(samples) > 20 * 27 * 0.7
    assert device.counts.retries == 27
    assert set(kinds(device)) <= {"imu.overflow"}


def test_three_failed_reads_restart_the_chip(start_imu):
    b, device = start_imu()
    samples = loop(b, device, 1.0)
    b.bus.fail(NACK, 6)
    samples += loop(b, device, 1.0)
    assert device.counts.failures == 3
    assert device.counts.restarts == 1
    assert kinds(device) == ["imu.restart", "imu.started"]
    assert device.is_running
    assert 0.16 < np.max(gaps_s(samples)) < 0.35, "the chip's own 160 ms, and a step at each call"
    assert_sane(samples)


def test_a_brown_out_is_detected_within_a_second_and_settings_are_restored(bench):
    b = bench()
    device = start(b, accel_range_g=8)
    before = loop(b, device, 1.35)
    b.chip.brown_out()
    after = loop(b, device, 1.5)
    events = device.events()
    assert [
        e.message.code for e in events if e.message.code not in ("imu.data-missing", "imu.answers-again")
    ] == ["imu.lost-supply", "imu.started"]
    assert events[0].message.figures["power"] == 0x40
    assert after[-1].t_ns - before[-1].t_ns > 1.3e9
    assert np.max(gaps_s(before + after)) < 0.4, "at 5 missing samples the registers are looked at"
    assert_sane(after)


def test_rt9_a_changed_chip_setting_is_restored_within_a_second(start_imu):
    b, device = start_imu()
    loop(b, device, 0.5)
    b.chip.regs[0x1C] = 0x18
    loop(b, device, 1.5)
    events = device.events()
    assert [e.message.code for e in events] == ["imu.lost-settings", "imu.started"]
    assert_sane(loop(b, device, 0.2))


def test_a_full_fifo_is_emptied_and_its_old_samples_are_discarded(start_imu):
    b, device = start_imu()
    before = loop(b, device, 1.0)
    b.clock.sleep(0.5)
    pause_time = b.clock.now
    after = loop(b, device, 1.0)
    assert kinds(device) == ["imu.overflow"]
    assert device.counts.overflows == 1
    assert after[0].t_ns > pause_time
    assert after[0].t_ns > before[-1].t_ns
    assert_sane(after)
    assert len(after) == pytest.approx(200, abs=5)


def test_rt7_frozen_samples_are_discarded_and_the_chip_is_restarted(start_imu):
    b, device = start_imu(read_s=1.0)
    b.chip.freeze()
    samples = loop(b, device, 0.8)
    assert len(samples) <= 21
    assert kinds(device)[:4] == ["imu.frozen", "imu.restart", "imu.started", "imu.data-missing"]
    assert device.is_silent
    b.chip.freeze(False)
    fresh = loop(b, device, 1.0)
    assert "imu.answers-again" in kinds(device)
    assert not device.is_silent
    assert_sane(fresh)


def test_a_frozen_chip_is_restarted_each_second_and_reported_once(start_imu):
    b, device = start_imu(read_s=1.0)
    b.chip.freeze()
    loop(b, device, 5.0)
    assert device.counts.restarts in (5, 6)
    assert kinds(device) == [
        "imu.frozen",
        "imu.restart",
        "imu.started",
        "imu.data-missing",
        "imu.restart",
        "imu.started",
    ]


def test_a_chip_without_new_samples_is_restarted(start_imu):
    b, device = start_imu(read_s=1.0)
    b.chip.regs[0x23] = 0  # its FIFO accepts no samples; all checked registers are unchanged
    samples = loop(b, device, 1.5)
    assert kinds(device) == ["imu.data-missing", "imu.restart", "imu.started", "imu.answers-again"]
    assert len(samples) > 100
    assert_sane(samples)


@pytest.mark.parametrize("who_am_i", [0x68, 0x98])
def test_rt7_a_real_sensor_at_rest_never_counts_as_frozen(bench, who_am_i):
    """The narrowest filter, the widest ranges, and half of the noise in the data sheet, for 2,000 rows."""
    b = bench(noise=0.5, who_am_i=who_am_i)
    device = start(b, filter=6, accel_range_g=16, gyro_range_dps=2000, rate_hz=1000)
    samples = loop(b, device, 2.0)
    assert len(samples) == pytest.approx(2000, abs=20)
    assert kinds(device) == []


def test_a_saturated_axis_is_named_once(start_imu):
    b, device = start_imu()
    loop(b, device, 0.2)
    b.chip.saturate(5, -32768)
    samples = loop(b, device, 1.0)
    events = device.events()
    assert [e.message.code for e in events] == ["imu.saturated"]
    assert "gyro z" in events[0].text
    assert "±1000 °/s" in events[0].text
    assert device.counts.full_scale_samples == pytest.approx(200, abs=5)
    assert len(samples) == pytest.approx(200, abs=5), "the log retains the measured value"


def test_rt9_a_blocked_bus_delays_only_one_read(start_imu):
    b, device = start_imu(read_s=1.0)
    b.bus.sda_low = True
    longest, start_ns = 0, b.clock.now
    silent_after = None
    while b.clock.now - start_ns < 2_000_000_000:
        before = b.clock.now
        assert device.read() == []
        longest = max(longest, b.clock.now - before)
        if device.is_silent and silent_after is None:
            silent_after = b.clock.now - start_ns
        b.clock.now = max(b.clock.now, before + 10_000_000)
    assert longest <= 40_000_000, "i2c.py sets 40 ms in the kernel; its second would be too long"
    assert silent_after == pytest.approx(0.5e9, abs=0.06e9)
    events = device.events()
    assert [e.message.code for e in events].count("imu.held") == 1
    assert [e.message.code for e in events].count("imu.data-missing") == 1
    b.bus.sda_low = False
    samples = loop(b, device, 1.0)
    assert len(samples) > 100
    assert_sane(samples)
    assert "imu.answers-again" in kinds(device)


def test_a_blocked_bus_at_start_is_distinguished_from_a_missing_chip(bench):
    from baqueano.errors import RobotUnreachable

    b = bench()
    b.bus.sda_low = True
    with refused("imu.bus-unusable", RobotUnreachable):
        start(b)


def test_a_chip_that_is_disconnected_recovers_after_reconnection(start_imu):
    b, device = start_imu(read_s=1.0)
    chip = b.bus.devices.pop(0x68)
    assert loop(b, device, 3.0) == []
    assert device.is_silent
    events = kinds(device)
    assert events == ["imu.restart", "imu.data-missing"], "each fault is reported once"
    chip.brown_out()
    b.bus.devices[0x68] = chip
    samples = loop(b, device, 1.0)
    assert len(samples) > 100
    assert_sane(samples)
    assert kinds(device) == ["imu.started", "imu.answers-again"]


def test_a_missing_device_file_raises_no_error_and_reading_resumes_later(start_imu, tmp_path):
    b, device = start_imu()
    loop(b, device, 0.5)
    b.bus.fail(errno.ENODEV, 6)
    (tmp_path / "i2c-1").rename(tmp_path / "gone")
    assert len(loop(b, device, 0.7)) < 10
    assert device.is_silent
    (tmp_path / "gone").rename(tmp_path / "i2c-1")
    assert len(loop(b, device, 1.0)) > 100
    assert kinds(device) == ["imu.restart", "imu.data-missing", "imu.started", "imu.answers-again"]


def test_random_bus_errors_cause_only_short_gaps(start_imu):
    b, device = start_imu(clock_ppm=8000)
    rng = np.random.default_rng(5)
    original = b.bus.transfer

    def noisy(address, messages):
        if rng.random() < 0.05:
            b.bus.fail((NACK, errno.EIO)[int(rng.integers(2))])
        return original(address, messages)

    b.bus.transfer = noisy
    samples = loop(b, device, 10.0)
    assert_sane(samples)
    assert len(samples) > 0.98 * 10 * 201.6
    assert np.max(gaps_s(samples)) < 0.35
    assert device.rate_hz == pytest.approx(201.6, rel=5e-4)
