"""Replay a run: pass its ticks through blocks again. A smoothed estimate also uses the later measurements."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.blocks import permit_blocks
from baqueano.contracts.blocks import Controller, Estimator, OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.controllers import Schedule
from baqueano.diagnostics import note
from baqueano.drive.session import Conditions, drive, initial_pose_for
from baqueano.errors import FileError, UsageError
from baqueano.estimators.pauses import split_ticks
from baqueano.estimators.smoother import can_be_smoothed, smooth
from baqueano.guides import Idle, Playback
from baqueano.guides.route import Route
from baqueano.loop import Blocks
from baqueano.messages import english_text
from baqueano.runs import EstimateLog, Event, Run, write_run
from baqueano.runs.initial_pose import initial_pose
from baqueano.signals import Slot, Tick, empty_slots, seconds, sensor_slots
from baqueano.symbolic import TraceError
from baqueano.vehicle_file.file import VehicleFile, parse
from baqueano.worlds.replayed import ReplayedWorld, replay_supervisor


@checked_call("bq.replay(run)", checked=(drive, Conditions))
def replay(
    run: Run, vehicle_file: VehicleFile | None = None, blocks: Blocks | None = None, *,
    estimator: OwnBlock | None = None, guide: OwnBlock | None = None, controller: OwnBlock | None = None,
    allow_blocks: bool = False, smooth: bool = False, **options: Any,
) -> Run:  # fmt: skip
    """Pass the ticks of a run through blocks again; no vehicle moves.

    The same blocks and back end return the same results, bit for bit. The commands of a controller are recorded as
    requested; they do not affect the motion.

    Parameters
    ----------
    run : Run
        A recorded run.
    vehicle_file : VehicleFile, optional
        The file that defines the blocks; by default the file in the run.
    blocks : Blocks, optional
        All blocks of the loop at once.
    estimator, guide, controller : str, type or block, optional
        A block instead of the file's, as in `repeat`.
    allow_blocks : bool
        True to execute the user's blocks that the run names.
    smooth : bool
        True to estimate each instant from the whole run, later measurements included.
    **options : object
        The options of `experiment`.

    Returns
    -------
    Run
        The same measurements with the estimates of these blocks.

    Raises
    ------
    ValueError
        For a run without ticks.
    UsageError
        For a run without a vehicle file, or an estimator that cannot be smoothed.

    Examples
    --------
    >>> small = bq.load("small")
    >>> run = bq.experiment(small, np.tile([0.5, 0.0, 0.0], (100, 1)))
    >>> np.array_equal(replay(run, small).estimate.eta, run.estimate.eta)
    True
    """
    vehicle_file = (
        recorded_vehicle_file(run, allow_blocks=allow_blocks) if vehicle_file is None else vehicle_file
    )
    world, path = ReplayedWorld(run, vehicle_file.sensors), options.pop("path", None) if smooth else None
    backend = run.metadata.get("backend", "auto")
    options = {"backend": backend, "eta": initial_pose(run), "rest_s": run.rest_s} | options
    with permit_blocks(allow_blocks):
        blocks = blocks or replay_blocks(run, vehicle_file, estimator, guide, controller)
    replayed_run = drive(blocks, vehicle_file, "replay", world=world, tick_times_ns=world.times, **options)
    if not smooth:
        return replayed_run
    return _smooth_run(replayed_run, vehicle_file, blocks.estimator, options["eta"], options["backend"], path)


def recorded_vehicle_file(run: Run, *, allow_blocks: bool = False) -> VehicleFile:
    """Return the vehicle file that a run contains. Raise UsageError for a run without a vehicle file.
    Raise FileError for a user's block that vehicle.toml of this folder does not name, except with `allow_blocks`."""
    if not run.vehicle_text:
        raise UsageError.of("drive.no-vehicle-in-run", run=run.name)
    with permit_blocks(allow_blocks):
        return parse(run.vehicle_text, f"{run.name}: vehicle.toml")


