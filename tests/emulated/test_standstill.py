"""The computer freezes during a drive and the vehicle does not: afterwards the vehicle does not continue without a
driver.

Process, line and listening thread are frozen together; the firmware continues. Times are those of the vehicle.
"""

import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.states import DoorState
from baqueano.drive import drive_stop_reason
from tests.emulated.drives import drive, look_around, serve, spin

BUFFER = 4095  # bytes that the kernel stores of an unread line
PHASES = ("before read", "after read", "before write", "between write and log", "after log")
LONG_FREEZES = [  # phase, seconds and kept telemetry: each pair of two of these values
    (phase, seconds, BUFFER * ((k + j) % 2))
    for k, phase in enumerate((*PHASES, "in a block"))
    for j, seconds in enumerate((0.35, 5.0))  # 0.8 s: below
]


class Freeze:
    """Stop the host once, at a phase of the tick that is `after_s` into the drive."""

    def __init__(self, robot, service, phase, seconds, after_s=0.5, keeps=BUFFER):
        self.robot, self.seconds, self.after_s, self.keeps = robot, seconds, after_s, keeps
        self.begun_s = self.woken_s = self.armed_s = None
        self.arm, self.read, self.pump = robot.uno.arm, robot.read, robot.uno.pump
        robot.uno.arm = self.armed
        robot.read = self.kept
        self.late = b""
        place, name = {
            "before read": (robot.uno, "receive"),
            "after read": (robot.imu, "events"),
            "before write": (robot.uno, "drive"),
            "between write and log": (service.operator, "pop_mark_count"),
            "after log": (service, "notify_watchdog"),
            "in a block": (service.health, "stop_reason"),
        }[phase]
        call = getattr(place, name)

        def frozen_input(*inputs):
            self.maybe()
            return call(*inputs)

        setattr(place, name, frozen_input)

    def armed(self):
        self.armed_s = self.robot.board.t_s
        self.arm()

    def kept(self):
        data, self.late = self.late + self.read(), b""
        return data

    def maybe(self):
        robot = self.robot
        if self.armed_s is None or self.begun_s is not None or robot.board.t_s - self.armed_s < self.after_s:
            return
        self.begun_s = robot.board.t_s
        robot.uno.pump = lambda: None  # the listening thread is frozen too
        robot.wait(self.seconds)
        self.late, robot.uno.pump = self.read()[: self.keeps], self.pump
        self.woken_s = robot.board.t_s
        robot.board.forget_outputs()


def frozen_drive(robot, folder, phase, seconds, **options):
    service = serve(robot, vehicle_file.load("small"), folder)
    freeze = Freeze(robot, service, phase, seconds, **options)
    end, run = drive(service, spin(2.5))
    return service, freeze, end, run


@pytest.mark.parametrize(("phase", "seconds", "keeps"), LONG_FREEZES)
def test_rt2_a_freeze_longer_than_the_command_timeout_ends_the_drive(robot, tmp_path, phase, seconds, keeps):
    service, _, end, run = frozen_drive(robot, tmp_path, phase, seconds, keeps=keeps)
    assert robot.board.first_time(lambda out: any(out.pwm)) is None, "no motor has moved since it woke"
    assert end["reason"].code == StopReason.STANDSTILL
    assert end["reason"].figures["dead_man_s"] == 0.3
    assert drive_stop_reason(run) == end["reason"]
    assert end["reason"].figures["silent_s"] == pytest.approx(seconds, abs=0.02)
    assert service.machine.state is DoorState.STOPPED
    look_around(service, robot, 5)
    assert service.machine.state is DoorState.STOPPED, "the stop is latched"
    service.operator.is_clear_requested = True
    look_around(service, robot, 20)
    end, _ = drive(service, spin(0.5))
    assert end["reason"] is None, "after an inspection the vehicle drives again"


@pytest.mark.parametrize("phase", ["after read", "in a block"])
def test_a_freeze_in_the_first_tick_stops_the_drive_before_motion(robot, tmp_path, phase):
    _, _, end, _ = frozen_drive(robot, tmp_path, phase, 0.8, after_s=0.0)
    assert end["reason"].code == StopReason.STANDSTILL
    assert robot.board.first_time(lambda out: any(out.pwm)) is None


@pytest.mark.parametrize("phase", PHASES)
def test_a_short_freeze_does_not_stop_the_drive(robot, tmp_path, phase):
    service, _, end, _ = frozen_drive(robot, tmp_path, phase, 0.2)
    assert end["reason"] is None
    assert service.machine.state is DoorState.READY
    assert robot.board.first_time(lambda out: any(out.pwm)) is not None


def test_a_freeze_during_a_write_moves_motors_for_one_tick_at_most(robot, tmp_path):
    """The command is computed but not yet sent; only this command is still sent."""
    service = serve(robot, vehicle_file.load("small"), tmp_path)
    freeze = Freeze(robot, service, "after log", 0.8)
    service.notify_watchdog = lambda: None
    write = robot.write

    def slow(data):
        freeze.maybe()
        write(data)

    robot.write = slow
    end, _ = drive(service, spin(2.5))
    assert end["reason"].code == StopReason.STANDSTILL
    assert robot.board.off_since() - freeze.woken_s <= 0.02
