"""Every fault during a mission: the drive stops safely or continues, and its run contains the result.

On the real firmware and the real drivers in lock-step; figures are in the time of the vehicle.
"""

import errno
import threading
import time

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.states import DoorState
from baqueano.drive import drive_stop_reason, run_route
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import HARDWARE_SOURCE, IMU_SOURCE, LINE_SOURCE, UNO_SOURCE
from baqueano.guides import shapes
from baqueano.robot.uno.frames import ResetCause
from baqueano.runs import read_run
from baqueano.runs.container.writer import SYNC_PERIOD_S
from tests.emulated.bad_line import BadLine
from tests.emulated.drives import TEACHER, drive, during, look_around, serve, spin

CIRCLE = shapes.circle(0.4, 0.25)  # 10 s


@pytest.fixture
def vehicle(new_robot, tmp_path):
    """Return `vehicle(settings, …)`, which starts a service on a robot; the options are those of EmulatedRobot."""

    def make(*settings, **options):
        file = vehicle_file.override(vehicle_file.load("small"), settings)
        robot = new_robot(file, **options)
        return robot, serve(robot, file, tmp_path)

    return make


def last(run, source):
    """Return the only event of this source in the run."""
    (event,) = [e for e in run.events if e.source == source]
    return event


def counts_of(run):
    """Return the counts of the line: sent, unsent, received, lost, out of order, damaged, resets."""
    return [n for n in last(run, LINE_SOURCE).diagnostic.figures.values() if isinstance(n, int)]


def position_rms(run):
    """Return the RMS distance [m] between the estimated position and the reference."""
    gap = run.estimate.eta[:, :2] - run.reference.eta[:, :2]
    return np.sqrt(np.mean(np.sum(gap**2, axis=1)))


def end(robot, run):
    """Return the true distance [m] from the intended end."""
    return np.hypot(*(robot.motion.eta[:2] - run.reference.eta[-1, :2]))


def clear_stop(service, robot):
    """Clear the stop, as an operator does after an inspection of the vehicle."""
    assert service.machine.state is DoorState.STOPPED
    look_around(service, robot, 5)
    assert service.machine.state is DoorState.STOPPED, "the stop is latched"
    service.operator.is_clear_requested = True
    look_around(service, robot, 20)
    return service.machine.state is DoorState.READY


@pytest.mark.parametrize("reset", [True, False], ids=["as USB does", "as other lines do"])
def test_a_disconnected_cable_stops_the_drive_and_driving_resumes_afterwards(robot, service, reset):
    line, cut = BadLine(robot), []

    def pull():
        line.gone = True
        cut.append(robot.board.t_s)

    during(service, robot, 1.0, pull)
    end, run = drive(service, spin(3.0))
    assert end["reason"].code == StopReason.UNO_SILENT
    assert drive_stop_reason(run) == end["reason"]
    assert 0.25 < robot.board.off_since() - cut[0] <= 0.320
    assert run.notes == ()
    assert run.duration_s == pytest.approx(2.1, abs=0.05), "a second of it after the stop"
    assert last(run, LINE_SOURCE).level == "warning"
    assert counts_of(run)[1] > 100, "some commands could not be sent"
    robot.wait(5.0)
    line.gone = False
    if reset:
        robot.board.reset(ResetCause.EXTERNAL)
    robot.uno.on_reopen()  # as the listening thread calls it
    assert clear_stop(service, robot)
    end, run = drive(service, spin(0.5))
    assert end["reason"] is None
    assert counts_of(run)[1] == 0


