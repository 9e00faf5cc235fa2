"""Record a drive: each tick, the messages of the world, the monitor and the observers, and the end."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.drive.health import Health
from baqueano.drive.observers import Observer, select_observers
from baqueano.errors import error_text
from baqueano.loop import Blocks, Record, World
from baqueano.runs.recorder import RunRecorder
from baqueano.signals import seconds

STOP_SOURCE = "loop"
HARDWARE_SOURCE, CLOCK_SOURCE, LINE_SOURCE, UNO_SOURCE = "hardware", "clock", "line", "uno"
IMU_SOURCE = "imu"
MARK_SOURCE, SHAKE_SOURCE = "mark", "shake"
PROGRESS_PERIOD_TICKS = 50  # ticks


@dataclass
class Recording:
    """A recorder that writes all data of the loop to `sink`, and passes the records and events to the observers."""

    sink: RunRecorder
    world: World
    health: Health
    observers: Sequence[Observer]
    start_ns: int
    diagnostics: dict[str, Callable[[Tree], Diagnostic | None]] = field(default_factory=dict)  # by role
    tick_count: int = 0
    is_logging: bool = True  # the disk accepts the run

    def __post_init__(self) -> None:
        self.last_ns = self.start_ns
        self.mark_observers = select_observers(self.observers, "pop_mark_count")
        self.event_observers = select_observers(self.observers, "events")

    def begin(self, notes: Iterable[Diagnostic | str]) -> None:
        """Write the messages that are known before the first tick."""
        for diagnostic in notes:
            is_warning = isinstance(diagnostic, Diagnostic) and diagnostic.severity == Severity.WARNING
            self.sink.event(self.start_ns, "warning" if is_warning else "info", "drive", diagnostic)

    def tick(self, record: Record) -> None:
        """Write a record of the loop, and all data and events that belong to the tick of this record."""
        sink, t_ns = self.sink, record.tick.t_ns
        sink.record(record)
        for truth_ns, motion in self.world.new_truths():
            sink.truth(truth_ns, motion)
        for name, channel_ns, z in self.world.new_channels():
            sink.channel(name, channel_ns, z)
        for event_ns, cause in self.world.new_events():
            is_fault = isinstance(cause, Diagnostic) and cause.subject == SHAKE_SOURCE
            self._event(event_ns, "warning", SHAKE_SOURCE if is_fault else HARDWARE_SOURCE, cause)
        for source, level, cause in self.health.events(record.tick, record.estimate):
            self._event(t_ns, level, source, cause)
        for role in tuple(self.diagnostics):
            self._write_diagnostic(role, record)
        for _ in range(sum(observer.pop_mark_count() for observer in self.mark_observers)):
            self._event(t_ns, "info", MARK_SOURCE, note("drive.on-mark"))
        for source, level, message in [
            line for observer in self.event_observers for line in observer.events()
        ]:
            self._event(t_ns, level, source, message)
        self._show(record)
        self.tick_count, self.last_ns = self.tick_count + 1, t_ns

    def record_stop(self, t_ns: int, reason: Diagnostic) -> None:
        """Write the reason why the motors are stopped from now on."""
        self._event(t_ns, "error", STOP_SOURCE, reason)

    def end(self, reason: Diagnostic | None) -> None:
        """Write the last events; `reason` is the reason of the stop, None if the vehicle was not stopped."""
        lines = [line for observer in self.observers for line in observer.end(reason)]
        for source, level, message in (*self.health.final_events(), *lines):
            self.sink.event(self.last_ns, level, source, message)

    def _write_diagnostic(self, role: str, record: Record) -> None:
        """Write the diagnostic of a block about its state; a block that raises an error is not called again."""
        state, t_ns = getattr(record.states, role, None), record.tick.t_ns
        if state is None:  # it was replaced after a fault
            return
        try:
            diagnostic = self.diagnostics[role](state)
        except Exception as error:
            del self.diagnostics[role]
            diagnostic = note("drive.diagnostic-failed", Severity.WARNING, role=role, error=error_text(error))
        if diagnostic is not None:
            self._event(
                t_ns, "warning" if diagnostic.severity == Severity.WARNING else "info", role, diagnostic
            )

    def _event(self, t_ns: int, level: str, source: str, message: Diagnostic | str) -> None:
        self.sink.event(t_ns, level, source, message)
        for observer in self.observers:
            observer.on_event(t_ns, source, message)

    def _show(self, record: Record) -> None:
        failure, findings = self.sink.failure, self.health.degraded_sensors
        shown_record = record._replace(sensor_findings=findings) if findings else record
        is_newly_full = self.is_logging and failure is not None
        if is_newly_full and failure is not None:
            self.is_logging = False
            disk = note("drive.disk-full", Severity.ERROR, error=failure.strerror or str(failure))
            for observer in self.observers:
                observer.on_disk_full(disk)
        for observer in self.observers:
            observer.on_record(shown_record)
            if self.tick_count % PROGRESS_PERIOD_TICKS == 0:
                observer.progress(seconds(record.tick.t_ns, self.start_ns))


def block_diagnostics(blocks: Blocks) -> dict[str, Callable[[Tree], Diagnostic | None]]:
    """Return, for each role whose block has diagnostics, a function from the block's state to a diagnostic or None."""
    functions = {role: tuple(_diagnostic_functions(block)) for role, block in blocks._asdict().items()}
    return {role: partial(_first_diagnostic, diagnose) for role, diagnose in functions.items() if diagnose}


def _diagnostic_functions(block: Tree) -> Iterator[Callable[[Tree], Diagnostic | None]]:
    """Yield the `diagnostic` functions of a block and of the blocks inside it, as functions of the outer state."""
    # a budgeted or compiled block has the state of the inner block
    if (inner_block := getattr(block, "block", None)) is not None:
        yield from _diagnostic_functions(inner_block)
        return
    if (diagnostic := optional.attribute(block, "diagnostic")) is not None:
        yield diagnostic
    for name in optional.attribute(block, "inner_blocks"):
        for diagnose in _diagnostic_functions(getattr(block, name)):
            yield partial(_diagnose_part, diagnose, name)


def _diagnose_part(
    diagnose: Callable[[Tree], Diagnostic | None], name: str, state: Tree
) -> Diagnostic | None:
    return diagnose(getattr(state, name))


def _first_diagnostic(
    functions: Sequence[Callable[[Tree], Diagnostic | None]], state: Tree
) -> Diagnostic | None:
    return next((diagnostic for diagnose in functions if (diagnostic := diagnose(state)) is not None), None)
