"""`identify`: runs and a vehicle file → the parameters that explain what was measured.

    C(p) = Σ_t ‖s(t) − h_p(t)‖_Huber          Grotz et al., `equ:cost_function`                           (1)

over all channels of all sensors, each in units of its own noise σ, k = 1.345 σ; minimised by damped
Gauss-Newton with exact sensitivities (least_squares.py, search.py) over the free parameters and, run by run,
the sensors' biases and the velocity at the start. What the data do not show is held where it was, and the
rest is fitted again (observability.py).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify import without_encoders
from baqueano.identify.answer.intervals import Information, information
from baqueano.identify.answer.observability import Seen, seen
from baqueano.identify.answer.result import Fit
from baqueano.identify.answer.summary import Finished, fit_of
from baqueano.identify.doubts import mended
from baqueano.identify.rows.clocks import CLOCK_S, slots_for
from baqueano.identify.rows.pieces import cut, without_starts
from baqueano.identify.rows.record import Record, beginning, record_of
from baqueano.identify.rows.resting import with_gyro_at_rest
from baqueano.identify.rows.tape import with_tape
from baqueano.identify.rows.truth import TRUTH, with_truth
from baqueano.identify.rows.voltage import VOLTAGE, with_voltage
from baqueano.identify.solve.by_innovations import checked, fit_by_innovations
from baqueano.identify.solve.cores import each
from baqueano.identify.solve.delay import best_search_of_all, bounds_of
from baqueano.identify.solve.huber import believed, smallest_spread
from baqueano.identify.solve.parameters import (
    DELAY,
    Blocks,
    Free,
    chosen,
    described,
    entries,
    frozen_columns,
    value,
    with_room,
)
from baqueano.identify.solve.problem import Problem, Shape, chosen_sensors
from baqueano.identify.solve.search import Search, Task, search
from baqueano.runs.run import Run
from baqueano.vehicles import Car, Kinematic

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

BIASES = ("accel_bias", "gyro_bias")
POSE_S = 5.0  # of a piece, where a pose is believed: a simulated heading wanders off
SETTLED_LAGS = 8.0  # of the motors, after which 3e-4 is left of what they did before
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
    _same_commands(vehicle_file, runs)
    special = sigma or per_run or clocks or measured or segment_s or at_rest or speed_noise or not doubts
    if led is None and biases and cost == "simulation" and not special:
        led = without_encoders.imu_is_all(vehicle_file, runs, use, free)
    if led:
        return without_encoders.without_encoders(
            runs, vehicle_file, free, fixed=fixed, bounds=bounds, start=start, say=say, backend=backend
        )
    if biases and isinstance(vehicle_file.vehicle, Car):
        vehicle_file, said = with_gyro_at_rest(vehicle_file, runs)
    blocks, runs, only = _sensors(vehicle_file, runs, use)
    runs, blocks = with_tape(runs, blocks, measured)
    runs, found_before = mended(runs, vehicle_file, blocks.sensors._asdict())
    asked = Asked(tuple(per_run), tuple(clocks), segment_s, biases, at_rest).checked(blocks)
    if measured and asked.segment_s is not None:
        raise UsageError(
            "what a tape told is of a whole run, and this one is cut into pieces: leave out segment_s, and the "
            "pose that a camera saw, which tells more than a tape."
        )
    wanted = chosen(blocks, free, (*fixed, *per_run), bounds or {})
    _sensible(bounds or {}, [one.path for one in wanted] + list(per_run))
    u = np.nan_to_num(np.concatenate([run.applied for run in runs]))
    frozen = frozen_columns(wanted, u)
    blocks, wanted = with_room(blocks, wanted, vehicle_file.rate_hz, u)
    records = with_voltage(_records(runs, blocks, only, asked), runs, blocks)
    if (wanted and len(frozen) == len(wanted)) or not np.any(u):
        raise UsageError("no command moved, so there is nothing to fit: was the right run read?")
    told = [one for k, one in enumerate(wanted) if k not in frozen]
    shape = _shape(blocks, told, records, asked)
    problem = Problem(blocks, shape, records, backend)
    given = None if sigma is None else _given(sigma, blocks.sensors)
    floor = smallest_spread(blocks.sensors, problem.z, problem.has)
    bounded = _begin(blocks, told, problem, start or {}, bounds or {})
    few = believed(blocks.sensors, problem.has)
    task = Task(problem, *bounded, floor, given, speed_noise, say, few)
    names = [*shape.shared, *([""] * (problem.size - len(told)))]
    begin = task.first if problem.scan.backend == "c" else _first_part(task, blocks, backend)
    within, found = best_search_of_all(task, begin)
    found, sight, info = _without_the_unseen(within, found, names)
    found = bounds_of(task, found)
    end = Finished(vehicle_file, blocks, task, wanted, frozen, found, sight, info, said, found_before, doubts)
    return fit_by_innovations(end) if cost == "innovations" else fit_of(end)


class Asked(NamedTuple):
    """What stands beside the shared parameters."""

    per_run: tuple[str, ...]
    clocks: tuple[str, ...]
    segment_s: float | None
    biases: bool
    at_rest: bool

    def checked(self, blocks: Blocks) -> "Asked":
        """Itself, with pieces where a pose is believed. UsageError for what does not exist."""
        names = blocks.sensors._fields
        for name in self.clocks:
            if name not in names:
                raise UsageError(
                    f'clocks = "{name}": it is not among what is believed, {", ".join(names)}. Add it to use.'
                )
        if self.segment_s is not None and not self.segment_s > 0.0:
            raise UsageError(f"segment_s = {self.segment_s:g}: expected the length of a piece, above 0 s.")
        poses = any(hasattr(sensor, "difference") for sensor in blocks.sensors)
        return self._replace(segment_s=POSE_S) if poses and self.segment_s is None else self


def _records(runs: list[Run], blocks: Blocks, only: dict[str, list[int]], asked: Asked) -> list[Record]:
    """The rows of all runs, piece by piece."""
    out, sensors = [], blocks.sensors._asdict()
    read = each(
        lambda run: record_of(run, sensors, only, asked.clocks), runs, rows=sum(len(r.t_ns) for r in runs)
    )
    for k, whole in enumerate(read):
        whole = whole._replace(run=k)
        drivetrain = getattr(blocks.model, "drivetrain", None)
        late_s = float(np.median(whole.dt_s)) * getattr(drivetrain, "delay_slots", 0)
        settled_s = SETTLED_LAGS * getattr(drivetrain, "lag_s", 0.0)
        lead_s = max(late_s, settled_s, 2.0 * CLOCK_S if asked.clocks else 0.0)
        out += [whole] if asked.segment_s is None else cut(whole, asked.segment_s, lead_s)
    return out


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


def _shape(blocks: Blocks, told: list[Free], records: list[Record], asked: Asked) -> Shape:
    paths, names = tuple(one.path for one in told), blocks.sensors._fields
    own = [p for path in asked.per_run for p in entries(blocks, path)]
    for name, sensor in zip(names, blocks.sensors, strict=True):
        known = BIASES[:1] if isinstance(blocks.model, Car) else BIASES
        fields = [f for f in known if hasattr(sensor, f)] if asked.biases else []
        biases = [p for f in fields for p in entries(blocks, f"sensors.{name}.{f}")]
        own += [p for p in biases if p not in paths and p not in own]
    pieces = asked.segment_s is not None
    if (asked.at_rest and not pieces) or isinstance(blocks.model, Kinematic):
        start: tuple[int, ...] = ()
    else:
        start = (0, 2) if isinstance(blocks.model, Car) else (0, 1, 2)
    if any(hasattr(sensor, "difference") for sensor in blocks.sensors):
        start += (3, 4, 5)
    early = tuple(any(r.sensors[name].early is not None for r in records) for name in names)
    slots = max(slots_for(record.dt_s) for record in records) if asked.clocks else 0
    volts = any(VOLTAGE in record.sensors for record in records)
    return Shape(paths, tuple(own), start, early, asked.clocks, slots, volts)


def _begin(
    blocks: Blocks,
    told: list[Free],
    problem: Problem,
    start: Mapping[str, Any],
    bounds: Mapping[str, tuple[float, float]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """θ at the start, and its bounds."""
    shape, layout = problem.shape, problem.layout
    said: dict[str, float] = {}
    for path, numbers in start.items():
        paths = entries(blocks, path)
        for p, x in zip(paths, np.broadcast_to(np.asarray(numbers, float).ravel(), len(paths)), strict=True):
            said[p] = float(x)
    lost = [p for p in said if p not in shape.shared and p not in shape.own]
    if lost:
        raise UsageError(f"start = {lost[0]}: it is not among the free parameters, so it has no start value.")
    theta, low, high = np.zeros(layout.size), np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    for k, one in enumerate(told):
        theta[k], low[k], high[k] = said.get(one.path, value(blocks, one.path)), one.low, one.high
    for run in range(max(layout.runs) + 1):
        for k, path in enumerate(shape.by_run, layout.shared + run * layout.by_run):
            if path in shape.own:
                one = described(blocks, path, bounds)
                theta[k], low[k], high[k] = said.get(path, value(blocks, path)), one.low, one.high
            else:
                low[k], high[k] = -CLOCK_S, CLOCK_S
    for k, record in enumerate(problem.records):
        seen = _first_pose(record, blocks)
        theta[layout.of_starts(k)] = [seen[i - 3] if i >= 3 else 0.0 for i in shape.start]
    return np.clip(theta, low, high), low, high


def _first_pose(record: Record, blocks: Blocks) -> np.ndarray:
    """(3,) of the first pose that was measured, 0 without one."""
    for name, sensor in blocks.sensors._asdict().items():
        said = record.sensors[name]
        if hasattr(sensor, "difference") and said.has.any():
            return np.asarray(said.z[np.argmax(said.has[:, 0] > 0.0)])
    return np.zeros(3)


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
    whole = len(problem.layout.runs) == max(problem.layout.runs) + 1
    told = problem.size if whole else problem.layout.starts  # starts of pieces are of no interest
    held, ties = np.zeros(told, bool), {}
    while True:
        problem.weigh(found.sigma, found.profile)
        theta = found.solution.theta
        info = information(problem, theta)
        if not whole:
            A, B = without_starts(info.bread, info.meat, problem.layout)
            info = info._replace(bread=A, meat=B, channels=info.channels[:, :told])
        if task.believed is not None:  # a tape has no signal to compare with
            info = info._replace(channels=info.channels * (task.believed == 0.0)[:, None])
        span = np.where([name == DELAY for name in names], np.inf, task.high - task.low)[:told]
        sight = seen(info, energy(problem, theta), theta[:told], names[:told], held, span)
        ties |= sight.tied
        if np.array_equal(~sight.kept, held):
            return found, sight._replace(tied=ties), info
        held = ~sight.kept
        still = np.concatenate([held, np.zeros(problem.size - told, bool)])
        again = search(task, np.where(still, task.first, theta), still, found)
        found = again._replace(evaluations=found.evaluations + again.evaluations)


def energy(problem: Problem, theta: np.ndarray) -> np.ndarray:
    """(m,) of what the model says of each channel about its mean, in standard deviations of the noise."""

    def of(r: np.ndarray, z: np.ndarray, has: np.ndarray, weight: np.ndarray) -> np.ndarray:
        h = (z * weight - r) * has
        h -= has * (np.einsum("tc->c", h) / np.maximum(np.einsum("tc->c", has), 1.0))
        return np.einsum("tc,tc->c", h, h)

    rows = sum(map(len, problem.z))
    found = each(of, problem.residuals(theta), problem.z, problem.has, problem.weights, rows=rows)
    return np.sum(found, axis=0)