def replay_blocks(
    run: Run, vehicle_file: VehicleFile, estimator: OwnBlock | None = None, guide: OwnBlock | None = None,
    controller: OwnBlock | None = None,
) -> Blocks:  # fmt: skip
    """Return the blocks for a replay: the blocks of `vehicle_file` or the given ones, with the recorded references.

    A `guide` receives them as a route. Without `controller` or gains of a repetition, the commands are repeated.
    """
    ref, log, begin = run.guide_reference, run.reference, min(run.begin_index, len(run.t_ns) - 1)
    end_ns = np.zeros(0) if log is None else log.t_ns[log.at_end > 0.0]
    guide_block = Playback(*ref) if ref is not None else Idle(
        float(seconds(end_ns[0], run.t_ns[begin])) if len(end_ns) else float("inf"))  # fmt: skip
    if guide is not None:
        route = None if ref is None else Route(seconds(ref.t_ns, ref.t_ns[0]), ref.eta, ref.nu, closed=False)
        guide_block = vehicle_file.guide(route, guide)
    follower = None if controller is None else vehicle_file.controller(controller)
    if follower is None and run.metadata.get("kind") == "repeat":
        follower = _file_controller(vehicle_file)
    if follower is None:
        u = run.requested_commands
        u = run.applied_commands if u is None else np.where(np.isfinite(u), u, 0.0)
        follower = Schedule(run.t_ns[begin:] - run.t_ns[begin], u[begin:])
    return Blocks(
        vehicle_file.estimator(estimator), guide_block, follower, replay_supervisor(run, vehicle_file)
    )


def _file_controller(vehicle_file: VehicleFile) -> Controller | None:
    """Return the controller of the file, None if the file lacks its gains."""
    try:
        return vehicle_file.controller()
    except FileError as error:
        if error.diagnostic.code == "vehicle.lacks-estimates":
            return None
        raise


def _smooth_run(
    run: Run,
    vehicle_file: VehicleFile,
    estimator: Estimator,
    start: np.ndarray,
    backend: str = "auto",
    path: Path | str | None = None,
) -> Run:
    """Return the run with the smoothed estimates of `estimator` over its ticks; write it to `path` if given.

    `start` is the pose (3,), or pose and velocity (6,). Raise UsageError for an estimator that is not a Kalman filter
    or cannot be compiled.
    """
    sizes = {name: sensor.size for name, sensor in vehicle_file.sensors._asdict().items()}
    state, _ = initial_pose_for(estimator, start)
    belief = estimator.init(
        *(() if state is None else (state,) if len(state) == 3 else (state[:3], state[3:]))
    )
    silent_tick = Tick(int(run.t_ns[0]), run.applied_commands[0], empty_slots(sizes))
    block_name = type(estimator).__name__
    if not can_be_smoothed(estimator, belief, silent_tick):
        raise UsageError.of("smooth.not-kalman", estimator=block_name)
    rows, tick_rows = split_ticks(_ticks(run, sizes), vehicle_file.rate_hz)
    try:
        estimate = smooth(estimator, belief, rows, backend)
    except TraceError as error:
        raise UsageError.of("smooth.not-compiled", estimator=block_name, cause=error.diagnostic) from error
    log = EstimateLog(run.t_ns, *(column[tick_rows] for column in estimate[1:4]))
    message = note("smooth.smoothed", estimator=block_name)
    event = Event(int(run.t_ns[0]), "info", "estimator", english_text(message), message)
    run = replace(run, estimate=log, reference=run.guide_reference, events=(event, *run.events))
    if path is None:
        return run
    run = replace(run, name=Path(path).stem)
    write_run(run, Path(path))
    return run


def _ticks(run: Run, sizes: dict[str, int]) -> Tick:
    """Return the N ticks of the run as one Tick of arrays with N as the first axis.

    A sensor that is not in the run is silent.
    """
    ticks, n = list(run.ticks()), len(run.t_ns)
    slots = {}
    for name, m in sizes.items():
        columns: Any = (np.zeros(n), np.zeros((n, m)), np.zeros(n))
        if name in run.sensors:
            slots_of_sensor = [getattr(tick.sensors, name) for tick in ticks]
            columns = (np.array([slot[i] for slot in slots_of_sensor], dtype=float) for i in range(3))
        slots[name] = Slot(*columns)
    fields: Any = (run.t_ns, run.applied_commands, sensor_slots(tuple(sizes))(**slots))
    return Tick(*fields)
