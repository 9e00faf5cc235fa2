"""The service as a separate process in real time: pyserial on a pty, the firmware behind the pty, guests at the door.

The machine may be busy. Assertions about the vehicle use the clock and the pins of the Uno. A drive that ended by a
stall of the machine is repeated, if its cause is this stall.
"""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door import VERSION
from baqueano.door.remote import connect
from baqueano.drive import drive_stop_reason
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import CLOCK_SOURCE
from baqueano.errors import RobotUnreachable, SafetyStop
from baqueano.runs import read_run
from baqueano.runs.container.recover import recover
from tests.emulated.test_ends_of_blocks import PLACES, repetition

PATIENCE_S = 60.0  # timeout of the test
STALL_S = 0.05  # stall of the machine: half of the silence that stops a drive
WHEELS = """
[sensors.wheels]
kind = "wheels"
rate_hz = 50.0
noise_std = 0.01
"""


@pytest.fixture
def vehicle(live, tmp_path):
    """A vehicle file without an IMU, whose Uno is on the pty."""
    text = vehicle_file.load("small").text
    head, rest = text.split("[sensors.imu]")
    text = head + WHEELS + '\n[estimator]\nuse = ["wheels"]' + rest.split("[estimator]")[1]
    text = text.replace("rate_hz = 100.0\n", "rate_hz = 50.0\n", 1)
    path = tmp_path / "vehicle.toml"
    path.write_text(f'{text}\n[robot]\nport = "{live.path}"\ncounts_per_turn = 576.0\n', encoding="utf-8")
    return vehicle_file.load(path)


@pytest.fixture
def service(vehicle, tmp_path):
    """Return (process, door) of a service that is ready."""
    with start_vehicle(vehicle, tmp_path) as (process, door):
        yield process, door


