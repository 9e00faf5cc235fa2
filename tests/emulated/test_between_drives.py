"""State of one drive is removed before the next drive, and messages between two drives are not lost.

On the real firmware and the real drivers in lock-step.
"""

import tracemalloc
from itertools import groupby, pairwise

import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, stop
from baqueano.door.states import DoorState
from baqueano.errors import FileError
from baqueano.messages import text
from baqueano.robot.service import service as service_module
from baqueano.robot.service.configuration import firmware_config
from baqueano.robot.service.hardware_observer import CLOSE_TIMEOUT_S
from baqueano.robot.service.service import HANG_TIMEOUT_S, PREPARE_TIMEOUT_S
from baqueano.robot.uno.frames import ResetCause, StateFlag
from baqueano.runs import RunWriter
from tests.emulated.bad_line import BadLine
from tests.emulated.drives import TEACHER, drive, during, look_around, serve, spin
from tests.memory import memory_trace


@pytest.fixture
def closing(monkeypatch):
    """Return `closing(act)`, which lets `act` run before a run is closed."""

    def begin(act):
        close = RunWriter.close
        monkeypatch.setattr(RunWriter, "close", lambda writer: (act(), close(writer))[1])

    return begin


@pytest.fixture
def preparing(monkeypatch):
    """Return `preparing(act)`, which lets `act` run before the file of a mission is loaded."""

    def begin(act):
        load = service_module.unpack
        monkeypatch.setattr(service_module, "unpack", lambda *args: (act(), load(*args))[1])

    return begin


def test_slow_closing_of_a_run_causes_no_command_timeout_fault(service, robot, closing):
    troubles = []
    closing(lambda: (robot.wait(0.5), troubles.append(robot.uno.stop_cause)))
    end, run = drive(service, spin())
    assert (end["reason"], troubles) == (None, [None])
    assert StopReason.UNO_DEAD_MAN not in [e.diagnostic.code for e in run.events if e.diagnostic is not None]
    look_around(service, robot, 5)
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)


def test_an_unwritable_run_folder_ends_the_mission_and_not_the_service(service, robot, tmp_path):
    look_around(service, robot, 3)
    service.folder = tmp_path / "a file" / "runs"
    service.folder.parent.write_text("no folder")
    service.execute_request(spin(), attended=True, name="mine")
    look_around(service, robot, 3)
    end = [message for message in service.messages if message["type"] == "done"][-1]
    assert (end["id"], end["run"], end["code"]) == ("mine", None, 3)
    assert "Type: ls -ld" in text(end["reason"])
    assert service.machine.state is DoorState.READY


def clear_after(service, robot, times):
    """Request a clear once; the service then looks at the hardware `times` times."""
    service.operator.is_clear_requested = True
    look_around(service, robot, times)


def latched(robot):
    """Return True if the Uno itself reports its latch."""
    return bool(robot.board.state().flags & StateFlag.STOPPED)


def test_clearing_the_latch_is_repeated_until_telemetry_confirms(service, robot):
    service.operator.stop(TEACHER)
    look_around(service, robot, 3)
    assert latched(robot)
    robot.write = lambda data: None
    clear_after(service, robot, 2)
    del robot.write
    assert (service.machine.state, service.machine.reason) == (DoorState.STOPPED, TEACHER)
    look_around(service, robot, 3)
    assert service.machine.state is DoorState.READY
    assert not latched(robot)


def test_a_latch_from_before_the_service_start_can_be_cleared(service, robot):
    robot.uno.stop()
    look_around(service, robot, 2)
    assert service.machine.state is DoorState.DISARMED
    assert service.machine.reason == stop(StopReason.UNO_LATCHED, "baqueano robot clear HOST")
    look_around(service, robot, 5)
    assert latched(robot), "only a person may clear the latch"
    clear_after(service, robot, 3)
    assert service.machine.state is DoorState.READY
    assert not latched(robot)


def test_an_earlier_clear_request_does_not_clear_a_later_latch(service, robot):
    clear_after(service, robot, 2)
    robot.uno.stop()
    look_around(service, robot, 5)
    assert service.machine.state is DoorState.DISARMED
    assert latched(robot)
    service.operator.stop(TEACHER)
    look_around(service, robot, 5)
    assert service.machine.state is DoorState.STOPPED
    assert latched(robot)


def test_a_reset_in_the_last_tick_of_a_drive_is_recovered(service, robot):
    holder = object()
    service.operator.set_holder(holder)

    def pair():
        robot.board.reset(ResetCause.BROWN_OUT)
        service.operator.request_end(holder)

    during(service, robot, 0.5, pair)
    drive(service, spin(3.0))
    look_around(service, robot, 10)
    assert robot.uno.statistics.resets == 1
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)


def test_a_stop_during_closing_of_the_run_is_latched(service, robot, closing):
    closing(lambda: service.operator.stop(TEACHER))
    end, run = drive(service, spin())
    assert (end["reason"], end["code"]) == (None, 0), "the drive had no fault"
    assert run.duration_s == pytest.approx(1.0, abs=0.03)
    assert (service.machine.state, service.machine.reason) == (DoorState.STOPPED, TEACHER)
    look_around(service, robot, 3)
    assert service.machine.state is DoorState.STOPPED
    clear_after(service, robot, 3)
    assert service.machine.state is DoorState.READY


