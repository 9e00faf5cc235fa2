"""A run as the fit reads it: one row per tick, with all that was measured during that tick.

    dt_k = t_k − t_{k−1},  u_k in force during it,  z_k measured at its end, has_k = 0 where nothing was   (1)

Ticks need not be regular. A long one is cut into equal rows, of which the last alone has measurements, so that the
integrator stays exact: a step of Runge-Kutta is to be short beside the fastest motion of a small vehicle, 15 ms. A
measurement belongs to the tick that ended at its own time stamp (not at its arrival) or first after it; of several in
one tick the last one counts. Left out are entries that are not finite, also those that diagnostics/samples.py removed.
What was measured before the first tick is left out too, where the model has not begun. So are readings at the end of
the sensor's range, which are counted.

Where a sensor's clock is not the commands', what it showed at t happened at t + o, |o| ≤ CLOCK_S: a measurement is read
CLOCK_S after its stamp. The model's h is read at the age of t + o, from a line of the rows before (vehicles/delay.py).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import UsageError
from baqueano.runs.run import Channel, Run
from baqueano.signals import ByName, seconds
from baqueano.vehicles.rk4 import ROW_S, rows_in

LONG_STEP = 2.5  # median steps, above which a step is a gap
JUST = 1e-6  # of a row: rounding
LATE = 0.02  # of a step: how far a stamp may lie from its tick to count as on it
CLOCK_S = 0.25  # the largest offset of a clock that a fit looks for


class Measurements(NamedTuple):
    """One sensor's measurements, row by row."""

    z: np.ndarray  # (N, m), 0 where there is none
    has: np.ndarray  # (N, m) 1.0 where there is one
    sample_fraction: (
        np.ndarray | None
    )  # (N,) part of the step by which it precedes the tick; None: on the tick;
    # of a sensor whose clock is free: its age at the row's end [s]


class FitRecord(NamedTuple):
    """A run, row by row."""

    name: str
    t_s: np.ndarray  # (N,) end of each row, from the first tick on
    dt_s: np.ndarray  # (N,)
    u: np.ndarray  # (N, n)
    sensors: dict[str, Measurements]
    notes: tuple[Diagnostic, ...]
    run: int = 0  # which of the runs of a fit
    lead: int = 0  # rows at the beginning that belong to the piece before


def record_of(
    run: Run,
    sensors: dict[str, Tree],
    only: Mapping[str, list[int]] | None = None,
    clocks: Sequence[str] = (),
) -> FitRecord:
    """The rows of `run` for the sensor blocks by name; of the sensors in `only`, those channels alone; those in
    `clocks` stand CLOCK_S late."""
    if len(run.t_ns) < 2:
        raise UsageError(fault("runs.few-ticks", run=run.name, ticks=len(run.t_ns)))
    steps = np.diff(run.t_ns)
    median_ns = int(np.median(steps))
    dt_s = seconds(np.concatenate([[median_ns], steps]))
    u, notes = _command(run)
    gaps = dt_s > LONG_STEP * median_ns * 1e-9
    if gaps.any():
        notes.append(note("data.gaps", gaps=int(gaps.sum()), longest_s=float(dt_s.max())))
    pieces = rows_in(dt_s)
    pieces[gaps] = np.maximum(pieces[gaps], np.ceil(dt_s[gaps] / (LONG_STEP * median_ns * 1e-9)).astype(int))
    ends = np.cumsum(pieces) - 1
    readings = {}
    for name, block in sensors.items():
        readings[name] = _measurements(run, name, block, ends, notes, CLOCK_S if name in clocks else 0.0)
        if only and name in only:
            left_out = np.setdiff1d(np.arange(block.size), only[name])
            readings[name].has[:, left_out] = 0.0
    t_s = seconds(run.t_ns, run.t_ns[0])
    if np.any(pieces > 1):
        dt_s = np.repeat(dt_s / pieces, pieces)
        u = np.repeat(u, pieces, axis=0)
        t_s = np.cumsum(dt_s) - dt_s[0]
    return FitRecord(run.name, t_s, dt_s, u, readings, tuple(notes))


def past_of(runs: Sequence[Run]) -> Callable[[float], int]:
    """Return how many rows of the past a delay [s] needs, in the rows of `runs`."""
    ticks = [seconds(np.diff(run.t_ns)) for run in runs if len(run.t_ns) > 1]
    rows = [np.repeat(dt_s / rows_in(dt_s), rows_in(dt_s)) for dt_s in ticks]
    usual_s = min((float(np.median(dt_s)) for dt_s in rows), default=ROW_S)

    def slots(delay_s: float) -> int:
        if delay_s <= 0.0:
            return 0
        count = int(np.ceil(delay_s / usual_s - JUST))
        ends = [np.concatenate([[0.0], np.cumsum(dt_s)]) for dt_s in rows]
        spans = [np.min(t[count:] - t[:-count], initial=np.inf) for t in ends]
        return count + bool(
            min(spans, default=np.inf) < delay_s * (1.0 - JUST)
        )  # one more where ticks are uneven

    return slots


