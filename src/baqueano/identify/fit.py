"""`identify`: runs and a vehicle file → the parameters that explain what was measured.

    C(p) = Σ_t ‖s(t) − h_p(t)‖_Huber          Grotz et al., `equ:cost_function`                           (1)

over all channels of all sensors, each in units of its own noise σ, k = 1.345 σ; minimised by damped
Gauss-Newton with exact sensitivities (least_squares.py, search.py) over the free parameters and, run by run,
the sensors' biases and the velocity at the start. What the data do not show is held where it was, and the
rest is fitted again (observability.py).
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.huber import smallest_spread
from baqueano.identify.intervals import Information, information
from baqueano.identify.observability import Seen, seen
from baqueano.identify.parameters import Blocks, Free, chosen, entries, frozen_columns, value, with_room
from baqueano.identify.problem import Problem, Shape, chosen_sensors
from baqueano.identify.record import Record, beginning, record_of
from baqueano.identify.resting import with_gyro_at_rest
from baqueano.identify.result import Fit
from baqueano.identify.search import Search, Task, best_search, search
from baqueano.identify.summary import Finished, fit_of
from baqueano.identify.velocity import TRUTH, with_truth
from baqueano.runs.run import Run
from baqueano.vehicles import Car, Kinematic

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

BIASES = ("accel_bias", "gyro_bias")
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
    backend: str = "auto",
) -> Fit:
    """The parameters of `vehicle_file` that explain `runs`.

    `free` are dotted paths of the file ("model.friction.linear", "model.actuator_matrix[0,2]"), else what the
    model needs; `fixed` are taken out again; `bounds` {path: (low, high)} narrow those of the fields; `start`
    {path: value} is where the search begins, else the file's values. `use` names the sensors, else all that
    the runs have, or single channels, "imu[2]"; "truth" takes the velocity of a simulation for a measurement.
    `biases`: estimate those of
    the IMU, per run, but of a car that of the gyro at rest (resting.py); `at_rest`: the runs begin at rest.
    `sigma` {sensor: (m,)} fixes the noise.
    """
    runs, said = [runs] if isinstance(runs, Run) else list(runs), ""
    _same_commands(vehicle_file, runs)
    if biases and isinstance(vehicle_file.vehicle, Car):
        vehicle_file, said = with_gyro_at_rest(vehicle_file, runs)
    blocks, runs, only = _sensors(vehicle_file, runs, use)
    sensors = blocks.sensors._asdict()
    records = [record_of(run, sensors, only) for run in runs]
    wanted = chosen(blocks, free, fixed, bounds or {})
    _sensible(bounds or {}, [one.path for one in wanted])
    frozen = frozen_columns(wanted, np.concatenate([record.u for record in records]))
    if len(frozen) == len(wanted) or not any(np.any(record.u) for record in records):
        raise UsageError("no command moved, so there is nothing to fit: was the right run read?")
    blocks, wanted = with_room(blocks, wanted, vehicle_file.rate_hz)
    told = [one for k, one in enumerate(wanted) if k not in frozen]
    shape = _shape(blocks, told, records, biases, at_rest)
    problem = Problem(blocks, shape, records, backend)
    given = None if sigma is None else _given(sigma, blocks.sensors)
    floor = smallest_spread(blocks.sensors, problem.z, problem.has)
    task = Task(problem, *_begin(blocks, told, shape, len(records), start or {}), floor, given)
    names = [*shape.shared, *([""] * (problem.size - len(told)))]
    begin = task.first if problem.scan.backend == "c" else _first_part(task, blocks, backend)
    found, sight, info = _without_the_unseen(task, best_search(task, begin), names)
    return fit_of(Finished(vehicle_file, blocks, task, wanted, frozen, found, sight, info, said))


def _same_commands(file: "VehicleFile", runs: Sequence[Run]) -> None:
    """UsageError where a run is of another kind of vehicle."""
    n = file.vehicle.commands
    for run in runs:
        if run.applied.shape[1] != n:
            raise UsageError(
                f"{run.name} was driven with {run.applied.shape[1]} commands and {file.name} takes {n}: they are "
                "not the same kind of vehicle. Give the file of the one that was driven. Type: --vehicle FILE"
            )


def _sensible(bounds: Mapping[str, tuple[float, float]], free: Sequence[str]) -> None:
    """UsageError where bounds are empty, or of what is not fitted."""
    for path, (low, high) in bounds.items():
        if not low < high:
            raise UsageError(f"the bounds of {path} are {low:g} and {high:g}: expected the lower one first.")
        if not any(one == path or one.startswith(f"{path}[") for one in free):
            raise UsageError(
                f"{path} has bounds and is not fitted, so they would do nothing. Add: --free {path}"
            )


def _sensors(
    file: "VehicleFile", runs: list[Run], use: Sequence[str] | None
) -> tuple[Blocks, list[Run], dict[str, list[int]]]:
    """The vehicle and the sensors to be believed, the truth among them if it is asked for; and which channels
    of those of which not all are."""
    if not runs:
        raise UsageError("identify needs at least one run.")
    known = file.sensors._fields
    if use is None:
        use = [name for name in known if all(name in r.sensors and len(r.sensors[name].z) for r in runs)]
        if not use:
            has = sorted({name for run in runs for name in run.sensors})
            raise UsageError(
                f"the runs hold {', '.join(has) or 'no sensor'}, the vehicle file "
                f"{', '.join(known) or 'no sensor'}: expected at least one in common."
            )
    sensors, only = file.sensors, _channels(use)
    names = list(dict.fromkeys(one.partition("[")[0] for one in use))
    if TRUTH in names:
        runs, sensors = with_truth(runs, sensors)
    for name in names:
        if name not in sensors._fields:
            raise UsageError(
                f'use = "{name}": the vehicle file has no such sensor; it has {", ".join(known) or "none"}.'
            )
        size = getattr(sensors, name).size
        if name in only and max(only[name]) >= size:
            raise UsageError(f'use = "{name}[{max(only[name])}]": its channels are 0 to {size - 1}.')
    return Blocks(file.vehicle, chosen_sensors(sensors, names)), runs, only


def _channels(use: Sequence[str]) -> dict[str, list[int]]:
    """Sensor → channels, of "imu[2]" and the like; sensors that are named whole are not among them."""
    only: dict[str, list[int]] = {}
    for one in use:
        name, bracket, entry = one.partition("[")
        if bracket and name not in use:
            if not entry.rstrip("]").isdigit():
                raise UsageError(f'use = "{one}": expected a sensor, or one channel of it as "imu[2]".')
            only.setdefault(name, []).append(int(entry.rstrip("]")))
    return only


def _shape(blocks: Blocks, told: list[Free], records: list[Record], biases: bool, at_rest: bool) -> Shape:
    paths = tuple(one.path for one in told)
    own: list[str] = []
    for name, sensor in zip(blocks.sensors._fields, blocks.sensors, strict=True):
        known = BIASES[:1] if isinstance(blocks.model, Car) else BIASES
        fields = [f for f in known if hasattr(sensor, f)] if biases else []
        own += [p for f in fields for p in entries(blocks, f"sensors.{name}.{f}") if p not in paths]
    if at_rest or isinstance(blocks.model, Kinematic):
        start: tuple[int, ...] = ()
    else:
        start = (0, 2) if isinstance(blocks.model, Car) else (0, 1, 2)
    early = tuple(any(r.sensors[name].early is not None for r in records) for name in blocks.sensors._fields)
    return Shape(paths, tuple(own), start, early)


def _begin(
    blocks: Blocks, told: list[Free], shape: Shape, runs: int, start: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ at the start, and its bounds."""
    said: dict[str, float] = {}
    for path, numbers in start.items():
        paths = entries(blocks, path)
        for p, x in zip(paths, np.broadcast_to(np.asarray(numbers, float).ravel(), len(paths)), strict=True):
            said[p] = float(x)
    lost = [p for p in said if p not in shape.shared and p not in shape.own]
    if lost:
        raise UsageError(f"start = {lost[0]}: it is not among the free parameters, so it has no start value.")
    shared = [said.get(one.path, value(blocks, one.path)) for one in told]
    own = [said.get(p, value(blocks, p)) for p in shape.own] + [0.0] * len(shape.start)
    theta = np.array(shared + own * runs)
    low, high = np.full(len(theta), -np.inf), np.full(len(theta), np.inf)
    low[: len(told)], high[: len(told)] = [one.low for one in told], [one.high for one in told]
    return np.clip(theta, low, high), low, high