@contextmanager
def start_vehicle(vehicle, tmp_path):
    """Start a service as systemd does and return (process, door); it can be started again."""
    door = tmp_path / "door"
    door.unlink(missing_ok=True)  # of a killed service
    process = subprocess.Popen(
        [sys.executable, "-m", "baqueano", "robot", "run", "--vehicle", vehicle.path, "--door", door,
         "--runs", tmp_path / "there"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env={**os.environ, "BAQUEANO_BACKEND": "python"},
    )  # fmt: skip
    try:
        assert wait(lambda: process.poll() is not None or answers(door), PATIENCE_S)
        assert process.poll() is None, process.stdout.read().decode()
        yield process, door
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def answers(door):
    """Return True if a service listens at this socket; the socket file exists earlier."""
    with suppress(RobotUnreachable), connect(str(door)):
        return True
    return False


def spin(vehicle, seconds):
    u = np.tile([0.0, 0.0, 0.6], (round(seconds * vehicle.rate_hz), 1))
    return pack(Mission("experiment", u=u), vehicle)


def ready(remote):
    """Wait until the service is READY, after any earlier stop."""
    end = time.monotonic() + PATIENCE_S
    while remote.state.get("state") != "READY":
        assert time.monotonic() < end, remote.state
        if remote.state.get("state") == "STOPPED":
            remote.send(type="clear")
        remote.receive(("state",), PATIENCE_S)


def wait(condition, within_s):
    end = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


def stops(live, within_s):
    """Return the time until the motors are off [s], on the clock of the Uno."""
    now_s = live.now_s()
    assert wait(lambda: not live.moving(), PATIENCE_S)
    with live.lock:
        took_s = live.uno.off_since() - now_s
    assert took_s < within_s
    return took_s


def perform_mission(remote, mission, path, **options):
    """Return the run of a mission, also after refusals: a stall of this machine silences the Uno between two drives."""
    end = time.monotonic() + PATIENCE_S
    while True:
        ready(remote)
        try:
            return remote.perform(mission, path, **options)
        except SafetyStop:
            if path.exists() or time.monotonic() > end:  # the drive has begun
                raise
            remote.receive(("state",), PATIENCE_S)


def drive_whole(remote, mission, live, folder):
    """Return the run of a mission; repeat the mission if a stall of this machine ended it."""
    end = time.monotonic() + 3.0 * PATIENCE_S
    while True:
        loss_s, path = live.loss_s, folder / f"{time.monotonic_ns()}.mcap"
        run = perform_mission(remote, mission, path)
        if not drive_stop_reason(run) or time.monotonic() > end or not stalled(run, live.loss_s - loss_s):
            return run


def stalled(run, loss_s):
    """Return True if this machine delayed the emulated Uno or the ticks of the loop, which may end a drive."""
    (text,) = [event.text for event in run.events if event.source == CLOCK_SOURCE]
    match = re.search(r"the latest started ([\d.]+) ms late", text)
    late_s = 1e-3 * float(match[1]) if match else 0.0
    return max(loss_s, late_s, *np.diff(run.t_s)) >= STALL_S


def end_of_drive(door, folder):
    """Return the reason for the end of the last drive, and its run in the folder of the service."""
    with connect(str(door)) as remote:
        while remote.state["state"] == "MISSION":
            remote.receive(("state",), PATIENCE_S)
        return remote.state["reason"], read_run(max(folder.glob("*.mcap")))


@contextmanager
def driving(door, vehicle, live):
    """Start a mission of a guest at the door that moves the motors."""
    end, moves = time.monotonic() + 3.0 * PATIENCE_S, False
    while not moves:
        assert time.monotonic() < end
        with connect(str(door)) as remote:
            ready(remote)
            remote.send(type="mission", door=VERSION, mission=spin(vehicle, 300.0).to_json())
            moves = wait(lambda remote=remote: remote.send(type="beat") or live.moving(), PATIENCE_S / 4.0)
            if moves:
                yield remote


def lives(live, seconds, meanwhile=lambda: None):
    """Wait until the Uno has run this long on its own clock; return True if a motor is driven then."""
    end_s = live.now_s() + seconds
    assert wait(lambda: meanwhile() or live.now_s() > end_s, PATIENCE_S)
    return live.moving()


def test_a_mission_through_the_door_returns_its_run(service, vehicle, live, tmp_path):
    _, door = service
    with connect(str(door)) as remote:
        run = drive_whole(remote, spin(vehicle, 1.0), live, tmp_path / "here")
    assert drive_stop_reason(run) is None
    (event_of_clock,) = [e for e in run.events if e.source == CLOCK_SOURCE]
    left_out = int(re.search(r"(\d+) were skipped", event_of_clock.text)[1])
    assert left_out == np.sum(np.diff(run.t_ns) // 20_000_000 - 1)
    assert event_of_clock.level == ("warning" if left_out else "info")
    assert run.duration_s == 1.0 if left_out == 0 else run.duration_s >= 1.0
    assert np.all(run.requested_commands[run.t_s < 0.99, 2] == 0.6)
    with live.lock:
        duties = np.array(
            [[out.terminal(k, live.uno.driver).duty for k in (0, 1)] for out in live.uno.outputs()]
        )
    # at the pins, independent of the clock of the host
    assert np.min(duties, axis=0) == pytest.approx([-0.6, 0.0], abs=0.002)
    assert np.max(duties, axis=0) == pytest.approx([0.0, 0.6], abs=0.002)
    assert np.median(run.applied_commands[run.t_s > 0.2, 2]) == pytest.approx(0.6, abs=0.002)
    stops(live, 1.0)
    assert not list((tmp_path / "here").glob("*.part"))


def test_rt5_rt13_a_disconnected_laptop_stops_the_vehicle(service, vehicle, live, tmp_path):
    _, door = service
    end, reason = time.monotonic() + 3.0 * PATIENCE_S, None
    while reason is None or reason.code != StopReason.HOLDER_SILENT:
        loss_s = live.loss_s
        with driving(door, vehicle, live):
            pass
        stops(live, 2.0)  # 0.5 s on the clock of the vehicle: test_service.py
        reason, run = end_of_drive(door, tmp_path / "there")
        assert (reason is not None and reason.code == StopReason.HOLDER_SILENT) or (
            stalled(run, live.loss_s - loss_s) and time.monotonic() < end
        )


def test_rt5_a_killed_service_leaves_a_stopped_vehicle_and_a_readable_run(service, vehicle, live, tmp_path):
    process, door = service
    end, moves = time.monotonic() + 3.0 * PATIENCE_S, False
    while not moves:
        loss_s = live.loss_s
        with driving(door, vehicle, live) as remote:
            lives(live, 2.0, lambda remote=remote: remote.send(type="beat"))
            process.send_signal(signal.SIGSTOP)
            os.waitpid(process.pid, os.WUNTRACED)
            moves = lives(live, 0.05)  # the last command has arrived
            process.send_signal(signal.SIGKILL if moves else signal.SIGCONT)
        if not moves:
            reason, run = end_of_drive(door, tmp_path / "there")
            assert stalled(run, live.loss_s - loss_s), reason
            assert time.monotonic() < end, reason
    process.wait()
    assert wait(lambda: not live.moving(), PATIENCE_S)
    assert 0.25 < live.off_after_s() <= 0.32  # the command timeout of the firmware, on its clock
    damaged_file = max((tmp_path / "there").glob("*.mcap*"))
    path = tmp_path / "whole.mcap"
    recover(damaged_file, path)
    assert read_run(path).duration_s > 0.7


def test_a_service_that_receives_sigterm_exits(service, vehicle, live):
    process, door = service
    with connect(str(door)) as remote:
        ready(remote)
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0
    assert not door.exists()


def status(door):
    """Return the output of `robot status`."""
    with connect(str(door)) as remote:
        end = time.monotonic() + PATIENCE_S
        while remote.state.get("state") not in ("STOPPED", "READY"):
            assert time.monotonic() < end, remote.state
            remote.receive(("state",), PATIENCE_S)
        return remote.state


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("os._exit(0)", 0, 0),  # a success to systemd, which starts it again: Restart=always
        ("os.abort()", -signal.SIGABRT, PLACES["line"]),
        ("hang()", -signal.SIGABRT, 9),  # the watchdog of systemd ends the process this way
    ],
)
def test_a_block_that_kills_the_service_is_named_after_restart(vehicle, live, tmp_path, text, code, line):
    mission = repetition(tmp_path, "line", text, vehicle)
    mark_file = tmp_path / "begun"
    lines = ["def hang():", "  import signal", "  signal.signal(signal.SIGALRM, signal.SIG_IGN)",
             f"  open({str(mark_file)!r}, 'w').close()", "  while True: pass"]  # fmt: skip
    if text == "hang()":
        mission.texts["mine.py"] = mission.texts["mine.py"].replace(
            "\npass\n", "\n" + "\n".join(lines) + "\n", 1
        )
    with start_vehicle(vehicle, tmp_path) as (process, door):
        with suppress(RobotUnreachable), connect(str(door)) as remote:
            ready(remote)
            remote.send(type="mission", door=VERSION, mission=mission.to_json())
            assert wait(lambda: remote.send(type="beat") or live.moving(), PATIENCE_S)
            if text == "hang()":
                assert wait(lambda: remote.send(type="beat") or mark_file.exists(), PATIENCE_S)
                assert wait(lambda: not live.moving(), PATIENCE_S)
                process.send_signal(signal.SIGABRT)
        assert process.wait(PATIENCE_S) == code
    assert wait(lambda: not live.moving(), PATIENCE_S)
    assert live.off_after_s() <= 0.32
    with start_vehicle(vehicle, tmp_path) as (_, door):
        state = status(door)
        assert state["state"] == "STOPPED"
        (run,) = (path.name for path in (tmp_path / "there").glob("*.mcap"))
        reason = state["reason"]
        assert reason.code == (StopReason.MISSION_UNFINISHED_AT if line else StopReason.MISSION_UNFINISHED)
        file = "mine.py" if line else ""
        figures = {"kind": "repeat", "run": run, "blocks": "mine.py:Mine", "file": file, "line": line}
        assert reason.figures == figures
        with connect(str(door)) as remote:
            remote.send(type="clear")
            ready(remote)
    with start_vehicle(vehicle, tmp_path) as (_, door):
        assert status(door)["state"] == "READY"
