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
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from baqueano.contracts.time_limit import PREPARE_S, within
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.door.frames.descriptions import drive_description
from baqueano.door.frames.rows import Frames
from baqueano.door.gain_changes import ChangeObserver
from baqueano.door.operator import Operator
from baqueano.door.outcome import mission_outcome
from baqueano.door.states import DoorState, StateMachine
from baqueano.drive.mission import Mission, perform, unpack
from baqueano.drive.observers import EventLine, Observer
from baqueano.drive.recording import CLOCK_SOURCE, IMU_SOURCE, LINE_SOURCE, UNO_SOURCE
from baqueano.errors import BaqueanoError, FileError
from baqueano.loop import Blocks, Record
from baqueano.messages import templates, text
from baqueano.robot.imu.bus_recovery import RecoveryOutcome
from baqueano.robot.service.configuration import configure_body, firmware_config
from baqueano.robot.service.drive_figures import TickDelays, imu_losses, line_losses, uno_losses
from baqueano.robot.service.health import ComputerHealth
from baqueano.robot.service.journal import Journal
from baqueano.robot.uno.link import Uno
from baqueano.signals import NANOSECONDS, sensor_slots
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicle_file.head import Hardware
from baqueano.worlds import Robot, clock
from baqueano.worlds.robot import Body

HANG_TIMEOUT_S = 2.0  # after this time without a tick or an idle check, systemd starts the service again
PREPARE_TIMEOUT_S = PREPARE_S + 10.0  # the same while a mission is loaded and compiled
FIND_TIMEOUT_S = 30.0  # the same while the service searches for an IMU
FIND_PERIOD_S = 5.0  # between two searches for an IMU
CLOSE_TIMEOUT_S = 60.0  # the same while a run is closed, which waits for the card
IDLE_HZ, TELL_HZ = 20.0, 5.0
Broadcast = Callable[[JsonObject], None]


