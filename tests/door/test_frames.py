"""Frames: each tick is sent once and in order and is encoded once for all clients; unread frames are replaced."""

import json
import threading

import numpy as np
import pytest

from baqueano.door import sockets
from baqueano.door.frames.descriptions import route_description
from baqueano.door.frames.route_progress import RouteProgress
from baqueano.door.frames.rows import MAX_STORED_TICKS, DriveRows, Frames
from baqueano.drive import experiment
from baqueano.drive.health import normalised_innovation_squared
from baqueano.drive.observers import Observer
from baqueano.guides import shapes
from baqueano.vehicle_file import load
from tests.door.test_sockets import wait_for


class Listening(Observer):
    """Stores the records of a drive, and the estimator."""

    def __init__(self):
        self.records = []

    def begin(self, blocks):
        self.estimator = blocks.estimator
        return blocks

    def on_record(self, record):
        self.records.append(record)


@pytest.fixture(scope="module")
def drive_of_service():
    file, listening = load("small"), Listening()
    u = np.tile([0.5, 0.0, 0.2], (60, 1))
    run = experiment(file, u, observers=(listening,))
    return file, listening, run


def rows_of(drive, first_row=0, columns=None):
    return json.loads(drive.frame(first_row, columns))


def test_a_row_contains_the_values_of_its_tick(drive_of_service):
    file, listening, run = drive_of_service
    drive = DriveRows(file, listening.estimator)
    frames = Frames()
    frames._drive = drive
    for record in listening.records:
        frames.on_record(record, battery_v=7.4)
    drive.convert()
    frame = rows_of(drive)
    assert (frame["n"], len(frame["x"])) == (0, len(run.t_ns))
    names = [column.name for column in drive.columns]
    row = dict(zip(names, frame["x"][-1], strict=True))
    log = run.estimate
    for name, value in {
        "t": run.t_ns[-1] * 1e-9, "eta.x": log.eta[-1, 0], "eta.psi": log.eta[-1, 2], "P.xy": log.cov[-1, 0, 1],
        "nu.u": log.nu[-1, 0], "u.0": run.applied_commands[-1, 0], "requested.2": run.requested_commands[-1, 2],
        "z.imu[2]": run.sensors["imu"].z[-1, 2], "innov.imu[1]": log.innovation[-1, 1],
        "S.imu[0]": np.sqrt(log.innovation_cov[-1, 0, 0]), "battery": 7.4,
        "model.imu[2]": run.sensors["imu"].z[-1, 2] - log.innovation[-1, 2],
        "nis": normalised_innovation_squared(log.innovation[-1].tolist(), log.innovation_cov[-1].tolist()),
    }.items():  # fmt: skip
        assert row[name] == pytest.approx(value, rel=1e-6), name
    assert row["truth.x"] is None
    assert row["progress"] is None


def test_every_tick_is_sent_once_and_in_order(drive_of_service):
    file, listening, _ = drive_of_service
    drive, frames, rows_shown, rows = DriveRows(file), Frames(), 0, []
    frames._drive = drive
    rng = np.random.default_rng(0)
    for record in listening.records:
        frames.on_record(record)
        if rng.random() < 0.3:
            drive.convert()
            if (line := drive.frame(rows_shown, (0,))) is not None:
                rows += json.loads(line)["x"]
            rows_shown = drive.row_count
    drive.convert()
    rows += rows_of(drive, rows_shown, (0,))["x"] if drive.row_count > rows_shown else []
    np.testing.assert_allclose(np.ravel(rows), [r.tick.t_ns * 1e-9 for r in listening.records], rtol=1e-6)


def test_rows_lost_by_the_ring_buffer_are_shown_as_a_gap(drive_of_service):
    file, listening, _ = drive_of_service
    drive, frames = DriveRows(file), Frames()
    frames._drive = drive
    for k in range(3 * MAX_STORED_TICKS):
        frames.on_record(listening.records[k % len(listening.records)])
    drive.convert()
    frame = rows_of(drive)
    assert frame["n"] + len(frame["x"]) == drive.row_count == 3 * MAX_STORED_TICKS
    assert len(frame["x"]) <= MAX_STORED_TICKS


def test_progress_grows_over_all_laps_and_across_the_crossing_of_an_eight():
    for route, laps in ((shapes.circle(0.5, 0.3), 3), (shapes.eight(0.5, 0.3), 2)):
        progress, places = RouteProgress(route), []
        for _ in range(laps):
            for x, y in route.eta[::10, :2]:
                places.append(progress.update([x, y + 0.0]))
        s, cross = np.array(places).T
        assert np.all(np.diff(s) > -1e-9)
        assert s[-1] == pytest.approx(laps * progress.length_m, rel=0.02)
        np.testing.assert_allclose(cross, 0.0, atol=1e-6)
    deviation = RouteProgress(shapes.circle(0.5, 0.3)).update([0.0, 0.02])
    assert deviation[1] == pytest.approx(0.02, rel=0.01)