@pytest.mark.parametrize(
    ("noise", "twice", "pins_swapped"), [(0.05, 0.0, 0.0), (0.0, 0.1, 0.1)], ids=["noise", "order"]
)
def test_a_circle_is_repeated_over_a_faulty_serial_line(robot, service, noise, twice, pins_swapped):
    line = BadLine(robot, seed=3)

    def begins():
        line.noise, line.twice, line.swapped = noise, twice, pins_swapped

    during(service, robot, 0.1, begins)
    done, run = drive(service, pack(Mission("repeat", route=CIRCLE), vehicle_file.load("small")))
    assert done["reason"] is None
    assert position_rms(run) < 0.1
    assert end(robot, run) < (0.2 if noise else 0.1), "where it really is; 0.04 m over a line that is well"
    _, unsent, count_received, count_lost, late_count, count_damaged, resets = counts_of(run)
    assert (unsent, resets) == (0, 0)
    assert last(run, LINE_SOURCE).level == "warning"
    if noise:
        # 46 bytes are whole with 0.95⁴⁶ = 9 %
        assert count_lost / (count_received + count_lost) == pytest.approx(0.9, abs=0.03)
        assert count_damaged > 800
    else:
        assert late_count / count_received == pytest.approx(0.18, abs=0.04)
        assert count_lost / count_received == pytest.approx(0.09, abs=0.03), (
            "one of each swapped pair was not there in its turn"
        )
        assert count_damaged == 0


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_run_ends_with_the_frame_counts_of_the_uno(robot, service, noise):
    """The host cannot detect frames that are damaged on the way to the Uno."""
    line, before = BadLine(robot, seed=2), robot.board.info()
    line.noise = noise
    end, run = drive(service, spin(5.0))
    assert end["reason"] is None
    event = last(run, UNO_SOURCE)
    n = event.diagnostic.figures
    count_sent = n["received_frames"]
    count_damaged = n["damaged_frames"]
    count_ignored = n["ignored_frames"]
    count_lost = n["lost_bytes"]
    assert count_sent > 500
    assert 0 <= robot.board.info().bad_crc - before.bad_crc - count_damaged <= 1
    assert count_damaged / count_sent == pytest.approx(16 * noise, abs=0.6 * 16 * noise)
    assert (count_ignored, count_lost) == (0, 0)
    assert event.level == ("warning" if noise else "info")
    assert event.diagnostic in [m["message"] for m in service.messages if m["type"] == "event"], (
        "every client receives it"
    )


def test_a_mission_with_a_lost_arming_frame_drives_normally(robot, service):
    arm, write = service.uno.arm, robot.write

    def lose_arming():
        robot.write = lambda data: None
        arm()
        robot.write = write

    service.uno.arm = lose_arming
    end, run = drive(service, spin())
    assert end["reason"] is None
    assert run.applied_commands[-1, 2] == pytest.approx(0.6, abs=0.002)
    count_ignored = last(run, UNO_SOURCE).diagnostic.figures["ignored_frames"]
    assert 1 <= count_ignored <= 4, "the run counts the commands that arrived before arming"


def test_a_mission_that_the_uno_never_receives_fails(robot, service):
    arm = service.uno.arm

    def deaf():
        robot.board.forget_outputs()
        robot.write = lambda data: None
        arm()

    service.uno.arm = deaf
    end, run = drive(service, spin())
    assert end["reason"].code == StopReason.UNO_DEAF
    assert drive_stop_reason(run) == end["reason"]
    assert robot.board.first_time(lambda out: any(out.pwm)) is None


@pytest.mark.parametrize("line_harmed", [False, True])
def test_a_run_ends_with_the_fault_counts_of_the_imu(robot, service, line_harmed):
    """Saturation of an axis for less than a tenth of a second is not a separate event."""

    def brief():
        robot.bus.fail(errno.EREMOTEIO, 1)
        robot.chip.saturate(2)

    if line_harmed:
        during(service, robot, 0.95, brief)
    end, run = drive(service, spin(1.0))
    assert end["reason"] is None
    assert [e.text for e in run.events if e.source == HARDWARE_SOURCE] == []
    event = last(run, IMU_SOURCE)
    counts = dict(event.diagnostic.figures)
    assert counts.pop("samples") == pytest.approx(200, abs=5)
    harm = {"full_scale_samples": pytest.approx(10, abs=3), "retries": 1} if line_harmed else {}
    assert counts == dict.fromkeys(counts, 0) | harm
    assert event.level == ("warning" if line_harmed else "info")


ACCIDENTS = {  # fault, motors off within [s], reason in the run
    "a brown-out": (lambda board: board.reset(ResetCause.BROWN_OUT), 0.003, "brown-out"),
    "its reset button": (lambda board: board.reset(ResetCause.EXTERNAL), 0.003, "external"),
    "its supply gone": (lambda board: board.power_cycle(3), 0.003, "power"),
    "a hang": (lambda board: board.hang(), 0.150, "watchdog hung"),
}


@pytest.mark.parametrize("accident", ACCIDENTS)
def test_fw7_a_restarted_uno_stops_the_drive_and_can_be_cleared(robot, service, accident):
    act, within_s, beginning = ACCIDENTS[accident]
    at_s = []
    during(service, robot, 0.5, lambda: (at_s.append(robot.board.t_s), act(robot.board)))
    end, run = drive(service, spin(3.0))
    assert end["reason"].code in (StopReason.UNO_RESET, StopReason.UNO_SILENT)
    assert drive_stop_reason(run) == end["reason"]
    assert run.duration_s < 1.7
    assert robot.board.off_since() - at_s[0] <= within_s
    figures = last(run, LINE_SOURCE).diagnostic.figures
    assert (figures["resets"], figures["cause"].code) == (1, StopReason.UNO_RESET)
    assert figures["cause"].figures["cause"].startswith(beginning)
    assert clear_stop(service, robot)


