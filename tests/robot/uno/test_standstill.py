"""A computer that froze longer than the command timeout sends no more commands until the vehicle is armed again."""

import time

import pytest

from baqueano.diagnostics import StopReason
from baqueano.robot.uno.clock import WRAP_US, UnoClock
from baqueano.robot.uno.frames import Config, Drive, DriveFlag, StateFlag
from baqueano.robot.uno.link import Uno
from baqueano.robot.uno.standstill import Standstill, boot_ns
from tests.robot.uno.test_link import MS, Line, info, state


@pytest.fixture
def line():
    return Line()


def armed(line, dead_man_ms=300):
    uno = Uno(line, lambda: line.now_ns)
    line.send(info(config=Config(dead_man_ms=dead_man_ms)))
    uno.pump()
    uno.arm()
    line.send(state(10, flags=StateFlag.ARMED))
    uno.receive()
    uno.drive(0.5, 0.5)
    line.sent.clear()
    return uno


@pytest.mark.parametrize("dead_man_ms", [50, 300, 1000])
def test_rt2_a_gap_longer_than_the_command_timeout_disarms(line, dead_man_ms):
    uno = armed(line, dead_man_ms)
    line.now_ns += dead_man_ms * MS
    uno.drive(0.5, 0.5)
    assert line.drives() == [Drive(7, 500, 500, DriveFlag.ARM)]
    line.sent.clear()
    line.now_ns += (dead_man_ms + 1) * MS
    uno.drive(0.5, 0.5)
    uno.drive(0.5, 0.5)
    assert line.drives() == [Drive(7, 0, 0, 0)], "the first words after it disarm, and no command follows"
    assert uno.stop_cause.code == uno.standstill_reason().code == StopReason.STANDSTILL
    uno.arm()
    uno.drive(0.5, 0.5)
    assert line.drives()[-1] == Drive(7, 500, 500, DriveFlag.ARM)
    assert uno.stop_cause is None
    assert uno.standstill_reason() is None


def test_the_stop_reason_contains_the_gap_and_the_command_timeout(line):
    uno = armed(line)
    line.now_ns += 800 * MS
    assert uno.standstill_reason().figures == {"silent_s": 0.8, "dead_man_s": 0.3}


@pytest.mark.parametrize("outcome", ["nothing", "well", "dead man", "disarmed"])
def test_telemetry_buffered_during_a_gap_does_not_prevent_disarming(line, outcome):
    flags = {"well": StateFlag.ARMED, "dead man": StateFlag.ARMED | StateFlag.DEAD_MAN, "disarmed": 0}
    uno = armed(line)
    line.now_ns += 800 * MS
    if outcome != "nothing":
        for t_ms in range(20, 800, 10):
            line.send(state(t_ms, flags=flags[outcome]))
    uno.pump()  # the listening thread may run first after the freeze
    uno.receive()
    assert uno.standstill_reason().code == StopReason.STANDSTILL
    uno.drive(0.5, 0.5)
    assert line.drives() == [Drive(7, 0, 0, 0)]


def test_a_gap_while_disarmed_is_not_reported(line):
    uno = armed(line)
    uno.disarm()
    line.now_ns += 60_000 * MS
    assert uno.standstill_reason() is None
    uno.arm()
    assert uno.stop_cause is None


def test_time_in_suspend_counts_as_a_gap(monkeypatch):
    assert boot_ns() >= time.monotonic_ns() - 1_000_000_000
    now = [0]
    monkeypatch.setattr("baqueano.robot.uno.standstill.boot_ns", lambda: now[0])
    stand = Standstill()
    stand.record_command()
    now[0] = 3_600_000 * MS  # one hour in suspend, which CLOCK_MONOTONIC does not count
    assert stand.check(300).figures["silent_s"] == 3600.0


@pytest.mark.parametrize("suspended_s", [0.2, 60.0, 3000.0])
def test_timestamps_are_correct_after_a_suspension_of_the_host(suspended_s):
    """During a suspension the clock of the host stops, and the clock of the Uno continues."""
    clock, errors_ms = UnoClock(), []
    for k in range(200):
        host_ns, suspended_us = k * 100_000_000, round(1e6 * suspended_s) if k >= 100 else 0
        device_us = clock.unwrap((k * 100_000 + suspended_us) % WRAP_US)
        clock.add_ping(host_ns - 500_000, device_us, host_ns + 500_000)
        errors_ms.append(1e-6 * abs(clock.host_ns(device_us) - host_ns))
    assert max(errors_ms) < 1.0
