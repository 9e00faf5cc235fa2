"""Detect and repair wrong timestamps: jumps, bursts, repeated or reversed stamps, a clock in another unit.

    steps   Δ_k = t_k − t_{k−1},   usual step = median Δ,   regular rate = 1 / mean Δ                     (1)

A step longer than 1 s and 20 usual steps is a pause, or a clock that was set. The run is cut there and never integrated
across. Parts below 2 s are dropped, and so is the first 0.5 s after a cut, when motors still follow unknown commands.
If more than a fifth of the steps are shorter than a fifth of the mean, samples were stamped in bursts as they were
read. They are spread evenly from the end of the previous burst to the end of this burst. For a regular sensor, the
error is at most one sample. A usual step that is 20 times off the file's rate means a clock in another unit. A sample
whose delay from stamp to arrival differs by more than 0.25 s from the usual delay is removed. Its stamp is not the time
of measurement.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS

PAUSE_S, PAUSE_STEPS = 1.0, 20.0
PIECE_S = 2.0
SETTLE_S = 0.5  # after a pause, for motors and delays to settle
OFF_UNIT = 20.0  # factor on the rate beyond which the clock is in another unit
SHORT, MANY = 0.2, 0.2  # of a burst
LATE_S = 0.25
FEW = 20  # samples


def check_timestamps(run: Run, rate_hz: float) -> tuple[list[Run], list[Diagnostic]]:
    """Return the repaired run, cut at pauses, and the findings. A run of fewer than FEW ticks is unchanged."""
    if len(run.t_ns) < FEW:
        return [run], []
    run, unit = _units(run, rate_hz)
    run, more = _bursts(run)
    with_stamps = {name: _stamps(name, channel) for name, channel in run.sensors.items()}
    messages = [message for _, messages in with_stamps.values() for message in messages]
    if messages:
        run = replace(run, sensors={name: channel for name, (channel, _) in with_stamps.items()})
    segments, cuts = _segments(run)
    return segments, unit + more + messages + cuts


def _units(run: Run, rate_hz: float) -> tuple[Run, list[Diagnostic]]:
    usual_s = float(np.median(np.diff(run.t_ns))) / NANOSECONDS
    off = usual_s * rate_hz
    if 1.0 / OFF_UNIT < off < OFF_UNIT:
        return run, []
    thousands = 10.0 ** (3 * round(np.log10(off) / 3))
    guess = {1e3: note("time.milliseconds-as-seconds"), 1e-3: note("time.seconds-as-milliseconds")}.get(
        thousands, note("time.which-unit")
    )
    message = note(
        "time.unit", Severity.ERROR, step_s=usual_s, rate_hz=rate_hz, expected_s=1.0 / rate_hz, guess=guess
    )
    first = int(run.t_ns[0])

    def scale_log(log: Any) -> Any:
        if log is None:
            return None
        times = {k: _scale(getattr(log, k), first, off) for k in log._fields if k in ("t_ns", "arrival_ns")}
        return log._replace(**times)

    # The search uses the time scale of the file, so that it converges; the verdict is REFUSED in any case.
    sensors = {name: scale_log(channel) for name, channel in run.sensors.items()}
    t_ns = _scale(run.t_ns, first, off)
    if np.any(np.diff(t_ns) <= 0):
        return run, [message]
    bare = replace(run, t_ns=t_ns, sensors=sensors, truth=scale_log(run.truth), estimate=None, reference=None)
    return bare, [message]


def _scale(t_ns: np.ndarray, first: int, off: float) -> np.ndarray:
    return first + np.rint((t_ns - first) / off).astype(np.int64)


def _is_burst(t_ns: np.ndarray) -> bool:
    steps = np.diff(t_ns)
    if np.min(steps) >= SHORT * np.max(steps):
        return False
    usual = steps[steps <= np.quantile(steps, 0.99)]
    return len(usual) > FEW and bool(np.mean(usual < SHORT * np.mean(usual)) > MANY)


def spread(t_ns: np.ndarray) -> np.ndarray:
    """Return the stamps with bursts spread evenly: each burst ends at the stamp of its last sample."""
    steps = np.diff(t_ns)
    usual = steps[steps <= np.quantile(steps, 0.99)]
    ends = np.flatnonzero(np.concatenate([steps >= 0.5 * np.mean(usual), [True]]))
    out = np.interp(np.arange(len(t_ns)), ends, t_ns[ends].astype(float) - float(t_ns[0]))
    before = np.arange(len(t_ns)) < ends[0]
    out[before] -= np.median(np.diff(out)) * (ends[0] - np.arange(len(t_ns))[before])
    out = np.rint(out).astype(np.int64) + int(t_ns[0])
    return np.maximum.accumulate(out)


def _bursts(run: Run) -> tuple[Run, list[Diagnostic]]:
    messages = []
    if _is_burst(run.t_ns):
        t_ns = spread(run.t_ns)
        if np.all(np.diff(t_ns) > 0):
            shift_s = float(np.quantile(np.abs(t_ns - run.t_ns), 0.95)) / NANOSECONDS
            sensors = {
                name: c._replace(t_ns=_shift(c.t_ns, run.t_ns, t_ns), arrival_ns=_shift(c.arrival_ns, run.t_ns, t_ns))
                for name, c in run.sensors.items()
            }  # fmt: skip
            run = replace(run, t_ns=t_ns, sensors=sensors)
            messages.append(_burst("ticks", shift_s))
    channels = dict(run.sensors)
    for name, c in channels.items():
        if len(c.t_ns) > FEW and np.all(np.diff(c.t_ns) >= 0) and _is_burst(c.t_ns):
            t_ns = spread(c.t_ns)
            shift_s = float(np.quantile(np.abs(t_ns - c.t_ns), 0.95)) / NANOSECONDS
            channels[name] = c._replace(t_ns=t_ns)
            messages.append(_burst(name, shift_s))
    return replace(run, sensors=channels) if messages else run, messages


def _burst(subject: str, moved_s: float) -> Diagnostic:
    return note("time.bursts", Severity.WARNING, subject=subject, moved_ms=1e3 * moved_s)


def _shift(timestamps: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return stamps that refer to the ticks `before`, moved to the ticks `after`."""
    origin = int(before[0])
    shift = np.interp(
        (timestamps - origin).astype(float), (before - origin).astype(float), (after - before).astype(float)
    )
    return np.maximum.accumulate(timestamps + np.rint(shift).astype(np.int64))


