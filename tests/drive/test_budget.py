"""A block that hangs on a live vehicle is stopped and named with its line, and the vehicle stops."""

import itertools
import signal
import sys
import time

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.controllers import Schedule
from baqueano.diagnostics import StopReason, stop
from baqueano.drive import budget, drive, drive_stop_reason
from baqueano.drive.budget import within
from baqueano.drive.observers import Observer
from baqueano.guides import Idle
from baqueano.loop import Blocks
from baqueano.runs import read_run
from baqueano.signals import Command
from baqueano.worlds import SimulatedWorld
from baqueano.worlds.clock import simulated_ticks

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timer")


class Hangs:
    """A controller that never returns from its tenth step, and catches every exception that it can."""

    def init(self):
        return 0

    def step(self, state, reference, estimate):
        u = np.array([0.3, 0.0, 0.0])
        while state == 10:
            try:
                time.sleep(0.001)
            except Exception:
                continue
        return state + 1, Command(estimate.t_ns, u)


def blocks_of(file, controller, duration_s=1.0):
    return Blocks(file.estimator(), Idle(duration_s), controller, file.supervisor())


def world_of(file):
    return SimulatedWorld(file.vehicle, file.sensors, file.rate_hz)


def test_a_hanging_block_is_stopped_and_its_line_is_named():
    file = vehicle_file.load("small")
    run = drive(
        blocks_of(file, Hangs()), file, kind="repeat", world=world_of(file),
        tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=True,
    )  # fmt: skip
    reason = drive_stop_reason(run)
    assert reason.code == StopReason.BLOCK_RAISED
    assert reason.figures["block"].startswith("controller Hangs (")
    assert "test_budget.py:" in reason.figures["block"]
    assert "longer than 100 ms" in reason.figures["error"]
    assert np.all(run.applied_commands[-20:] == 0.0)


def test_an_external_stop_reason_is_latched_and_logged():
    file = vehicle_file.load("small")
    lift_stop = stop(StopReason.STOPPED_BY, words="the vehicle was lifted")

    class LiftWatch(Observer):
        answers = iter([None] * 20 + [lift_stop] + [None] * 1000)

        def stop_reason(self, t_ns):
            return next(self.answers)

    run = drive(
        blocks_of(file, Schedule.at_rate(np.full((100, 3), 0.2), file.rate_hz)), file, kind="experiment",
        world=world_of(file), tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=True, observers=[LiftWatch()],
    )  # fmt: skip
    assert drive_stop_reason(run) == lift_stop
    assert np.any(run.applied_commands[:20] != 0.0)
    assert np.all(run.applied_commands[25:] == 0.0)


def test_the_alarm_handler_is_restored_and_no_alarm_remains():
    before = signal.getsignal(signal.SIGALRM)
    left_s, _ = within(5.0, signal.getitimer, signal.ITIMER_REAL)
    assert left_s > 0.0
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


class AlarmAtInstruction:
    """Raise the alarm at instruction number `at` of `within` and of the functions that it calls, while the alarm is
    set."""

    def __init__(self, tick):
        self.left = tick

    def __call__(self, frame, event, arg):
        if frame.f_code.co_filename not in (budget.__file__, __file__):
            return None
        frame.f_trace_opcodes = True
        if event == "opcode" and signal.getitimer(signal.ITIMER_REAL)[0] > 0.0:
            self.left -= 1
            if self.left == 0:
                signal.raise_signal(signal.SIGALRM)
        return self


def test_an_alarm_at_any_instruction_raises_a_timeout_or_has_no_effect():
    """The alarm may also arrive after the end of the block, before its time budget is removed."""
    before, tracing, ends = signal.getsignal(signal.SIGALRM), sys.gettrace(), []
    # Python 3.12 reports instructions only if requested before `settrace`
    sys._getframe().f_trace_opcodes = True
    for tick in itertools.count(1):
        alarm = AlarmAtInstruction(tick)
        sys.settrace(alarm)
        try:
            ends.append(within(5.0, lambda: 7))
        except TimeoutError:
            ends.append(None)
        finally:
            sys.settrace(tracing)
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
        assert signal.getsignal(signal.SIGALRM) is before
        if alarm.left > 0:
            break
    index = ends.index(7)
    assert ends == [None] * index + [7] * (len(ends) - index)
    assert index > 2
    assert len(ends) - index > 2, "alarms arrived after the end of the block"


def test_a_live_drive_does_not_read_its_run_file(tmp_path):
    file = vehicle_file.load("small")
    run = drive(
        blocks_of(file, Schedule.at_rate(np.full((100, 3), 0.2), file.rate_hz)), file, kind="experiment",
        world=world_of(file), tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=True, path=tmp_path / "run.mcap",
    )  # fmt: skip
    assert len(run.t_ns) == 0
    assert len(read_run(tmp_path / "run.mcap").t_ns) == 100
