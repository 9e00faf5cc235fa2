"""`identify`: runs and a vehicle file → the parameters that explain what was measured.

    C(p) = Σ_t ‖s(t) − h_p(t)‖_Huber          Grotz et al., `equ:cost_function`                           (1)

over all channels of all sensors, each in units of its own noise σ, k = 1.345 σ; minimised by damped
Gauss-Newton with exact sensitivities (least_squares.py, search.py) over the free parameters and, run by run,
the sensors' biases and the velocity at the start. What the data do not show is held where it was, and the
rest is fitted again (observability.py).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify import without_encoders
from baqueano.identify.answer.result import Fit
from baqueano.identify.answer.summary import Finished, fit_of
from baqueano.identify.doubts import REFUSED, mended
from baqueano.identify.rows.record import beginning
from baqueano.identify.rows.resting import with_gyro_at_rest
from baqueano.identify.rows.tape import with_tape
from baqueano.identify.rows.voltage import with_voltage
from baqueano.identify.solve.by_innovations import checked, fit_by_innovations
from baqueano.identify.solve.delay import best_search_of_all, bounds_of
from baqueano.identify.solve.huber import believed, smallest_spread
from baqueano.identify.solve.parameters import Blocks, chosen, frozen_columns, with_room
from baqueano.identify.solve.posed import (
    Asked,
    first_theta,
    given_sigma,
    records_of,
    same_commands,
    sensible,
    sensors_of,
    shape_of,
)
from baqueano.identify.solve.problem import Problem
from baqueano.identify.solve.search import Task, search
from baqueano.identify.solve.unseen import without_the_unseen
from baqueano.runs.run import Run
from baqueano.vehicles import Car

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

PART, ENOUGH = 4, 1000  # of the rows of a run, and at least, for a first search without a compiler


def identify(
    runs: Run | Sequence[Run],
    vehicle_file: "VehicleFile",
    free: Sequence[str] | None = None,
    *,
    fixed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    start: Mapping[str, Any] | None = None,
    use: Sequence[str] | None = None,
    biases: bool = True,
    at_rest: bool = False,
    sigma: Mapping[str, Any] | None = None,
    per_run: Sequence[str] = (),
    clocks: Sequence[str] = (),
    segment_s: float | None = None,
    measured: Sequence[str] = (),
    speed_noise: bool = False,
    cost: str = "simulation",
    doubts: bool = True,
    led: bool | None = None,
    say: Callable[[str], object] | None = None,
    backend: str = "auto",
) -> Fit:
    """The parameters of `vehicle_file` that explain `runs`.

    `free` are dotted paths of the file ("model.friction.linear", "model.actuator_matrix[0,2]"), else what the
    model needs; `fixed` are taken out again; `bounds` {path: (low, high)} narrow those of the fields; `start`
    {path: value} is where the search begins, else the file's values. `use` names the sensors, else all that
    the runs have, or single channels, "imu[2]"; "truth" takes the velocity of a simulation, or the pose that a
    camera saw, for a measurement.
    `biases`: estimate those of the IMU, per run, but of a car that of the gyro at rest (resting.py); `at_rest`:
    the runs begin at rest. `per_run` are paths that each run has for itself; `clocks` sensors whose stamps may
    be off by ± 0.25 s, run by run (clocks.py). `segment_s` cuts the runs into pieces with a start of their own
    (pieces.py); poses are cut into 5 s if it is not given. `measured` is what a tape told, "end: 2.31 m, 95 deg"
    (tape.py). `sigma` {sensor: (m,)} fixes the noise;
    `speed_noise` lets it grow with speed (by_speed.py). `cost` "innovations" goes on with the likelihood of a
    filter's innovations, the floor's noise among what is fitted (prediction.py), and tells which to believe.
    `doubts` asks at the end what is not in the model (doubts/structure.py), which takes a few times as long as
    the fit; without it the verdict knows less. `led`: by the gyro (without_encoders.py), None: a car whose IMU is
    all that is believed. `say` is told how far it is; True from it ends it.
    """
    runs, said, cost = [runs] if isinstance(runs, Run) else list(runs), "", checked(cost, clocks)
    same_commands(vehicle_file, runs)
    special = sigma or per_run or clocks or measured or segment_s or at_rest or speed_noise or not doubts
    if led is None and biases and cost == "simulation" and not special:
        led = without_encoders.imu_is_all(vehicle_file, runs, use, free)
    if led:
        return without_encoders.without_encoders(
            runs, vehicle_file, free, fixed=fixed, bounds=bounds, start=start, say=say, backend=backend
        )
    if biases and isinstance(vehicle_file.vehicle, Car):
        vehicle_file, said = with_gyro_at_rest(vehicle_file, runs)
    blocks, runs, only = sensors_of(vehicle_file, runs, use)
    runs, blocks = with_tape(runs, blocks, measured)
    runs, found_before = mended(runs, vehicle_file, blocks.sensors._asdict())
    asked = Asked(tuple(per_run), tuple(clocks), segment_s, biases, at_rest).checked(blocks)
    if measured and asked.segment_s is not None:
        raise UsageError(
            "what a tape told is of a whole run, and this one is cut into pieces: leave out segment_s, and the "
            "pose that a camera saw, which tells more than a tape."
        )
    wanted = chosen(blocks, free, (*fixed, *per_run), bounds or {})
    sensible(bounds or {}, [one.path for one in wanted] + list(per_run))
    u = np.nan_to_num(np.concatenate([run.applied for run in runs]))
    frozen = frozen_columns(wanted, u)
    blocks, wanted = with_room(blocks, wanted, vehicle_file.rate_hz, u)
    records = with_voltage(records_of(runs, blocks, only, asked), runs, blocks)
    if (wanted and len(frozen) == len(wanted)) or not np.any(u):
        raise UsageError("no command moved, so there is nothing to fit: was the right run read?")
    told = [one for k, one in enumerate(wanted) if k not in frozen]
    shape = shape_of(blocks, told, records, asked)
    problem = Problem(blocks, shape, records, backend)
    given = None if sigma is None else given_sigma(sigma, blocks.sensors)
    floor = smallest_spread(blocks.sensors, problem.z, problem.has)
    bounded = first_theta(blocks, told, problem, start or {}, bounds or {})
    few = believed(blocks.sensors, problem.has)
    usable = not any(one.level == REFUSED for one in found_before)
    task = Task(problem, *bounded, floor, given, speed_noise, say, few, usable)
    names = [*shape.shared, *([""] * (problem.size - len(told)))]
    begin = task.first if problem.scan.backend == "c" else _first_part(task, blocks, backend)
    within, found = best_search_of_all(task, begin)
    found, sight, info = without_the_unseen(within, found, names)
    found = bounds_of(task, found)
    end = Finished(vehicle_file, blocks, task, wanted, frozen, found, sight, info, said, found_before, doubts)
    return fit_by_innovations(end) if cost == "innovations" else fit_of(end)


def _first_part(task: Task, blocks: Blocks, backend: str) -> np.ndarray:
    """Where a rough search over the first part of each run ends: without a compiler every row counts."""
    records = task.problem.records
    rows = [max(ENOUGH, len(record.dt_s) // PART) for record in records]
    if all(len(record.dt_s) <= n for record, n in zip(records, rows, strict=True)):
        return task.first
    first = [beginning(record, n) for record, n in zip(records, rows, strict=True)]
    part = Problem(blocks, task.problem.shape, first, backend)
    return search(task._replace(problem=part), task.first, rough=True).solution.theta
