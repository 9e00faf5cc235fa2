"""`pinctrl` clocks a bus free that a chip blocks in mid-byte; the pins return to I2C at every end."""

import os
import subprocess
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.errors import RobotUnreachable
from baqueano.messages import text
from baqueano.robot.imu import bus_recovery
from baqueano.robot.imu.bus_recovery import RETRY_PERIOD_NS, BusRecovery, check_bus_recovery, recover_bus
from tests.codes import refused
from tests.emulated.i2c_ioctl import Bench, loop, start
from tests.emulated.pinctrl import on_path

BUS = "/dev/i2c-1"
ZEROS = [0, 0]  # the pins are set ten times: all released, two clocks, STOP, returned
SETS = 10


@pytest.fixture
def lines(tmp_path, monkeypatch):
    """Return `lines(bits)`, which puts a chip on the two lines. Long timeouts allow for a busy machine."""
    monkeypatch.setattr(bus_recovery, "CALL_S", 60.0)
    monkeypatch.setattr(bus_recovery, "ALL_S", 600.0)
    return lambda bits, **options: on_path(tmp_path, monkeypatch, bits, **options)


def as_it_was(pins):
    """The pins are in I2C mode, and no output has driven a line high."""
    return pins.given_back and pins.read()["driven_high"] == 0


@pytest.mark.parametrize("clocks", [1, 2, 5, 8, 9])
def test_rt9_a_chip_in_the_middle_of_a_byte_releases_the_bus_within_nine_clocks(lines, clocks):
    pins = lines([0] * clocks)
    assert pins
    outcome = recover_bus(BUS)
    assert outcome.is_free
    assert (outcome.message.code, outcome.message.figures) == (
        "bus.freed-at-once" if clocks == 1 else "bus.freed",
        {"clocks": clocks},
    )
    after = pins.read()
    assert (after["clocks"], after["starts"], after["stops"]) == (clocks + 1, 0, 1), "one more for the STOP"
    assert not pins
    assert as_it_was(pins)


def test_a_high_data_bit_is_not_mistaken_for_a_free_bus(lines):
    pins = lines([0, 1, 0, 0, 1, 0, 0, 0])
    outcome = recover_bus(BUS)
    assert outcome.is_free
    assert pins.read()["stops"] == 1
    assert not pins
    assert as_it_was(pins)


def test_a_chip_that_blocks_the_bus_after_nine_clocks_is_reported(lines):
    pins = lines([0] * 10)
    outcome = recover_bus(BUS)
    assert not outcome.is_free
    assert (outcome.message.code, outcome.message.figures) == ("bus.sda-held", {"clocks": 9})
    assert pins.read()["clocks"] == 9
    assert as_it_was(pins)


@pytest.mark.parametrize(
    ("bits", "is_scl_low", "code"), [([0, 0], True, "bus.scl-held"), ([], False, "bus.free")]
)
def test_a_blocked_scl_or_a_free_bus_is_reported_and_not_clocked(lines, bits, is_scl_low, code):
    pins = lines(bits, is_scl_low=is_scl_low)
    outcome = recover_bus(BUS)
    assert not outcome.is_free
    assert outcome.message.code == code
    assert {call[0] for call in pins.read()["calls"]} == {"get"}


@pytest.mark.parametrize("after", range(SETS))
def test_after_a_crash_at_any_call_the_pins_return_to_i2c(lines, after):
    pins = lines(ZEROS)
    pins.fails("crash", after=after)
    outcome = recover_bus(BUS)
    assert outcome.is_free == (after == SETS - 1), "returning the pins is tried twice"
    assert outcome.is_free or str(outcome.message.figures).count("pinctrl set")
    assert sum(call[0] == "set" for call in pins.read()["calls"]) > after, "the failing call was reached"
    assert as_it_was(pins)


@pytest.mark.parametrize("after", [3, SETS - 1])
def test_a_hanging_call_is_ended_and_the_pins_return_to_i2c(lines, monkeypatch, after):
    pins = lines(ZEROS)
    monkeypatch.setattr(bus_recovery, "CALL_S", 3.0)
    pins.fails("hang", after=after)
    outcome = recover_bus(BUS)
    assert outcome.is_free == (after == SETS - 1)
    assert outcome.is_free or "timed out after 3.0 seconds" in outcome.message.figures["error"]
    assert as_it_was(pins)


def test_pins_that_remain_gpio_without_an_error_are_set_to_i2c_again(lines):
    pins = lines(ZEROS)
    pins.fails("deaf", after=SETS - 1)
    assert recover_bus(BUS).is_free
    assert as_it_was(pins)


