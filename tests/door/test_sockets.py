"""The door of the service: every message reaches the operator, no invalid message ends the connection, and a slow
client delays no other client.
"""

import base64
import gc
import json
import os
import socket
import sys
import time
from contextlib import suppress

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, stop
from baqueano.door import VERSION
from baqueano.door.operator import Operator
from baqueano.door.sockets import MAX_SHORT_LINE_BYTES, Door
from baqueano.drive.mission import Mission, pack
from baqueano.errors import RobotUnreachable
from tests.codes import refused

PATIENCE_S = 20.0  # timeout of the test


class Person:
    def __init__(self, path):
        self.line = socket.socket(socket.AF_UNIX)
        self.line.connect(str(path))
        self.line.settimeout(PATIENCE_S)
        self.file = self.line.makefile("rb")

    def send(self, **words):
        self.line.sendall(json.dumps(words).encode() + b"\n")

    def close(self):
        self.file.close()
        self.line.close()

    def receive(self):
        return json.loads(self.file.readline())


@pytest.fixture
def person(connect):
    return connect()


def wait_for(condition):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_missions_and_manual_commands_reach_the_operator(door, person):
    file = vehicle_file.load("small")
    person.send(
        type="mission",
        door=VERSION,
        mission=pack(Mission("experiment", u=np.zeros((3, 3))), file).to_json(),
        attended=False,
    )
    requests = []
    wait_for(lambda: requests.append(door.operator.pop_mission()) or requests[-1] is not None)
    mission, is_attended, _ = requests[-1]
    assert Mission.from_json(mission).kind == "experiment"
    assert not is_attended
    commands = []

    def hand_arrives():  # sent repeatedly: a set-point is valid for 0.3 s only
        person.send(type="hand", u=[0.1, 0.0, 0.2])
        commands.append(door.operator.command(3))
        return commands[-1].any()

    wait_for(hand_arrives)
    np.testing.assert_allclose(commands[-1], [0.1, 0.0, 0.2])


def test_rt14_rt15_ne3_only_the_holder_drives_and_anyone_stops(door, person, connect):
    file = vehicle_file.load("small")
    mission = pack(Mission("experiment", u=np.zeros((3, 3))), file).to_json()
    person.send(type="mission", door=VERSION, mission=mission)
    wait_for(lambda: door.operator.pop_mission() is not None)
    second = connect()
    second.send(type="mission", door=VERSION, mission=mission)
    assert second.receive()["diagnostic"]["code"] == "door.other-driver"
    second.send(type="hand", u=[1.0, 0.0, 0.0])
    second.send(type="stop", reason="it nears the stairs")
    wait_for(lambda: door.operator.stop_reason(attended=False) is not None)
    assert door.operator.stop_reason(attended=False) == stop(
        StopReason.STOPPED_BY, words="it nears the stairs"
    )
    assert not door.operator.command(3).any()


@pytest.mark.parametrize("ticks", [3, 3000])
def test_a_refused_mission_is_not_decoded(door, person, connect, monkeypatch, ticks):
    file, decoded_texts, loads = vehicle_file.load("small"), [], json.loads
    person.send(
        type="mission", door=VERSION, mission=pack(Mission("experiment", u=np.zeros((3, 3))), file).to_json()
    )
    wait_for(lambda: door.operator.pop_mission() is not None)
    message = pack(Mission("experiment", u=np.full((ticks, 3), 1.0 / 3.0)), file).to_json()
    monkeypatch.setattr(json, "loads", lambda text: decoded_texts.append(len(text)) or loads(text))
    second = connect()
    second.send(type="mission", door=VERSION, mission=message)
    assert loads(second.file.readline())["diagnostic"]["code"] == "door.other-driver"
    # at most one line, never the commands of a mission
    assert all(n <= MAX_SHORT_LINE_BYTES for n in decoded_texts)
    assert len(decoded_texts) == (len(message) < MAX_SHORT_LINE_BYTES)


def test_several_messages_in_one_packet_are_all_received(door, person):
    person.line.sendall(b'{"type": "ping", "token": 1}\n{"type": "ping", "token": 2}\n{"type": "ping", ')
    assert [person.receive()["token"] for _ in range(2)] == [1, 2]
    person.line.sendall(b'"token": 3}\n')
    assert person.receive()["token"] == 3


