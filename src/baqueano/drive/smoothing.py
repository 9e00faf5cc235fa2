"""Smooth the estimates of a replayed run. Each estimate then also uses the later measurements."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.contracts.blocks import Estimator
from baqueano.diagnostics import fault, note
from baqueano.drive.session import initial_pose_for
from baqueano.errors import UsageError
from baqueano.estimators.pauses import split_ticks
from baqueano.estimators.smoother import can_be_smoothed, smooth
from baqueano.messages import english_text
from baqueano.runs import EstimateLog, Event, Run, write_run
from baqueano.signals import Slot, Tick, sensor_slots, silent
from baqueano.symbolic import TraceError
from baqueano.vehicle_file.file import VehicleFile


def smooth_run(
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
    initial, _ = initial_pose_for(estimator, start)
    belief = estimator.init(
        *(() if initial is None else (initial,) if len(initial) == 3 else (initial[:3], initial[3:]))
    )
    silent_tick = Tick(int(run.t_ns[0]), run.applied_commands[0], silent(sizes))
    block_name = type(estimator).__name__
    if not can_be_smoothed(estimator, belief, silent_tick):
        raise UsageError(fault("smooth.not-kalman", estimator=block_name))
    rows, tick_rows = split_ticks(_ticks(run, sizes), vehicle_file.rate_hz)
    try:
        estimate = smooth(estimator, belief, rows, backend)
    except TraceError as error:
        raise UsageError(
            fault("smooth.not-compiled", estimator=block_name, cause=error.diagnostic)
        ) from error
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