def _given(sigma: Mapping[str, Any], sensors: Any) -> np.ndarray:
    """σ (m,) from {sensor: (m_s,)}."""
    out = []
    for name, sensor in zip(sensors._fields, sensors, strict=True):
        if name not in sigma or np.shape(np.atleast_1d(sigma[name])) not in ((1,), (sensor.size,)):
            raise UsageError(
                f"sigma: expected {sensor.size} numbers for {name}, the standard deviation of its noise."
            )
        out.append(np.broadcast_to(np.asarray(sigma[name], dtype=float), sensor.size))
    full = np.concatenate(out)
    if not np.all(np.isfinite(full) & (full > 0.0)):
        raise UsageError(f"sigma = {full.tolist()}: expected standard deviations greater than 0.")
    return full


def _first_part(task: Task, blocks: Blocks, backend: str) -> np.ndarray:
    """Where a rough search over the first part of each run ends: without a compiler every row counts."""
    records = task.problem.records
    rows = [max(ENOUGH, len(record.dt_s) // PART) for record in records]
    if all(len(record.dt_s) <= n for record, n in zip(records, rows, strict=True)):
        return task.first
    first = [beginning(record, n) for record, n in zip(records, rows, strict=True)]
    part = Problem(blocks, task.problem.shape, first, backend)
    return search(task._replace(problem=part), task.first, rough=True).solution.theta


def _without_the_unseen(task: Task, found: Search, names: Sequence[str]) -> tuple[Search, Seen, Information]:
    """The same search with all that the data do not show held where it was; `names` of all entries of θ."""
    problem = task.problem
    held, ties = np.zeros(problem.size, bool), {}
    while True:
        problem.weigh(found.sigma)
        theta = found.solution.theta
        info = information(problem, theta)
        sight = seen(info, energy(problem, theta), theta, names, held)
        ties |= sight.tied
        if np.array_equal(~sight.kept, held):
            return found, sight._replace(tied=ties), info
        held = ~sight.kept
        again = search(task, np.where(held, task.first, theta), held, found.sigma)
        found = again._replace(evaluations=found.evaluations + again.evaluations)


def energy(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """(m,) of what the model says of each channel about its mean, in standard deviations of the noise."""
    total = np.zeros(len(problem.sigma))
    for r, z, has in zip(problem.residuals(theta), problem.z, problem.has, strict=True):
        h = (z / problem.sigma - r) * has
        mean = h.sum(axis=0) / np.maximum(has.sum(axis=0), 1.0)
        total += np.sum(has * (h - mean) ** 2, axis=0)
    return total
