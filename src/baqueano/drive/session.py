"""One drive: blocks and a world in, a run out. The verbs of this room all end here."""

import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from baqueano import clock, loop
from baqueano.controllers import CarefulController, Hand, HeadingHold, Schedule
from baqueano.diagnostics import Diagnostic, Severity, StopReason, fault, note, stop
from baqueano.drive.budget import PREPARE_S, Budgeted, within
from baqueano.drive.health import Health
from baqueano.drive.interrupt import between_ticks
from baqueano.drive.watchdog import Watchdog
from baqueano.errors import SafetyStop, UsageError, from_outside, named
from baqueano.estimators import Inertial
from baqueano.guides import CarefulGuide, Idle, Playback
from baqueano.loop import Blocks, Outcome, Record
from baqueano.messages import text
from baqueano.monitor import Watching
from baqueano.runs import Channel, EstimateLog, Event, ReferenceLog, Run, RunWriter, TruthLog, read_run
from baqueano.signals import Command, Motion, Reference, Tick, measured_ns, seconds, silent
from baqueano.symbolic import TraceError, compiled
from baqueano.worlds import Simulated

Progress = Callable[[float], None]  # seconds of the run that are done
LastLine = tuple[str, str, Diagnostic | str]  # source, level, message
STOP_SOURCE = "loop"
HARDWARE_SOURCE, CLOCK_SOURCE, LINE_SOURCE, UNO_SOURCE = "hardware", "clock", "line", "uno"
IMU_SOURCE = "imu"
MARK_SOURCE = "mark"
PROGRESS_EVERY = 50  # ticks
AS_WRITTEN = (  # blocks of ours that are not compiled
    Schedule | Idle | Playback | Hand | HeadingHold | Inertial | CarefulGuide | CarefulController
)


def drive(
    blocks: Blocks,
    vehicle_file: Any,
    *,
    kind: str,
    truth: Any = None,
    world: Any = None,
    ticking: Iterable[int] | None = None,
    eta: np.ndarray | None = None,
    duration_s: float | None = None,
    seed: int = 0,
    backend: str = "auto",
    path: Path | str | None = None,
    live: bool = False,
    progress: Progress | None = None,
    watch: Callable[[int], Diagnostic | None] | None = None,
    marked: Callable[[], int] = int,
    look: Callable[[Record], Any] | None = None,
    ended: Callable[[Diagnostic | None], Iterable[LastLine]] = lambda why: (),
    unlogged: Callable[[Diagnostic], Any] = lambda what: None,
) -> Run:
    """Drives `blocks` through a world until the guide is done, and returns the run, which is also in the file `path`,
    if that is given. `kind` stands in its metadata.

    The world is a simulation of `truth` (a vehicle file; the same as `vehicle_file` if not given) with
    the noise of `seed`, for `duration_s` at most, unless another `world` and its clock `ticking` are given. `eta` (3,)
    [m, rad] is the pose at the start; (6,) of a vehicle that is moving then, with its velocity. `live`: a real
    vehicle, which waits neither for the disk nor for a block that hangs; `watch` tells at each tick why it must stop,
    None if it need not. `marked` tells how often a person said since the last tick that the vehicle is on its mark,
    which becomes events of the run; `look` is shown each tick's record, `progress` the seconds that are done;
    `ended` is told at the end why the vehicle was stopped, None if nothing stopped it, and gives the last events;
    `unlogged` is told at once when the disk takes no more of the run: a live drive goes on. One into a file returns a
    run without records, which are in the file: to read an hour takes more memory than a vehicle has.

    UsageError where file and world take another number of commands; SafetyStop where the drive is stopped before its
    first tick. One that is stopped later returns its run: `stop_of` says why. FileError at the end of a drive whose
    disk took no more: what was written before is in `path`.
    """
    start = np.zeros(3) if eta is None else np.array(eta, dtype=float)
    if world is None:
        real = vehicle_file if truth is None else truth
        world = Simulated(real.vehicle, real.sensors, real.rate_hz, seed, start, backend)
    _same_commands(vehicle_file, world)
    inputs = blocks, example_tick(vehicle_file), backend
    sensors, unwatched = within(PREPARE_S, watched, vehicle_file, blocks.estimator)
    blocks, notes = within(PREPARE_S, ready, *inputs) if live else ready(*inputs)
    notes += unwatched
    if live:
        blocks = Blocks(*(Budgeted(b) if _as_written(b) else b for b in blocks))
    if watch is not None:
        blocks = blocks._replace(supervisor=Watchdog(blocks.supervisor, watch))
    begun_with: list[Diagnostic | str] = [*getattr(world, "notes", ()), *notes]
    told, elsewhere = told_start(blocks.estimator, start)
    if sensors is not None:
        sensors.begin(*(start[k : k + 3] for k in range(0, len(start), 3)))
    begun_with += [] if elsewhere is None else [elsewhere]
    if ticking is None:
        ticking = clock.simulated(vehicle_file.rate_hz, duration_s)
    metadata = {"kind": kind, "seed": str(seed), "start": " ".join(map(repr, start.tolist()))}
    metadata["backend"] = getattr(blocks.estimator, "backend", "numpy")
    health = Health(vehicle_file.envelope, sensors)
    if path is None:
        memory = Memory(vehicle_file.text, metadata)
        _run(
            blocks, world, ticking, told, memory, begun_with, health, progress, marked, look, ended, unlogged
        )
        return memory.run(vehicle_file.name)
    try:
        with RunWriter(path, vehicle_file.text, metadata, live=live) as writer:
            _run(
                blocks,
                world,
                ticking,
                told,
                writer,
                begun_with,
                health,
                progress,
                marked,
                look,
                ended,
                unlogged,
            )
    except SafetyStop:  # before the first tick
        Path(path).unlink()
        raise
    if live:
        nothing = np.zeros((0, world.commands))
        return Run(vehicle_file.name, Path(path), np.zeros(0, dtype=np.int64), nothing, metadata=metadata)
    return read_run(path)


