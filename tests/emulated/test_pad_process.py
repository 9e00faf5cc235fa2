"""Whole processes that look for a game pad in /dev/input and drive by it, with emulated devices behind umockdev.

Nothing in the client is replaced: its open, ioctl and read calls go to libumockdev-preload, which answers instead of
the kernel. The tests run in real time, so none of them checks a duration.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive.session import drive_stop_reason, mark_times_ns
from baqueano.runs import read_run
from tests.emulated.test_imu_process import SYSTEM_PYTHON, _installed, lacking  # noqa: F401

SERVER = Path(__file__).parent / "pad_umockdev.py"
FRONT, SOUTH = 0x136, 0x130
AHEAD, MIDDLE, PRESS, RELEASE = [3, 1, -32768], [3, 1, 0], [1, FRONT, 1], [1, FRONT, 0]
ASK = "from baqueano.drive.by_hand.pad import find_pad; print(find_pad().name)"


class Machine:
    """A machine with these devices of evdev."""

    def __init__(self, *names):
        self._server = subprocess.Popen(
            [SYSTEM_PYTHON, str(SERVER), json.dumps(names)], stdin=-1, stdout=-1, text=True
        )
        root = json.loads(self._server.stdout.readline())["root"]
        self.environment = {"UMOCKDEV_DIR": root, "LD_PRELOAD": "libumockdev-preload.so.0"}

    def order(self, *words):
        self._server.stdin.write(json.dumps(words) + "\n")
        self._server.stdin.flush()
        return json.loads(self._server.stdout.readline())

    def run(self, *command):
        """Return the output of a process that ends without help."""
        return subprocess.run(
            [sys.executable, *command], env={**os.environ, **self.environment}, capture_output=True, text=True,
            timeout=60,
        )  # fmt: skip

    def close(self):
        self._server.communicate(json.dumps(["quit"]) + "\n", timeout=20)


@pytest.fixture
def machine():
    machines = []

    def make(*names):
        machines.append(Machine(*names))
        return machines[-1]

    yield make
    for pad_machine in machines:
        pad_machine.close()


@pytest.fixture
def drive(machine, tmp_path, monkeypatch):
    """Return a drive with the pad of a machine that also has other devices, and this machine."""
    from tests.cli.test_driving import Terminal

    screens = []

    def begin(pad_machine, run):
        with monkeypatch.context() as patch:
            for name, value in pad_machine.environment.items():
                patch.setenv(name, value)
            screens.append(Terminal(tmp_path, "drive", "--vehicle", "small", "--pad", "-o", run))
        return screens[-1]

    yield lambda: machine("keyboard", "touchpad", "pad"), begin
    for screen in screens:
        screen.close()


def test_a_process_selects_the_pad_by_real_system_calls(machine):
    assert machine("keyboard", "touchpad", "bare_pad").run("-c", ASK).stdout == "Bare pad\n"
    errors = machine("keyboard", "touchpad").run("-c", ASK).stderr
    assert 'event0 "AT keyboard" (no stick), event1 "Touchpad" (no front buttons)' in errors


def test_a_pad_drives_marks_and_stops_the_vehicle_when_it_is_unplugged(drive, tmp_path):
    make, begin = drive
    machine = make()
    screen = begin(machine, "run.mcap")
    screen.until(rb"hold a front button to drive")
    machine.order("change", 2, AHEAD, PRESS)
    screen.until(rb"speed +0\.[1-9]")
    machine.order("change", 2, [1, SOUTH, 1])
    screen.until(rb"marks 1")
    machine.order("unplug", 2)
    assert screen.ends() == 5
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.PAD_UNPLUGGED
    assert len(mark_times_ns(run)) == 1
    assert np.max(run.applied_commands[:, 0]) == pytest.approx(0.5)
    assert run.applied_commands[-1, 0] == 0.0

    machine.order("plug", 3, "pad")
    machine.order("change", 3, AHEAD, PRESS)
    screen = begin(machine, "again.mcap")
    screen.until(rb"(?s)(?:release its stick.*?){6}")  # without the wait, the second press would drive
    assert b"pad drives" not in screen.output
    machine.order("change", 3, MIDDLE, RELEASE)
    screen.until(rb"hold a front button to drive")
    machine.order("change", 3, AHEAD, PRESS)
    screen.until(rb"speed +0\.[1-9]")
    machine.order("change", 3, MIDDLE, RELEASE)
    screen.type(b"\x1b[113u")
    assert screen.ends() == 0
    assert np.max(read_run(tmp_path / "again.mcap").applied_commands[:, 0]) == pytest.approx(0.5)


def test_the_pad_state_is_correct_after_dropped_kernel_events(drive, tmp_path):
    make, begin = drive
    machine = make()
    screen = begin(machine, "run.mcap")
    screen.until(rb"hold a front button to drive")
    machine.order("change", 2, AHEAD, PRESS)
    screen.until(rb"pad drives")
    flood = [[3, 3, k] for k in range(150)]
    machine.order("change", 2, *flood, MIDDLE, RELEASE, *flood)
    screen.until(rb"(?s)pad drives.*hold a front button")
    assert machine.order("waiting", 2) == 0
    screen.type(b"\x1b[113u")
    assert screen.ends() == 0
    assert read_run(tmp_path / "run.mcap").applied_commands[-1, 0] == 0.0