def test_a_short_battery_sag_at_motor_start_does_not_stop_the_drive(vehicle):
    robot, service = vehicle("robot.least_battery_v=6.6")
    service.notify_watchdog = lambda: robot.board.set_battery(
        7.4 - abs(robot.board.duty(0)) - abs(robot.board.duty(1))
    )
    pushes = np.tile(np.repeat([[0.0, 0.0, 0.6], [0.0, 0.0, 0.0]], [120, 40], axis=0), (2, 1))
    end, run = drive(service, pack(Mission("experiment", u=pushes), vehicle_file.load("small")))
    assert end["reason"] is None
    battery = run.sensors["battery"].z[:, 0]
    assert np.min(battery) == pytest.approx(6.2, abs=0.05), "the run contains the event"
    assert np.max(battery) == pytest.approx(7.4, abs=0.05)


def test_fw8_a_battery_that_stays_low_stops_the_drive_after_two_seconds(robot, service):
    low = pack(spin(5.0), vehicle_file.override(vehicle_file.load("small"), ["robot.least_battery_v=6.6"]))
    at_s = []
    during(service, robot, 0.5, lambda: (at_s.append(robot.board.t_s), robot.board.set_battery(6.2)))
    end, run = drive(service, low)
    assert end["reason"].code in (StopReason.UNO_BATTERY, StopReason.BATTERY)
    assert drive_stop_reason(run) == end["reason"]
    assert 1.9 <= robot.board.off_since() - at_s[0] <= 2.2
    assert run.sensors["battery"].z[-1, 0] == pytest.approx(6.2, abs=0.05)


@pytest.mark.parametrize("accident", ["its supply", "single transfers"])
def test_rt6_an_imu_gap_below_half_a_second_stops_no_drive(robot, service, accident):

    def brief():
        if accident == "its supply":
            robot.chip.brown_out()
        else:
            robot.bus.fail(errno.EREMOTEIO, 5)

    during(service, robot, 0.5, brief)
    end, run = drive(service, spin(1.5))
    assert end["reason"] is None
    gap_s = np.max(np.diff(run.sensors["imu"].t_ns)) / 1e9
    assert gap_s < 0.5
    codes = {e.diagnostic.code for e in run.events if e.source == HARDWARE_SOURCE}
    assert ("imu.lost-supply" in codes) == (accident == "its supply")


def test_a_clone_imu_with_a_slow_clock_teaches_and_repeats_a_route(vehicle):
    file = vehicle_file.load("small")
    robot, service = vehicle(chip={"who_am_i": 0x98, "clock_ppm": -40_000})
    last, lesson = drive(service, pack(Mission("teach", route=CIRCLE), file))
    assert last["reason"] is None
    assert "IMU: ICM-20689 (WHO_AM_I 0x98)" in [e.text for e in lesson.events]
    robot.put_back()
    last, run = drive(service, pack(Mission("repeat", route=run_route(lesson, closed=True)), file))
    assert last["reason"] is None
    assert position_rms(run) < 0.1
    assert end(robot, run) < 0.1


@pytest.mark.parametrize("with_stop", [False, True], ids=["goes on", "is stopped"])
def test_rt16_a_full_disk_ends_the_log_and_not_the_drive(robot, service, with_stop):
    """The disk is one of RLIMIT_FSIZE: the system itself refuses to write more."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    motions = []

    def fills_up():
        time.sleep(2.0 * SYNC_PERIOD_S)  # the drive until now is on the disk
        (file,) = service.folder.glob("*.mcap*")
        resource.setrlimit(resource.RLIMIT_FSIZE, (file.stat().st_size + 1000, hard))
        during(service, robot, 2.5, fill)

    def fill():
        for thread in threading.enumerate():
            if thread.name == "run writer":
                thread.join(30.0)  # the simulated vehicle is faster than the disk here
        motions.append(robot.board.moving)
        if with_stop:
            service.operator.stop(TEACHER)

    during(service, robot, 2.0, fills_up)
    try:
        service.execute_request(spin(7.0), attended=False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    end = service.messages[-1]
    assert (end["code"], end["reason"]) == (0, TEACHER if with_stop else None)
    assert service.machine.state is (DoorState.STOPPED if with_stop else DoorState.READY)
    first, *_, last = [m["message"] for m in service.messages if m["type"] == "event"]
    assert (first.code, first.figures) == ("drive.disk-full", {"error": "File too large"})
    assert last.code == "runs.disk-full"
    assert motions == [True], "the drive continued while the log was closed"
    run = read_run(service.folder / end["run"])
    assert 1.5 < run.duration_s < 5.5
    assert run.notes[0].code == "run.not-closed"
