"""The onboard service on the real firmware and the real drivers: it drives, and it stops for every stop reason."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import LINE_SOURCE, UNO_SOURCE
from tests.emulated.drives import TEACHER, drive, during, spin


def test_a_mission_writes_a_run_with_the_applied_duty(service, robot):
    assert service.machine.state is DoorState.READY
    end, run = drive(service, spin())
    assert end["reason"] is None
    assert service.machine.state is DoorState.READY
    assert run.duration_s == pytest.approx(1.0, abs=0.03)
    assert run.applied_commands[-1, 2] == pytest.approx(0.6, abs=0.002)
    assert abs(robot.motion.eta[2]) > 1.0
    assert run.sensors["battery"].z[-1, 0] == pytest.approx(7.4, abs=0.05)
    robot.wait(0.1)
    assert not robot.board.moving


def test_rt15_a_stop_by_anyone_is_latched_until_cleared(service, robot):
    during(service, robot, 0.5, lambda: service.operator.stop(TEACHER))
    end, run = drive(service, spin(3.0))
    assert end["reason"] == TEACHER
    assert service.machine.state is DoorState.STOPPED
    assert run.duration_s < 1.7
    second, _ = drive(service, spin())
    assert second["reason"].figures["cause"] == TEACHER
    assert second["run"] is None
    service.operator.is_clear_requested = True
    for _ in range(3):
        service.idle()
        robot.wait(0.05)
    assert service.machine.state is DoorState.READY
    assert drive(service, spin())[0]["reason"] is None


def test_rt15_a_stop_that_latches_the_uno_at_once_is_reported_as_the_stop_and_not_as_a_fault(service, robot):
    during(service, robot, 0.5, lambda: (robot.uno.stop(), service.operator.stop(TEACHER), robot.wait(0.03)))
    end, run = drive(service, spin(3.0))
    assert end["reason"] == TEACHER
    assert {event.level for event in run.events if event.source in (LINE_SOURCE, UNO_SOURCE)} == {"info"}
    assert service.machine.reason == TEACHER


def test_rt13_a_silent_driver_stops_the_vehicle_within_half_a_second(service, robot):
    holder = object()
    stops_ns = []
    service.operator.set_holder(holder)

    def healthy():
        if service.machine.state is DoorState.MISSION:
            stops_ns.append(robot.now_ns)
            if robot.now_ns - stops_ns[0] < 0.5e9:
                service.operator.record_heartbeat(holder)
                stops_ns[-1:] = [robot.now_ns]

    service.notify_watchdog = healthy
    end, run = drive(service, spin(3.0), attended=True)
    assert end["reason"].code == StopReason.HOLDER_SILENT
    moving = np.flatnonzero(np.abs(run.applied_commands[:, 2]) > 0.0)
    assert run.t_ns[moving[-1]] / 1e9 < 1.0


def test_a_tilt_ends_the_drive(service, robot):
    robot.chip.motion = lambda t_ns: ((8.0, 0.0, 4.0), (0.0, 0.0, 0.0))
    robot.wait(0.1)
    end, _ = drive(service, spin(3.0))
    assert end["reason"].code == StopReason.TILT


def test_rt6_a_silent_imu_ends_the_drive_and_is_logged(service, robot):
    during(service, robot, 0.3, lambda: setattr(robot.chip, "is_frozen", True))
    end, run = drive(service, spin(3.0))
    assert end["reason"].code == StopReason.SENSOR_SILENT
    assert not robot.board.moving
    assert any(e.source == "hardware" for e in run.events)


def test_manual_commands_drive_only_while_they_are_fresh(service, robot):
    holder = object()
    service.operator.set_holder(holder)
    starts_ns = []

    def healthy():
        if service.machine.state is DoorState.MANUAL:
            starts_ns.append(robot.now_ns)
            if robot.now_ns - starts_ns[0] < 0.6e9:
                service.operator.set_command(holder, [0.0, 0.0, 0.5])
            service.operator.record_heartbeat(holder)
            if robot.now_ns - starts_ns[0] > 1.5e9:
                service.operator.request_end(holder)

    service.notify_watchdog = healthy
    end, run = drive(service, pack(Mission("teach"), vehicle_file.load("small")), attended=True)
    assert end["reason"].code == StopReason.INTERRUPTED
    assert service.machine.state is DoorState.READY
    moving = run.t_ns[np.abs(run.applied_commands[:, 2]) > 0.01] / 1e9
    assert moving[0] < 0.2
    assert 0.9 < moving[-1] < 1.15
