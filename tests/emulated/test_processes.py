"""The service as a process of its own, in real time: pyserial on a pty, the firmware behind it, people at the door."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive.mission import Mission, packed
from baqueano.robot.remote import reached
from baqueano.runs import read_run
from baqueano.runs.recover import recover
from tests.emulated.realtime import on_pty

WHEELS = """
[sensors.wheels]
kind = "wheels"
rate_hz = 50.0
noise_std = 0.01
"""


@pytest.fixture
def live(firmware):
    with on_pty(firmware) as live:
        yield live


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
    """(process, door) of a service that is ready."""
    door = tmp_path / "door"
    process = subprocess.Popen(
        [sys.executable, "-m", "baqueano", "robot", "run", "--vehicle", vehicle.path, "--door", door,
         "--runs", tmp_path / "there"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env={**os.environ, "BAQUEANO_BACKEND": "numpy"},
    )  # fmt: skip
    end = time.monotonic() + 60.0
    while not door.exists():
        assert process.poll() is None, process.stdout.read().decode()
        assert time.monotonic() < end
        time.sleep(0.05)
    yield process, door
    process.kill()
    process.wait()
    process.stdout.close()


def spin(vehicle, seconds):
    u = np.tile([0.0, 0.0, 0.6], (round(seconds * vehicle.rate_hz), 1))
    return packed(Mission("experiment", u=u), vehicle)


def ready(remote):
    end = time.monotonic() + 20.0
    while remote.state.get("state") != "READY":
        assert time.monotonic() < end, remote.state
        remote.hear(("state",), 5.0)


def until(true, within_s):
    end = time.monotonic() + within_s
    while not true():
        if time.monotonic() > end:
            return False
        time.sleep(0.005)
    return True


def test_a_mission_by_the_door_brings_its_run_back(service, vehicle, live, tmp_path):
    _, door = service
    with reached(str(door)) as remote:
        ready(remote)
        run = remote.perform(spin(vehicle, 1.0), tmp_path / "here" / "run.mcap")
    assert run.duration_s == pytest.approx(1.0, abs=0.1)
    assert np.max(run.applied[:, 2]) == pytest.approx(0.6, abs=0.002)
    assert until(lambda: not live.moving(), 1.0)
    assert not list((tmp_path / "here").glob("*.part"))


def test_a_laptop_that_is_gone_stops_the_vehicle(service, vehicle, live, tmp_path):
    _, door = service
    with reached(str(door)) as remote:
        ready(remote)
        remote.say(do="mission", mission=spin(vehicle, 30.0).json())
        assert until(lambda: remote.say(do="beat") or live.moving(), 20.0)
    gone = time.monotonic()
    assert until(lambda: not live.moving(), 5.0)
    assert time.monotonic() - gone < 2.0  # 0.5 s on a machine that is not loaded, see the emulated figures


def test_a_service_that_is_killed_leaves_a_stopped_vehicle_and_a_whole_run(service, vehicle, live, tmp_path):
    process, door = service
    with reached(str(door)) as remote:
        ready(remote)
        remote.say(do="mission", mission=spin(vehicle, 30.0).json())
        assert until(lambda: remote.say(do="beat") or live.moving(), 20.0)
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            remote.say(do="beat")
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert until(lambda: not live.moving(), 2.0)
    (there,) = (tmp_path / "there").glob("*.mcap*")
    whole = tmp_path / "whole.mcap"
    recover(there, whole)
    assert read_run(whole).duration_s > 0.7


def test_a_service_that_is_told_to_end_stops_and_goes(service, vehicle, live):
    process, door = service
    with reached(str(door)) as remote:
        ready(remote)
    process.send_signal(signal.SIGTERM)
    assert process.wait(10.0) == 0
    assert not door.exists()
