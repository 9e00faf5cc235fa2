"""Set up θ, the second stage of a fit: its meaning, its start, its bounds, and the rows that it is fitted to.

    θ = (shared by all runs | of each run | start of each segment)                                        (1)

A simulation without correction drifts away, because of its heading error and of process noise. So a long run is split
into segments of a few seconds, each with its own start (multiple shooting, Bock 1983). The starts are nuisance
parameters. Before its first measurement a segment has a lead, in which delayed commands and sensors fill their buffers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree, Value
from baqueano.errors import UsageError
from baqueano.identify.data.added_channels import VOLTAGE_KEY, with_voltage
from baqueano.identify.data.averaging import ROW_MEAN, WEIGHT_COLUMNS, longest_interval_s
from baqueano.identify.data.record import (
    MAX_CLOCK_OFFSET_S,
    FitRecord,
    FittedBlocks,
    make_record,
    offset_rows,
    offset_s,
    past_row_counter,
    split_record,
)
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import (
    BATTERY_EFFECT,
    DELAY_PATH,
    FreeParameter,
    enable_parameters,
    entries,
    fixed_columns,
    free_parameter,
    has_offset,
    value,
)
from baqueano.messages.printable import baqueano_command
from baqueano.numerics.normal_equations import ArrowLayout, eliminate
from baqueano.numerics.parallel import parallel_map
from baqueano.runs.run import Run
from baqueano.sensors.sampling import measures_pose
from baqueano.signals import ByName
from baqueano.vehicles.freedoms import coasting_axes

BIASES = ("accel_bias", "gyro_bias")
POSE_SEGMENT_S = 5.0  # length of a segment if a pose is used: a simulated heading drifts away
LEAD_LAGS = 8.0  # lags of the motors, after which 3e-4 of their earlier state remains
MIN_SEGMENT_ENTRIES = 48  # of all segments; with more, (3) is faster than one solve of full size
START_NAMES = ("nu_x", "nu_y", "nu_psi", "x", "y", "psi")


class ThetaShape(NamedTuple):
    """Names and numbers of the entries of θ for one segment of a run."""

    shared_paths: tuple[str, ...]  # paths that all runs share
    per_run: tuple[str, ...]  # paths with one value per run: biases
    start: tuple[int, ...]  # indices of START_NAMES that are free
    # for each sensor, True if its timestamps are between ticks, or if its clock is free
    sample_fraction: tuple[bool, ...]
    clocks: tuple[str, ...] = ()  # sensors whose clock is free
    past_rows: int = 0  # rows before the newest that free clocks need
    has_voltage: bool = False  # True if rows end with the battery's voltage
    means: tuple[str, ...] = ()  # sensors whose readings are means over an interval
    clock_means: tuple[str, ...] = ()  # sensors of means among `clocks`; they are not in `means`

    @property
    def paths(self) -> tuple[str, ...]:
        """Return the paths of the parameters at the beginning of θ."""
        return (*self.shared_paths, *self.per_run)

    @property
    def by_run(self) -> tuple[str, ...]:
        """Return the names of the entries that each run has separately."""
        return (*self.per_run, *(f"clock.{name}" for name in self.clocks))

    def mean_weights(self, names: Sequence[str], columns: np.ndarray) -> list[np.ndarray | None]:
        """Return for each sensor its weights (7,) of a mean, from the beginning of `columns`; None for an instant. A
        sensor of means with a free clock has the weights of a whole row.
        """
        first = {name: WEIGHT_COLUMNS * k for k, name in enumerate(self.means)}
        whole_row = {name: ROW_MEAN for name in self.clock_means}
        return [
            columns[first[n] : first[n] + WEIGHT_COLUMNS] if n in first else whole_row.get(n) for n in names
        ]

    def sample_fractions(self, columns: np.ndarray) -> list[Value | None]:
        """Return for each sensor the number of `columns` that its timestamps between ticks need, after the weights of
        the means; None for a sensor without such a number."""
        index = WEIGHT_COLUMNS * len(self.means) + np.cumsum(self.sample_fraction) - 1
        return [columns[k] if part else None for k, part in zip(index, self.sample_fraction, strict=True)]

    @property
    def extra_columns(self) -> int:
        """Return the number of columns of a row after the weights of its measurements."""
        means = WEIGHT_COLUMNS * len(self.means) + len(self.clock_means)
        return sum(self.sample_fraction) + means + self.has_voltage

    @property
    def size(self) -> int:
        """Return the length of θ of one segment."""
        return len(self.shared_paths) + len(self.by_run) + len(self.start)


class ThetaLayout(NamedTuple):
    """Indices in θ of the entries of each segment."""

    shared_count: int
    run_entry_count: int
    start_size: int
    runs: tuple[int, ...]  # of each segment

    @property
    def run_count(self) -> int:
        """Return the number of runs."""
        return max(self.runs) + 1

    @property
    def has_split_runs(self) -> bool:
        """Return True if any run is split into segments."""
        return len(self.runs) > self.run_count

    @property
    def first_start(self) -> int:
        """Return the index of the first start."""
        return self.shared_count + self.run_entry_count * self.run_count

    @property
    def size(self) -> int:
        """Return the length of θ."""
        return self.first_start + self.start_size * len(self.runs)

    @property
    def indices(self) -> list[np.ndarray]:
        """Return for each segment the indices of its entries in θ."""
        s, o = self.shared_count, self.run_entry_count
        run_slices = [slice(s + run * o, s + (run + 1) * o) for run in self.runs]
        return [np.r_[:s, run_slice, self.start_slice(k)] for k, run_slice in enumerate(run_slices)]

    def start_slice(self, k: int) -> slice:
        """Return the slice of θ with the start of segment k."""
        return slice(self.first_start + k * self.start_size, self.first_start + (k + 1) * self.start_size)


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """θ (p,): the parameters that all runs share, then those of each run, then the start of each segment."""

    blocks: FittedBlocks  # prepared for the free parameters
    requested_parameters: tuple[FreeParameter, ...]  # (q,) all requested parameters
    fixed_indices: tuple[int, ...]  # indices of parameters whose command never moved; they are not in θ
    records: tuple[FitRecord, ...]  # per segment
    shape: ThetaShape
    layout: ThetaLayout
    start: np.ndarray  # (p,) start of the search
    low: np.ndarray  # (p,)
    high: np.ndarray  # (p,)

    @property
    def theta_indices(self) -> list[int]:
        """Return the indices of the requested parameters that are in θ."""
        return [k for k in range(len(self.requested_parameters)) if k not in self.fixed_indices]

    @property
    def free(self) -> list[FreeParameter]:
        """Return the requested parameters that are in θ; they are its first entries, in order."""
        return [self.requested_parameters[k] for k in self.theta_indices]


def fit_parameters(
    blocks: FittedBlocks,
    requested_parameters: Sequence[FreeParameter],
    runs: Sequence[Run],
    channels: Mapping[str, list[int]],
    rate_hz: float,
    options: FitOptions,
) -> Parameters:
    """Return the requested parameters of `blocks` for all rows of `runs`; `channels` is a field of `Dataset`. Raise
    UsageError if no command moved, or if bounds or start values belong to no free parameter."""
    names = [*(parameter.path for parameter in requested_parameters), *options.per_run]
    for path in options.bounds:
        if not any(name == path or name.startswith(f"{path}[") for name in names):
            raise UsageError.of("parameter.bounds-unused", f"--free {path}", path=path)
    options = with_pose_segments(options, blocks, names)
    for run in runs:
        if len(run.applied_commands) and not np.any(np.isfinite(run.applied_commands)):
            raise UsageError.of("runs.no-command", run=run.name)
    u = np.nan_to_num(np.concatenate([run.applied_commands for run in runs]))
    fixed_numbers = fixed_columns(list(requested_parameters), u)
    if (requested_parameters and len(fixed_numbers) == len(requested_parameters)) or not np.any(u):
        raise UsageError.of("runs.all-still", baqueano_command("runs", "calibrate", runs[0].name))
    blocks, requested_parameters = enable_parameters(
        blocks, list(requested_parameters), rate_hz, u, past_row_counter(runs)
    )
    free = [parameter for k, parameter in enumerate(requested_parameters) if k not in fixed_numbers]
    has_effect = any(parameter.path == BATTERY_EFFECT for parameter in free)
    records = with_voltage(make_records(runs, blocks, channels, options), runs, blocks, has_effect)
    shape = theta_shape(blocks, free, records, options)
    layout = theta_layout(shape, records)
    begin = start_theta(blocks, free, shape, records, options)
    return Parameters(
        blocks, tuple(requested_parameters), tuple(fixed_numbers), tuple(records), shape, layout, *begin
    )


def with_pose_segments(options: FitOptions, blocks: FittedBlocks, free: Sequence[str]) -> FitOptions:
    """Return the options, with segments if a pose is used. Raise UsageError for a clock that cannot be estimated."""
    names = blocks.sensors._fields
    for name in options.clocks:
        if name not in names:
            raise UsageError.of("clock.unreliable", sensor=name, valid=names)
    if DELAY_PATH in free and {*names} == {*options.clocks}:
        raise UsageError.of("clock.all-free", f"--fix {DELAY_PATH}", path=DELAY_PATH, clocks=names)
    has_pose = any(measures_pose(sensor) for sensor in blocks.sensors)
    return replace(options, segment_s=POSE_SEGMENT_S) if has_pose and options.segment_s is None else options


def theta_layout(shape: ThetaShape, records: Sequence[FitRecord]) -> ThetaLayout:
    """Return the indices in θ of the entries of each segment."""
    runs = tuple(record.run for record in records)
    return ThetaLayout(len(shape.shared_paths), len(shape.by_run), len(shape.start), runs)


def eliminate_starts(
    bread: np.ndarray, meat: np.ndarray, layout: ThetaLayout
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) with the starts eliminated: (2) of numerics/normal_equations.py."""
    starts = [layout.start_slice(k) for k in range(len(layout.runs))]
    return eliminate(bread, meat, layout.first_start, starts)