def test_rt14_a_mission_of_a_disconnected_client_is_not_given_to_the_next(door, person, connect):
    mission = pack(Mission("experiment", u=np.zeros((3, 3))), vehicle_file.load("small")).to_json()
    person.send(type="mission", door=VERSION, mission=mission)
    wait_for(lambda: door.operator.pop_mission() is not None)
    person.send(type="mission", door=VERSION, mission=mission)
    assert person.receive()["diagnostic"]["code"] == "door.own-mission"
    person.close()
    second = connect()
    wait_for(lambda: door.operator.stop_reason() is not None)  # the door accepts no more clients
    second.send(type="mission", door=VERSION, mission=mission)
    assert second.receive()["diagnostic"]["code"] == "door.mission"
    second.send(type="beat")
    second.send(type="hand", u=[1.0, 0.0, 0.0])
    second.send(type="ping")
    second.receive()
    assert door.operator.stop_reason().code == StopReason.HOLDER_SILENT
    assert not door.operator.command(3).any()
    door.operator.record_mission_end()
    second.send(type="mission", door=VERSION, mission=mission)
    wait_for(lambda: door.operator.pop_mission() is not None)


@pytest.mark.parametrize(
    "line",
    [
        b"{",
        b"[1]",
        b'{"type": "dance"}',
        b"{}",
        b'{"type": "mission"}',
        b'{"type": "fetch", "run": "../x"}',
        b"\xff\xfe",
        b'{"type": "hand", "u": [' + b"1" * 400 + b"]}",  # beyond the range of a double
        b"[" * 50_000,
        b'{"type": "fetch", "run": "' + b"x" * 300 + b'"}',  # longer than a file name may be
    ],
)
def test_fi6_an_invalid_line_is_answered_without_disconnecting(door, person, line):
    door.operator.set_holder(next(iter(until_client(door))))  # the client whose set-points are used
    person.line.sendall(line + b"\n")
    assert person.receive()["type"] == "refused"
    person.send(type="runs")
    assert person.receive() == {"type": "runs", "runs": []}


def test_a_new_client_receives_the_last_state_at_once(door, connect):
    door.broadcast({"type": "state", "state": "READY"})
    door.broadcast({"type": "state", "state": "MISSION"})
    door.broadcast({"type": "event", "text": "nothing more is sent while a mission is prepared"})
    assert connect().receive() == {"type": "state", "state": "MISSION", "door": VERSION}


LONG_LINES = [
    b'{"type": "ping", "token": "' + b"x" * MAX_SHORT_LINE_BYTES + b'"}\n',
    b'{"type": "ping", "token": "'
    + b"x" * (20 * MAX_SHORT_LINE_BYTES)
    + b'"}\n',  # refused before its end is received
    b'{"type": "hand", "u": [' + b"0, " * MAX_SHORT_LINE_BYTES + b"0]}\n",
    b'{"type": "ping", "token": {"type": "mission", "x": "' + b"x" * MAX_SHORT_LINE_BYTES + b'"}}\n',
]


@pytest.mark.parametrize("line", LONG_LINES, ids=["just too long", "far too long", "hand", "nested"])
def test_a_long_line_that_is_not_a_mission_is_refused_at_rest(door, person, monkeypatch, line):
    door.operator.set_holder(next(iter(until_client(door))))  # a mission would be accepted
    decoded_messages, loads = [], json.loads
    monkeypatch.setattr(json, "loads", lambda text: decoded_messages.append(len(text)) or loads(text))
    with suppress(OSError):  # disconnected before the end of the line
        person.line.sendall(line)
    assert loads(person.file.readline())["diagnostic"]["code"] == "door.too-long"
    assert all(
        n < 2 * MAX_SHORT_LINE_BYTES for n in decoded_messages
    )  # a far longer line is refused before its end
    assert not door.operator.command(2 * MAX_SHORT_LINE_BYTES).any()


@pytest.mark.parametrize("field", ["type", "do"])  # do: of an earlier version
def test_a_stop_is_acknowledged_after_the_operator_received_the_stop(door, person, field):
    person.send(**{field: "stop", "reason": "it nears the stairs"})
    assert person.receive() == {"type": "received", "request": "stop"}
    assert door.operator.stop_reason(attended=False) == stop(
        StopReason.STOPPED_BY, words="it nears the stairs"
    )


