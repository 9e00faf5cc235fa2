"""Run the service on the vehicle: it monitors the hardware, executes missions, and stops the vehicle at any fault.

    idle    telemetry, IMU and health are checked at IDLE_HZ; a waiting mission begins when the vehicle is READY
    mission the loop of loop.py at the rate of the vehicle file, by a monotonic clock, recorded in a run on disk
    watch   at each tick: the link and the firmware, health, the operator, systemd's watchdog

One thread runs the loop. Other threads read the Uno, serve the clients and write the run, and cannot delay it. After a
power cut at most the last second of the run is missing. A full disk ends the recording, but the drive continues.
"""

import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from baqueano.contracts.time_limit import PREPARE_S, within
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.door.frames.descriptions import state_description
from baqueano.door.frames.rows import Frames
from baqueano.door.mission.gain_changes import ChangeObserver
from baqueano.door.mission.outcome import mission_outcome
from baqueano.door.operator import Operator
from baqueano.door.states import DoorState, StateMachine
from baqueano.drive.mission import Mission, perform, unpack
from baqueano.errors import BaqueanoError, FileError
from baqueano.messages import templates, text
from baqueano.robot.service.configuration import configure_body, firmware_config
from baqueano.robot.service.hardware_observer import HardwareObserver
from baqueano.robot.service.health import ComputerHealth
from baqueano.robot.service.imu_upkeep import ImuUpkeep
from baqueano.robot.service.journal import Journal
from baqueano.robot.uno.link import Uno
from baqueano.signals import NANOSECONDS, sensor_slots
from baqueano.vehicle_file.head import Hardware
from baqueano.worlds import Robot, clock
from baqueano.worlds.robot import Body

HANG_TIMEOUT_S = 2.0  # after this time without a tick or an idle check, systemd starts the service again
PREPARE_TIMEOUT_S = PREPARE_S + 10.0  # the same while a mission is loaded and compiled
FIND_TIMEOUT_S = 30.0  # the same while the service searches for an IMU
IDLE_HZ, TELL_HZ = 20.0, 5.0
Broadcast = Callable[[JsonObject], None]