@dataclass
class Service:
    """The service: its hardware, the operator's mailbox, and the state. `broadcast` sends a message to all clients."""

    uno: Uno
    imu: Any
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
    find_imu: Callable[[], object] | None = None  # opens the IMU that did not answer at the start

    def __post_init__(self) -> None:
        templates()  # read from the disk now, not in a tick that stops the vehicle
        self.machine, self.done = StateMachine(), threading.Event()
        self.health = ComputerHealth(self.hardware, self.folder, self.now_ns)
        self._world = Robot(sensor_slots(())(), self.uno, self.imu, Body())
        self._published_ns = 0
        self._record: Record | None = None  # the last record of the present drive
        self._mission: Mission | None = None
        self._run: str | None = None  # name of the run that is being written
        self._counts_before: Any = None  # the counts of the IMU at the first tick
        self._bus: RecoveryOutcome | None = None  # the last recovery of the IMU's bus, until the next drive
        self._no_imu: Diagnostic | None = None  # why the IMU is missing
        self._find_ns = -(1 << 62)  # time of the next search for the IMU
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
        self._find_imu()
        for message in self._world.pop_events(self.now_ns()):
            self._send_event("warning", message)
        self._free_bus()
        self._restore_configuration()
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
        self.notify_watchdog()
        self._publish()

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

    def _find_imu(self) -> None:
        """Search every FIND_PERIOD_S for an IMU that did not answer, and report each new obstacle once.

        The search takes two seconds if a chip answers but does not send samples.
        """
        if self.imu is not None or self.find_imu is None or self.now_ns() < self._find_ns:
            return
        self.set_watchdog_timeout(FIND_TIMEOUT_S)
        try:
            self.imu, previous_reason, self._no_imu = self.find_imu(), self._no_imu, None
            self._world = Robot(sensor_slots(())(), self.uno, self.imu, Body())
        except BaqueanoError as error:
            previous_reason, self._no_imu = self._no_imu, stop(StopReason.IMU_ABSENT, cause=error.diagnostic)
        self.set_watchdog_timeout(HANG_TIMEOUT_S)
        self._find_ns = self.now_ns() + round(FIND_PERIOD_S * NANOSECONDS)
        if self._no_imu != previous_reason:
            diagnostic = self._no_imu or note("imu.answers")
            self._send_event("warning", diagnostic)
            self.log(text(diagnostic))

    def _free_bus(self) -> None:
        """Clock a stuck bus of the IMU free in a second thread, and report the outcome.

        The same failure is reported only once. The caller must ensure that no drive is in progress.
        """
        if self.imu is None:
            return
        outcome = self.imu.free_bus()
        if outcome is not None and (outcome.is_free or outcome != self._bus):
            self._bus = outcome
            self._send_event("warning", outcome.message)
            self.log(outcome.text)
        elif not self.imu.is_silent and self._bus is not None and not self._bus.is_free:
            self._bus = None

    def execute_request(self, request: Mission | str, *, attended: bool, name: str = "") -> None:
        """Execute a mission, given as an object or in JSON, and report the outcome under the name of the request.

        A faulty mission does not end the service.
        """
        self.set_watchdog_timeout(PREPARE_TIMEOUT_S)
        try:
            mission = Mission.from_json(request) if isinstance(request, str) else request
            path = self._new_run_path(mission.kind)
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
            reason, code = mission_outcome(lambda: self._drive_with_journal(mission, path, attended=attended))
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

    def _drive_with_journal(self, mission: Mission, path: Path, *, attended: bool) -> Diagnostic | None:
        """Write the journal file, and execute a mission as `drive` does; the caller deletes the file."""
        self.journal.begin(mission, path.name)
        return self.drive(mission, path, attended=attended)

    def drive(self, mission: Mission, path: Path, *, attended: bool) -> Diagnostic | None:
        """Execute a mission, record it at `path`, and return why the vehicle was stopped, None if it was not stopped.

        If the disk is full, the missing rest of the run is reported, and the drive continues.
        """
        with tempfile.TemporaryDirectory(prefix="baqueano-") as folder:
            vehicle_file = within(PREPARE_S, unpack, mission, Path(folder))
            self.set_watchdog_timeout(PREPARE_TIMEOUT_S)
            body = configure_body(vehicle_file, self.uno, self.sleep)
            world, lateness = Robot(vehicle_file.sensors, self.uno, self.imu, body, self.now_ns), TickDelays()
            self._mission = mission.with_durations(vehicle_file)
            self._record, self._bus, _ = None, None, self.operator.pop_mark_count()  # marks before the drive
            self.health.limits = vehicle_file.robot
            world.notes = () if self.imu is None else self.imu.notes
            watching = _ServiceObserver(self, world, lateness, mission, vehicle_file, attended=attended)
            self._counts_before = None
            observers = (watching, ChangeObserver(self.operator, self.broadcast, mission.blocks))
            try:
                perform(
                    mission, vehicle_file, hand=lambda: self.operator.command(3), world=world, live=True, path=path,
                    tick_times_ns=self._ticks(world, vehicle_file.rate_hz, lateness), observers=observers,
                )  # fmt: skip
            except FileError as error:
                if not watching.over:  # the drive has not begun
                    raise
                self._send_event("error", error.diagnostic)
            return watching.stopped

    def _ticks(self, world: Robot, rate_hz: float, lateness: TickDelays) -> Iterator[int]:
        """Yield the times [ns] of a drive's ticks, from 0 on.

        Arm the Uno before the first tick. After each tick, notify the watchdog and publish the state.
        """
        wall = clock.Wall(rate_hz, now_ns=self.now_ns, sleep=self.sleep)
        start_ns = -1
        for due in wall:
            if start_ns < 0:
                start_ns = due
                world.begin(due)
                self._counts_before = None if self.imu is None else replace(self.imu.counts)
                self.uno.arm()
                self.set_watchdog_timeout(HANG_TIMEOUT_S)
            behind_ms = (self.now_ns() - due) / 1e6
            lateness.ticks, lateness.skipped_ticks = lateness.ticks + 1, wall.missed_ticks
            lateness.now_ms, lateness.worst_ms = behind_ms, max(lateness.worst_ms, behind_ms)
            lateness.late_ticks += behind_ms > 500.0 / rate_hz
            if self.operator.is_end_requested:
                raise KeyboardInterrupt
            yield due - start_ns
            self.notify_watchdog()
            self._publish(world)

    def _send_event(self, level: str, content: Diagnostic | str) -> None:
        if isinstance(content, str):
            content = note("hardware.note", Severity(level), words=content)
        self.broadcast({"type": "event", "level": level, "message": content})

    def _start_obstacle(self) -> Diagnostic | None:
        """Return the reason why a drive is not allowed to begin; None if it is allowed."""
        if self.uno.info is None:
            return stop(StopReason.UNO_ABSENT)
        if self._no_imu is not None:
            return self._no_imu
        if self.imu is not None and self.imu.is_silent:
            return self._silence_reason()
        return self._world.stop_reason(self.now_ns()) or self.health.start_obstacle(self._world)

    def _silence_reason(self) -> Diagnostic:
        """Return the reason to stop because of a silent IMU, with the state of its bus."""
        if not self.imu.is_bus_stuck:
            return stop(StopReason.IMU_SILENT)
        if self._bus is None or self._bus.is_free:  # the last recovery freed it, but it is stuck again
            return stop(StopReason.IMU_BUS_BLOCKED)
        return stop(StopReason.IMU_BUS_STILL_BLOCKED, cause=self._bus.message)

    def _publish(self, world: Robot | None = None, *, at_once: bool = False) -> None:
        now_ns = self.now_ns()
        if not at_once and now_ns - self._published_ns < NANOSECONDS / TELL_HZ:
            return
        self._published_ns = now_ns
        link = world or self._world
        trips = sorted(self.uno.statistics.trips_ms)
        self.broadcast(
            {
                "type": "state", "state": str(self.machine.state), "reason": self.machine.reason, "run": self._run,
                "battery_v": link.battery_v, "tilt_rad": link.tilt_rad, "temperature_c": self.health.temperature_c,
                "uno_trip_ms": trips[len(trips) // 2] if trips else None,
                "imu_bus": self._bus.message if self._bus else None,
                "lost_telemetry": self.uno.statistics.lost_frames, "resets": self.uno.statistics.resets,
                "world": "real",
                **drive_description(self._mission, self._record if world is not None else None),
            }
        )  # fmt: skip

    def _new_run_path(self, kind: str) -> Path:
        """Return a new path for a run, named after date and time. Raise FileError if the folder cannot be used."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            fix, reason = f"ls -ld {self.folder}", error.strerror
            raise FileError.of("service.no-run-there", fix, folder=self.folder, error=reason) from error
        stem = f"{datetime.now():%Y%m%d-%H%M%S}-{kind}"
        for k in range(100):
            path = self.folder / (f"{stem}.mcap" if k == 0 else f"{stem}-{k}.mcap")
            if not path.exists():
                return path
        raise FileError.of("service.hundred-runs", folder=self.folder)

    def _close_hardware(self) -> None:
        self.operator.stop(stop(StopReason.SERVICE_ENDED))
        self.done.set()


class _ServiceObserver(Observer):
    """An observer that stops a drive for hardware faults or on request, and reports the losses at its end."""

    def __init__(
        self,
        service: Service,
        world: Robot,
        lateness: TickDelays,
        mission: Mission,
        vehicle_file: VehicleFile,
        *,
        attended: bool,
    ) -> None:
        self._service, self._world, self._lateness, self._attended = service, world, lateness, attended
        self._mission, self._file = mission, vehicle_file
        self._previous = replace(service.uno.statistics)
        self.over = False
        self.stopped: Diagnostic | None = None

    def begin(self, blocks: Blocks) -> Blocks:
        mission, frames = self._mission, self._service.frames
        frames.begin(self._file, "real", estimator=blocks.estimator, mission=mission)
        return blocks

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        s, world = self._service, self._world
        if (request := s.operator.stop_reason(attended=False)) is not None:
            return request  # it latches the Uno, so the telemetry reports a latch
        reason = s.uno.standstill_reason() or world.stop_reason(t_ns) or s.health.stop_reason(world)
        return reason or s.operator.stop_reason(attended=self._attended)

    def pop_mark_count(self) -> int:
        return self._service.operator.pop_mark_count()

    def on_record(self, record: Record) -> None:
        s = self._service
        s._record = record
        s.frames.on_record(record, battery_v=self._world.battery_v, late_ms=self._lateness.now_ms)

    def on_disk_full(self, reason: Diagnostic) -> None:
        self._service._send_event("error", reason)

    def end(self, reason: Diagnostic | None) -> list[EventLine]:
        self.over, self.stopped, s = True, reason, self._service
        previous, current, stop_cause = self._previous, s.uno.statistics, s.uno.stop_cause
        if (
            stop_cause
            and stop_cause.code == StopReason.UNO_LATCHED
            and s.operator.stop_reason(attended=False)
        ):
            stop_cause = None  # the requested stop
        last_lines: list[EventLine] = [
            (CLOCK_SOURCE, *self._lateness.event_line()),
            (LINE_SOURCE, *line_losses(previous, current, stop_cause)), (UNO_SOURCE, *uno_losses(previous, current)),
        ]  # fmt: skip
        last_lines += [(IMU_SOURCE, *imu_losses(s._counts_before, s.imu.counts))] if s._counts_before else []
        for _, level, message in last_lines:
            s._send_event(level, message)
        s.uno.disarm()  # closing the run can take longer than the dead-man time, because a card can stall
        s.set_watchdog_timeout(CLOSE_TIMEOUT_S)
        return last_lines
