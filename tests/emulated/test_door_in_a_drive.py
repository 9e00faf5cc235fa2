"""Messages of guests at the door while the service prepares or drives the real firmware."""

import json
import socket

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, stop
from baqueano.door.sockets import Door
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, pack
from baqueano.guides import shapes
from baqueano.robot.service.service import HANG_TIMEOUT_S, PREPARE_TIMEOUT_S
from tests.emulated.drives import drive, during, look_around, spin

PATIENCE_S = 60.0  # timeout of the test


@pytest.fixture
def door(service, tmp_path, until_end):
    """The door of the service."""
    door, broadcast = until_end(Door(tmp_path / "door", service.operator, service.folder)), service.broadcast
    service.broadcast = lambda message: (door.broadcast(message), broadcast(message))
    return door


def answer_to(door, request):
    """Send a message and return the answer of the door."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(PATIENCE_S)
        line.connect(str(door.path))
        line.sendall(json.dumps({"type": request}).encode() + b"\n")
        with line.makefile("rb") as file:
            return next(message for message in map(json.loads, file) if message["type"] != "state")


def test_a_stop_during_preparation_of_a_mission_prevents_motion(service, robot, door, tmp_path, monkeypatch):
    messages = []

    def somebody_stops_it():
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(PATIENCE_S)
            line.connect(str(door.path))
            line.sendall(b'{"type": "stop", "reason": "it nears the stairs"}\n')
            with line.makefile("rb") as file:
                messages.extend(json.loads(file.readline()) for _ in range(2))

    monkeypatch.setattr("builtins.somebody_stops_it", somebody_stops_it, raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow.py").write_text(
        "from baqueano.controllers import PdFeedforward\n\nsomebody_stops_it()  # a library that loads for long\n"
    )
    look_around(service, robot, 5)
    mission = Mission(
        "repeat", route=shapes.circle(0.4, 0.25), blocks={"controller": "slow.py:PdFeedforward"}
    )
    end, run = drive(service, pack(mission, vehicle_file.load("small")))
    assert messages[0]["state"] == DoorState.MISSION
    assert messages[1] == {"type": "received", "request": "stop"}
    assert end["reason"] == stop(StopReason.STOPPED_BY, words="it nears the stairs")
    assert run is None or not np.any(run.applied_commands)
    assert not robot.board.moving
    look_around(service, robot, 2)
    assert service.machine.state is DoorState.STOPPED
    assert service.machine.reason == end["reason"]


@pytest.mark.parametrize("text", ["{", "7", "[" * 100_000, "{}"])
def test_an_invalid_mission_is_refused_and_the_service_continues(service, text):
    waits = []
    service.set_watchdog_timeout = waits.append
    end, run = drive(service, text)
    assert run is None
    assert (end["code"], end["reason"].code) == (2, "mission.damaged")
    assert waits == [PREPARE_TIMEOUT_S, HANG_TIMEOUT_S]
    assert service.machine.state is DoorState.READY
    assert drive(service, spin().to_json())[0]["reason"] is None


def test_a_run_is_listed_only_after_it_is_complete(service, robot, door):
    folders = []
    during(service, robot, 0.3, lambda: folders.append(answer_to(door, "runs")["runs"]))
    end, _ = drive(service, spin())
    assert folders == [[]]
    assert answer_to(door, "runs")["runs"] == [end["run"]]
    # a client can fetch the run then
    assert [m["type"] for m in service.messages][-2:] == ["state", "done"]