def arrow_layout(layout: ThetaLayout, extra_count: int = 0) -> ArrowLayout | None:
    """Return the parts of θ and of `extra_count` shared entries after it; None if few belong to segments."""
    count, o, q = len(layout.runs), layout.run_entry_count, layout.start_size
    segment_entries = layout.first_start + np.arange(count * q).reshape(count, q)
    if layout.runs == tuple(range(count)):  # runs of one segment: entries of the run belong to it
        segment_entries = np.hstack(
            [layout.shared_count + np.arange(count * o).reshape(count, o), segment_entries]
        )
    if count < 2 or segment_entries.size < MIN_SEGMENT_ENTRIES:
        return None
    is_segment_entry = np.zeros(layout.size + extra_count, bool)
    is_segment_entry[segment_entries] = True
    shared_entries, index_in_part = np.flatnonzero(~is_segment_entry), np.zeros(len(is_segment_entry), int)
    index_in_part[shared_entries] = np.arange(len(shared_entries))
    index_in_part[segment_entries] = np.arange(segment_entries.shape[1])
    return ArrowLayout(shared_entries, segment_entries, is_segment_entry, index_in_part)


def make_records(
    runs: Sequence[Run], blocks: FittedBlocks, channels: Mapping[str, list[int]], options: FitOptions
) -> list[FitRecord]:
    """Return the rows of all runs, segment by segment."""
    segments, sensors, rows = [], blocks.sensors._asdict(), sum(len(run.t_ns) for run in runs)
    records = parallel_map(lambda run: make_record(run, sensors, channels, options.clocks), runs, rows=rows)
    drivetrain = getattr(blocks.model, "drivetrain", None)
    for k, record in enumerate(records):
        record = record._replace(run=k)
        delay_s = float(np.median(record.dt_s)) * getattr(drivetrain, "delay_slots", 0)
        settled_s = LEAD_LAGS * getattr(drivetrain, "longest_lag_s", 0.0)
        past_s = offset_s(record) if options.clocks else 0.0
        intervals_s = [longest_interval_s(s.mean_weights, record.dt_s) for s in record.sensors.values()]
        lead_s = max(delay_s, settled_s, past_s, *intervals_s)
        if not options.at_rest:
            record = record.without_start(_unknown_s(record, float(getattr(drivetrain, "delay_s", 0.0))))
        segments += [record] if options.segment_s is None else split_record(record, options.segment_s, lead_s)
    return segments