def test_rt15_a_stop_halts_the_motors_before_it_is_acknowledged(tmp_path):
    halts = []
    door = Door(tmp_path / "s", Operator(), tmp_path, halt=lambda: halts.append(True))
    person = Person(door.path)
    person.send(type="stop", reason="it nears the stairs")
    assert person.receive()["type"] == "received"
    assert halts == [True]
    person.close()
    door.close()


def test_a_mission_of_another_version_is_refused_with_a_readable_reason(door, person):
    person.send(type="mission", mission="{}", id="one")
    message = person.receive()
    assert (message["type"], message["code"], message["diagnostic"]["code"]) == ("refused", 2, "door.version")
    assert isinstance(message["reason"], str)
    assert door.operator.pop_mission() is None


def test_the_reason_of_a_stop_is_received_as_data(door, person):
    person.send(type="stop", reason=stop(StopReason.TERMINAL_SILENT, silent_ms=355.5).to_json())
    person.receive()
    assert door.operator.stop_reason(attended=False) == stop(StopReason.TERMINAL_SILENT, silent_ms=355.5)


def test_a_run_is_fetched_byte_for_byte(door, person, tmp_path):
    data = np.random.default_rng(0).bytes(1_000_000)
    (tmp_path / "a.mcap").write_bytes(data)
    person.send(type="fetch", run="a.mcap")
    content, remaining = b"", 1
    while remaining:
        message = person.receive()
        content, remaining = content + base64.b64decode(message["data"]), message["left"]
    assert content == data


def test_an_empty_run_of_a_power_cut_is_fetched(door, person, tmp_path):
    (tmp_path / "a.mcap").touch()
    person.send(type="fetch", run="a.mcap")
    assert person.receive() == {"type": "file", "run": "a.mcap", "data": "", "left": 0}


def test_a_run_that_is_being_written_is_not_listed(door, person, tmp_path):
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).touch()
    for open_file, names in (("b.mcap", ["a.mcap"]), (None, ["a.mcap", "b.mcap"])):
        door.broadcast({"type": "state", "state": "MISSION", "run": open_file})
        person.send(type="runs")
        wait_for(lambda: person.receive()["type"] == "state")
        assert person.receive() == {"type": "runs", "runs": names}


def test_ne5_a_client_that_does_not_read_is_disconnected(door, person, connect):
    connect()
    wait_for(lambda: len(door._clients) == 2)
    for k in range(200):
        door.broadcast({"type": "event", "text": "x" * 100_000, "k": k})
        person.receive()
    wait_for(lambda: len(door._clients) == 1)


@pytest.mark.skipif(sys.platform != "linux", reason="counts open files in /proc")
def test_two_hundred_clients_that_come_and_go_leave_nothing_behind(door):
    def come_and_go():
        client = Person(door.path)
        client.send(type="watch", hz=20.0)
        client.send(type="ping", token=1)
        assert client.receive()["type"] == "pong"
        client.close()
        wait_for(lambda: not door._clients)

    def left():
        gc.collect()
        return np.array(
            [len(os.listdir("/proc/self/fd")), len(door._selector.get_map()), len(gc.get_objects())]
        )

    for _ in range(20):
        come_and_go()
    before = left()
    for _ in range(200):
        come_and_go()
    assert np.all(left() - before < [3, 1, 100])


def test_a_disconnected_driver_releases_the_vehicle(door, person):
    door.operator.set_holder(next(iter(until_client(door))))
    person.close()
    wait_for(lambda: not door._clients)
    door.operator.set_holder("another")


def until_client(door):
    wait_for(lambda: door._clients)
    return door._clients


def test_a_file_that_is_no_socket_is_not_replaced(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        Door(path, Operator(), tmp_path)
    assert path.read_text() == "mine"


def test_a_second_service_is_refused_and_a_dead_socket_is_replaced(door, tmp_path):
    with refused("door.runs-already", RobotUnreachable):
        Door(door.path, Operator(), tmp_path)
    no_link = tmp_path / "dead"
    old = socket.socket(socket.AF_UNIX)
    old.bind(str(no_link))
    old.close()
    Door(no_link, Operator(), tmp_path).close()


@pytest.mark.parametrize("word", ["shake", "again", "pace", "pause"])
def test_a_robot_refuses_commands_of_a_simulation(person, word):
    person.send(type=word, kind="sag", part=0.5)
    assert person.receive()["diagnostic"]["code"] == "door.unknown-word"