def stop_of(run: Run) -> Diagnostic | None:
    """Return why the motors were stopped in this run; None if nothing stopped them."""
    event = next((e for e in run.events if e.source == STOP_SOURCE and e.level == "error"), None)
    if event is None or event.diagnostic is not None:
        return None if event is None else event.diagnostic
    return stop(StopReason.RECORDED, words=event.text)  # a run of before there were codes


def marks_of(run: Run) -> list[int]:
    """The times [ns] at which the driver said that the vehicle was on its mark."""
    return [e.t_ns for e in run.events if e.source == MARK_SOURCE]


def ready(blocks: Blocks, tick: Tick, backend: str) -> tuple[Blocks, list[Diagnostic]]:
    """The blocks compiled, and tried once so that the first tick does not wait for a compiler. A block that
    cannot be compiled runs as it is written, slower; the diagnostics say which, and why."""
    if backend == "numpy":
        return blocks, []
    try:
        states = loop.init(blocks)
        _, estimate = blocks.estimator.step(states.estimator, tick)
    except BaseException as error:  # the loop meets it again, stops, and names the block
        if from_outside(error):
            raise
        return blocks, []
    reference = Reference(0, np.zeros(3), np.zeros(3), 0.0)
    command = Command(0, np.zeros(len(tick.u)))
    inputs = Blocks((tick,), (estimate,), (reference, estimate), (command, tick, estimate))
    tried = [fast(*x, backend) for x in zip(Blocks._fields, blocks, states, inputs, strict=True)]
    return Blocks(*(block for block, _ in tried)), [why for _, why in tried if why is not None]


def watched(vehicle_file: Any, estimator: Any) -> tuple[Watching | None, list[Diagnostic]]:
    """The monitor of the sensors beside this estimator; None, and why, where there can be none."""
    if not vehicle_file.sensors:
        return None, []
    tick = example_tick(vehicle_file)
    try:
        model = vehicle_file.estimator("augmented_ekf", use=(), speed_from=())
        _, estimate = estimator.step(estimator.init(), tick)
        return Watching(model, estimator, tick, estimate), []
    except BaseException as error:  # a vehicle or an estimator of one's own; the loop meets it again
        if from_outside(error):
            raise
        return None, [note("drive.not-watched", error=named(error))]