def test_at_most_one_frame_waits_for_a_client_that_does_not_read(door, connect, drive_of_service):
    file, listening, _ = drive_of_service
    door.frames.begin(file, "simulated", estimator=listening.estimator)
    sleeper, healthy = connect(), connect()
    for person in (sleeper, healthy):
        person.send(type="watch", hz=50)
    wait_for(lambda: sum(client.hz > 0 for client in door._clients) == 2)
    count, largest = 0, 0
    for _ in range(150):
        for record in listening.records[:40]:
            door.frames.on_record(record)
        while count < door.frames.drive()[0].tick_count:
            message = healthy.receive()
            count = message["n"] + len(message["x"]) if message["type"] == "frame" else count
        largest = max(largest, *(client.pending_bytes for client in door._clients))
    assert largest < 2 * MAX_STORED_TICKS * 400  # of 6,000 rows of 300 bytes
    assert len(door._clients) == 2
    ends = []
    while not ends or ends[-1] < count:
        message = sleeper.receive()
        if message["type"] == "frame":
            assert message["n"] >= (ends[-1] if ends else 0)
            ends.append(message["n"] + len(message["x"]))
    assert len(ends) < 100


def test_the_last_rows_are_sent_before_the_end_of_the_drive(door, connect, drive_of_service):
    file, listening, _ = drive_of_service
    door.frames.begin(file, "simulated", estimator=listening.estimator)
    person = connect()
    person.send(type="watch", hz=1)
    assert [person.receive()["type"] for _ in range(3)] == ["vehicle", "fields", "route"]
    for turn in range(20):
        door.frames.begin(file, "simulated", estimator=listening.estimator)
        for record in listening.records:
            door.frames.on_record(record)
        door._outbox.extend(
            [{"type": "state", "state": "READY"}, {"type": "done", "id": str(turn), "run": None}]
        )
        door._wake()
        messages = []
        while not messages or messages[-1]["type"] != "done":
            messages.append(person.receive())
        begin = next(k for k, m in enumerate(messages) if m["type"] == "fields")
        assert sum(len(m["x"]) for m in messages[begin:] if m["type"] == "frame") == len(listening.records)


def test_a_watcher_receives_the_vehicle_the_columns_and_then_every_tick(door, connect, drive_of_service):
    file, listening, _ = drive_of_service
    door.frames.begin(file, "simulated", estimator=listening.estimator)
    person, viewer = connect(), connect()
    person.send(type="watch", hz=50, fields=["t", "eta.x", "what there is not"])
    viewer.send(type="watch", hz=5)
    messages = [person.receive() for _ in range(3)]
    assert [m["type"] for m in messages] == ["vehicle", "fields", "route"]
    assert messages[1]["names"] == ["t", "eta.x"]
    assert messages[1]["units"] == ["s", "m"]
    assert [viewer.receive()["type"] for _ in range(3)] == ["vehicle", "fields", "route"]
    for record in listening.records:
        door.frames.on_record(record)
    for client, width in ((person, 2), (viewer, len(DriveRows(file).columns))):
        rows = []
        while len(rows) < len(listening.records):
            frame = client.receive()
            assert (frame["type"], frame["n"]) == ("frame", len(rows))
            rows += frame["x"]
        assert {len(row) for row in rows} == {width}
    door.frames.begin(file, "simulated", estimator=listening.estimator)  # the next drive
    door.frames.on_record(listening.records[0])
    assert [person.receive()["type"] for _ in range(4)] == ["vehicle", "fields", "route", "frame"]
    person.send(type="watch", hz=0)
    person.send(type="ping")
    assert person.receive()["type"] == "pong"
    door.frames.on_record(listening.records[1])
    person.send(type="ping")
    assert person.receive()["type"] == "pong"


def test_a_message_wakes_the_door_and_is_encoded_once(door, connect, monkeypatch):
    encodings, encode_frame = [], sockets.encode

    def encode(message):
        encodings.append(threading.current_thread().name)
        return encode_frame(message)

    monkeypatch.setattr(sockets, "encode", encode)
    monkeypatch.setattr(sockets, "LOOK_S", 1e6)  # without a wake-up nothing arrives
    people = [connect() for _ in range(5)]
    wait_for(lambda: len(door._clients) == 5)
    for k in range(20):
        door.broadcast({"type": "event", "message": k})
        assert [person.receive()["message"] for person in people] == [k] * 5
    assert encodings == ["door"] * 20  # and not in the thread of the loop


@pytest.mark.parametrize("hz", ["a", None, [], float("nan")])
def test_a_watch_with_a_wrong_rate_does_not_end_the_connection(connect, hz):
    person = connect()
    person.send(type="watch", hz=hz)
    person.send(type="ping", token=1)
    message = person.receive()
    assert message["type"] in ("refused", "pong")
    if message["type"] == "refused":
        assert person.receive()["token"] == 1


def test_the_limit_of_a_room_surrounds_the_pose_at_which_the_route_begins():
    """The room is 2 m × 4 m for the centre; the vehicle starts 0.5 m in front of its middle, and looks along y."""
    route = shapes.circle(0.5, 0.3)
    along_y = route._replace(eta=route.eta - route.eta[0] + np.array([10.0, 0.0, np.pi / 2]))
    room = {"free": [1.0, 2.0], "start": [0.5, 0.0, 0.0]}
    limit = route_description(along_y, room=room)["room"]
    assert np.allclose(limit["x"], [8.0, 8.0, 12.0, 12.0, 8.0])
    assert np.allclose(limit["y"], [0.5, -1.5, -1.5, 0.5, 0.5])
    assert "room" not in route_description(route)
