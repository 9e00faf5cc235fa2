"""The verbs that talk to the door: what was not seen STOPPED is not called STOPPED, what is here of a run is whole."""

import socket
from typing import Any

import pytest

from baqueano.diagnostics import StopReason
from baqueano.door import remote
from baqueano.door.operator import Operator
from baqueano.door.sockets import Door

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="this system has no sockets in files")


class Stoppable(Operator):
    """One whose vehicle says STOPPED as soon as it is stopped."""

    door: Any = None

    def stop(self, why):
        super().stop(why)
        self.door.tell({"is": "state", "state": "STOPPED", "why": why})


@pytest.fixture(params=[Operator])
def door(request, tmp_path):
    operator = request.param()
    door = Door(tmp_path / "s", operator, tmp_path)
    operator.door = door
    yield door
    door.close()


@pytest.mark.parametrize("door", [Stoppable], indirect=True)
def test_a_vehicle_that_was_seen_stopped_is_reported_so(baqueano, door):
    door.tell({"is": "state", "state": "MISSION", "why": None})
    end = baqueano("robot", "stop", str(door.path))
    assert (end.code, end.out) == (0, f"{door.path}: STOPPED\n")


@pytest.mark.parametrize(
    "last", [{"is": "state", "state": "MISSION", "why": None}, {"is": "event"}], ids=["preparing", "starting"]
)
def test_a_vehicle_that_tells_nothing_just_now_hears_a_stop_and_is_not_called_stopped(
    baqueano, door, last, monkeypatch
):
    monkeypatch.setattr(remote, "STOP_S", 0.0)
    door.tell(last)
    end = baqueano("robot", "stop", str(door.path))
    assert door.operator.stop_reason(attended=False).code == StopReason.STOPPED_BY_COMMAND
    assert end.code == 1
    assert "confirmed the stop, but did not reach the state STOPPED" in end.paragraph
    assert f"baqueano robot status {door.path}" in end.paragraph


def test_runs_are_fetched_whole_also_behind_one_without_a_byte(baqueano, door, tmp_path):
    folder = tmp_path / "here"
    (tmp_path / "1.mcap").touch()
    (tmp_path / "2.mcap").write_bytes(b"whole")
    (tmp_path / "3.mcap").write_bytes(b"ha")
    door.tell({"is": "state", "state": "MISSION", "why": None, "run": "3.mcap"})
    assert baqueano("robot", "runs", str(door.path), "--fetch", "--runs", str(folder)).code == 0
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == {"1.mcap": b"", "2.mcap": b"whole"}
    (tmp_path / "3.mcap").write_bytes(b"half, and the other half")
    door.tell({"is": "state", "state": "READY", "why": None, "run": None})
    assert baqueano("robot", "runs", str(door.path), "--fetch", "--runs", str(folder)).code == 0
    assert (folder / "3.mcap").read_bytes() == b"half, and the other half"