def fast(
    room: str, block: Any, state: Any, inputs: tuple[Any, ...], backend: str
) -> tuple[Any, Diagnostic | None]:
    """The block compiled, or as it is and why."""
    if isinstance(block, AS_WRITTEN):
        return block, None
    try:
        quick = compiled(block, backend)
        quick.step(state, *inputs)
    except TraceError as error:
        return block, note("drive.not-compiled", room=room, block=type(block).__name__, error=str(error))
    except BaseException as error:  # the loop meets it again, stops, and names the block
        if from_outside(error):
            raise
        return block, None
    return quick, None


def _as_written(block: Any) -> bool:
    """Whether it is text of the user's that may hang: neither compiled nor ours."""
    return not isinstance(block, AS_WRITTEN) and not hasattr(block, "backend")


def told_start(estimator: Any, start: np.ndarray) -> tuple[np.ndarray | None, Diagnostic | None]:
    """The start (3,) or (6,) to tell the estimator, as much of it as its init() takes, None for one that
    takes none; and a diagnostic if that matters."""
    if takes := len(inspect.signature(estimator.init).parameters):
        return start if takes > 1 else start[:3], None
    who = type(getattr(estimator, "block", estimator)).__name__
    where = str(np.round(start, 3).tolist())
    return None, note("drive.own-origin", block=who, start=where) if np.any(start != 0.0) else None


def example_tick(vehicle_file: Any) -> Tick:
    """A tick of this vehicle in which nothing happened."""
    sensors = vehicle_file.sensors
    return Tick(
        0,
        np.zeros(vehicle_file.vehicle.commands),
        silent({n: getattr(sensors, n).size for n in sensors._fields}),
    )


def _run(
    blocks: Blocks,
    world: Any,
    ticking: Iterable[int],
    start: np.ndarray | None,
    sink: Any,
    notes: list[Diagnostic | str],
    health: Health,
    progress: Progress | None,
    marked: Callable[[], int],
    look: Callable[[Record], Any] | None,
    ended: Callable[[Diagnostic | None], Iterable[LastLine]],
    unlogged: Callable[[Diagnostic], Any],
) -> Outcome:
    """The loop, with everything that is known poured into `sink`."""
    seen, begun_ns = 0, int(ticking[0]) if isinstance(ticking, list) and ticking else 0
    last_ns, logged = begun_ns, True

    def on_record(record: Record) -> None:
        nonlocal seen, last_ns, logged
        sink.record(record)
        for t_ns, motion in world.new_truths() if hasattr(world, "new_truths") else ():
            sink.truth(t_ns, motion)
        for name, t_ns, z in world.new_channels() if hasattr(world, "new_channels") else ():
            sink.channel(name, t_ns, z)
        for t_ns, one in world.new_events() if hasattr(world, "new_events") else ():
            sink.event(t_ns, "warning", HARDWARE_SOURCE, one)
        for source, level, one in health.lines(record.tick, record.estimate):
            sink.event(record.tick.t_ns, level, source, one)
        for _ in range(marked()):
            sink.event(record.tick.t_ns, "info", MARK_SOURCE, note("drive.on-mark"))
        if logged and sink.failure is not None:
            logged = False
            why = sink.failure.strerror or str(sink.failure)
            unlogged(note("drive.disk-full", Severity.ERROR, error=why))
        if look is not None:
            look(record._replace(degraded=health.degraded))
        if progress is not None and seen % PROGRESS_EVERY == 0:
            progress(seconds(record.tick.t_ns, begun_ns))
        seen, last_ns = seen + 1, record.tick.t_ns

    for one in notes:
        sink.event(begun_ns, "info", "drive", one)
    with between_ticks(ticking) as until_interrupted:
        outcome = loop.run(
            blocks,
            world,
            until_interrupted,
            on_record,
            lambda t_ns, why: sink.event(t_ns, "error", STOP_SOURCE, why),
            start,
        )
    if outcome.stopped is not None and not outcome.ticks:
        raise SafetyStop(
            f"{text(outcome.stopped)}. That was before the first tick: nothing moved, no run was made.",
            outcome.stopped,
        )
    for source, level, one in (*health.last_lines(), *ended(outcome.stopped)):
        sink.event(last_ns, level, source, one)
    return outcome


