"""The recorder of a drive: each tick, the messages of the world and the monitor, and the end."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.drive.health import Health
from baqueano.drive.observers import Observer
from baqueano.loop import Record, World
from baqueano.runs.in_memory import RunSink
from baqueano.signals import seconds

STOP_SOURCE = "loop"
HARDWARE_SOURCE, CLOCK_SOURCE, LINE_SOURCE, UNO_SOURCE = "hardware", "clock", "line", "uno"
IMU_SOURCE = "imu"
MARK_SOURCE, SHAKE_SOURCE = "mark", "shake"
PROGRESS_EVERY = 50  # ticks


@dataclass
class Recording:
    """Listens to the loop, pours everything into `sink`, and shows it to the observers."""

    sink: RunSink
    world: World
    health: Health
    observers: Sequence[Observer]
    begun_ns: int
    ticks: int = 0
    logged: bool = True  # the disk takes the run

    def __post_init__(self) -> None:
        self.last_ns = self.begun_ns

    def begin(self, notes: Iterable[Diagnostic | str]) -> None:
        """Write the data that are known before the first tick."""
        for one in notes:
            grave = isinstance(one, Diagnostic) and one.severity == Severity.WARNING
            self.sink.event(self.begun_ns, "warning" if grave else "info", "drive", one)

    def tick(self, record: Record) -> None:
        """Write a record of the loop."""
        sink, t_ns = self.sink, record.tick.t_ns
        sink.record(record)
        for truth_ns, motion in self.world.new_truths():
            sink.truth(truth_ns, motion)
        for name, channel_ns, z in self.world.new_channels():
            sink.channel(name, channel_ns, z)
        for event_ns, one in self.world.new_events():
            ours = isinstance(one, Diagnostic) and one.subject == SHAKE_SOURCE
            self._event(event_ns, "warning", SHAKE_SOURCE if ours else HARDWARE_SOURCE, one)
        for source, level, one in self.health.lines(record.tick, record.estimate):
            self._event(t_ns, level, source, one)
        for _ in range(sum(one.marked() for one in self.observers)):
            self._event(t_ns, "info", MARK_SOURCE, note("drive.on-mark"))
        for source, level, said in [line for one in self.observers for line in one.events()]:
            self._event(t_ns, level, source, said)
        self._show(record)
        self.ticks, self.last_ns = self.ticks + 1, t_ns

    def stopped(self, t_ns: int, why: Diagnostic) -> None:
        """Why the motors are stopped from now on."""
        self._event(t_ns, "error", STOP_SOURCE, why)

    def end(self, why: Diagnostic | None) -> None:
        """The last events; `why` the vehicle was stopped, None if nothing stopped it."""
        lines = [line for one in self.observers for line in one.ended(why)]
        for source, level, said in (*self.health.last_lines(), *lines):
            self.sink.event(self.last_ns, level, source, said)

    def _event(self, t_ns: int, level: str, source: str, what: Diagnostic | str) -> None:
        self.sink.event(t_ns, level, source, what)
        for one in self.observers:
            one.happened(t_ns, source, what)

    def _show(self, record: Record) -> None:
        failure, shown = self.sink.failure, record._replace(degraded=self.health.degraded)
        full = self.logged and failure is not None
        if full and failure is not None:
            self.logged = False
            disk = note("drive.disk-full", Severity.ERROR, error=failure.strerror or str(failure))
            for one in self.observers:
                one.unlogged(disk)
        for one in self.observers:
            one.look(shown)
            if self.ticks % PROGRESS_EVERY == 0:
                one.progress(seconds(record.tick.t_ns, self.begun_ns))
