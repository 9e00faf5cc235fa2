"""Run the service of a simulated vehicle, like robot/service, with a simulation instead of the hardware.

  idle       a waiting mission begins once the vehicle is READY
  mission    the loop of loop.py in wall time, at a pace (pace.py), recorded in a run on disk

The service accepts the messages of the door, and further messages for a simulation: pause, go {ticks}, pace {factor},
routes, shake, again (fault_requests.py).
"""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.door.frames.descriptions import state_description
from baqueano.door.frames.rows import Frames
from baqueano.door.mission.gain_changes import ChangeObserver
from baqueano.door.mission.observer import MissionObserver
from baqueano.door.mission.outcome import mission_outcome
from baqueano.door.operator import STOP_COMMAND, Operator
from baqueano.door.simulated.fault_requests import FaultRequests
from baqueano.door.simulated.missions import MissionPlan, StoredRoutes, mission_plan, reload_if_changed
from baqueano.door.simulated.pace import PacedClock
from baqueano.door.states import DoorState, StateMachine
from baqueano.drive.mission import perform
from baqueano.drive.tasks import run_route
from baqueano.errors import BaqueanoError, SafetyStop
from baqueano.loop import Blocks, Record
from baqueano.messages import templates
from baqueano.runs import read_run
from baqueano.runs.folder import release_path, reserve_path
from baqueano.runs.route_file import write_route
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.units import channel_units
from baqueano.worlds import FaultyWorld

Handler = Callable[[object, JsonObject], JsonObject | None]
IDLE_S, STATE_PERIOD_S = 0.02, 0.2


