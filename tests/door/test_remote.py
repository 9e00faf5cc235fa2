"""The connection from the laptop to the vehicle: the end of another client's drive does not end this client's drive."""

import threading
import time

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import Severity, note
from baqueano.door.operator import Operator
from baqueano.door.remote import STOP_REQUEST, connect
from baqueano.door.sockets import Door
from baqueano.door.wire import decode, encode
from baqueano.drive.mission import Mission, pack
from baqueano.errors import SafetyStop, UsageError
from baqueano.runs import Run, write_run
from baqueano.worlds.silent_encoders import FIX

PATIENCE_S = 60.0  # timeout of the test


class Vehicle:
    """A door, and an operator that answers each mission with the result of `drives` for its id."""

    def __init__(self, folder):
        self.folder, self.operator = folder, Operator()
        self.door = Door(folder / "door", self.operator, folder)
        self.door.broadcast({"type": "state", "state": "READY", "reason": None})
        self.drives, self.requested = lambda name: [], threading.Event()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def run(self, name, ticks):
        """Write a run in its folder."""
        write_run(Run(name, None, np.arange(ticks), np.zeros((ticks, 3))), self.folder / f"{name}.mcap")
        return f"{name}.mcap"

    def done(self, run, **name):
        return {"type": "done", "run": run, "reason": None, "code": 0, **name}

    def _work(self):
        while not self._done.wait(0.005):
            if (waiting := self.operator.pop_mission()) is not None:
                for message in self.drives(waiting[2]):
                    self.door.broadcast(message)

    def close(self):
        self._done.set()
        self._thread.join()
        self.door.close()


@pytest.fixture
def vehicle(tmp_path, until_end):
    return until_end(Vehicle(tmp_path))


@pytest.fixture
def mission():
    return pack(Mission("experiment", u=np.zeros((100, 3))), vehicle_file.load("small"))


def test_a_pause_that_arrives_after_the_drive_does_not_hide_its_end(vehicle, mission, tmp_path):
    run, message = vehicle.run("mine", 5), note("door.not-holder", Severity.ERROR)
    vehicle.drives = lambda name: [
        {"type": "refused", "reason": "", "diagnostic": message, "code": 5}, vehicle.done(run, id=name),
    ]  # fmt: skip
    with connect(str(vehicle.door.path)) as remote:
        assert len(remote.perform(mission, tmp_path / "run.mcap").t_ns) == 5


def test_a_command_advised_by_a_service_at_a_socket_contains_its_path(vehicle, mission, tmp_path):
    busy = note("door.other-driver", Severity.ERROR, "baqueano robot stop HOST")
    refusal = note("door.state", Severity.ERROR, state="STOPPED", advice=busy)
    vehicle.drives = lambda name: [{"type": "refused", "reason": "", "diagnostic": refusal, "code": 5}]
    with connect(str(vehicle.door.path)) as remote, pytest.raises(SafetyStop) as error_info:
        remote.perform(mission, tmp_path / "run.mcap")
    advice = note("door.other-driver", Severity.ERROR, f"baqueano robot stop {vehicle.door.path}")
    assert error_info.value.diagnostic.figures["advice"] == advice


def test_a_client_ignores_the_end_of_another_clients_drive(vehicle, mission, tmp_path):
    foreign, own_run = vehicle.run("theirs", 3), vehicle.run("mine", 5)
    vehicle.drives = lambda name: [vehicle.done(foreign, id="another"), vehicle.done(own_run, id=name)]
    with connect(str(vehicle.door.path)) as remote:
        vehicle.door.broadcast({"type": "event", "level": "info", "message": note("imu.answers")})
        vehicle.door.broadcast(vehicle.done(foreign, id="another"))  # before this drive begins
        remote.send(type="ping", token=1)
        end = time.monotonic() + PATIENCE_S
        while remote.inbox.qsize() < 3:
            assert time.monotonic() < end
            time.sleep(0.005)
        events = []
        run = remote.perform(mission, tmp_path / "here.mcap", on_event=events.append)
        assert len(run.t_ns) == 5
        assert events == []


@pytest.mark.parametrize("message", [{"type": "pong"}, {"type": "refused", "reason": "x", "diagnostic": 5}])
def test_a_malformed_message_during_a_drive_is_ignored(vehicle, mission, tmp_path, message):
    run = vehicle.run("mine", 5)
    vehicle.drives = lambda name: [message, vehicle.done(run, id=name)]
    with connect(str(vehicle.door.path)) as remote:
        assert len(remote.perform(mission, tmp_path / "here.mcap").t_ns) == 5


@pytest.mark.parametrize("version", [None, 3, 5])
def test_a_vehicle_with_another_version_is_refused_before_the_drive(vehicle, mission, tmp_path, version):
    with connect(str(vehicle.door.path)) as remote:
        remote.state.pop("door")
        remote.state |= {} if version is None else {"door": version}
        with pytest.raises(UsageError) as error_info:
            remote.perform(mission, tmp_path / "here.mcap")
    about = error_info.value.diagnostic
    assert (about.code, about.figures["laptop_protocol"]) == ("door.version-of-robot", 4)
    assert about.fix.startswith("baqueano robot setup ")
    assert vehicle.operator.pop_mission() is None


@pytest.mark.parametrize(
    ("line", "message"),
    [(b'{"is": "received", "do": "stop"}', {"type": "received", "request": "stop"}),
     (b'{"is": "state", "state": "STOPPED"}', {"type": "state", "state": "STOPPED"})],
)  # fmt: skip
def test_a_message_of_a_vehicle_with_an_earlier_version_is_decoded(line, message):
    assert decode(line) == message
    assert STOP_REQUEST["do"] == STOP_REQUEST["type"] == "stop"  # which such a vehicle accepts


@pytest.mark.parametrize(
    ("address", "fix"), [("pi@rover", "baqueano robot settings pi@rover --encoders none"),
                         ("", "baqueano robot settings --encoders none")],
)  # fmt: skip
def test_a_command_advised_by_a_vehicle_contains_its_address(address, fix):
    line = encode({"type": "event", "message": note("encoders.both-silent", Severity.WARNING, FIX)})
    message = decode(line, address)
    assert message is not None
    assert message["message"].fix == fix
