"""The emulated MPU-6050 follows the register map, especially where drivers make errors."""

import errno
import math

import pytest

from tests.emulated.mpu import CLONES, STANDARD_GRAVITY, EmulatedBus, MpuEmulator

PWR = 0x6B
USER = 0x6A
DIV = 0x19
CONFIG = 0x1A
FIFO_EN = 0x23
INT_ENABLE = 0x38
INT_STATUS = 0x3A
COUNT = 0x72
FIFO = 0x74
MS = 1_000_000
I2C_SLAVE = 0x703


@pytest.fixture
def chip():
    return MpuEmulator(noise=0.0)


def write(chip, register, *values):
    chip.transfer([(False, bytes((register, *values)))])


def read_register(chip, register, count=1):
    return chip.transfer([(False, bytes([register])), (True, count)])[0]


def awake(chip):
    write(chip, PWR, 0x01)
    write(chip, DIV, 4, 3)


def awake_with_fifo(chip):
    awake(chip)
    write(chip, FIFO_EN, 0xF8)
    write(chip, USER, 0x40)


def test_the_chip_sleeps_without_samples_after_power_on(chip):
    chip.run_until(500 * MS)
    assert read_register(chip, PWR) == b"\x40"
    assert read_register(chip, 0x75) == b"\x68"
    assert read_register(chip, 0x3B, 14) == bytes(14)
    assert chip.taken == []


def test_a_reset_restores_registers_and_ignores_writes_for_100_ms(chip):
    awake(chip)
    write(chip, PWR, 0x80)
    chip.run_until(99 * MS)
    write(chip, DIV, 9)
    assert chip.lost_writes == 1
    assert read_register(chip, PWR)[0] == 0x40
    assert read_register(chip, DIV) == b"\x00"
    chip.run_until(100 * MS)
    write(chip, DIV, 9)
    assert read_register(chip, DIV) == b"\x09"


def test_the_register_pointer_advances_except_at_the_fifo(chip):
    write(chip, DIV, 1, 2, 8, 16)
    assert read_register(chip, DIV, 4) == bytes([1, 2, 8, 16])
    awake_with_fifo(chip)
    chip.run_until(50 * MS)
    count = read_register(chip, COUNT, 2)
    assert count == len(chip.fifo).to_bytes(2, "big")
    before = len(chip.fifo)
    read_register(chip, FIFO, 28)
    assert len(chip.fifo) == before - 28


def test_an_empty_fifo_repeats_its_last_byte(chip):
    awake_with_fifo(chip)
    chip.run_until(6 * MS)
    data = read_register(chip, FIFO, 20)
    assert data[14:] == data[13:14] * 6


def test_fifo_reset_is_ignored_while_the_fifo_is_on(chip):
    awake_with_fifo(chip)
    chip.run_until(50 * MS)
    write(chip, USER, 0x44)
    assert len(chip.fifo) > 0
    write(chip, USER, 0x04)
    assert len(chip.fifo) == 0
    assert read_register(chip, USER) == b"\x00", "the bit clears itself"


def test_a_full_fifo_retains_the_newest_bytes_and_sets_a_flag(chip):
    awake_with_fifo(chip)
    chip.run_until(1000 * MS)
    assert read_register(chip, INT_STATUS)[0] & 0x10
    assert len(chip.fifo) == 1024
    assert bytes(chip.fifo)[-14:] == bytes(chip.regs[0x3B:0x49])


def test_only_the_enabled_sensors_enter_the_fifo(chip):
    awake(chip)
    for bits, size in ((0x08, 6), (0x78, 12), (0x80, 2), (0x10, 2), (0xF8, 14)):
        write(chip, FIFO_EN, bits)
        write(chip, USER, 0x04)
        write(chip, USER, 0x40)
        count_taken = len(chip.taken)
        chip.run_until(chip.t_ns + 20 * MS)
        assert len(chip.fifo) == size * (len(chip.taken) - count_taken)


def test_data_ready_is_reported_once_and_interrupts_only_if_enabled(chip):
    awake(chip)
    chip.run_until(20 * MS)
    assert not chip.interrupt
    write(chip, INT_ENABLE, 1)
    assert chip.interrupt
    assert read_register(chip, INT_STATUS)[0] & 1
    assert read_register(chip, INT_STATUS)[0] & 1 == 0
    assert not chip.interrupt
    chip.run_until(26 * MS)
    assert chip.interrupt


def test_the_sample_rate_is_divided_and_follows_the_clock_of_the_chip():
    for ppm in (-40_000, 0, 40_000):
        chip = MpuEmulator(noise=0.0, clock_ppm=ppm)
        awake(chip)
        chip.run_until(10_000 * MS)
        assert len(chip.taken) == pytest.approx(2000 * (1 + ppm * 1e-6), abs=1)


def test_readings_scale_with_the_ranges():
    chip = MpuEmulator(lambda t: ((1.0, 0.0, STANDARD_GRAVITY), (0.0, 0.0, 2.0)), noise=0.0)
    awake(chip)
    for setting in range(4):
        write(chip, 0x1B, setting << 3, setting << 3)
        chip.run_until(chip.t_ns + 100 * MS)
        words = [
            int.from_bytes(read_register(chip, 0x3B, 14)[i : i + 2], "big", signed=True)
            for i in range(0, 14, 2)
        ]
        assert words[2] == 16384 >> setting
        assert words[6] == pytest.approx(math.degrees(2.0) * (131.0, 65.5, 32.8, 16.4)[setting], abs=1)
        assert words[3] / 340 + 36.53 == pytest.approx(chip.temperature_c, abs=0.01)


