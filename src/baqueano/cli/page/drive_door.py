"""Serve a page in the process of a subcommand: the page receives the drives as from the service of a vehicle.

here     the loop runs in this process, in wall time, and shows each tick                        (`local_options`)
there    a robot drives: its messages are sent to the page, and the page's stop to the robot     (`remote_options`)
"""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from baqueano.contracts.blocks import World
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, fault, note
from baqueano.door.frames.descriptions import state_description
from baqueano.door.mission.gain_changes import ChangeObserver
from baqueano.door.operator import Operator
from baqueano.door.simulated.pace import PacedClock
from baqueano.door.sockets import Door
from baqueano.door.states import DoorState
from baqueano.drive.interrupt import is_default_handler
from baqueano.drive.observers import EventLine, Observer
from baqueano.drive.session import Conditions
from baqueano.errors import RobotUnreachable, SafetyStop
from baqueano.loop import Blocks, Record
from baqueano.messages.printable import baqueano_command
from baqueano.signals import Motion
from baqueano.vehicle_file.file import VehicleFile

if TYPE_CHECKING:
    from baqueano.door.remote import Remote
    from baqueano.drive.mission import Mission

SEND_PERIOD_S = 0.2  # between states
PAGE_RATE_HZ = 20.0  # frames of a robot
RELAY_TYPES = ("vehicle", "fields", "route", "frame", "state", "event")
PACE = "guide.pace"  # 0 if the vehicle waits on its route
TIME_FIELDS = ("pace", "paused")  # of a simulation: the page of a subcommand does not set the time of a robot
MANUAL_MISSIONS = ("drive", "teach")


class BodyWorld(World, Protocol):
    """A simulated or emulated world with a body."""

    @property
    def truth(self) -> Motion:
        """Return the true motion of the body."""
        ...