def _unknown_s(record: FitRecord, delay_s: float) -> float:
    """Return the time [s] until the first command of the record takes effect: `delay_s`, the delay in the file, even if
    the delay is free, because a run from rest shows a delay by its first command. Return 0 for a record that begins
    without a command (not driven before), or is shorter than twice `delay_s`."""
    is_command_old = np.any(record.u[0]) and np.cumsum(record.dt_s)[-1] >= 2.0 * delay_s
    return delay_s * (1.0 + 1e-9) if is_command_old else 0.0


def theta_shape(
    blocks: FittedBlocks,
    shared_parameters: Sequence[FreeParameter],
    records: Sequence[FitRecord],
    options: FitOptions,
) -> ThetaShape:
    """Return the meaning of θ: `shared_parameters`, the parameters of each run, the start of each segment."""
    paths, names = tuple(parameter.path for parameter in shared_parameters), blocks.sensors._fields
    run_paths = [p for path in options.per_run for p in entries(blocks, path)]
    for name, sensor in zip(names, blocks.sensors, strict=True):
        zero_names = BIASES[:1] if has_offset(blocks.model) else BIASES
        fields = [f for f in zero_names if has_field(sensor, f)] if options.biases else []
        biases = [p for f in fields for p in entries(blocks, f"sensors.{name}.{f}")]
        run_paths += [p for p in biases if p not in paths and p not in run_paths]
    is_cut = options.segment_s is not None
    start = () if options.at_rest and not is_cut else coasting_axes(blocks.model)
    if any(measures_pose(sensor) for sensor in blocks.sensors):
        start += (3, 4, 5)

    def is_present(name: str, column: str) -> bool:
        return any(getattr(record.sensors[name], column) is not None for record in records)

    means = tuple(name for name in names if is_present(name, "mean_weights"))
    sample_fraction = tuple(name not in means and is_present(name, "sample_fraction") for name in names)
    past_rows = max(map(offset_rows, records)) if options.clocks else 0
    clock_means = tuple(name for name in options.clocks if is_present(name, "duration_s"))
    has_voltage = any(VOLTAGE_KEY in record.sensors for record in records)
    clocks = tuple(options.clocks), past_rows
    return ThetaShape(
        paths, tuple(run_paths), start, sample_fraction, *clocks, has_voltage, means, clock_means
    )