def _stamps(name: str, c: Channel) -> tuple[Channel, list[Diagnostic]]:
    """Return the channel without samples whose stamp is far from its arrival or not after the previous stamps, and
    the findings."""
    if len(c.t_ns) < FEW:
        return c, []
    late_s = (c.arrival_ns - c.t_ns) / NANOSECONDS
    off = np.abs(late_s - np.median(late_s)) > LATE_S
    back = np.zeros(len(off), bool)
    latest = np.maximum.accumulate(np.where(off, np.iinfo(np.int64).min, c.t_ns))
    back[1:] = (c.t_ns[1:] <= latest[:-1]) & ~off[1:]
    messages = []
    if off.any():
        messages.append(
            note("time.stamps-far", _grave(off), subject=name, lost=int(off.sum()), late_s=LATE_S)
        )
    if back.any():
        messages.append(note("time.stamps-back", _grave(back), subject=name, lost=int(back.sum())))
    keep = ~(off | back)
    return (Channel(*(column[keep] for column in c)), messages) if messages else (c, [])


def _grave(loss: np.ndarray) -> Severity:
    return Severity.WARNING if loss.mean() > MANY else Severity.INFO


def _segments(run: Run) -> tuple[list[Run], list[Diagnostic]]:
    """Return the segments of the run between pauses, and a message if it was cut. Segments below PIECE_S are dropped,
    but the run stays whole, with an error, if none would remain."""
    steps_s = np.diff(run.t_ns) / NANOSECONDS
    pause = max(PAUSE_S, PAUSE_STEPS * float(np.median(steps_s)))
    cuts = np.flatnonzero(steps_s > pause)
    if not len(cuts):
        return [run], []
    edges, segments = [0, *(cuts + 1).tolist(), len(run.t_ns)], []
    for a, b in pairwise(edges):
        if (run.t_ns[b - 1] - run.t_ns[a]) / NANOSECONDS >= PIECE_S:
            segments.append(_segment(run, a, b))
    figures = {"jumps": len(cuts), "most_s": float(steps_s.max()), "least_s": PIECE_S}
    if not segments:
        return [run], [note("time.jump-throughout", Severity.ERROR, **figures)]
    return segments, [note("time.jump", Severity.INFO, pieces=len(segments), **figures)]


def _segment(run: Run, a: int, b: int) -> Run:
    """Return ticks a to b − 1 of the run, and the samples measured during them. If a > 0, the samples of the first
    SETTLE_S are excluded."""
    low, high = int(run.t_ns[a]), int(run.t_ns[b - 1])

    begin_ns = low + round(SETTLE_S * NANOSECONDS) * (a > 0)

    def part(log: Any) -> Any:
        if log is None:
            return None
        inside = (log.t_ns >= begin_ns) & (log.t_ns <= high)
        return type(log)(*(None if column is None else column[inside] for column in log))

    return replace(
        run, t_ns=run.t_ns[a:b], applied=run.applied[a:b], requested=None, sent=None, estimate=None, reference=None,
        truth=part(run.truth), sensors={name: part(c) for name, c in run.sensors.items()},
        name=f"{run.name} from {(low - int(run.t_ns[0])) / NANOSECONDS:.0f} s",
    )  # fmt: skip
