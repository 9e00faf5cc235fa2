"""Stop a drive for hardware faults or on request, and report the losses at its end."""

from dataclasses import replace
from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, StopReason
from baqueano.door.mission.observer import MissionObserver
from baqueano.drive.mission import Mission
from baqueano.drive.observers import EventLine
from baqueano.drive.recording import CLOCK_SOURCE, IMU_SOURCE, LINE_SOURCE, UNO_SOURCE
from baqueano.loop import Blocks, Record
from baqueano.robot.imu.settings import Counts
from baqueano.robot.service.drive_figures import TickDelays, imu_losses, line_losses, uno_losses
from baqueano.vehicle_file.file import VehicleFile
from baqueano.worlds import Robot

if TYPE_CHECKING:
    from baqueano.robot.service.service import Service

CLOSE_TIMEOUT_S = 60.0  # limit of systemd while a run is closed, because a card can stall


class HardwareObserver(MissionObserver):
    """An observer of a drive of the service: its world, and the delays of its ticks."""

    def __init__(
        self, service: "Service", world: Robot, mission: Mission, vehicle_file: VehicleFile, *, attended: bool
    ) -> None:
        super().__init__(service.operator, service.send_event, attended=attended)
        self.world, self.delays = world, TickDelays()
        self._service, self._mission, self._file = service, mission, vehicle_file
        self._statistics_before = replace(service.uno.statistics)
        self._counts_before: Counts | None = None  # of the IMU at the first tick

    def begin(self, blocks: Blocks) -> Blocks:
        """Describe the drive to the clients; the blocks stay as they are."""
        self._service.frames.begin(self._file, "real", estimator=blocks.estimator, mission=self._mission)
        return blocks

    def begin_ticks(self, now_ns: int) -> None:
        """Begin the world and the counts of losses with the first tick."""
        self.world.begin(now_ns)
        imu = self._service.imu.driver
        self._counts_before = None if imu is None else replace(imu.counts)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to stop: the operator's request, or the first fault of the hardware."""
        s = self._service
        if (request := s.operator.stop_reason(attended=False)) is not None:
            return request  # it latches the Uno, so the telemetry reports a latch
        fault = s.uno.standstill_reason() or self.world.stop_reason(t_ns) or s.health.stop_reason(self.world)
        return fault or super().stop_reason(t_ns)

    def on_record(self, record: Record) -> None:
        """Keep the record, and send it to the clients."""
        super().on_record(record)
        self._service.frames.on_record(record, battery_v=self.world.battery_v, late_ms=self.delays.now_ms)

    def end(self, reason: Diagnostic | None) -> list[EventLine]:
        """Disarm the Uno, and return the losses of the drive."""
        super().end(reason)
        s, previous = self._service, self._statistics_before
        current, stop_cause = s.uno.statistics, s.uno.stop_cause
        is_latched = stop_cause is not None and stop_cause.code == StopReason.UNO_LATCHED
        if is_latched and s.operator.stop_reason(attended=False):
            stop_cause = None  # the requested stop
        last_lines: list[EventLine] = [
            (CLOCK_SOURCE, *self.delays.event_line()),
            (LINE_SOURCE, *line_losses(previous, current, stop_cause)),
            (UNO_SOURCE, *uno_losses(previous, current)),
        ]
        if self._counts_before is not None:
            last_lines.append((IMU_SOURCE, *imu_losses(self._counts_before, s.imu.driver.counts)))
        for _, level, message in last_lines:
            s.send_event(level, message)
        s.uno.disarm()  # closing the run can take longer than the dead-man time, because a card can stall
        s.set_watchdog_timeout(CLOSE_TIMEOUT_S)
        return last_lines
