"""A person drives the real firmware through the service, all on one simulated clock: the stop after the terminal
disappears.
"""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.states import DoorState
from baqueano.drive.manual.cockpit import Cockpit
from baqueano.drive.manual.key_hold import FIRST_S
from baqueano.drive.mission import Mission, pack
from baqueano.drive.session import mark_times_ns
from baqueano.runs import read_run
from tests.drive.test_cockpit import Terminal

HAND_NS = 20_000_000  # between set-points, as door/remote.py sends them


class Driver:
    """A cockpit, and the door between the cockpit and the service, on the clock of the vehicle."""

    def __init__(self, robot, service, terminal, **options):
        self.robot, self.service, self.terminal = robot, service, terminal
        self.cockpit = Cockpit(
            np.array([1.0, 0.0, 1.0]), terminal, now=self.now, sleep=lambda s: self.wait(s), **options
        )
        self.start_ns, self.sent_ns, self.script = 0, 0, []

    def now(self):
        self.terminal.t_s = self.robot.now_ns * 1e-9
        return self.terminal.t_s

    def wait(self, seconds):
        self.robot.wait(seconds)
        self.now()

    def each_tick(self):
        if self.service.machine.state is not DoorState.MANUAL:
            return
        now_ns = self.robot.now_ns
        self.start_ns = self.start_ns or now_ns
        self.now()
        while self.script and self.script[0][0] <= (now_ns - self.start_ns) * 1e-9:
            self.script.pop(0)[1]()
        if now_ns - self.sent_ns >= HAND_NS:
            self.sent_ns = now_ns
            try:
                self.service.operator.set_command(self, self.cockpit())
            except KeyboardInterrupt:
                self.service.operator.request_end(self)
            for word in self.cockpit.pop_messages():
                if word["type"] == "mark":
                    self.service.operator.record_mark(self)
                else:
                    self.service.operator.stop(word["reason"])

    def drives(self, *script):
        """Return the run of a drive in which these actions happen at their times [s]."""
        self.script = sorted(script, key=lambda step: step[0])
        self.service.operator.set_holder(self)
        self.service.notify_watchdog = self.each_tick
        with self.cockpit:
            self.service.execute_request(pack(Mission("teach"), vehicle_file.load("small")), attended=True)
        end = [m for m in self.service.messages if m["type"] == "done"][-1]
        return end, read_run(self.service.folder / end["run"])


@pytest.fixture
def driver(robot, service):
    return lambda terminal, **options: Driver(robot, service, terminal, **options)


def stop_after(person, terminal, phase_ms, latched=False, **change):
    """Return the reason of the stop of a drive whose terminal changes in this phase, and how much later it is [ms]."""
    changes_ns = []

    def leave():
        vars(terminal).update(change)
        changes_ns.append(person.robot.now_ns)

    keys = ["d"] * 12 if latched else ["d"]
    end, run = person.drives((0.2, lambda: terminal.type(*keys)), (1.0 + 1e-3 * phase_ms, leave))
    assert person.service.machine.state is DoorState.STOPPED
    assert not person.robot.board.moving
    moving = person.start_ns + run.t_ns[np.abs(run.applied_commands[:, 2]) > 0.0][-1] - run.t_ns[0]
    return end["reason"].code, (moving - changes_ns[0]) * 1e-6


@pytest.mark.parametrize(("latched", "phase_ms"), [(False, 0), (False, 47), (False, 98), (True, 23)])
def test_rt13_motors_are_off_half_a_second_after_the_terminal_disappears(driver, latched, phase_ms):
    terminal = Terminal(kitty=not latched, trip_s=0.03)
    person = driver(terminal, latched=latched)
    reason, after_ms = stop_after(person, terminal, phase_ms, latched, there=False)
    assert reason == StopReason.TERMINAL_SILENT
    assert 200.0 < after_ms < 500.0


@pytest.mark.parametrize("phase_ms", [0, 9, 17])
def test_motors_are_off_at_once_after_the_terminal_closes(driver, phase_ms):
    terminal = Terminal(kitty=True)
    reason, after_ms = stop_after(driver(terminal), terminal, phase_ms, ended=True)
    assert reason == StopReason.TERMINAL_CLOSED
    assert after_ms < 100.0


def test_a_key_at_a_silent_terminal_drives_for_a_limited_time(driver):
    terminal = Terminal(answers=False)
    person = driver(terminal)
    end, run = person.drives((0.3, lambda: terminal.type("w")), (3.0, lambda: terminal.type("q")))
    assert end["reason"].code == StopReason.INTERRUPTED
    times = run.t_s[np.abs(run.applied_commands[:, 0]) > 0.0]
    assert times[0] == pytest.approx(0.3, abs=0.08)
    assert times[-1] - times[0] == pytest.approx(FIRST_S, abs=0.12)
    assert np.max(run.applied_commands[:, 0]) == pytest.approx(0.15, abs=0.002)


def test_releasing_a_key_stops_the_motors_and_marks_are_logged(driver):
    terminal = Terminal(kitty=True)
    person = driver(terminal)
    end, run = person.drives(
        (0.3, lambda: terminal.type("a")), (0.9, lambda: terminal.type("a", kind="release")),
        (1.5, lambda: terminal.type("m")), (2.0, lambda: terminal.type("q")),
    )  # fmt: skip
    assert end["reason"].code == StopReason.INTERRUPTED
    assert person.service.machine.state is DoorState.READY
    (mark_ns,) = mark_times_ns(run)
    assert (mark_ns - run.t_ns[0]) * 1e-9 == pytest.approx(1.5, abs=0.06)
    moving = run.t_s[np.abs(run.applied_commands[:, 2]) > 0.0]
    assert moving[0] == pytest.approx(0.3, abs=0.08)
    assert moving[-1] == pytest.approx(0.9, abs=0.12)
    states = [m for m in person.service.messages if m["type"] == "state" and m.get("u")]
    assert max(m["yaw_rate_rad_s"] for m in states) > 0.5


def test_the_space_bar_latches_the_stop_of_the_vehicle(driver):
    terminal = Terminal(kitty=True)
    person = driver(terminal)
    end, _ = person.drives((0.2, lambda: terminal.type("a")), (0.8, lambda: terminal.type(" ")))
    assert end["reason"].code == StopReason.DRIVER
    assert person.service.machine.state is DoorState.STOPPED
    assert not person.robot.board.moving


def test_heading_control_acts_on_straight_driving_but_not_in_turns(driver):
    terminal = Terminal(kitty=True)
    person = driver(terminal, hold=True, command_share=0.8)
    end, run = person.drives(
        (0.2, lambda: terminal.type("w")), (2.5, lambda: terminal.type("a")),
        (3.5, lambda: terminal.type("q")),
    )  # fmt: skip
    assert end["reason"].code == StopReason.INTERRUPTED
    straight, turning = (run.requested_commands[(run.t_s > t) & (run.t_s < t + 0.7)] for t in (1.0, 2.7))
    assert np.all(straight[:, 2] != 0.0)
    assert np.max(np.abs(straight[:, 2])) < 0.25
    assert np.all(turning[:, 2] == 0.8)
    moving = [m for m in person.service.messages if m["type"] == "state" and m.get("requested", (0.0,))[0]]
    person.cockpit.status.driver_command = np.array([0.8, 0.0, 0.0])
    person.cockpit.show(moving[3])
    assert person.cockpit.status.hold_command == moving[3]["requested"][2] != 0.0
