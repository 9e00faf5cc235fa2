"""A fit as it is posed: which sensors are believed, which rows they give, what θ means, where the search begins."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.identify.blocks import Blocks
from baqueano.identify.rows.clocks import CLOCK_S, slots_for
from baqueano.identify.rows.pieces import cut
from baqueano.identify.rows.record import Measured, Record, past_of, record_of
from baqueano.identify.rows.truth import TRUTH, with_truth
from baqueano.identify.rows.voltage import VOLTAGE, with_voltage
from baqueano.identify.solve.cores import each
from baqueano.identify.solve.huber import smallest_spread
from baqueano.identify.solve.parameters import (
    Free,
    acts_alone,
    described,
    entries,
    frozen_columns,
    value,
    with_room,
)
from baqueano.identify.solve.problem import Problem, chosen_sensors
from baqueano.identify.solve.start import Shape
from baqueano.runs.run import Run
from baqueano.sensors.sampling import tells_pose
from baqueano.vehicles.freedoms import kept

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

BIASES = ("accel_bias", "gyro_bias")
POSE_S = 5.0  # of a piece, where a pose is believed: a simulated heading wanders off
SETTLED_LAGS = 8.0  # of the motors, after which 3e-4 is left of what they did before


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
                raise UsageError(fault("clock.not-believed", sensor=name, known=names))
        if self.segment_s is not None and not self.segment_s > 0.0:
            raise UsageError(fault("segment.length", length_s=self.segment_s))
        poses = any(tells_pose(sensor) for sensor in blocks.sensors)
        return self._replace(segment_s=POSE_S) if poses and self.segment_s is None else self


class Posed(NamedTuple):
    """What is searched for, and in which rows."""

    blocks: Blocks  # with room for what is free
    wanted: list[Free]  # (q,) all parameters that were asked for
    frozen: list[int]  # those of them whose command never moved; they are not in θ
    problem: Problem
    floor: np.ndarray  # (m,) least σ

    @property
    def told(self) -> list[Free]:
        """Those of `wanted` that are in θ; they are its first entries, in order."""
        return [one for k, one in enumerate(self.wanted) if k not in self.frozen]


def posed(
    blocks: Blocks,
    wanted: list[Free],
    runs: list[Run],
    only: dict[str, list[int]],
    asked: Asked,
    rate_hz: float,
    residuals: type[Problem] = Problem,
    backend: str = "auto",
) -> Posed:
    """The parameters `wanted` as the unknowns of `residuals` over all rows of the runs. `only` as `sensors_of` gives
    it. UsageError where no command moved."""
    for run in runs:
        if len(run.applied) and not np.any(np.isfinite(run.applied)):
            raise UsageError(fault("runs.no-command", run=run.name))
    u = np.nan_to_num(np.concatenate([run.applied for run in runs]))
    frozen = frozen_columns(wanted, u)
    if (wanted and len(frozen) == len(wanted)) or not np.any(u):
        raise UsageError(fault("runs.all-still", f"baqueano runs calibrate {runs[0].name}"))
    blocks, wanted = with_room(blocks, wanted, rate_hz, u, past_of(runs))
    records = with_voltage(records_of(runs, blocks, only, asked), runs, blocks)
    told = [one for k, one in enumerate(wanted) if k not in frozen]
    problem = residuals(blocks, shape_of(blocks, told, records, asked), records, backend)
    return Posed(blocks, wanted, frozen, problem, smallest_spread(blocks.sensors, problem.z, problem.has))


def records_of(runs: list[Run], blocks: Blocks, only: dict[str, list[int]], asked: Asked) -> list[Record]:
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
        if not asked.at_rest:
            whole = _after_the_past(whole, float(getattr(drivetrain, "delay_s", 0.0)))
        out += [whole] if asked.segment_s is None else cut(whole, asked.segment_s, lead_s)
    return out


def _after_the_past(record: Record, late_s: float) -> Record:
    """The record without what was measured before its own commands arrive, `late_s` after it begins with one:
    what was sent before then is not known, and the start is found from what comes after. `late_s` is what the file
    tells, also where the delay is free: a run from rest shows a delay by its first command. A run that begins without
    a command was not driven before, and one shorter than twice that stays whole."""
    ends = np.cumsum(record.dt_s)
    if not np.any(record.u[0]) or ends[-1] < 2.0 * late_s:
        return record
    known = (ends > late_s * (1.0 + 1e-9))[:, None]
    sensors = {name: Measured(z, has * known, early) for name, (z, has, early) in record.sensors.items()}
    return record._replace(sensors=sensors)


def same_commands(file: "VehicleFile", runs: Sequence[Run]) -> None:
    """UsageError where a run is of another kind of vehicle."""
    n = file.vehicle.commands
    for run in runs:
        if run.applied.shape[1] != n:
            raise UsageError(
                fault(
                    "runs.other-vehicle",
                    "--vehicle FILE",
                    run=run.name,
                    commands=run.applied.shape[1],
                    vehicle=file.name,
                    expected=n,
                )
            )


def sensible(bounds: Mapping[str, tuple[float, float]], free: Sequence[str]) -> None:
    """UsageError where bounds are empty, or of what is not fitted."""
    for path, (low, high) in bounds.items():
        if not low < high:
            raise UsageError(fault("parameter.bounds", path=path, low=low, high=high))
        if not any(one == path or one.startswith(f"{path}[") for one in free):
            raise UsageError(fault("parameter.bounds-unused", f"--free {path}", path=path))


def sensors_of(
    file: "VehicleFile", runs: list[Run], use: Sequence[str] | None
) -> tuple[Blocks, list[Run], dict[str, list[int]]]:
    """The vehicle and the sensors to be believed, the truth among them if it is asked for; and which channels
    of those of which not all are."""
    if not runs:
        raise UsageError(fault("runs.none"))
    known = file.sensors._fields
    if use is None:
        use = [name for name in known if all(name in r.sensors and len(r.sensors[name].z) for r in runs)]
        if not use:
            raise _nothing_in_common(known, runs)
    sensors, only = file.sensors, _channels(use)
    names = list(dict.fromkeys(one.partition("[")[0] for one in use))
    if TRUTH in names:
        runs, sensors = with_truth(runs, sensors)
    for name in names:
        if name not in sensors._fields:
            raise UsageError(fault("use.unknown", sensor=name, known=known))
        size = getattr(sensors, name).size
        if name in only and max(only[name]) >= size:
            raise UsageError(fault("use.no-channel", sensor=name, entry=max(only[name]), last=size - 1))
    return Blocks(file.vehicle, chosen_sensors(sensors, names)), runs, only


def _nothing_in_common(known: Sequence[str], runs: list[Run]) -> UsageError:
    """What is said where no sensor of the file, of all that are `known`, is read in every run."""
    read = [{name for name, channel in run.sensors.items() if len(channel.z)} for run in runs]
    name = max(known, key=lambda one: sum(one in has for has in read), default="")
    without = [run.name for run, has in zip(runs, read, strict=True) if name not in has]
    if len(without) < len(runs):
        empty = all(name in run.sensors for run in runs)  # what was recorded and never read can be believed
        code = "use.read-in-some" if empty else "use.not-in-all"
        return UsageError(fault(code, runs=without, sensor=name))
    return UsageError(fault("use.nothing-common", read=sorted(set().union(*read)), known=known))


def _channels(use: Sequence[str]) -> dict[str, list[int]]:
    """Sensor → channels, of "imu[2]" and the like; sensors that are named whole are not among them."""
    only: dict[str, list[int]] = {}
    for one in use:
        name, bracket, entry = one.partition("[")
        if bracket and name not in use:
            if not entry.rstrip("]").isdigit():
                raise UsageError(fault("use.unreadable", found=one))
            only.setdefault(name, []).append(int(entry.rstrip("]")))
    return only


def shape_of(blocks: Blocks, told: list[Free], records: list[Record], asked: Asked) -> Shape:
    """What θ means: the shared numbers `told`, what each run has for itself, and the start of each piece."""
    paths, names = tuple(one.path for one in told), blocks.sensors._fields
    own = [p for path in asked.per_run for p in entries(blocks, path)]
    for name, sensor in zip(names, blocks.sensors, strict=True):
        known = BIASES[:1] if acts_alone(blocks.model) else BIASES
        fields = [f for f in known if hasattr(sensor, f)] if asked.biases else []
        biases = [p for f in fields for p in entries(blocks, f"sensors.{name}.{f}")]
        own += [p for p in biases if p not in paths and p not in own]
    pieces = asked.segment_s is not None
    start = () if asked.at_rest and not pieces else kept(blocks.model)
    if any(tells_pose(sensor) for sensor in blocks.sensors):
        start += (3, 4, 5)
    early = tuple(any(r.sensors[name].early is not None for r in records) for name in names)
    slots = max(slots_for(record.dt_s) for record in records) if asked.clocks else 0
    volts = any(VOLTAGE in record.sensors for record in records)
    return Shape(paths, tuple(own), start, early, asked.clocks, slots, volts)


def first_theta(
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
        raise UsageError(fault("start.not-free", path=lost[0]))
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
    """(3,) of the first pose that was measured, 0 without one; without a heading, the course of the first half of the
    way."""
    for name, sensor in blocks.sensors._asdict().items():
        said = record.sensors[name]
        if tells_pose(sensor) and said.has.any():
            first = np.array(said.z[np.argmax(said.has[:, 0] > 0.0)])
            if not said.has[:, 2].any():
                way = said.z[said.has[:, 0] > 0.0, :2] - first[:2]
                far = np.hypot(*way.T)
                first[2] = np.arctan2(*way[np.argmax(far >= 0.5 * far.max())][::-1])
            return first
    return np.zeros(3)


def given_sigma(sigma: Mapping[str, Any], sensors: Any) -> np.ndarray:
    """σ (m,) from {sensor: (m_s,)}."""
    out = []
    for name, sensor in zip(sensors._fields, sensors, strict=True):
        if name not in sigma or np.shape(np.atleast_1d(sigma[name])) not in ((1,), (sensor.size,)):
            raise UsageError(fault("sigma.size", size=sensor.size, sensor=name))
        out.append(np.broadcast_to(np.asarray(sigma[name], dtype=float), sensor.size))
    full = np.concatenate(out)
    if not np.all(np.isfinite(full) & (full > 0.0)):
        raise UsageError(fault("sigma.negative", found=full.tolist()))
    return full