@dataclass
class SimulatedService:
    """The service of the vehicle `vehicle_file`. Its body is simulated with `truth`. `broadcast` sends a message to
    all clients."""

    vehicle_file: VehicleFile
    truth: VehicleFile
    folder: Path  # folder of the runs
    routes: StoredRoutes
    seed: int = 0  # seed of the first drive; each later drive adds 1
    backend: str = "auto"
    operator: Operator = field(default_factory=Operator)
    pace: PacedClock = field(default_factory=PacedClock)
    broadcast: Callable[[JsonObject], None] = lambda message: None
    frames: Frames = field(default_factory=Frames)

    def __post_init__(self) -> None:
        templates()
        self.machine, self.done = StateMachine(), threading.Event()
        self._drives = 0
        self._plan: MissionPlan | None = None
        self._run: str | None = None  # name of the run that is being written
        self._observer: _DriveObserver | None = None  # of the present drive
        self._published_s = float("-inf")
        self.fault_requests = FaultRequests(self.operator, lambda message: self.broadcast(message))

    def handlers(self) -> dict[str, Handler]:
        """Return the handlers of the messages that only a simulation accepts."""
        return {
            "pause": lambda client, request: self._call_for_holder(client, self.pace.pause),
            "go": lambda client, request: self._call_for_holder(client,
            lambda: self.pace.resume(int(request.get("ticks", 0)))),
            "pace": lambda client, request: self._call_for_holder(client,
            lambda: self.pace.set_pace(float(request["factor"]))),
            "routes": lambda client, request: {"type": "routes", "routes": self.routes.rows()},
            "shake": lambda client, request: self._call_for_holder(client, lambda: self.fault_requests.handle(request)),
            "again": lambda client, request: self._call_for_holder(
                client, lambda: self.fault_requests.repeat_mission(client, request)
            ),
        }  # fmt: skip

    def run(self) -> None:
        """Run until `done` is set."""
        self.frames.begin(self.vehicle_file, "simulated", self.seed)
        while not self.done.is_set():
            self.idle()
            next_mission = self.operator.pop_mission()
            if next_mission is not None:
                mission, is_attended, name = next_mission
                self.execute_request(mission, attended=is_attended, name=name)
            else:
                time.sleep(IDLE_S)

    def idle(self) -> None:
        """Handle stop and clear requests while no mission is driven, and update the state."""
        machine = self.machine
        is_clear_requested, self.operator.is_clear_requested = self.operator.is_clear_requested, False
        if (stop_reason := self.operator.stop_reason(attended=False)) is not None:
            self.operator.discard_requests(stop_reason)
            machine.transition("stop", stop_reason)
        elif is_clear_requested and machine.state is DoorState.STOPPED:
            machine.transition("clear", stop(StopReason.CHECKED_AGAIN))
        elif machine.state is DoorState.DISARMED:
            machine.transition("ready")
        self.send_state()

    def execute_request(self, mission_json: str, *, attended: bool, name: str = "") -> None:
        """Execute a mission in JSON, and report its end under this name; its errors do not end the service."""
        self._drives += 1
        outcome: JsonObject = {"type": "done", "id": name, "run": None}
        reason, code = mission_outcome(lambda: self._drive_mission(mission_json, outcome, attended=attended))
        self._plan = self._run = self._observer = None
        self.send_state(at_once=True)
        self.operator.record_mission_end()
        self.broadcast({"reason": reason, "code": code} | outcome)
        self.fault_requests.queue_repetition()

    def _drive_mission(self, mission_json: str, outcome: JsonObject, *, attended: bool) -> None:
        """Execute a mission until it ends or is stopped, and write the result into `outcome`."""
        self.vehicle_file = reload_if_changed(self.vehicle_file)
        with mission_plan(mission_json, self.vehicle_file, self.routes, self.seed + self._drives - 1) as plan:
            path = reserve_path(self.folder, plan.mission.kind)
            try:
                self.machine.transition("manual" if plan.mission.is_manual else "mission")
                self._plan, self._run = plan, path.name
                self.send_state(at_once=True)
                reason, code = mission_outcome(
                    lambda: self._drive(plan, mission_json, path, attended=attended)
                )
                stop_reason = self.machine.finish_mission(self.operator, reason, code)
                outcome |= {"run": path.name if path.exists() else None, "reason": reason, "code": code}
                if plan.route_name and stop_reason is None and not code and path.exists():
                    outcome |= self._store_taught_route(plan, path)
            finally:
                release_path(path)

    def _drive(
        self, plan: MissionPlan, mission_json: str, path: Path, *, attended: bool
    ) -> Diagnostic | None:
        """Execute a plan, and return the reason of the stop, or None if the vehicle was not stopped."""
        truth, start_pose = self.truth, plan.start
        seed = self.seed if plan.seed is None else plan.seed
        world = FaultyWorld(
            truth.vehicle, truth.sensors, truth.rate_hz, seed, start_pose, self.backend, plan.faults,
            channel_units(truth),
        )  # fmt: skip
        self.operator.pop_mark_count()  # drop marks from before this drive
        self._observer = observer = _DriveObserver(self, plan, world, attended=attended)
        observers = (
            observer,
            ChangeObserver(self.operator, self.broadcast, plan.mission.blocks),
            self.fault_requests.begin(plan, world, mission_json, attended),
        )
        return observer.watch(
            lambda: perform(
                plan.mission, plan.vehicle_file, hand=lambda: self.operator.command(world.commands), world=world,
                live=True, path=path, tick_times_ns=self._ticks(plan, attended=attended),
                observers=observers, eta=start_pose, seed=seed, backend=self.backend,
            )
        )  # fmt: skip

    def _ticks(self, plan: MissionPlan, *, attended: bool) -> Iterator[int]:
        def is_interrupted() -> bool:
            self.send_state()
            return self.operator.is_end_requested or self.operator.stop_reason(attended=attended) is not None

        for t_ns in self.pace.ticks(plan.vehicle_file.rate_hz, is_interrupted, plan.fast_until_s):
            if self.operator.is_end_requested:
                raise KeyboardInterrupt
            yield t_ns
            self.send_state()

    def _store_taught_route(self, plan: MissionPlan, path: Path) -> JsonObject:
        """Store the route of a mission of kind "teach"; return {route}, its name, or {reason, code} after a failure."""
        try:
            write_route(run_route(read_run(path), closed=plan.closed), self.routes.path(plan.route_name))
        except BaqueanoError as error:
            return {"reason": error.diagnostic, "code": error.exit_code}
        return {"route": plan.route_name}

    def send_event(self, level: str, event: Diagnostic) -> None:
        """Send an event to all clients."""
        self.broadcast({"type": "event", "level": level, "message": event})

    def send_state(self, *, at_once: bool = False) -> None:
        """Send the state to all clients, if `at_once` or if the last state was sent at least STATE_PERIOD_S ago."""
        now_s = time.monotonic()
        if not at_once and now_s - self._published_s < STATE_PERIOD_S:
            return
        self._published_s, mission = now_s, None if self._plan is None else self._plan.mission
        record = None if self._observer is None else self._observer.record
        self.broadcast(
            state_description(
                "simulated", self.machine.state, self.machine.reason, self._run, mission, record
            )
            | {"pace": self.pace.factor, "paused": self.pace.paused}
        )

    def end(self) -> None:
        """Stop the vehicle, and end the service; callable from any thread and from a signal handler."""
        self.operator.stop(stop(StopReason.SERVICE_ENDED))
        self.done.set()

    def _call_for_holder(self, client: object, act: Callable[[], object]) -> None:
        """Call `act` on request of the holder, or of any client while no mission is in progress.

        Raise SafetyStop otherwise.
        """
        if self.operator.is_busy and not self.operator.is_holder(client):
            raise SafetyStop(note("door.other-driver", Severity.ERROR, STOP_COMMAND))
        act()
        self.send_state(at_once=True)


class _DriveObserver(MissionObserver):
    """An observer that also passes the ticks of a drive to the clients."""

    def __init__(
        self, service: SimulatedService, plan: MissionPlan, world: FaultyWorld, *, attended: bool
    ) -> None:
        super().__init__(service.operator, service.send_event, attended=attended)
        self._service, self._plan, self._world = service, plan, world

    def begin(self, blocks: Blocks) -> Blocks:
        plan, frames = self._plan, self._service.frames
        frames.begin(plan.vehicle_file, "simulated", plan.seed, blocks.estimator, plan.mission, plan.name)
        return blocks

    def on_record(self, record: Record) -> None:
        super().on_record(record)
        self._service.frames.on_record(record, self._world.truth, late_ms=self._service.pace.late_ms)
