"""Convert a run to the rows of a fit: one row per tick, with all measurements of that tick.

    dt_k = t_k − t_{k−1},  u_k applied in dt_k,  z_k measured at its end,  has_k = 0 without a measurement   (1)

Ticks can be irregular. A long tick is split into equal rows, so that the integrator stays accurate. A Runge-Kutta
step must be short compared with the fastest time constant of a small vehicle, 15 ms. A measurement belongs to the row
that ends at its timestamp (not at its arrival), or to the first row that ends after it. If a row contains several
measurements, the last one is used. A reading that is a mean belongs to the row in which its interval ends
(averaging.py). Entries that are not finite and measurements before the first tick are excluded. If sensor and commands
have different clocks, a reading with timestamp t was taken at t + o, |o| ≤ MAX_CLOCK_OFFSET_S. Readings of this sensor
are assigned MAX_CLOCK_OFFSET_S after their timestamp, and the model's h is evaluated with that delay
(vehicles/delay.py).
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import UsageError
from baqueano.identify.data.averaging import averaged_readings, durations_s, is_average
from baqueano.runs.run import Run
from baqueano.signals import ByName, seconds
from baqueano.vehicles.rk4 import MAX_ROW_S, row_counts

GAP_STEPS = 2.5  # median steps, above which a step is a gap
ROW_TOLERANCE = 1e-6  # fraction of a row: rounding
MAX_EARLY_FRACTION = 0.02  # fraction of a step: a timestamp this close to a tick is treated as equal to it
MAX_CLOCK_OFFSET_S = 0.25  # the largest clock offset that a fit estimates
MIN_SEGMENT_ROWS = 10  # for the start of a segment, at most six numbers
MAX_INTERVAL_RATIO = 2.0  # times the median interval of means: a longer one is not used if the clock is free


class Measurements(NamedTuple):
    """Measurements of one sensor, row by row."""

    z: np.ndarray  # (N, m), 0 without a measurement
    mask: np.ndarray  # (N, m) 1.0 at each measurement, else 0.0
    # (N,) part of the row by which the reading precedes its end, or None at the end. If the clock offset of the
    # sensor is free: the age of the reading at the end of the row [s]
    sample_fraction: np.ndarray | None
    mean_weights: np.ndarray | None = None  # (N, 7) of averaging.py, if the readings are means
    duration_s: np.ndarray | None = None  # (N,) of the intervals of means, if the clock of the sensor is free


class FitRecord(NamedTuple):
    """Rows of a run, as a fit reads them."""

    name: str
    t_s: np.ndarray  # (N,) end of each row, 0 at the first tick
    dt_s: np.ndarray  # (N,)
    u: np.ndarray  # (N, n)
    sensors: dict[str, Measurements]
    notes: tuple[Diagnostic, ...]
    run: int = 0  # index among the runs of a fit
    lead: int = 0  # rows at the beginning that belong to the previous segment

    def part(self, rows: slice) -> "FitRecord":
        """Return the record with these rows only."""

        def part(x: np.ndarray | None) -> np.ndarray | None:
            return None if x is None else x[rows]

        sensors = {
            name: Measurements(s.z[rows], s.mask[rows], *map(part, s[2:])) for name, s in self.sensors.items()
        }
        return self._replace(t_s=self.t_s[rows], dt_s=self.dt_s[rows], u=self.u[rows], sensors=sensors)

    def with_mask(self, mask: np.ndarray) -> "FitRecord":
        """Return the record with the measurements of the rows of `mask` (N,) only."""
        sensors = {name: s._replace(mask=s.mask * mask[:, None]) for name, s in self.sensors.items()}
        return self._replace(sensors=sensors)

    def without_start(self, unknown_s: float) -> "FitRecord":
        """Return the record without the measurements of the first `unknown_s` [s]. In this time the vehicle moves by
        commands before the record, which are unknown."""
        return self.with_mask(np.cumsum(self.dt_s) > unknown_s)


def make_record(
    run: Run,
    sensors: dict[str, Tree],
    used_channels: Mapping[str, list[int]] | None = None,
    clocks: Sequence[str] = (),
) -> FitRecord:
    """Return the rows of `run`, with the readings of `sensors` (name → block). `used_channels` limits a sensor to the
    listed channels. Readings of the sensors in `clocks` are assigned MAX_CLOCK_OFFSET_S after their timestamp. Raise
    UsageError for a run with fewer than 2 ticks, without a finite command, or without a fitting channel of a sensor."""
    if len(run.t_ns) < 2:
        raise UsageError.of("runs.few-ticks", run=run.name, ticks=len(run.t_ns))
    steps = np.diff(run.t_ns)
    median_ns = int(np.median(steps))
    dt_s = seconds(np.concatenate([[median_ns], steps]))
    u, notes = _command(run)
    gaps = dt_s > GAP_STEPS * median_ns * 1e-9
    if gaps.any():
        notes.append(note("data.gaps", gaps=int(gaps.sum()), longest_s=float(dt_s.max())))
    splits = row_counts(dt_s)
    # integrable, as other rows
    splits[gaps] = np.maximum(splits[gaps], (dt_s[gaps] / (median_ns * 1e-9)).astype(int))
    ends = np.cumsum(splits) - 1
    row_s = np.repeat(dt_s / splits, splits)
    readings = {}
    for name, block in sensors.items():
        max_offset_s = MAX_CLOCK_OFFSET_S if name in clocks else 0.0
        readings[name] = _measurements(run, name, block, ends, row_s, max_offset_s)
        if used_channels and name in used_channels:
            unused_channels = np.setdiff1d(np.arange(block.size), used_channels[name])
            readings[name].mask[:, unused_channels] = 0.0
    t_s = seconds(run.t_ns, run.t_ns[0])
    if np.any(splits > 1):
        dt_s = row_s
        u = np.repeat(u, splits, axis=0)
        t_s = np.cumsum(dt_s) - np.sum(dt_s[: splits[0]])  # 0 at the end of the first tick
    return FitRecord(run.name, t_s, dt_s, u, readings, tuple(notes))


def past_row_counter(runs: Sequence[Run]) -> Callable[[float], int]:
    """Return a function that returns the number of past rows that a delay [s] needs, in the rows of `runs`."""
    ticks = [seconds(np.diff(run.t_ns)) for run in runs if len(run.t_ns) > 1]
    rows = [np.repeat(dt_s / row_counts(dt_s), row_counts(dt_s)) for dt_s in ticks]
    typical_s = min((float(np.median(dt_s)) for dt_s in rows), default=MAX_ROW_S)

    def row_count(delay_s: float) -> int:
        if delay_s <= 0.0:
            return 0
        count = int(np.ceil(delay_s / typical_s - ROW_TOLERANCE))
        ends = [np.concatenate([[0.0], np.cumsum(dt_s)]) for dt_s in rows]
        spans = [np.min(t[count:] - t[:-count], initial=np.inf) for t in ends]
        # one more row if ticks are uneven
        return count + bool(min(spans, default=np.inf) < delay_s * (1.0 - ROW_TOLERANCE))

    return row_count


def _command(run: Run) -> tuple[np.ndarray, list[Diagnostic]]:
    """Return u (N, n) and a note on unknown commands. An unknown command is replaced by the last finite command, or by
    0 before the first finite command. Raise UsageError if all commands are unknown."""
    is_finite = np.asarray(np.isfinite(run.applied_commands).all(axis=1))
    if is_finite.all():
        return run.applied_commands, []
    if not is_finite.any():
        raise UsageError.of("runs.no-command", run=run.name)
    last_finite = np.maximum.accumulate(np.where(is_finite, np.arange(len(is_finite)), 0))
    u = np.where(is_finite[last_finite][:, None], run.applied_commands[last_finite], 0.0)
    return u, [note("data.command-unknown", ticks=int((~is_finite).sum()))]


def _measurements(
    run: Run, name: str, block: Tree, ends: np.ndarray, row_s: np.ndarray, max_offset_s: float
) -> Measurements:
    """Return the measurements of one sensor in N rows of `row_s` (N,) [s]. `ends` contains the last row of each tick.
    Each reading is assigned `max_offset_s` after its timestamp. Raise UsageError for a run without this sensor, or with
    another number of channels."""
    channel = run.sensors.get(name)
    if channel is None:
        raise UsageError.of("runs.no-sensor", run=run.name, sensor=name, valid=run.sensors)
    if channel.z.shape[1] != block.size:
        sizes: JsonObject = {"entries": channel.z.shape[1], "size": block.size, "kind": type(block).__name__}
        raise UsageError.of("runs.other-size", run=run.name, sensor=name, **sizes)
    m, row_count = block.size, len(row_s)
    z, mask = np.zeros((row_count, m)), np.zeros((row_count, m))
    is_sound = np.isfinite(channel.z)
    intervals_s = durations_s(run, name) if len(channel.t_ns) > 1 and is_average(run, name, block) else None
    if max_offset_s == 0.0 and intervals_s is not None:
        row_end_s = np.cumsum(row_s) - row_s[: ends[0] + 1].sum()
        t_s = seconds(channel.t_ns, run.t_ns[0])
        used_rows, rows, weights = averaged_readings(t_s, intervals_s, row_end_s, row_s)
        z[rows], mask[rows] = np.where(is_sound[used_rows], channel.z[used_rows], 0.0), is_sound[used_rows]
        return Measurements(z, mask, None, weights)
    median_s = 0.0 if intervals_s is None else float(np.median(intervals_s))
    assigned_s = max_offset_s + 0.5 * median_s * (max_offset_s > 0.0)
    tick = np.searchsorted(run.t_ns, channel.t_ns + round(assigned_s * 1e9))
    first_ns = run.t_ns[0] - round(MAX_EARLY_FRACTION * float(np.median(np.diff(run.t_ns))))
    is_inside = (tick < len(run.t_ns)) & ((channel.t_ns >= first_ns) | (max_offset_s > 0.0))
    row_index, part = ends[tick[is_inside]], np.zeros(0)
    if max_offset_s == 0.0 and len(row_index):
        row_index, part = _row_and_part(run.t_ns, channel.t_ns[is_inside], tick[is_inside], ends)
    z[row_index] = np.where(is_sound[is_inside], channel.z[is_inside], 0.0)
    mask[row_index] = is_sound[is_inside]
    if max_offset_s > 0.0:
        age_s = np.zeros(row_count)
        age_s[row_index] = seconds(run.t_ns[tick[is_inside]], channel.t_ns[is_inside])
        # the delay line is not full yet
        full_ns = round(1e9 * (2.0 * MAX_CLOCK_OFFSET_S + median_s))
        mask[: int(ends[min(np.searchsorted(run.t_ns - run.t_ns[0], full_ns), len(ends) - 1)])] = 0.0
        if intervals_s is None:
            return Measurements(z, mask, age_s)
        duration_s = np.full(row_count, median_s)
        duration_s[row_index] = intervals_s[is_inside]
        # an interval that is much longer than usual is longer than the delay line
        mask[duration_s > MAX_INTERVAL_RATIO * median_s] = 0.0
        return Measurements(z, mask, age_s, None, duration_s)
    if np.all(part < MAX_EARLY_FRACTION):
        return Measurements(z, mask, None)
    sample_fraction = np.zeros(row_count)
    sample_fraction[row_index] = part
    return Measurements(z, mask, sample_fraction)


def _row_and_part(
    tick_ns: np.ndarray, t_ns: np.ndarray, tick: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of each reading at `t_ns` in its `tick`, and the part of this row by which it precedes its end."""
    later_tick = np.maximum(tick, 1)
    tick_part = (tick_ns[tick] - t_ns) / np.maximum(tick_ns[later_tick] - tick_ns[later_tick - 1], 1)
    rows = np.diff(ends, prepend=-1)[tick]
    age_rows = np.clip(tick_part, 0.0, 1.0) * rows  # in rows
    earlier_rows = np.minimum(np.floor(age_rows + MAX_EARLY_FRACTION), rows - 1).astype(int)
    return ends[tick] - earlier_rows, np.clip(age_rows - earlier_rows, 0.0, 1.0)


