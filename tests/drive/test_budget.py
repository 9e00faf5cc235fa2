"""A block that hangs on a live vehicle ends by name and line, and the vehicle stops."""

import signal
import time

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.clock import simulated
from baqueano.drive import drive, stop_of
from baqueano.drive.budget import within
from baqueano.drive.scripted import Idle, Schedule
from baqueano.loop import Blocks
from baqueano.runs import read_run
from baqueano.signals import Command
from baqueano.worlds import Simulated

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timer")


class Hangs:
    """A controller that never comes back at its tenth step, and swallows what it can."""

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
    return Simulated(file.vehicle, file.sensors, file.rate_hz)


def test_a_block_that_hangs_is_stopped_and_its_line_is_named():
    file = vehicle_file.load("small")
    run = drive(
        blocks_of(file, Hangs()), file, kind="repeat", world=world_of(file),
        ticking=simulated(file.rate_hz, 1.0), live=True,
    )  # fmt: skip
    said = stop_of(run)
    assert "controller Hangs" in said
    assert "test_budget.py:" in said
    assert "longer than 100 ms" in said
    assert np.all(run.applied[-20:] == 0.0)


def test_a_reason_to_stop_from_outside_is_latched_and_in_the_run():
    file = vehicle_file.load("small")
    said = iter([""] * 20 + ["the vehicle was lifted"] + [""] * 1000)
    run = drive(
        blocks_of(file, Schedule.at_rate(np.full((100, 3), 0.2), file.rate_hz)), file, kind="experiment",
        world=world_of(file), ticking=simulated(file.rate_hz, 1.0), live=True, watch=lambda t_ns: next(said),
    )  # fmt: skip
    assert stop_of(run) == "the vehicle was lifted"
    assert np.any(run.applied[:20] != 0.0)
    assert np.all(run.applied[25:] == 0.0)


def test_the_alarm_is_given_back_and_does_not_ring_later():
    before = signal.getsignal(signal.SIGALRM)
    with within(5.0):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


def test_a_live_drive_into_a_file_does_not_read_it_back(tmp_path):
    file = vehicle_file.load("small")
    run = drive(
        blocks_of(file, Schedule.at_rate(np.full((100, 3), 0.2), file.rate_hz)), file, kind="experiment",
        world=world_of(file), ticking=simulated(file.rate_hz, 1.0), live=True, path=tmp_path / "run.mcap",
    )  # fmt: skip
    assert len(run.t_ns) == 0
    assert len(read_run(tmp_path / "run.mcap").t_ns) == 100