def test_a_stop_during_a_failing_preparation_is_latched(service, robot, preparing):
    def fails():
        service.operator.stop(TEACHER)
        raise FileError("mine.py: broken")

    preparing(fails)
    end, _ = drive(service, spin())
    assert text(end["reason"]) == "mine.py: broken"
    assert (service.machine.state, service.machine.reason) == (DoorState.STOPPED, TEACHER)


def test_a_second_stop_does_not_replace_the_first_reason(service, robot, closing):
    during(service, robot, 0.3, lambda: robot.board.reset(ResetCause.BROWN_OUT))
    closing(lambda: service.operator.stop(TEACHER))
    end, _ = drive(service, spin(3.0))
    assert end["reason"].code == StopReason.UNO_RESET
    look_around(service, robot, 3)
    assert (service.machine.state, service.machine.reason) == (DoorState.STOPPED, end["reason"])


def test_systemd_waits_for_preparation_and_for_a_run_that_is_closed_slowly(
    service, robot, preparing, closing
):
    signs, begun_ns = [], robot.now_ns

    def sign(seconds):
        signs.append((robot.now_ns, seconds))

    service.notify_watchdog, service.set_watchdog_timeout = lambda: sign(signs[-1][1]), sign
    sign(HANG_TIMEOUT_S)
    preparing(lambda: robot.wait(1.5 * HANG_TIMEOUT_S))
    closing(lambda: robot.wait(1.5 * HANG_TIMEOUT_S))
    drive(service, spin(0.3))
    service.idle()
    sign(HANG_TIMEOUT_S)
    over = [b - a for (a, seconds), (b, _) in pairwise(signs) if (b - a) / 1e9 > seconds]
    assert over == []
    assert (robot.now_ns - begun_ns) / 1e9 > 3.0 * HANG_TIMEOUT_S
    assert [seconds for seconds, _ in groupby(seconds for _, seconds in signs)] == [
        HANG_TIMEOUT_S, PREPARE_TIMEOUT_S, HANG_TIMEOUT_S, CLOSE_TIMEOUT_S, HANG_TIMEOUT_S,
    ]  # fmt: skip


def test_a_failed_mission_restores_the_systemd_timeout(service, robot, preparing):
    waits = []
    service.set_watchdog_timeout = waits.append

    def breaks():
        raise FileError("mine.py: broken")

    preparing(breaks)
    drive(service, spin(0.3))
    assert waits == [PREPARE_TIMEOUT_S, HANG_TIMEOUT_S]


def mission_of(*settings):
    """Return a short mission whose vehicle file has these settings."""
    return spin(0.3, file=vehicle_file.override(vehicle_file.load("small"), settings))


def test_hardware_settings_of_a_mission_apply_until_its_end(service, robot):
    own, configs = firmware_config(service.hardware, robot.uno.info), []
    during(service, robot, 0.1, lambda: configs.append(robot.uno.info.config))
    drive(service, mission_of("robot.least_battery_v=7.9", "robot.dead_man_s=0.2"))
    assert [(config.least_battery_mv, config.dead_man_ms) for config in configs] == [(7900, 200)]
    look_around(service, robot, 60)
    assert robot.board.info().config == own
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)


def test_vehicle_settings_are_restored_after_the_line_reconnects(service, robot):
    line = BadLine(robot)
    during(service, robot, 0.2, lambda: setattr(line, "gone", True))
    drive(service, mission_of("robot.least_battery_v=7.9"))
    end_ns = robot.now_ns
    look_around(service, robot, 3)
    assert robot.now_ns - end_ns == pytest.approx(0.15e9), "the service must not wait for an answer"
    line.gone = False
    clear_after(service, robot, 60)
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)


def test_a_reset_at_rest_restores_the_limits_of_the_vehicle(robot, tmp_path):
    file = vehicle_file.override(vehicle_file.load("small"), ["robot.least_battery_v=6.6"])
    service = serve(robot, file, tmp_path)
    config = firmware_config(file.robot, robot.uno.info)
    assert robot.board.info().config == config
    robot.board.reset(ResetCause.BROWN_OUT)
    look_around(service, robot, 10)
    assert robot.uno.statistics.resets == 1
    assert robot.board.info().config == config
    assert service.machine.state is DoorState.READY


def test_memory_does_not_grow_at_rest(service, robot):
    service.broadcast = lambda message: None
    filters = [  # the clock estimates store windows of seconds, which are not full yet
        tracemalloc.Filter(True, f"*/baqueano/{part}.py")
        for part in ("worlds/robot", "robot/service/service", "robot/service/health", "robot/imu/watch")
    ]
    looks = 100
    with memory_trace():
        look_around(service, robot, looks)
        before = tracemalloc.take_snapshot().filter_traces(filters)
        look_around(service, robot, looks)
        after = tracemalloc.take_snapshot().filter_traces(filters)
    growth = sum(difference.size_diff for difference in after.compare_to(before, "filename"))
    assert growth / looks < 5.0, "bytes for each look, 1.7 million of which are a day"


def test_a_hardware_fault_at_rest_is_reported_once(service, robot):
    robot.chip.brown_out()
    look_around(service, robot, 60)
    codes = [m["message"].code for m in service.messages if m["type"] == "event"]
    assert codes.count("imu.lost-supply") == 1
    assert service.machine.state is DoorState.READY