class DriveDoor:
    """The connection of one subcommand to the page. With `is_manual`, a person drives from the page, and begins."""

    def __init__(
        self, file: VehicleFile, world: str, folder: Path, pace: float = 1.0, is_manual: bool = False
    ) -> None:
        self.operator, self.pace, self.is_manual = Operator(), PacedClock(pace), is_manual
        self.listens, self.visited = threading.Event(), threading.Event()
        self._file, self._world = file, world
        self._state, self._reason = DoorState.READY, None
        self._mission: Mission | None = None
        self._record: Record | None = None
        self._published_s = float("-inf")
        self._robot: Remote | None = None
        words = {
            "viewers": self._on_viewers,
            "routes": lambda client, message: {"type": "routes", "routes": []},
        }
        for do in ("pause", "go", "pace"):
            words[do] = self._on_time
        self._door = Door(None, self.operator, folder, words | {"stop": self._on_stop, "set": self._on_set})
        self.frames = self._door.frames
        self.frames.begin(file, world)
        self.publish(at_once=True)

    def welcome(self, line: socket) -> None:
        """Add `line`, the connection of the page."""
        self._door.add_client(line)

    def close(self, reason: Diagnostic) -> None:
        """Report that the drives have ended, and disconnect the page."""
        self._door.broadcast({"type": "over", "reason": reason})
        self._door.close()

    def wait_for_hand(self, is_running: Callable[[], bool]) -> None:
        """Wait until a person begins a manual drive on the page.

        Requests for other missions are refused. Raise RobotUnreachable once `is_running` returns False.
        """
        while is_running():
            request = self.operator.pop_mission()
            if request is None:
                time.sleep(SEND_PERIOD_S / 10)
                continue
            if json.loads(request[0]).get("kind") in MANUAL_MISSIONS:
                return
            self.operator.record_mission_end()
            self._end(request[2], fault("cli.page-manual"), SafetyStop.exit_code)
        raise RobotUnreachable.of("cli.page-ended")

    def local_options(self, mission: "Mission", file: VehicleFile, mission_options: JsonObject) -> JsonObject:
        """Return the options of a drive in this process. With them the page shows the drive and sets its pace."""
        mission_options = ({"eta": mission.start_pose} if mission.kind == "repeat" else {}) | mission_options
        if "world" not in mission_options:
            world_options = ("truth", "seed", "eta", "backend")
            mission_options["world"] = Conditions(
                **{k: mission_options[k] for k in world_options if k in mission_options}
            ).make_world(file)
        page_observer = _PageObserver(self, mission, file, cast(BodyWorld, mission_options["world"]))
        mission_options["observers"] = (
            *mission_options.get("observers", ()),
            page_observer,
            ChangeObserver(self.operator, self._door.broadcast),
        )
        mission_options["tick_times_ns"] = self._ticks(file.rate_hz, mission_options.get("tick_times_ns"))
        return mission_options

    def hand(self, commands: int) -> np.ndarray:
        """Return the command (n,) that the page requests. Raise KeyboardInterrupt if the page has ended the drive."""
        if self.operator.is_end_requested:
            raise KeyboardInterrupt
        return self.operator.command(commands)

    def remote_options(self, remote: "Remote") -> JsonObject:
        """Return the options of `Remote.perform` for the drive of a robot. With them the page shows the drive."""
        self._robot, remote.on_message = remote, self._relay
        is_watching, is_stopped = False, False

        def words() -> list[JsonObject]:
            nonlocal is_watching, is_stopped
            replies: list[JsonObject] = [] if is_watching else [{"type": "watch", "hz": PAGE_RATE_HZ}]
            replies += [{"type": "mark"}] * self.operator.pop_mark_count()
            if self.operator.is_end_requested:
                raise KeyboardInterrupt
            stop_reason = self.operator.stop_reason(attended=self.is_manual)
            if stop_reason is not None and not is_stopped:
                is_stopped = True
                replies.append({"type": "stop", "reason": stop_reason})
            is_watching = True
            return replies

        return {"words": words}

    def publish(self, *, at_once: bool = False) -> None:
        """Send the state to the page, if `at_once` or if the last state was sent at least SEND_PERIOD_S ago."""
        now_s = time.monotonic()
        if not at_once and now_s - self._published_s < SEND_PERIOD_S:
            return
        self._published_s = now_s
        pace_fields = {} if self._world == "real" else {"pace": self.pace.factor, "paused": self.pace.paused}
        self._door.broadcast(
            state_description(self._world, self._state, self._reason, None, self._mission, self._record)
            | pace_fields
        )

    def drives(self, mission: "Mission | None", reason: Diagnostic | None = None) -> None:
        """Record that a drive begins, or that it has ended if `mission` is None."""
        self._mission = None if mission is None else mission.with_durations(self._file)
        self._record, self._reason = None, reason
        if mission is None:
            self._state = DoorState.READY if reason is None else DoorState.STOPPED
        else:
            self._state = DoorState.MANUAL if mission.is_manual else DoorState.MISSION
        self.publish(at_once=True)

    def on_record(self, record: Record, truth: Motion) -> None:
        """Show a tick of a drive in this process on the page."""
        self._record = record
        self.frames.on_record(record, truth, late_ms=self.pace.late_ms)

    def _ticks(self, rate_hz: float, tick_times_ns: Iterator[int] | None) -> Iterator[int]:
        def is_interrupted() -> bool:
            self.publish()
            operator = self.operator
            # the last: Ctrl-C was pressed
            return (
                operator.is_end_requested
                or operator.stop_reason(attended=self.is_manual) is not None
                or is_default_handler()
            )

        for t_ns in self.pace.ticks(rate_hz, is_interrupted):
            if self.operator.is_end_requested:
                raise KeyboardInterrupt
            yield t_ns if tick_times_ns is None else next(tick_times_ns)
            self.publish()

    def _relay(self, message: JsonObject) -> None:
        if message["type"] in RELAY_TYPES:
            self._door.broadcast({name: value for name, value in message.items() if name not in TIME_FIELDS})

    def _on_viewers(self, client: object, message: JsonObject) -> None:
        """Record that the page is listening, and the number of its viewers."""
        # reserves the operator: missions of the page are refused
        if not self.listens.is_set() and not self.is_manual:
            with suppress(SafetyStop):
                self.operator.queue_mission(client, "", attended=False)
                self.operator.pop_mission()
        self.listens.set()
        if int(message["count"]) > 0:
            self.visited.set()

    def _on_stop(self, client: object, message: JsonObject) -> JsonObject:
        reason = Diagnostic.from_json(message["reason"])
        if self._robot is not None:  # at once, from this thread
            self._robot.send(type="stop", reason=reason)
        else:
            self.operator.stop(reason)
        return {"type": "received", "request": "stop"}

    def _on_set(self, client: object, message: JsonObject) -> JsonObject:
        if self._robot is None:
            self.operator.set_gain(client, str(message["path"]), message["value"])
        elif message["path"] == PACE:
            self._robot.send(type="set", path=PACE, value=float(message["value"]))
        else:
            raise SafetyStop(
                note("cli.page-set", Severity.ERROR, baqueano_command("serve", "--robot", self._robot.name))
            )
        return {"type": "received", "request": "set"}

    def _on_time(self, client: object, message: JsonObject) -> None:
        if self._robot is not None:
            raise SafetyStop(note("cli.page-time", Severity.ERROR))
        match message["type"]:
            case "pause":
                self.pace.pause()
            case "go":
                self.pace.resume(int(message.get("ticks", 0)))
            case _:
                self.pace.set_pace(float(message["factor"]))
        self.publish(at_once=True)

    def _end(self, name: str, reason: Diagnostic, code: int) -> None:
        self._door.broadcast({"type": "done", "id": name, "run": None, "reason": reason, "code": code})


class _PageObserver(Observer):
    """The observer that sends a drive to the page."""

    def __init__(self, door: DriveDoor, mission: "Mission", file: VehicleFile, world: BodyWorld) -> None:
        self._door, self._mission, self._file, self._world = door, mission, file, world

    def begin(self, blocks: Blocks) -> Blocks:
        door, mission = self._door, self._mission
        door.frames.begin(self._file, door._world, None, blocks.estimator, mission)
        door.drives(mission)
        return blocks

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        return self._door.operator.stop_reason(attended=self._door.is_manual)

    def pop_mark_count(self) -> int:
        return self._door.operator.pop_mark_count()

    def on_record(self, record: Record) -> None:
        self._door.on_record(record, self._world.truth)

    def end(self, reason: Diagnostic | None) -> list[EventLine]:
        self._door.drives(None, reason)
        return []
