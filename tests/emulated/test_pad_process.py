"""Whole processes that look for a game pad in /dev/input and drive by it, with emulated devices behind umockdev.

Nothing in the client is replaced: its open, ioctl and read calls go to libumockdev-preload, which answers instead of
the kernel. The tests run in real time, so none of them checks a duration.
"""

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive.session import drive_stop_reason, mark_times_ns
from baqueano.runs import read_run
from tests.emulated.test_imu_process import _installed, lacking  # noqa: F401
from tests.emulated.umockdev import Machine

DEVICES = ("keyboard", "touchpad", "pad")
FRONT, SOUTH = 0x136, 0x130
AHEAD, MIDDLE, PRESS, RELEASE = [3, 1, -32768], [3, 1, 0], [1, FRONT, 1], [1, FRONT, 0]
ASK = "from baqueano.drive.manual.pad import find_pad; print(find_pad().name)"


@pytest.fixture
def machine(until_end):
    """Return `machine(…)`, which makes a machine with these devices of evdev."""
    return lambda *names: until_end(Machine("pad_umockdev.py", names))


@pytest.fixture
def drive(tmp_path, monkeypatch, until_end):
    """Return a function that begins a drive with the pad of a machine."""
    from tests.cli.test_driving import Terminal

    def begin(machine, run):
        with monkeypatch.context() as patch:
            for name, value in machine.environment.items():
                patch.setenv(name, value)
            return until_end(Terminal(tmp_path, "drive", "--vehicle", "small", "--pad", "-o", run))

    return begin


def test_a_process_selects_the_pad_by_real_system_calls(machine):
    assert machine("keyboard", "touchpad", "bare_pad").python("-c", ASK).stdout == "Bare pad\n"
    errors = machine("keyboard", "touchpad").python("-c", ASK).stderr
    assert 'event0 "AT keyboard" (no stick), event1 "Touchpad" (no front buttons)' in errors


def test_a_pad_drives_marks_and_stops_the_vehicle_when_it_is_unplugged(machine, drive, tmp_path):
    vehicle = machine(*DEVICES)
    screen = drive(vehicle, "run.mcap")
    screen.until(rb"hold a front button to drive")
    vehicle.order("change", 2, AHEAD, PRESS)
    screen.until(rb"speed +0\.[1-9]")
    vehicle.order("change", 2, [1, SOUTH, 1])
    screen.until(rb"marks 1")
    vehicle.order("unplug", 2)
    assert screen.ends() == 5
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.PAD_UNPLUGGED
    assert len(mark_times_ns(run)) == 1
    assert np.max(run.applied_commands[:, 0]) == pytest.approx(0.5)
    assert run.applied_commands[-1, 0] == 0.0

    vehicle.order("plug", 3, "pad")
    vehicle.order("change", 3, AHEAD, PRESS)
    screen = drive(vehicle, "again.mcap")
    screen.until(rb"(?s)(?:release its stick.*?){6}")  # without the wait, the second press would drive
    assert b"pad drives" not in screen.output
    vehicle.order("change", 3, MIDDLE, RELEASE)
    screen.until(rb"hold a front button to drive")
    vehicle.order("change", 3, AHEAD, PRESS)
    screen.until(rb"speed +0\.[1-9]")
    vehicle.order("change", 3, MIDDLE, RELEASE)
    screen.type(b"\x1b[113u")
    assert screen.ends() == 0
    assert np.max(read_run(tmp_path / "again.mcap").applied_commands[:, 0]) == pytest.approx(0.5)


def test_the_pad_state_is_correct_after_dropped_kernel_events(machine, drive, tmp_path):
    vehicle = machine(*DEVICES)
    screen = drive(vehicle, "run.mcap")
    screen.until(rb"hold a front button to drive")
    vehicle.order("change", 2, AHEAD, PRESS)
    screen.until(rb"pad drives")
    flood = [[3, 3, k] for k in range(150)]
    vehicle.order("change", 2, *flood, MIDDLE, RELEASE, *flood)
    screen.until(rb"(?s)pad drives.*hold a front button")
    assert vehicle.order("waiting", 2) == 0
    screen.type(b"\x1b[113u")
    assert screen.ends() == 0
    assert read_run(tmp_path / "run.mcap").applied_commands[-1, 0] == 0.0
