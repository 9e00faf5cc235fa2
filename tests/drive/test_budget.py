"""A block that hangs is stopped and named with its line, in a check and in a drive, and the vehicle stops."""

import bdb
import itertools
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.block_checks import check
from baqueano.blocks import read_module
from baqueano.contracts import time_limit
from baqueano.contracts.time_limit import within
from baqueano.controllers import Schedule
from baqueano.diagnostics import StopReason, stop
from baqueano.drive import drive, drive_stop_reason
from baqueano.drive.observers import Observer
from baqueano.errors import FileError
from baqueano.guides import Idle
from baqueano.loop import Blocks
from baqueano.runs import read_run
from baqueano.signals import Command
from baqueano.symbolic import function
from baqueano.worlds import SimulatedWorld
from baqueano.worlds.clock import simulated_ticks
from tests.codes import refused

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timer")


class Hangs:
    """A controller that never returns from its tenth step, and catches every exception."""

    def init(self):
        return 0

    def step(self, state, reference, estimate):
        u = np.array([0.3, 0.0, 0.0])
        while state == 10:
            try:
                time.sleep(0.001)
            except BaseException:
                continue
        return state + 1, Command(estimate.t_ns, u)


def blocks_of(file, controller, duration_s=1.0):
    return Blocks(file.estimator(), Idle(duration_s), controller, file.supervisor())


def make_world(file):
    return SimulatedWorld(file.vehicle, file.sensors, file.rate_hz)


@pytest.mark.parametrize(("live", "limit_s"), [(True, 0.1), (False, 0.3)])
def test_a_hanging_block_is_stopped_and_its_line_is_named(live, limit_s, monkeypatch):
    """Before, a drive in a simulation did not end."""
    monkeypatch.setattr("baqueano.drive.session.HANG_S", 0.3)
    file = vehicle_file.load("small")
    run = drive(
        blocks_of(file, Hangs()), file, kind="repeat", world=make_world(file),
        tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=live,
    )  # fmt: skip
    reason = drive_stop_reason(run)
    assert reason.code == StopReason.BLOCK_RAISED
    assert reason.figures["block"].startswith("controller Hangs (")
    assert "test_budget.py:" in reason.figures["block"]
    assert f"longer than {limit_s} s" in reason.figures["error"]
    assert np.all(run.applied_commands[-20:] == 0.0)


def test_a_block_check_ends_and_names_the_line_that_hangs(monkeypatch):
    """Before, the check did not end."""
    monkeypatch.setattr("baqueano.block_checks.trial.HANG_S", 0.3)
    (finding,) = [x for x in check("controller", Hangs()) if x.code == "check.raises-on-line"]
    lines = Path(__file__).read_text(encoding="utf-8").splitlines()
    loop = lines.index("        while state == 10:") + 1
    assert "longer than 0.3 s" in finding.figures["error"]
    assert loop <= finding.figures["line"] < loop + 5


def test_a_block_file_that_does_not_end_is_refused_with_its_line(tmp_path, monkeypatch):
    """Before, the file was read for a minute, as if the program had stopped."""
    monkeypatch.setattr("baqueano.blocks.HANG_S", 0.3)
    (tmp_path / "mine.py").write_text("x = 1\nwhile x:\n    x += 1\n")
    with refused("block.raised-while-read-too-long", FileError) as error_info:
        read_module("mine.py", tmp_path)
    assert error_info.value.diagnostic.figures["place"] in ("mine.py line 2", "mine.py line 3")


def test_a_block_file_that_imports_a_slow_library_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("baqueano.blocks.HANG_S", 0.1)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "slow_library.py").write_text(
        "import time\nfor _ in range(40):\n    time.sleep(0.01)\nx = 3\n"
    )
    (tmp_path / "mine.py").write_text("from slow_library import x\n")
    assert read_module("mine.py", tmp_path).x == 3


def test_a_function_that_hangs_while_it_is_traced_raises(monkeypatch):
    monkeypatch.setattr("baqueano.symbolic.graph.trace.PREPARE_S", 0.3)

    def hang(x):
        while True:
            x = 2.0 * x

    with pytest.raises(TimeoutError, match=r"0\.3 s"):
        function(hang, 1.0)(1.0)


def test_a_call_inside_does_not_end_the_limit_of_the_outer_call():
    def hang():
        assert within(0.2, lambda: 7) == 7
        while True:
            pass

    with pytest.raises(TimeoutError, match=r"0\.3 s"):
        within(0.3, hang)


def test_a_debugger_can_wait_inside_a_limited_call():
    assert within(0.1, lambda: bdb.Bdb().runcall(lambda: time.sleep(0.3))) is None


class Changes:
    """A controller that changes its input."""

    def init(self):
        return 0

    def step(self, state, reference, estimate):
        if state == 10:
            estimate.eta[0] = 3.0
        return state + 1, Command(estimate.t_ns, np.zeros(3))


def test_a_block_that_changes_its_input_is_stopped_and_the_record_is_unchanged():
    """Before, the changed estimate was recorded without a message."""
    file = vehicle_file.load("small")
    run = drive(blocks_of(file, Changes()), file, kind="repeat", duration_s=1.0)
    reason = drive_stop_reason(run)
    assert reason.code == StopReason.BLOCK_RAISED
    assert "read-only" in reason.figures["error"]
    assert np.all(np.abs(run.estimate.eta[:, 0]) < 0.1)


def test_an_external_stop_reason_is_latched_and_logged():
    file = vehicle_file.load("small")
    lift_stop = stop(StopReason.STOPPED_BY, words="the vehicle was lifted")

    class LiftWatch(Observer):
        answers = iter([None] * 20 + [lift_stop] + [None] * 1000)

        def stop_reason(self, t_ns):
            return next(self.answers)

    run = drive(
        blocks_of(file, Schedule.at_rate(np.full((100, 3), 0.2), file.rate_hz)), file, kind="experiment",
        world=make_world(file), tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=True, observers=[LiftWatch()],
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
        if frame.f_code.co_filename not in (time_limit.__file__, __file__):
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
        world=make_world(file), tick_times_ns=simulated_ticks(file.rate_hz, 1.0), live=True, path=tmp_path / "run.mcap",
    )  # fmt: skip
    assert len(run.t_ns) == 0
    assert len(read_run(tmp_path / "run.mcap").t_ns) == 100
