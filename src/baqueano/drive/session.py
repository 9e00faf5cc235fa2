"""Run the blocks of a drive in a world, and return the run. All functions of tasks.py call `drive`."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from baqueano import loop
from baqueano.block_checks.source_text import is_in_package, source_text
from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator, World
from baqueano.contracts.calls import checked_call
from baqueano.contracts.time_limit import HANG_S, within
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, StopReason, fault, note, stop
from baqueano.drive.budget import BUDGET_S, BudgetedBlock, may_hang
from baqueano.drive.health import Health
from baqueano.drive.interrupt import interruptible_ticks
from baqueano.drive.observers import Observer, Watchdog
from baqueano.drive.recording import MARK_SOURCE, STOP_SOURCE, Recording, block_diagnostics
from baqueano.drive.safety.sensor_notes import sensor_warnings
from baqueano.errors import SafetyStop, UsageError, error_text, is_interruption
from baqueano.loop import Blocks
from baqueano.monitor import SensorMonitor, alternative_models
from baqueano.runs import Run, RunWriter, read_run
from baqueano.runs.folder import path_of_run
from baqueano.runs.recorder import MemoryRecorder, RunRecorder
from baqueano.runs.run import REST_KEY
from baqueano.signals import Command, Reference, Tick, empty_slots
from baqueano.standstill import with_rest
from baqueano.symbolic import TraceError, compile_block
from baqueano.symbolic.function import CompiledBlock
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicle_file.units import channel_units
from baqueano.worlds import FaultyWorld, SimulatedWorld, clock
from baqueano.worlds.faults.fault import FaultLike
from baqueano.worlds.own_world import check_world, with_checked_ticks


@dataclass(frozen=True, slots=True, eq=False)
class Conditions:
    """The world, the clock and the options of a drive.

    The world is a simulation of `truth` with the noise of `seed`, for `duration_s` at most. `truth` is a vehicle file;
    its default is the truth that the file of the drive names, or that file itself. Another `world` and its clock
    `tick_times_ns` can be given. `shake` contains faults of the simulated vehicle, as `worlds.Fault` or as text ("12 s:
    push 0.3 N s left"). An empty list yields the same drive without faults: it is bit for bit equal to a run with
    faults up to the first fault. `eta` [m, rad] is the pose at the start in the map (3,). For a moving vehicle it is
    (6,) and contains the body velocity. For `backend` see `symbolic.compile_block`. The vehicle is at rest for
    `rest_s` before its drive, see standstill.py. `notes` are written at the start of the run.
    """

    truth: VehicleFile | None = None
    seed: int = 0
    eta: np.ndarray | None = None
    duration_s: float | None = None
    backend: str = "auto"
    world: World | None = None
    tick_times_ns: Iterable[int] | None = None
    shake: Sequence[FaultLike] | None = None
    rest_s: float = 0.0
    notes: Sequence[Diagnostic] = ()

    def __post_init__(self) -> None:
        _check_duration("rest_s", self.rest_s, "≥ 0")
        if self.duration_s is not None:
            _check_duration("duration_s", self.duration_s, "> 0")
        if self.start.shape not in ((3,), (6,)) or not np.all(np.isfinite(self.start)):
            raise UsageError.of("simulate.pose", name="eta", value=str(self.start.tolist()))

    @property
    def start(self) -> np.ndarray:
        """Return the pose (3,) at the start, or pose and velocity (6,); zeros by default."""
        return np.zeros(3) if self.eta is None else np.array(self.eta, dtype=float)

    def make_world(self, vehicle_file: VehicleFile) -> World:
        """Return the world of the drive.

        Raise UsageError if file and world have different numbers of commands, or if `world` and `shake` are both given.
        """
        world = self._simulated_world(vehicle_file) if self.world is None else self.world
        if self.world is not None and self.shake is not None:
            raise UsageError.of("shake.of-another-world", world=type(self.world).__name__)
        check_world(world)
        _check_command_count(vehicle_file, world)
        return world if is_in_package(type(world)) else with_checked_ticks(world, example_tick(vehicle_file))

    def _simulated_world(self, vehicle_file: VehicleFile) -> World:
        file = vehicle_file.truth if self.truth is None else vehicle_file.simulation_truth(self.truth)
        settings = file.vehicle, file.sensors, file.rate_hz, self.seed, self.start, self.backend
        if self.shake is None:
            return SimulatedWorld(*settings)
        return FaultyWorld(*settings, self.shake, channel_units(file))

    def tick_times(self, vehicle_file: VehicleFile) -> Iterable[int]:
        """Return the times of the ticks [ns]."""
        if self.tick_times_ns is not None:
            return self.tick_times_ns
        return clock.simulated_ticks(vehicle_file.rate_hz, self.duration_s)

    def metadata(self, kind: str, blocks: Blocks) -> dict[str, str]:
        """Return the metadata of a run about these conditions: kind, seed, start and backend."""
        start_text = " ".join(map(repr, self.start.tolist()))
        backend = blocks.estimator.backend if isinstance(blocks.estimator, CompiledBlock) else "numpy"
        rest = {REST_KEY: repr(float(self.rest_s))} if self.rest_s else {}
        return {"kind": kind, "seed": str(self.seed), "start": start_text, "backend": backend} | rest


def _check_duration(name: str, duration_s: object, bound: str) -> None:
    """Raise UsageError for a duration that is not a finite number within the bound, "≥ 0" or "> 0"."""
    is_number = isinstance(duration_s, int | float | np.number)
    if not (is_number and 0.0 <= duration_s < np.inf) or (duration_s == 0.0 and bound == "> 0"):
        raise UsageError.of("drive.duration", name=name, value=repr(duration_s), range=bound)


def user_block_metadata(blocks: Blocks, vehicle_file: VehicleFile) -> tuple[dict[str, str], list[Diagnostic]]:
    """Return the metadata about blocks that are not built in, and a message for each block without a source text.

    The key "controller" contains the class and its numeric parameters, "controller.text" the source text.
    """
    blocks_by_role = {**blocks._asdict(), "vehicle": vehicle_file.vehicle, **vehicle_file.sensors._asdict()}
    own_blocks = {
        role: part
        for role in blocks_by_role
        for part in optional.nested_blocks(blocks_by_role[role])
        if not is_in_package(type(part))
    }
    texts = {role: source_text(type(block)) for role, block in own_blocks.items()}
    text_notes = [
        note("drive.text-unknown", role=role, block=type(own_blocks[role]).__name__)
        for role in own_blocks
        if not texts[role]
    ]
    names = {role: parameters_text(block) for role, block in own_blocks.items()}
    return names | {f"{role}.text": text for role, text in texts.items() if text}, text_notes


def parameters_text(block: object) -> str:
    """Return the class of a block and its numeric parameters as text: "MyController(k_x=3.0)"."""
    values = {name: getattr(block, name, None) for name in inspect.signature(type(block)).parameters}
    parameters = ", ".join(
        f"{name}={value!r}" for name, value in values.items() if isinstance(value, int | float)
    )
    return f"{type(block).__name__}({parameters})"


@checked_call('drive(blocks, robot, "experiment")', checked=(Conditions,))
def drive(
    blocks: Blocks,
    vehicle_file: VehicleFile,
    kind: str,
    *,
    path: Path | str | None = None,
    live: bool = False,
    observers: Sequence[Observer] = (),
    **conditions: Any,
) -> Run:
    """Run blocks in a world until the guide is done.

    Parameters
    ----------
    blocks : Blocks
        Estimator, guide, controller and supervisor.
    vehicle_file : VehicleFile
        The vehicle to which the blocks belong.
    kind : str
        The kind of drive in the metadata of the run.
    path : path, optional
        File to which the run is written during the drive, or a folder with numbered runs.
    live : bool
        True for a real vehicle: the loop does not wait for the disk or for a block that hangs.
    observers : sequence of Observer
        Called at each tick with its record; they can stop the drive.
    **conditions : object
        Keywords of `Conditions`: `world`, `truth`, `seed`, `eta`, `backend`, …

    Returns
    -------
    Run
        Without records if `live` is True and `path` is given: one hour would take more memory than a vehicle has.

    Raises
    ------
    UsageError
        If file and world have different numbers of commands.
    SafetyStop
        If the drive is stopped before its first tick. A later stop returns the run, and `drive_stop_reason` returns the
        reason.
    FileError
        At the end of a drive, if the disk was full; the file at `path` contains the run up to that time.

    Examples
    --------
    >>> from baqueano.controllers import Schedule
    >>> from baqueano.guides import Idle
    >>> from baqueano.loop import Blocks
    >>> robot = bq.load("small")
    >>> plan = Schedule.at_rate(np.tile([0.5, 0.0, 0.0], (50, 1)), robot.rate_hz)
    >>> run = drive(Blocks(robot.estimator(), Idle(0.5), plan, robot.supervisor()), robot, "experiment")
    >>> run.duration_s
    0.5
    """
    settings = Conditions(**conditions)
    world = settings.make_world(vehicle_file)
    own_texts, text_notes = user_block_metadata(blocks, vehicle_file)
    blocks, sensors, notes = _prepare(blocks, vehicle_file, settings, live)
    for observer in observers:
        blocks = observer.begin(blocks)
    blocks = with_rest(blocks, settings.rest_s, world.commands)
    if settings.rest_s:
        notes = [*notes, note("drive.rest", rest_s=settings.rest_s)]
    blocks = blocks._replace(supervisor=Watchdog(blocks.supervisor, observers)) if observers else blocks
    metadata = settings.metadata(kind, blocks) | own_texts
    health = Health(vehicle_file.envelope, sensors)
    tick_times_ns = settings.tick_times(vehicle_file)

    def perform(sink: RunRecorder) -> None:
        recording = Recording(
            sink, world, health, observers, _first_ns(tick_times_ns), block_diagnostics(blocks)
        )
        start, origin_note = initial_pose_for(blocks.estimator, settings.start)
        recording.begin([*world.notes, *text_notes, *notes, *([] if origin_note is None else [origin_note])])
        _run(blocks, tick_times_ns, start, recording)

    label = kind.replace(" ", "-")
    if path is None:
        memory = MemoryRecorder(vehicle_file.text, metadata)
        perform(memory)
        return memory.run(label)
    path = path_of_run(path, label)
    try:
        with RunWriter(path, vehicle_file.text, metadata, live=live) as writer:
            perform(writer)
    except SafetyStop:  # before the first tick
        path.unlink()
        raise
    if live:
        zero_commands = np.zeros((0, world.commands))
        return Run(vehicle_file.name, path, np.zeros(0, dtype=np.int64), zero_commands, metadata=metadata)
    return read_run(path)


def _prepare(
    blocks: Blocks, vehicle_file: VehicleFile, settings: Conditions, live: bool
) -> tuple[Blocks, SensorMonitor | None, list[Diagnostic]]:
    """Return the compiled blocks, the monitor of the sensors or None, and the messages about both."""
    inputs = blocks, example_tick(vehicle_file), settings.backend
    own_notes = sensor_warnings(vehicle_file, blocks.estimator)
    estimator = blocks.estimator
    blocks, notes = compile_blocks(*inputs)
    sensors, sensor_notes = sensor_monitor(vehicle_file, estimator, blocks.estimator.step)
    budget_s = BUDGET_S if live else HANG_S
    blocks = Blocks._make(BudgetedBlock(b, budget_s) if may_hang(b) else b for b in blocks)
    if sensors is not None:
        sensors.begin(*(settings.start[k : k + 3] for k in range(0, len(settings.start), 3)))
    return blocks, sensors, [*settings.notes, *notes, *sensor_notes, *own_notes]


def drive_stop_reason(run: Run) -> Diagnostic | None:
    """Return the reason why the motors were stopped in this run, None if they were not stopped."""
    event = next((e for e in run.events if e.source == STOP_SOURCE and e.level == "error"), None)
    if event is None or event.diagnostic is not None:
        return None if event is None else event.diagnostic
    return stop(StopReason.RECORDED, words=event.text)  # a run that is older than the codes


def mark_times_ns(run: Run) -> list[int]:
    """Return the times [ns] at which the driver reported that the vehicle was on its mark."""
    return [e.t_ns for e in run.events if e.source == MARK_SOURCE]


def compile_blocks(blocks: Blocks, tick: Tick, backend: str) -> tuple[Blocks, list[Diagnostic]]:
    """Return the blocks compiled, after a first step of each, so that the first tick does not wait for a compiler.

    A block that cannot be compiled runs as Python code, which is slower; the diagnostics state the block and the
    reason.
    """
    if backend == "numpy":
        return blocks, []
    try:
        states = within(HANG_S, loop.init, blocks)
        _, estimate = within(HANG_S, blocks.estimator.step, states.estimator, tick)
    except BaseException as error:  # the loop raises it again, stops, and names the block
        if is_interruption(error):
            raise
        return blocks, []
    reference = Reference(0, np.zeros(3), np.zeros(3), 0.0)
    command = Command(0, np.zeros(len(tick.u)))
    inputs = (tick,), (estimate,), (reference, estimate), (command, tick, estimate)
    results = [
        compile_if_possible(*x, backend) for x in zip(Blocks._fields, blocks, states, inputs, strict=True)
    ]
    return Blocks._make(block for block, _ in results), [
        reason for _, reason in results if reason is not None
    ]


def sensor_monitor(
    vehicle_file: VehicleFile, estimator: Estimator, step: Callable[..., Tree]
) -> tuple[SensorMonitor | None, list[Diagnostic]]:
    """Return the monitor of the sensors for this estimator, whose step can be compiled, and messages.

    The monitor is None for a vehicle without sensors, or, with the reason as a message, if it cannot be built.
    """
    if not vehicle_file.sensors:
        return None, []
    tick = example_tick(vehicle_file)
    try:
        model = vehicle_file.estimator("augmented_ekf", use=(), speed_from=())
        _, estimate = within(HANG_S, lambda: step(estimator.init(), tick))
        fit = vehicle_file.parameter_cov
        limit, dt_s = vehicle_file.command.limit, 1.0 / vehicle_file.rate_hz
        alternatives = () if fit is None else alternative_models(model.vehicle, *fit[:2], limit, dt_s)
        return SensorMonitor(model, estimator, tick, estimate, alternatives), []
    except BaseException as error:  # of the user's vehicle or estimator; the loop raises it again
        if is_interruption(error):
            raise
        return None, [note("drive.not-watched", error=error_text(error))]


def compile_if_possible(
    role: str, block: Tree, state: Tree, inputs: tuple[Any, ...], backend: str
) -> tuple[Any, Diagnostic | None]:
    """Return the block compiled, or unchanged with the reason if it cannot be compiled.

    Of a block that runs as written, the blocks inside it are compiled.
    """
    if optional.attribute(block, "is_interpreted"):
        reasons: list[Diagnostic | None] = [None]
        for name in optional.attribute(block, "inner_blocks"):
            part_and_state = getattr(block, name), getattr(state, name)
            part, reason = compile_if_possible(role, *part_and_state, inputs, backend)
            block, reasons = replace(block, **{name: part}), [reason, *reasons]
        return block, next(filter(None, reasons), None)
    try:
        within(HANG_S, block.step, state, *inputs)
        quick_block = compile_block(block, backend)
        quick_block.step(state, *inputs)
    except TraceError as error:
        return block, note(
            "drive.not-compiled", role=role, block=type(block).__name__, error=error.diagnostic
        )
    except BaseException as error:  # the loop raises it again, stops, and names the block
        if is_interruption(error):
            raise
        return block, None
    return quick_block, None


def initial_pose_for(estimator: Estimator, start: np.ndarray) -> tuple[np.ndarray | None, Diagnostic | None]:
    """Return the part of the start, (3,) or (6,), that the estimator's init() accepts, and a diagnostic or None.

    The part is None if init() does not accept a start; the diagnostic reports this if the start is not zero.
    """
    while isinstance(estimator, BudgetedBlock | CompiledBlock):
        estimator = estimator.block
    if argument_count := len(inspect.signature(estimator.init).parameters):
        return start if argument_count > 1 else start[:3], None
    block_name = type(estimator).__name__
    position = str(np.round(start, 3).tolist())
    return None, note("drive.own-origin", block=block_name, start=position) if np.any(start != 0.0) else None


def example_tick(vehicle_file: VehicleFile) -> Tick:
    """Return a tick of this vehicle at rest, without measurements."""
    sensors = vehicle_file.sensors
    return Tick(
        0,
        np.zeros(vehicle_file.vehicle.commands),
        empty_slots({n: getattr(sensors, n).size for n in sensors._fields}),
    )


def _run(
    blocks: Blocks, tick_times_ns: Iterable[int], start: np.ndarray | None, recording: Recording
) -> None:
    """Run the loop. Raise SafetyStop if the drive was stopped before its first tick."""
    with interruptible_ticks(tick_times_ns) as drive_ticks_ns:
        outcome = loop.run(
            blocks, recording.world, drive_ticks_ns, recording.tick, recording.record_stop, start
        )
    if outcome.stop_reason is not None and not outcome.ticks:
        raise SafetyStop(fault("drive.not-started", cause=outcome.stop_reason), outcome.stop_reason)
    recording.end(outcome.stop_reason)


def _first_ns(tick_times_ns: Iterable[int]) -> int:
    """Return the time [ns] of the first tick if it is known before the clock runs, else 0."""
    return int(tick_times_ns[0]) if isinstance(tick_times_ns, list) and tick_times_ns else 0


def _check_command_count(vehicle_file: VehicleFile, world: World) -> None:
    own_commands, world_commands = vehicle_file.vehicle.commands, world.commands
    if own_commands != world_commands:
        raise UsageError.of(
            "drive.other-vehicle", file=vehicle_file.name, value=own_commands, expected=world_commands
        )