def test_an_axis_beyond_its_range_saturates():
    chip = MpuEmulator(lambda t: ((50.0, -50.0, 0.0), (0.0, 0.0, 0.0)), noise=0.0)
    awake(chip)
    chip.run_until(100 * MS)
    assert read_register(chip, 0x3B, 4) == b"\x7f\xff\x80\x00"


def test_a_narrower_filter_attenuates_a_sine_more():
    """At 20 Hz a first-order lag of the filter's width f₀ leaves 1/√(1 + (20/f₀)²)."""
    sizes = []
    for setting in (1, 3, 4):
        chip = MpuEmulator(
            lambda t: ((math.sin(t * 1e-9 * 40 * math.pi), 0.0, 0.0), (0.0, 0.0, 0.0)), noise=0.0
        )
        write(chip, PWR, 0x01)
        write(chip, DIV, 0, setting)
        peak = 0
        for n in range(300, 600):
            chip.run_until(n * MS)
            peak = max(peak, int.from_bytes(read_register(chip, 0x3B, 2), "big", signed=True))
        sizes.append(peak / 16384 * STANDARD_GRAVITY)
    lag = [1.0 / math.sqrt(1.0 + (20.0 / width) ** 2) for width in (184.0, 44.0, 21.0)]
    assert sizes == pytest.approx(lag, abs=0.03)


def test_noise_at_the_default_filter_equals_the_data_sheet_value():
    """400 µg/√Hz and 0.005 °/s/√Hz through a lag of 44 and 42 Hz, whose noise bandwidth is π/2 of that."""
    chip = MpuEmulator(seed=3)
    write(chip, PWR, 0x01)
    write(chip, DIV, 0, 3)
    rows = []
    for n in range(100, 4100):
        chip.run_until(n * MS)
        data = read_register(chip, 0x3B, 14)
        rows.append(
            (int.from_bytes(data[:2], "big", signed=True), int.from_bytes(data[8:10], "big", signed=True))
        )
    for column, lsb, density, width in ((0, 16384, 400e-6, 44.0), (1, 131, 0.005, 42.0)):
        values = [row[column] / lsb for row in rows]
        mean = sum(values) / len(values)
        std = math.sqrt(sum((v - mean) ** 2 for v in values) / len(values))
        assert std == pytest.approx(density * math.sqrt(width * math.pi / 2), rel=0.12)


def test_two_chips_with_the_same_seed_give_the_same_bytes():
    def bytes_of(seed):
        chip = MpuEmulator(seed=seed)
        awake_with_fifo(chip)
        chip.run_until(300 * MS)
        return bytes(chip.fifo)

    assert bytes_of(5) == bytes_of(5)
    assert bytes_of(5) != bytes_of(6)


@pytest.mark.parametrize("who_am_i", sorted(CLONES))
def test_a_clone_has_a_different_id_and_fifo_size(who_am_i):
    chip = MpuEmulator(who_am_i=who_am_i)
    assert read_register(chip, 0x75)[0] == who_am_i
    awake_with_fifo(chip)
    chip.run_until(1000 * MS)
    assert len(chip.fifo) == (1024 if who_am_i == 0x68 else 512)


def test_the_adapter_accepts_only_one_final_read_in_a_transfer(chip):
    bus = EmulatedBus({0x68: chip})
    with pytest.raises(OSError, match="only one read") as error:
        bus.transfer(0x68, [(True, 1), (False, b"\x75")])
    assert error.value.errno == errno.EOPNOTSUPP


def test_a_bus_transfer_consumes_time_up_to_its_timeout(chip):
    durations_s = []
    bus = EmulatedBus({0x68: chip}, durations_s.append)
    bus.transfer(0x68, [(False, b"\x3b"), (True, 14)])
    assert durations_s[-1] == pytest.approx(0.39e6, rel=0.03), "ns; 156 bits at 400 kHz"
    bus.sda_low = True
    with pytest.raises(OSError, match="timed out"):
        bus.transfer(0x68, [(False, b"\x3b"), (True, 14)])
    assert durations_s[-1] == 1_000_000_000
    bus.control(0x0702, 4)
    with pytest.raises(OSError, match="timed out"):
        bus.transfer(0x68, [(False, b"\x3b"), (True, 14)])
    assert durations_s[-1] == 40_000_000


def test_an_ioctl_call_on_another_file_is_passed_to_the_kernel(monkeypatch, tmp_path):
    fcntl = pytest.importorskip("fcntl", reason="this system has no ioctl")
    pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")
    from tests.emulated.i2c_ioctl import Bench

    Bench(monkeypatch, tmp_path)
    with (tmp_path / "other").open("w") as stream, pytest.raises(OSError, match="ioctl") as error_info:
        fcntl.ioctl(stream.fileno(), I2C_SLAVE, 0x68)
    assert error_info.value.errno == errno.ENOTTY