def first_rows(record: FitRecord, rows: int) -> FitRecord:
    """The first rows of it."""
    sensors = {
        name: Measurements(z[:rows], has[:rows], None if sample_fraction is None else sample_fraction[:rows])
        for name, (z, has, sample_fraction) in record.sensors.items()
    }
    return record._replace(t_s=record.t_s[:rows], dt_s=record.dt_s[:rows], u=record.u[:rows], sensors=sensors)


def _command(run: Run) -> tuple[np.ndarray, list[Diagnostic]]:
    """u (N, n), the last finite one where it is not known."""
    finite = np.asarray(np.isfinite(run.applied).all(axis=1))
    if finite.all():
        return run.applied, []
    if not finite.any():
        raise UsageError(fault("runs.no-command", run=run.name))
    last = np.maximum.accumulate(np.where(finite, np.arange(len(finite)), 0))
    u = np.where(finite[last][:, None], run.applied[last], 0.0)
    return u, [note("data.command-unknown", ticks=int((~finite).sum()))]


def _measurements(
    run: Run, name: str, block: Tree, ends: np.ndarray, notes: list[Diagnostic], late_s: float
) -> Measurements:
    """The measurements of one sensor at rows `ends` of ends[-1] + 1, each `late_s` after its stamp."""
    channel = run.sensors.get(name)
    if channel is None:
        raise UsageError(fault("runs.no-sensor", run=run.name, sensor=name, known=run.sensors))
    if channel.z.shape[1] != block.size:
        raise UsageError(
            fault(
                "runs.other-size",
                run=run.name,
                sensor=name,
                entries=channel.z.shape[1],
                kind=type(block).__name__,
                size=block.size,
            )
        )
    m, rows = block.size, int(ends[-1]) + 1
    z, has = np.zeros((rows, m)), np.zeros((rows, m))
    good = _sound(name, block, channel, notes)
    tick = np.searchsorted(run.t_ns, channel.t_ns + round(late_s * 1e9))
    first_ns = run.t_ns[0] - round(LATE * float(np.median(np.diff(run.t_ns))))
    inside = (tick < len(run.t_ns)) & ((channel.t_ns >= first_ns) | (late_s > 0.0))
    at = ends[tick[inside]]
    z[at] = np.where(good[inside], channel.z[inside], 0.0)
    has[at] = good[inside]
    if late_s > 0.0:
        age_s = np.zeros(rows)
        age_s[at] = seconds(run.t_ns[tick[inside]], channel.t_ns[inside])
        has[: int(ends[np.searchsorted(run.t_ns - run.t_ns[0], round(2e9 * CLOCK_S))])] = 0.0  # line not full
        return Measurements(z, has, age_s)
    return Measurements(z, has, _early(run, channel.t_ns[inside], tick[inside], at, rows))


def _early(run: Run, t_ns: np.ndarray, tick: np.ndarray, at: np.ndarray, rows: int) -> np.ndarray | None:
    """Part of the step by which the stamps precede the ends of their ticks, (rows,)."""
    if not len(tick):
        return None
    before = run.t_ns[np.maximum(tick, 1) - 1]
    part: np.ndarray = (run.t_ns[tick] - t_ns) / np.maximum(run.t_ns[np.maximum(tick, 1)] - before, 1)
    if np.all(part < LATE):
        return None
    sample_fraction = np.zeros(rows)
    sample_fraction[at] = np.clip(part, 0.0, 1.0)
    return sample_fraction


def _sound(name: str, block: Tree, channel: Channel, notes: list[Diagnostic]) -> np.ndarray:
    """(M, m) True where an entry may be believed."""
    good = np.isfinite(channel.z)
    limit = range_of(block)
    if limit is not None:
        at_limit = good & (np.abs(channel.z) >= limit)
        if at_limit.any():
            notes.append(note("data.end-of-range", subject=name, lost=int(at_limit.sum())))
        good &= ~at_limit
    return good


def range_of(block: Tree) -> np.ndarray | None:
    """(m,) the end of the range of an IMU; None for sensors without one."""
    if not has_field(block, "accel_limit"):
        return None
    step = np.array([block.accel_step, block.accel_step, block.gyro_step])
    return np.array([block.accel_limit, block.accel_limit, block.gyro_limit]) * (1.0 - 1e-9) - step


def slots_for(dt_s: np.ndarray) -> int:
    """Rows of the past that offsets of ± CLOCK_S need, with steps `dt_s` (N,)."""
    return int(np.ceil(2.0 * CLOCK_S / float(np.median(dt_s)))) + 2


class FittedBlocks(NamedTuple):
    """The part of a vehicle that a fit sees, by the tables of its file."""

    model: Tree
    sensors: ByName[Tree]  # NamedTuple of sensor blocks