def contains_readings(run: Run, sensor: str, entry: int, z: np.ndarray) -> bool:
    """Return True if all finite values z (N,) are readings of this channel; truth and hand measurements pass."""
    is_sensor = sensor in run.sensors
    return not is_sensor or bool(np.isin(z[np.isfinite(z)], run.sensors[sensor].z[:, entry]).all())


def offset_s(record: FitRecord) -> float:
    """Return the age [s] of the oldest h that offsets of ± MAX_CLOCK_OFFSET_S and the intervals of means need."""
    intervals = [s.duration_s for s in record.sensors.values() if s.duration_s is not None]
    longest_s = max((MAX_INTERVAL_RATIO * float(np.median(x)) for x in intervals), default=0.0)
    return 2.0 * MAX_CLOCK_OFFSET_S + longest_s


def offset_rows(record: FitRecord) -> int:
    """Return the number of past rows that `offset_s` needs."""
    return int(np.ceil(offset_s(record) / float(np.median(record.dt_s)))) + 2


def split_record(record: FitRecord, segment_s: float, lead_s: float) -> list[FitRecord]:
    """Return segments of about `segment_s` [s]. Each segment after the first has a lead of `lead_s` [s]. The lead does
    not contain measurements. It is at least one row long, because a reading between ticks is interpolated between rows.
    Raise UsageError for segments of less than MIN_SEGMENT_ROWS."""
    ends = np.cumsum(record.dt_s)
    min_length_s = MIN_SEGMENT_ROWS * float(np.median(record.dt_s))
    if segment_s < min_length_s:
        limits = {"rows": MIN_SEGMENT_ROWS, "shortest_s": min_length_s}
        raise UsageError.of("segment.short", length_s=segment_s, **limits)
    count = max(1, round(float(ends[-1]) / segment_s))
    edges = np.searchsorted(ends, ends[-1] * np.arange(1, count) / count)
    edges = np.unique(np.concatenate([[0], edges, [len(ends)]]))
    segments = []
    for first, last in pairwise(edges):
        begin = int(np.searchsorted(ends, ends[first] - lead_s))
        begin = max(min(begin, int(first) - 1), 0)
        lead = int(first) - begin
        segment = record.part(slice(begin, int(last))).with_mask(np.arange(int(last) - begin) >= lead)
        segments.append(segment._replace(lead=lead))
    return segments


class FittedBlocks(NamedTuple):
    """The part of a vehicle that a fit uses, with the names of the tables in its file."""

    model: Tree
    sensors: ByName[Tree]  # NamedTuple of sensor blocks