def start_theta(
    blocks: FittedBlocks,
    free: Sequence[FreeParameter],
    shape: ThetaShape,
    records: Sequence[FitRecord],
    options: FitOptions,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return θ (p,) at the start, and its bounds (p,), (p,). Raise UsageError for a start of a fixed parameter."""
    layout = theta_layout(shape, records)
    run_values: dict[str, float] = {}
    for path, numbers in options.start.items():
        paths = entries(blocks, path)
        for p, x in zip(paths, np.broadcast_to(np.asarray(numbers, float).ravel(), len(paths)), strict=True):
            run_values[p] = float(x)
    missing_paths = [p for p in run_values if p not in shape.shared_paths and p not in shape.per_run]
    if missing_paths:
        raise UsageError.of("start.not-free", path=missing_paths[0])
    theta, low, high = np.zeros(layout.size), np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    for k, parameter in enumerate(free):
        theta[k] = run_values.get(parameter.path, value(blocks, parameter.path))
        low[k], high[k] = parameter.low, parameter.high
    for run in range(layout.run_count):
        for k, path in enumerate(shape.by_run, layout.shared_count + run * layout.run_entry_count):
            if path in shape.per_run:
                parameter = free_parameter(blocks, path, options.bounds)
                theta[k] = run_values.get(path, value(blocks, path))
                low[k], high[k] = parameter.low, parameter.high
            else:
                low[k], high[k] = -MAX_CLOCK_OFFSET_S, MAX_CLOCK_OFFSET_S
    for k, record in enumerate(records):
        pose = _first_pose(record, blocks)
        theta[layout.start_slice(k)] = [pose[i - 3] if i >= 3 else 0.0 for i in shape.start]
    return np.clip(theta, low, high), low, high


def _first_pose(record: FitRecord, blocks: FittedBlocks) -> np.ndarray:
    """Return the first measured pose (3,), or zeros; a missing heading is the course of the first half."""
    for name, sensor in blocks.sensors._asdict().items():
        readings = record.sensors[name]
        if measures_pose(sensor) and readings.mask.any():
            first = np.array(readings.z[np.argmax(readings.mask[:, 0] > 0.0)])
            if not readings.mask[:, 2].any():
                displacement = readings.z[readings.mask[:, 0] > 0.0, :2] - first[:2]
                distance_m = np.hypot(*displacement.T)
                first[2] = np.arctan2(*displacement[np.argmax(distance_m >= 0.5 * distance_m.max())][::-1])
            return first
    return np.zeros(3)


def parse_sigma(sigma: Mapping[str, Any], sensors: "ByName[Tree]") -> np.ndarray:
    """Return σ (m,) of all channels from {sensor: (m_s,)}. Raise UsageError unless all are positive and finite."""
    by_sensor = []
    for name, sensor in zip(sensors._fields, sensors, strict=True):
        if name not in sigma or np.shape(np.atleast_1d(sigma[name])) not in ((1,), (sensor.size,)):
            raise UsageError.of("sigma.size", size=sensor.size, sensor=name)
        by_sensor.append(np.broadcast_to(np.asarray(sigma[name], dtype=float), sensor.size))
    sigmas = np.concatenate(by_sensor)
    if not np.all(np.isfinite(sigmas) & (sigmas > 0.0)):
        raise UsageError.of("sigma.negative", value=sigmas.tolist())
    return sigmas