@dataclass
class Service:
    """The service: its hardware, the operator's mailbox, and the state. `broadcast` sends a message to all clients."""

    uno: Uno
    imu: ImuUpkeep
    hardware: Hardware  # [robot] of the vehicle file of this vehicle
    folder: Path  # folder of the runs
    operator: Operator = field(default_factory=Operator)
    broadcast: Broadcast = lambda message: None
    frames: Frames = field(default_factory=Frames)
    notify_watchdog: Callable[[], object] = lambda: None  # notifies systemd's watchdog
    set_watchdog_timeout: Callable[[float], object] = lambda seconds: None  # of systemd
    now_ns: Callable[[], int] = time.monotonic_ns
    sleep: Callable[[float], object] = time.sleep
    log: Callable[[str], object] = lambda line: None  # writes into the system's log

    def __post_init__(self) -> None:
        templates()  # read from the disk now, not in a tick that stops the vehicle
        self.machine, self.done = StateMachine(), threading.Event()
        self.health = ComputerHealth(self.hardware, self.folder, self.now_ns)
        self._world = self._idle_world()
        self._published_ns = 0
        self._mission: Mission | None = None
        self._run: str | None = None  # name of the run that is being written
        self._clearing = False  # the operator has cleared the stop, and the Uno is still latched
        self.journal = Journal(self.folder)
        if (unfinished_mission := self.journal.unfinished_mission()) is not None:
            self.log(text(unfinished_mission))
            self.operator.stop(unfinished_mission)

    def run(self) -> None:
        """Run until `done` is set, or until SIGTERM if it runs in the main thread."""
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, lambda number, frame: self._close_hardware())
        while not self.done.is_set():
            self.idle()
            next_mission = self.operator.pop_mission()
            if next_mission is not None:
                mission, is_attended, name = next_mission
                self.execute_request(mission, attended=is_attended, name=name)
            self.sleep(1.0 / IDLE_HZ)
        self.uno.disarm()

    def idle(self) -> None:
        """Check hardware, health and requests once while no mission is driven, and update the state."""
        self._keep_imu_ready()
        for message in self._world.pop_events(self.now_ns()):
            self.send_event("warning", message)
        self._restore_configuration()
        self._update_state()
        self.notify_watchdog()
        self._publish()

    def _update_state(self) -> None:
        """Latch or clear a stop that the operator requested, and allow a drive if nothing prevents it."""
        machine, stop_cause = self.machine, self._start_obstacle()
        if (stop_reason := self.operator.stop_reason(attended=False)) is not None:
            self.uno.stop()
            self.operator.discard_requests(stop_reason)
            self._clearing = False
            machine.transition("stop", stop_reason)
        elif self._is_stop_cleared() and machine.state is DoorState.STOPPED:
            machine.transition("clear", stop(StopReason.CHECKED_AGAIN))
            self.journal.end()
        elif machine.state is DoorState.DISARMED and stop_cause is None:
            machine.transition("ready")
        elif stop_cause is not None and machine.state is not DoorState.STOPPED:
            if machine.state is DoorState.READY:
                machine.transition("not ready")
            machine.reason = stop_cause

    def execute_request(self, request: Mission | str, *, attended: bool, name: str = "") -> None:
        """Execute a mission, given as an object or in JSON, and report the outcome under the name of the request.

        A faulty mission does not end the service.
        """
        self.set_watchdog_timeout(PREPARE_TIMEOUT_S)
        try:
            mission = Mission.from_json(request) if isinstance(request, str) else request
            path = _new_run_path(self.folder, mission.kind)
            self.machine.transition("manual" if mission.is_manual else "mission")
        except BaqueanoError as error:
            self.set_watchdog_timeout(HANG_TIMEOUT_S)
            self.operator.record_mission_end()
            reason, code = error.diagnostic, error.exit_code
            self.broadcast({"type": "done", "id": name, "run": None, "reason": reason, "code": code})
            return
        self._run = path.name
        self._publish(at_once=True)  # the next state is published only after the preparation
        try:
            reason, code = mission_outcome(lambda: self._drive(mission, path, attended=attended))
        finally:
            self.uno.disarm()
            self.journal.end()
            self.health.limits = self.hardware
            self.set_watchdog_timeout(HANG_TIMEOUT_S)
        self.machine.finish_mission(self.operator, reason, code)
        self._run = self._mission = None
        self._publish(at_once=True)
        self.operator.record_mission_end()
        run = path.name if path.exists() else None
        self.broadcast({"type": "done", "id": name, "run": run, "reason": reason, "code": code})

    def _drive(self, mission: Mission, path: Path, *, attended: bool) -> Diagnostic | None:
        """Execute a mission, record it at `path`, and return why the vehicle was stopped, None if it was not stopped.

        If the disk is full, the missing rest of the run is reported, and the drive continues. The caller ends the
        journal.
        """
        self.journal.begin(mission, path.name)
        with tempfile.TemporaryDirectory(prefix="baqueano-") as folder:
            vehicle_file = within(PREPARE_S, unpack, mission, Path(folder))
            self.set_watchdog_timeout(PREPARE_TIMEOUT_S)
            body = configure_body(vehicle_file, self.uno, self.sleep)
            world = Robot(vehicle_file.sensors, self.uno, self.imu.driver, body, self.now_ns)
            world.notes = () if self.imu.driver is None else self.imu.driver.notes
            self._mission = mission.with_durations(vehicle_file)
            self.imu.begin_drive()
            self.operator.pop_mark_count()  # drop marks from before this drive
            self.health.limits = vehicle_file.robot
            observer = HardwareObserver(self, world, mission, vehicle_file, attended=attended)
            return observer.watch(
                lambda: perform(
                    mission, vehicle_file, hand=lambda: self.operator.command(3), world=world, live=True, path=path,
                    tick_times_ns=self._ticks(observer, vehicle_file.rate_hz),
                    observers=(observer, ChangeObserver(self.operator, self.broadcast, mission.blocks)),
                )
            )  # fmt: skip

    def _ticks(self, observer: HardwareObserver, rate_hz: float) -> Iterator[int]:
        """Yield the times [ns] of a drive's ticks, from 0 on.

        Arm the Uno before the first tick. After each tick, notify the watchdog and publish the state.
        """
        wall = clock.Wall(rate_hz, now_ns=self.now_ns, sleep=self.sleep)
        start_ns = -1
        for due in wall:
            if start_ns < 0:
                start_ns = due
                observer.begin_ticks(due)
                self.uno.arm()
                self.set_watchdog_timeout(HANG_TIMEOUT_S)
            observer.delays.record_tick((self.now_ns() - due) / 1e6, 500.0 / rate_hz, wall.missed_ticks)
            if self.operator.is_end_requested:
                raise KeyboardInterrupt
            yield due - start_ns
            self.notify_watchdog()
            self._publish(observer)

    def _is_stop_cleared(self) -> bool:
        """Return True if the operator has cleared the stop and the Uno is no longer latched.

        After a request each call sends the Uno a frame that clears its latch, until telemetry shows that the latch is
        cleared. One frame is not enough, because it can be lost.
        """
        is_clear_requested, self.operator.is_clear_requested = self.operator.is_clear_requested, False
        stop_cause = self.uno.stop_cause
        is_latch_cleared = self._clearing and (
            stop_cause is None or stop_cause.code != StopReason.UNO_LATCHED
        )
        self._clearing = is_clear_requested or (self._clearing and not is_latch_cleared)
        if self._clearing:
            self.uno.clear_stop()
        return is_latch_cleared

    def _restore_configuration(self) -> None:
        """Send the configuration of the vehicle file to an Uno with another one, as after a mission or a reset."""
        info = self.uno.info
        if info is not None and info.config != (own_config := firmware_config(self.hardware, info)):
            self.uno.send_config(own_config)

    def _keep_imu_ready(self) -> None:
        """Search for an IMU that did not answer, and free a stuck bus; report the outcome."""
        messages: list[Diagnostic | None] = []
        if self.imu.is_search_due(self.now_ns()):
            self.set_watchdog_timeout(FIND_TIMEOUT_S)
            messages.append(self.imu.search(self.now_ns))
            self.set_watchdog_timeout(HANG_TIMEOUT_S)
            if self.imu.driver is not None:
                self._world = self._idle_world()
        messages.append(self.imu.free_bus())
        for message in filter(None, messages):
            self.send_event("warning", message)
            self.log(text(message))

    def send_event(self, level: str, content: Diagnostic | str) -> None:
        """Send an event to all clients."""
        if isinstance(content, str):
            content = note("hardware.note", Severity(level), words=content)
        self.broadcast({"type": "event", "level": level, "message": content})

    def _start_obstacle(self) -> Diagnostic | None:
        """Return the reason why a drive is not allowed to begin; None if it is allowed."""
        if self.uno.info is None:
            return stop(StopReason.UNO_ABSENT)
        obstacle = self.imu.obstacle() or self._world.stop_reason(self.now_ns())
        return obstacle or self.health.start_obstacle(self._world)

    def _idle_world(self) -> Robot:
        return Robot(sensor_slots(())(), self.uno, self.imu.driver, Body())

    def _publish(self, drive: HardwareObserver | None = None, *, at_once: bool = False) -> None:
        """Send the state to all clients, if `at_once` or if the last state was sent 1/TELL_HZ ago."""
        now_ns = self.now_ns()
        if not at_once and now_ns - self._published_ns < NANOSECONDS / TELL_HZ:
            return
        self._published_ns = now_ns
        world, record = (self._world, None) if drive is None else (drive.world, drive.record)
        trips = sorted(self.uno.statistics.trips_ms)
        self.broadcast(
            state_description("real", self.machine.state, self.machine.reason, self._run, self._mission, record)
            | {
                "battery_v": world.battery_v, "tilt_rad": world.tilt_rad, "temperature_c": self.health.temperature_c,
                "uno_trip_ms": trips[len(trips) // 2] if trips else None, "imu_bus": self.imu.bus_message,
                "lost_telemetry": self.uno.statistics.lost_frames, "resets": self.uno.statistics.resets,
            }
        )  # fmt: skip

    def _close_hardware(self) -> None:
        self.operator.stop(stop(StopReason.SERVICE_ENDED))
        self.done.set()


def _new_run_path(folder: Path, kind: str) -> Path:
    """Return a new path for a run, named after date and time. Raise FileError if the folder cannot be used."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fix, reason = f"ls -ld {folder}", error.strerror
        raise FileError.of("service.no-run-there", fix, folder=folder, error=reason) from error
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{kind}"
    for k in range(100):
        path = folder / (f"{stem}.mcap" if k == 0 else f"{stem}-{k}.mcap")
        if not path.exists():
            return path
    raise FileError.of("service.hundred-runs", folder=folder)
