"""A chip blocks the I2C bus in a drive: the vehicle stops, clocks free the bus, and the vehicle is READY again.

On the real firmware and the real drivers in lock-step. The calls of `pinctrl` take the time of this machine, which the
vehicle waits for.
"""

import threading
from itertools import pairwise

import pytest

from baqueano.diagnostics import Severity, StopReason, note, stop
from baqueano.door.states import DoorState
from baqueano.drive import drive_stop_reason
from baqueano.drive.recording import CLOCK_SOURCE, HARDWARE_SOURCE
from baqueano.messages import text
from baqueano.robot.imu import bus_recovery
from tests.emulated.drives import drive, during, look_around, spin
from tests.emulated.pinctrl import on_path


@pytest.fixture
def lines(tmp_path, monkeypatch):
    """Return `lines(bits)`, which puts a chip on the two lines."""
    monkeypatch.setattr(bus_recovery, "CALL_S", 60.0)
    monkeypatch.setattr(bus_recovery, "ALL_S", 600.0)
    return lambda bits, **options: on_path(tmp_path, monkeypatch, bits, **options)


def hold(robot, pins):
    """Let each transfer last until the timeout of the driver, until the lines are free."""
    robot.bus.sda_low = pins
    robot.bus.spend = lambda ns: robot.wait(1e-9 * ns) if ns > 1e7 else None


def recoveries():
    """Return the running recoveries."""
    return [thread for thread in threading.enumerate() if thread.name == "bus recovery"]


def looked_on(service, robot, seconds):
    """Let the service examine its hardware while idle; a recovery takes no simulated time."""
    for _ in range(round(seconds / 0.05)):
        look_around(service, robot, 1)
        for thread in recoveries():
            thread.join()


def last_state(service):
    return [m for m in service.messages if m["type"] == "state"][-1]


def test_rt9_a_blocked_bus_stops_the_drive_and_is_freed_at_rest(service, robot, lines):
    pins, log, events, start_s = lines([]), [], [], []
    service.log = log.append

    def hangs():
        start_s.append(robot.board.t_s)
        pins.put(bits=[0] * 5)
        hold(robot, pins)

    during(service, robot, 0.5, hangs)
    healthy = service.notify_watchdog
    service.notify_watchdog = lambda: (healthy(), events.extend(pins.read()["calls"]))
    end, run = drive(service, spin(3.0))
    service.notify_watchdog = lambda: None
    assert end["reason"].code == StopReason.SENSOR_SILENT
    assert drive_stop_reason(run) == end["reason"]
    assert robot.board.off_since() - start_s[0] <= 0.56  # imu_timeout_s = 0.5
    (punctuality,) = [e for e in run.events if e.source == CLOCK_SOURCE]
    assert punctuality.level == "warning", "each look at the bus took 40 ms, four ticks"
    assert any("low" in e.text for e in run.events if e.source == HARDWARE_SOURCE)
    assert events == [], "no pin may change during a drive"

    looked_on(service, robot, 2.0)
    (message,) = log
    freed_note = note("bus.freed", Severity.WARNING, clocks=5)
    assert message == text(freed_note)
    assert freed_note in [m["message"] for m in service.messages if m["type"] == "event"]
    assert last_state(service)["imu_bus"] == freed_note
    assert not pins
    assert pins.read()["driven_high"] == 0
    assert not robot.imu.is_silent
    assert service.machine.state is DoorState.STOPPED, (
        "a stop is latched: an operator must inspect the vehicle"
    )
    service.operator.is_clear_requested = True
    looked_on(service, robot, 1.0)
    assert service.machine.state is DoorState.READY
    end, run = drive(service, spin(1.0))
    assert end["reason"] is None


def test_a_bus_blocked_at_rest_is_freed_automatically(service, robot, lines):
    pins, states = lines([0] * 9), []
    service.notify_watchdog = lambda: states.append(service.machine.state)
    hold(robot, pins)
    looked_on(service, robot, 2.0)
    service.notify_watchdog = lambda: None
    assert [a for a, b in pairwise([*states, None]) if a is not b] == [
        DoorState.READY,
        DoorState.DISARMED,
        DoorState.READY,
    ]
    assert last_state(service)["imu_bus"] == note("bus.freed", Severity.WARNING, clocks=9)
    end, _ = drive(service, spin(1.0))
    assert end["reason"] is None


def test_an_unrecoverable_bus_is_reported_once_and_retried(service, robot, lines):
    pins, log = lines([0] * 3, is_scl_low=True), []
    service.log = log.append
    hold(robot, pins)
    looked_on(service, robot, 12.0)
    assert len([call for call in pins.read()["calls"] if call[0] == "get"]) == 2 * 3, "two looks, each 5 s"
    assert log == [text(note("bus.scl-held"))]
    state = last_state(service)
    assert state["state"] == "DISARMED"
    assert state["reason"].code == StopReason.IMU_BUS_STILL_BLOCKED
    assert state["reason"].figures["cause"].code == "bus.scl-held"
    pins.put(bits=[], is_scl_low=False)
    looked_on(service, robot, 1.5)
    assert service.machine.state is DoorState.READY


def test_a_blocked_bus_without_pinctrl_is_reported_until_free(service, robot, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    hold(robot, True)
    looked_on(service, robot, 2.0)
    assert "sudo apt install raspi-utils" in text(last_state(service)["reason"])
    robot.bus.sda_low = False
    looked_on(service, robot, 1.5)
    assert service.machine.state is DoorState.READY


def test_a_second_bus_fault_gets_a_new_report(service, robot, lines):
    pins = lines([0] * 9)
    hold(robot, pins)
    looked_on(service, robot, 2.0)
    assert last_state(service)["imu_bus"] == note("bus.freed", Severity.WARNING, clocks=9)
    looked_on(service, robot, 5.0)
    count = len(service.messages)
    pins.put(bits=[0] * 3)
    looked_on(service, robot, 2.0)
    whys = {m["reason"] for m in service.messages[count:] if m["type"] == "state"} - {None}
    assert whys == {stop(StopReason.IMU_BUS_BLOCKED)}
    assert last_state(service)["imu_bus"] == note("bus.freed", Severity.WARNING, clocks=3)


def test_a_bus_recovery_is_reported_until_the_next_drive(service, robot, lines):
    hold(robot, lines([0] * 9))
    looked_on(service, robot, 10.0)
    assert last_state(service)["imu_bus"] == note("bus.freed", Severity.WARNING, clocks=9)
    drive(service, spin(1.0))
    assert last_state(service)["imu_bus"] is None
    looked_on(service, robot, 1.0)
    assert last_state(service)["imu_bus"] is None


def test_a_bus_that_recovers_without_help_is_not_reported_as_blocked(service, robot, lines):
    pins = lines([0] * 3, is_scl_low=True)
    hold(robot, pins)
    looked_on(service, robot, 2.0)
    assert last_state(service)["imu_bus"].code == "bus.scl-held"
    pins.put(bits=[], is_scl_low=False)
    looked_on(service, robot, 1.5)
    assert service.machine.state is DoorState.READY
    assert last_state(service)["imu_bus"] is None
