"""`baqueano robot stop`: said before anything is heard; what was not seen STOPPED is not called STOPPED."""

import socket
from typing import Any

import pytest

from baqueano.robot import remote
from baqueano.robot.operator import Operator
from baqueano.robot.sockets import Door

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
def test_a_vehicle_that_was_seen_stopped_is_told_so(baqueano, door):
    door.tell({"is": "state", "state": "MISSION", "why": ""})
    end = baqueano("robot", "stop", str(door.path))
    assert (end.code, end.out) == (0, f"{door.path}: STOPPED\n")


@pytest.mark.parametrize(
    "last", [{"is": "state", "state": "MISSION", "why": ""}, {"is": "event"}], ids=["preparing", "starting"]
)
def test_a_vehicle_that_tells_nothing_just_now_hears_a_stop_and_is_not_called_stopped(
    baqueano, door, last, monkeypatch
):
    monkeypatch.setattr(remote, "STOP_S", 0.0)
    door.tell(last)
    end = baqueano("robot", "stop", str(door.path))
    assert door.operator.why(attended=False) == "stopped with baqueano robot stop"
    assert end.code == 1
    assert "heard the stop, and was not seen STOPPED" in end.paragraph
    assert f"baqueano robot status {door.path}" in end.paragraph
