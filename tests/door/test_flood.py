"""A door that is flooded with messages: a stop has priority, and clients, lines and memory are limited."""

import json
import socket
import threading
from contextlib import suppress

import pytest

from baqueano.diagnostics import StopReason
from baqueano.door import clients, sockets
from baqueano.door.clients import MAX_BACKLOG, MAX_SHORT_LINE_BYTES, READ_BYTES, DoorClient
from baqueano.door.sockets import MAX_CLIENTS, MAX_LINES, STOP_CONNECTIONS
from tests.door.test_sockets import wait_for

RUNS = b'{"type": "runs"}\n'
BEAT = b'{"type": "beat"}\n'
HALF_A_MISSION = (
    b'{"type": "mission", "door": %d, "mission": "' % sockets.VERSION + b"x" * 2 * MAX_SHORT_LINE_BYTES
)
STOP = b'{"type": "stop", "reason": "it nears the stairs"}\n'


@pytest.fixture
def turns(door, monkeypatch):
    """Count the answers between the arrival of a stop in the socket and the stop of the vehicle."""
    answers, answer = [], door._answer
    monkeypatch.setattr(
        door, "_answer", lambda client, line: answers.append(bytes(line)) or answer(client, line)
    )
    return answers


class Flood(threading.Thread):
    """A client that sends one message again and again, and reads the answers."""

    def __init__(self, person, word=RUNS):
        super().__init__(daemon=True)
        self.person, self.data, self.over = person, word * (READ_BYTES // len(word)), threading.Event()
        self.start()

    def run(self):
        self.person.line.settimeout(0.05)
        while not self.over.is_set():
            try:
                self.person.line.sendall(self.data)
                self.person.line.recv(1 << 20)
            except TimeoutError:
                continue
            except OSError:
                return

    def end(self):
        self.over.set()
        self.join()


def test_rt15_a_stop_has_priority_over_five_flooding_clients(door, connect, turns):
    floods = [Flood(connect()) for _ in range(5)]
    wait_for(lambda: len(turns) > 20 * MAX_LINES)
    for _ in range(5):
        teacher, before = connect(), len(turns)
        teacher.line.sendall(STOP)
        while (message := teacher.receive())["type"] == "state":
            pass
        assert message == {"type": "received", "request": "stop"}
        index = next(k for k in range(before, len(turns)) if turns[k].startswith(b'{"type": "stop"'))
        assert index - before <= 8 * MAX_LINES  # of millions of messages sent meanwhile
        door.operator.discard_requests(door.operator.stop_reason(attended=False))
    for flood in floods:
        flood.end()


def test_a_message_of_the_loop_has_priority_over_the_waiting_lines(door, connect, monkeypatch):
    person, answer, event = connect(), door._answer, {"type": "event", "level": "info", "message": "x"}
    monkeypatch.setattr(door, "_answer", lambda client, line: (answer(client, line), door.broadcast(event)))
    person.line.sendall(b'{"type": "ping"}\n' * 20)
    kinds = [person.receive()["type"] for _ in range(40)]
    assert kinds == ["pong", "event"] * 20


def test_a_stop_has_priority_over_earlier_lines_of_its_client(door, connect, turns):
    person = connect()
    person.line.sendall(RUNS * 200 + STOP + RUNS * 20)
    wait_for(lambda: door.operator.stop_reason(attended=False) is not None)
    index = next(k for k, line in enumerate(turns) if line.startswith(b'{"type": "stop"'))
    assert index <= MAX_LINES
    assert door.operator.stop_reason(attended=False).code == StopReason.STOPPED_BY


def test_a_stop_nested_in_another_message_does_not_stop_the_vehicle(door, connect):
    person = connect()
    person.send(type="ping", token={"type": "stop"})
    assert person.receive()["token"] == {"type": "stop"}
    assert door.operator.stop_reason(attended=False) is None


def test_a_client_that_sends_too_fast_receives_the_number_of_dropped_lines(door, connect):
    near_end, far_end = socket.socketpair()
    with near_end, far_end:
        client = DoorClient(near_end)
        far_end.sendall(RUNS * (3 * MAX_BACKLOG))
        assert list(client.receive()) == []
        assert len(client.lines) == MAX_BACKLOG
        assert client.dropped == 2 * MAX_BACKLOG
        far_end.sendall(STOP)
        assert list(client.receive()) == [STOP.rstrip()]
    person = connect()
    person.line.sendall(RUNS * (4 * MAX_BACKLOG))
    while (message := person.receive())["type"] == "runs":
        pass
    assert message["diagnostic"]["code"] == "door.too-many"


def test_a_second_queued_mission_is_dropped_but_heartbeats_are_not():
    near_end, far_end = socket.socketpair()
    with near_end, far_end:
        near_end.setblocking(False)
        client = DoorClient(near_end)
        mission = b'{"type": "mission", "mission": "' + b"7" * MAX_SHORT_LINE_BYTES + b'"}\n'
        lines = mission + BEAT * 100 + mission + BEAT * 100
        sender = threading.Thread(target=far_end.sendall, args=(lines,))
        sender.start()
        wait_for(lambda: not list(client.receive()) and len(client.lines) + client.dropped == 202)
        sender.join()
        assert client.dropped == 1  # the second mission
        assert [client.pop_line() for _ in range(201)] == [mission.rstrip(), *[BEAT.rstrip()] * 200]
        far_end.sendall(BEAT)
        assert list(client.receive()) == []
        assert client.pop_line() == BEAT.rstrip()  # its client places are free again


def test_all_clients_receive_an_equal_share_of_answers(door, connect, turns):
    flood, client = Flood(connect()), connect()
    wait_for(lambda: len(turns) > 10 * MAX_LINES)
    for k in range(20):
        before = len(turns)
        client.send(type="ping", token=k)
        assert client.receive()["token"] == k
        assert len(turns) - before <= 8 * MAX_LINES
    flood.end()


def test_a_stop_is_received_even_if_all_client_places_are_taken(door, connect):
    door.broadcast({"type": "state", "state": "MISSION"})
    for _ in range(MAX_CLIENTS):
        assert connect().receive()["type"] == "state"
    client = connect()
    client.send(type="runs")
    assert client.receive()["diagnostic"]["code"] == "door.full"
    assert client.file.readline() == b""
    clients = [connect() for _ in range(STOP_CONNECTIONS + 2)]  # clients that send nothing
    teacher = connect()
    teacher.line.sendall(STOP)
    assert teacher.receive() == {"type": "received", "request": "stop"}
    assert len(door._clients) <= MAX_CLIENTS + STOP_CONNECTIONS
    door.broadcast({"type": "state", "state": "STOPPED"})
    assert teacher.receive()["state"] == "STOPPED"
    assert clients[0].file.readline() == b""


def test_only_one_client_at_a_time_may_send_an_endless_line(door, connect):
    people = [connect() for _ in range(12)]
    for person in people:
        person.line.settimeout(20.0)

    def pour(person):
        try:
            for _ in range(64):  # 4 MB each; at most 64 kB are stored of all but one
                person.line.sendall(b"x" * MAX_SHORT_LINE_BYTES)
        except OSError:
            return

    threads = [threading.Thread(target=pour, args=(person,), daemon=True) for person in people]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_for(lambda: sum(client.partial_line_bytes > MAX_SHORT_LINE_BYTES for client in door._clients) <= 1)
    total_bytes = sum(client.partial_line_bytes for client in door._clients)
    assert total_bytes <= 64 * MAX_SHORT_LINE_BYTES + 12 * (MAX_SHORT_LINE_BYTES + READ_BYTES)


def test_half_a_mission_that_stalls_does_not_refuse_the_next_mission(door, connect, monkeypatch):
    monkeypatch.setattr(clients, "MAX_PAUSE_S", 0.05)
    stalled_client, second = connect(), connect()
    stalled_client.line.sendall(HALF_A_MISSION)
    wait_for(lambda: any(client.has_stalled for client in door._clients))
    second.line.sendall(HALF_A_MISSION + b'"}\n')
    wait_for(lambda: door.operator.is_busy)
    assert stalled_client.file.readline() == b""


def many_causes(levels):
    """Return a reason whose cause has a cause, and so on."""
    reason = {"code": "operator.stopped-by", "subject": "", "fix": "", "severity": "error"}
    inner = reason | {"figures": {"words": "me"}}
    for _ in range(levels):
        inner = reason | {"figures": {"words": inner}}
    return inner


@pytest.mark.parametrize(
    "reason",
    [many_causes(400), None, 7, [], {}, {"code": 3}, {"code": "x", "figures": 1}, {"figures": {}}, "seen"],
)
def test_a_stop_with_any_reason_stops_and_its_reason_reaches_all(door, connect, reason):
    person = connect()
    person.send(type="stop", reason=reason)
    wait_for(lambda: door.operator.stop_reason(attended=False))
    door.broadcast({"type": "state", "state": "STOPPED", "reason": door.operator.stop_reason(attended=False)})
    states = (json.loads(line) for line in person.file)
    assert next(word for word in states if word["type"] == "state")["reason"]["code"] == StopReason.STOPPED_BY
    assert door._thread.is_alive()


@pytest.mark.parametrize(("bytes_each_s", "stalls"), [(1, True), (16 << 10, False)])
def test_a_long_line_must_arrive_at_a_least_rate(monkeypatch, bytes_each_s, stalls):
    now_s = 0.0
    monkeypatch.setattr(clients.time, "monotonic", lambda: now_s)
    end_a, end_b = socket.socketpair()
    with end_a, end_b:
        client = DoorClient(end_a)
        for data in (*[b"x" * READ_BYTES] * 5, *[b"x" * bytes_each_s] * 20):
            now_s += 1.0 if len(data) == bytes_each_s else 0.001
            end_b.sendall(data)
            assert not [*client.receive()]
        assert client.partial_line_bytes > MAX_SHORT_LINE_BYTES
        now_s += 1.0  # an interruption of Wi-Fi
        assert client.has_stalled is stalls
        now_s += 1.5
        assert client.has_stalled


def test_a_long_line_is_refused_during_a_drive(door, connect):
    driver, second = connect(), connect()
    wait_for(lambda: len(door._clients) == 2)
    driver.send(type="mission", door=sockets.VERSION, mission="{}")
    wait_for(lambda: door.operator.is_busy)
    with suppress(OSError):
        for _ in range(1000):
            second.line.sendall(b'{"type": "mission", "mission": "' + b"x" * MAX_SHORT_LINE_BYTES)
    assert json.loads(second.file.readline())["diagnostic"]["code"] == "door.other-driver"