def _same_commands(vehicle_file: Any, world: Any) -> None:
    mine, theirs = vehicle_file.vehicle.commands, world.commands
    if mine != theirs:
        raise UsageError(fault("drive.other-vehicle", file=vehicle_file.name, found=mine, expected=theirs))


@dataclass
class Memory:
    """What a RunWriter takes, kept in memory."""

    vehicle_text: str
    metadata: dict[str, str]
    records: list[Record] = field(default_factory=list)
    truths: list[tuple[int, Motion]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    channels: dict[str, list[tuple[int, Any]]] = field(default_factory=dict)
    failure: OSError | None = None  # memory takes everything

    def record(self, record: Record) -> None:
        """One tick."""
        self.records.append(record)

    def truth(self, t_ns: int, motion: Motion) -> None:
        """Where the vehicle is."""
        self.truths.append((t_ns, motion))

    def channel(self, name: str, t_ns: int, z: Any) -> None:
        """What no sensor of the vehicle holds."""
        self.channels.setdefault(name, []).append((t_ns, z))

    def event(self, t_ns: int, level: str, source: str, said: Diagnostic | str) -> None:
        """A line for the reader."""
        data = said if isinstance(said, Diagnostic) else None
        self.events.append(Event(t_ns, level, source, text(said), data))

    def run(self, name: str) -> Run:
        """All of it as a run."""
        r = self.records
        t_ns = np.array([x.tick.t_ns for x in r], dtype=np.int64)
        return Run(
            name,
            None,
            t_ns,
            np.array([x.tick.u for x in r]),
            np.array([x.requested.u for x in r]),
            {name: self._sensor(name) for name in (r[0].tick.sensors._fields if r else ())}
            | {name: self._channel(name) for name in self.channels},
            _estimates(t_ns, r),
            ReferenceLog(t_ns, *(np.array([x.reference[i] for x in r]) for i in (1, 2, 3))),
            self._truth(),
            tuple(self.events),
            self.vehicle_text,
            self.metadata,
            np.array([x.command.u for x in r]),
        )

    def _channel(self, name: str) -> Channel:
        t_ns = np.array([t for t, _ in self.channels[name]], dtype=np.int64)
        return Channel(t_ns, t_ns, np.array([z for _, z in self.channels[name]]))

    def _sensor(self, name: str) -> Channel:
        slots = [(x.tick.t_ns, getattr(x.tick.sensors, name)) for x in self.records]
        heard = [(measured_ns(t_ns, slot), t_ns, slot.z) for t_ns, slot in slots if slot.has > 0.5]
        t_ns, arrival_ns = (np.array([row[k] for row in heard], dtype=np.int64) for k in (0, 1))
        z = np.array([row[2] for row in heard]).reshape(len(heard), len(slots[0][1].z))
        return Channel(t_ns, arrival_ns, z)

    def _truth(self) -> TruthLog | None:
        if not self.truths:
            return None
        t_ns = np.array([t for t, _ in self.truths], dtype=np.int64)
        return TruthLog(t_ns, *(np.array([motion[i] for _, motion in self.truths]) for i in (0, 1, 2)))


def _estimates(t_ns: np.ndarray, records: list[Record]) -> EstimateLog:
    columns = [[x.estimate[i] for x in records] for i in range(1, 6)]
    told = columns if all(c is not None for column in columns[3:] for c in column) else columns[:3]
    return EstimateLog(t_ns, *(np.array(column) for column in told))