def test_pins_that_cannot_return_to_i2c_are_reported_with_a_command(lines):
    pins = lines(ZEROS)
    pins.fails("root", after=SETS - 1, times=100)
    outcome = recover_bus(BUS)
    assert not outcome.is_free
    assert (outcome.message.code, outcome.message.fix) == ("bus.pins-not-restored", "pinctrl set 2,3 a0")
    assert "(255): Must be root" in outcome.message.figures["cause"]


def test_ctrl_c_during_recovery_returns_the_pins_to_i2c(lines, monkeypatch):
    pins, run, ran = lines(ZEROS), subprocess.run, []

    def interrupted(*command, **options):
        ran.append(command)
        if len(ran) == 6:
            raise KeyboardInterrupt
        return run(*command, **options)

    monkeypatch.setattr(subprocess, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        recover_bus(BUS)
    assert pins.read()["clocks"] == 1, "the recovery was interrupted"
    assert as_it_was(pins)


def test_slow_calls_end_the_recovery_and_the_pins_return_to_i2c(lines, monkeypatch):
    pins, now = lines([0] * 9), iter(range(1000))
    monkeypatch.setattr(bus_recovery, "ALL_S", 8.0)
    monkeypatch.setattr(bus_recovery, "time", SimpleNamespace(monotonic=lambda: next(now)))  # one second each
    outcome = recover_bus(BUS)
    assert not outcome.is_free
    assert (outcome.message.code, outcome.message.figures["limit_s"]) == ("bus.too-late", 8.0)
    assert 0 < pins.read()["clocks"] < 9
    assert as_it_was(pins)


@pytest.mark.parametrize("function", ["ip", "op"])
def test_gpio_pins_of_a_killed_program_return_to_i2c_after_recovery(lines, function):
    pins = lines([0, 0, 0])
    pins.put(function={"2": "ip", "3": function})
    outcome = recover_bus(BUS)
    assert (outcome.message.code, outcome.message.figures) == ("bus.freed", {"clocks": 3})
    assert as_it_was(pins)
    pins.put(function={"2": "ip", "3": function})
    outcome = recover_bus(BUS)
    assert outcome.is_free, "only these pins block the bus"
    assert outcome.message.code == "bus.pins-restored"
    assert as_it_was(pins)


def test_a_user_outside_the_gpio_group_gets_the_command_to_join(lines):
    pins = lines(ZEROS)
    pins.fails("root", "get", times=100)
    outcome = recover_bus(BUS)
    assert not outcome.is_free
    reason = outcome.message
    assert (reason.code, reason.figures["command"], reason.figures["exit"]) == (
        "bus.call-refused",
        "pinctrl get 2,3",
        255,
    )
    assert "Must be root" in reason.figures["reply"]
    assert "sudo usermod -aG gpio $USER" in outcome.text


def test_a_missing_pinctrl_is_reported_with_the_install_command(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    outcome = recover_bus(BUS)
    assert (outcome.is_free, outcome.message.code) == (False, "bus.no-pinctrl")
    assert outcome.message.fix == "sudo apt install raspi-utils"


def test_pins_of_another_board_or_bus_are_not_changed(lines):
    pins = lines(ZEROS)
    pins.put(function={"2": "a3", "3": "a3"})
    message, message_3 = recover_bus(BUS).message, recover_bus("/dev/i2c-3").message
    assert (message.code, message.figures) == ("bus.other-pins", {"sda": "a3", "scl": "a3", "expected": "a0"})
    assert (message_3.code, message_3.figures) == ("bus.other-bus", {"path": "/dev/i2c-3", "bus": "i2c-1"})
    assert {call[0] for call in pins.read()["calls"]} == {"get"}


def test_a_background_recovery_is_reported_once_and_not_repeated_immediately(lines):
    pins, recovery = lines([0] * 10), BusRecovery(BUS)
    recovery.begin(0)
    recovery.begin(0)
    recovery.wait()
    outcome = recovery.pop_outcome()
    assert outcome is not None
    assert (outcome.message.code, outcome.message.figures) == ("bus.sda-held", {"clocks": 9})
    assert recovery.pop_outcome() is None
    recovery.begin(RETRY_PERIOD_NS - 1)
    recovery.wait()
    assert recovery.pop_outcome() is None
    assert pins.read()["clocks"] == 9
    recovery.begin(RETRY_PERIOD_NS)
    recovery.wait()
    outcome = recovery.pop_outcome()
    assert outcome is not None
    assert (outcome.message.code, outcome.message.figures) == ("bus.freed-at-once", {"clocks": 1})


def test_recovery_programs_run_without_the_real_time_priority_of_the_loop(monkeypatch):
    policies = []
    monkeypatch.setattr(bus_recovery, "recover_bus", lambda path: policies.append(os.sched_getscheduler(0)))
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        pytest.skip("this user may have no real-time priority")
    try:
        recovery = BusRecovery(BUS)
        recovery.begin(0)
        recovery.wait()
        assert os.sched_getscheduler(0) == os.SCHED_FIFO, "the priority of the loop is unchanged"
    finally:
        os.sched_setscheduler(0, *before)
    assert policies == [os.SCHED_OTHER]


def test_a_bus_blocked_at_imu_start_is_clocked_free_and_reported(lines, monkeypatch, tmp_path):
    pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")
    bench, pins = Bench(monkeypatch, tmp_path), lines([0] * 4)
    bench.bus.sda_low = pins
    imu = start(bench)
    assert imu.is_running
    (warning,) = imu.identity.warnings
    assert warning == text(note("bus.freed", clocks=4))
    assert any(warning in line for line in bench.printed)
    assert warning in imu.notes, "the run contains it"
    assert as_it_was(pins)


def test_a_bus_that_stays_blocked_at_imu_start_is_an_error(lines, monkeypatch, tmp_path):
    pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")
    bench = Bench(monkeypatch, tmp_path)
    bench.bus.sda_low = lines([0, 0], is_scl_low=True)
    with refused("imu.bus-unusable", RobotUnreachable):
        start(bench)


def test_the_bus_is_unused_during_clocking_and_the_chip_restarts_afterwards(lines, monkeypatch, tmp_path):
    pytest.importorskip("smbus2", reason="I2C needs Linux and smbus2")
    bench, pins = Bench(monkeypatch, tmp_path), lines([])
    imu = start(bench)
    loop(bench, imu, 0.5)
    assert imu.free_bus() is None
    pins.put(bits=[0] * 7)
    bench.bus.sda_low = pins
    loop(bench, imu, 0.3)
    assert imu.is_bus_stuck
    assert imu.free_bus() is None, "not silent for half a second: perhaps it is a disturbance"
    imu._recovery.wait()
    assert pins.read()["calls"] == []
    loop(bench, imu, 0.4)
    go, recover_bus = threading.Event(), bus_recovery.recover_bus
    monkeypatch.setattr(bus_recovery, "recover_bus", lambda path: (go.wait(), recover_bus(path))[1])
    assert imu.free_bus() is None
    before = bench.bus.transfers
    read = loop(bench, imu, 0.5)
    after = bench.bus.transfers
    go.set()
    imu._recovery.wait()
    assert (read, after) == ([], before)
    outcome = imu.free_bus()
    assert (outcome.message.code, outcome.message.figures) == ("bus.freed", {"clocks": 7})
    imu.events()
    samples = loop(bench, imu, 1.0)
    assert len(samples) > 100
    assert np.linalg.norm(np.mean([s.accel for s in samples], axis=0)) == pytest.approx(9.81, abs=0.1)
    assert "imu.answers-again" in [event.message.code for event in imu.events()]
    assert imu.free_bus() is None
    assert not imu.is_bus_stuck
    assert as_it_was(pins)


def test_the_doctor_reports_whether_bus_recovery_is_possible(lines, tmp_path):
    model, pins = tmp_path / "model", lines([])
    assert check_bus_recovery(BUS, model)[0] == "unknown"
    model.write_text("Orange Pi Zero\0")
    assert check_bus_recovery(BUS, model)[:2] == ("unknown", "this machine is not a Raspberry Pi")
    model.write_text("Raspberry Pi 3 Model B Plus Rev 1.3\0")
    assert check_bus_recovery(BUS, model)[:2] == ("ok", "pinctrl reaches GPIO 2 and 3; SDA high, SCL high")
    pins.put(function={"2": "ip", "3": "ip"})
    assert check_bus_recovery(BUS, model)[0::2] == ("warn", "Type: pinctrl set 2,3 a0")
    pins.fails("root", "get", times=100)
    verdict, _, remedy = check_bus_recovery(BUS, model)
    assert verdict == "warn"
    assert "usermod -aG gpio" in remedy
    assert {call[0] for call in pins.read()["calls"]} == {"get"}, "the check must not change a pin"
