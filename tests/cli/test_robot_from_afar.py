"""Commands that connect to the door: an unconfirmed stop is not reported as STOPPED, and a fetched run is complete."""

from typing import Any

import pytest

from baqueano.diagnostics import StopReason
from baqueano.door import remote
from baqueano.door.operator import Operator
from baqueano.door.sockets import Door


class Stoppable(Operator):
    """An operator whose vehicle reports STOPPED directly after a stop."""

    door: Any = None

    def stop(self, reason):
        super().stop(reason)
        self.door.broadcast({"type": "state", "state": "STOPPED", "reason": reason})


@pytest.fixture(params=[Operator])
def door(request, tmp_path, until_end):
    operator = request.param()
    operator.door = until_end(Door(tmp_path / "s", operator, tmp_path))
    return operator.door


@pytest.mark.parametrize("door", [Stoppable], indirect=True)
def test_a_confirmed_stop_is_reported_as_stopped(baqueano, door):
    door.broadcast({"type": "state", "state": "MISSION", "reason": None})
    end = baqueano("robot", "stop", str(door.path))
    assert (end.code, end.out) == (0, f"{door.path}: STOPPED\n")
    assert end.err.endswith(f"baqueano robot clear {door.path}\n")
    status = baqueano("robot", "status", str(door.path))
    assert status.err.endswith(f"baqueano robot clear {door.path}\n")


@pytest.mark.parametrize(
    "last",
    [{"type": "state", "state": "MISSION", "reason": None}, {"type": "event"}],
    ids=["preparing", "starting"],
)
def test_an_unconfirmed_stop_is_not_reported_as_stopped(baqueano, door, last, monkeypatch):
    monkeypatch.setattr(remote, "STOP_TIMEOUT_S", 0.0)
    door.broadcast(last)
    end = baqueano("robot", "stop", str(door.path))
    assert door.operator.stop_reason(attended=False).code == StopReason.STOPPED_BY_COMMAND
    assert end.code == 1
    assert (end.reason.code, end.reason.figures["limit_s"]) == ("remote.stop-not-reached", 0.0)
    assert f"baqueano robot status {door.path}" in end.paragraph


def test_an_empty_run_file_does_not_stop_the_fetch(baqueano, door, tmp_path):
    folder = tmp_path / "here"
    (tmp_path / "1.mcap").touch()
    (tmp_path / "2.mcap").write_bytes(b"whole")
    (tmp_path / "3.mcap").write_bytes(b"ha")
    door.broadcast({"type": "state", "state": "MISSION", "reason": None, "run": "3.mcap"})
    assert baqueano("robot", "runs", str(door.path), "--fetch", "--runs", str(folder)).code == 0
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == {"1.mcap": b"", "2.mcap": b"whole"}
    (tmp_path / "3.mcap").write_bytes(b"half, and the other half")
    door.broadcast({"type": "state", "state": "READY", "reason": None, "run": None})
    assert baqueano("robot", "runs", str(door.path), "--fetch", "--runs", str(folder)).code == 0
    assert (folder / "3.mcap").read_bytes() == b"half, and the other half"


def test_a_run_of_another_vehicle_with_the_same_name_is_kept_and_named(baqueano, door, tmp_path):
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "1.mcap").write_bytes(b"of another vehicle")
    (tmp_path / "1.mcap").write_bytes(b"of this vehicle")
    door.broadcast({"type": "state", "state": "READY", "reason": None, "run": None})
    for _ in range(2):
        end = baqueano("robot", "runs", str(door.path), "--fetch", "--runs", str(folder))
        assert (end.code, end.out) == (0, f"1.mcap  {folder / '1-2.mcap'}\n")
    contents = {p.name: p.read_bytes() for p in folder.iterdir()}
    assert contents == {"1.mcap": b"of another vehicle", "1-2.mcap": b"of this vehicle"}
