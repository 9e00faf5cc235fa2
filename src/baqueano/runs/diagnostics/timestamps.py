"""Detect and repair wrong timestamps: jumps, bursts, repeated or reversed timestamps, a clock in another unit.

    steps   Δ_k = t_k − t_{k−1},   usual step = median Δ,   regular rate = 1 / mean Δ                     (1)

A step longer than 1 s and 20 usual steps is a pause, or a clock that was set. The run is split there and is not
integrated across the step. Parts below 2 s are dropped. The first 0.5 s after a split is also dropped, because motors
still follow unknown commands. Samples have their timestamps in bursts if more than a fifth of the steps are shorter
than a fifth of the mean. They are spread evenly from the end of the previous burst to the end of this burst. For a
regular sensor, the error is at most one sample. A usual step that is 20 times off the file's rate means a clock in
another unit. A sample is removed if its delay from timestamp to arrival differs by more than 0.25 s from the usual
delay. Its timestamp is not the time of measurement.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.runs.diagnostics.signal_map import nearest_ratio
from baqueano.runs.logs import log_rows
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS

MIN_PAUSE_S, PAUSE_STEPS = 1.0, 20.0
MIN_SEGMENT_S = 2.0
SETTLE_S = 0.5  # after a pause, for motors and delays to settle
MAX_RATE_FACTOR = 20.0  # factor on the rate beyond which the clock is in another unit
SHORT_STEP_RATIO, LARGE_SHARE = 0.2, 0.2  # of a burst
MAX_LATENESS_S = 0.25
MIN_SAMPLES = 20  # samples
UNIT_CODES = {1e3: "time.milliseconds-as-seconds", 1e-3: "time.seconds-as-milliseconds"}


def check_timestamps(run: Run, rate_hz: float) -> tuple[list[Run], list[Diagnostic]]:
    """Return the repaired run, split at pauses, and the findings. A run of fewer than MIN_SAMPLES ticks is
    unchanged."""
    if len(run.t_ns) < MIN_SAMPLES:
        return [run], []
    run, unit_messages = _check_unit(run, rate_hz)
    run, burst_messages = _spread_all_bursts(run)
    checked_channels = {name: _check_stamps(name, channel) for name, channel in run.sensors.items()}
    messages = [message for _, messages in checked_channels.values() for message in messages]
    if messages:
        run = replace(run, sensors={name: channel for name, (channel, _) in checked_channels.items()})
    segments, cut_messages = _segments(run)
    return segments, unit_messages + burst_messages + messages + cut_messages


def _check_unit(run: Run, rate_hz: float) -> tuple[Run, list[Diagnostic]]:
    median_s = float(np.median(np.diff(run.t_ns))) / NANOSECONDS
    rate_ratio = median_s * rate_hz
    if 1.0 / MAX_RATE_FACTOR < rate_ratio < MAX_RATE_FACTOR:
        return run, []
    ratio = nearest_ratio(rate_ratio, 1000.0**-0.5, 1000.0**0.5, UNIT_CODES)
    guess = note(UNIT_CODES.get(ratio, "time.which-unit"))
    message = note(
        "time.unit", Severity.ERROR, step_s=median_s, rate_hz=rate_hz, expected_s=1.0 / rate_hz, guess=guess
    )
    first = int(run.t_ns[0])

    def scale_log(log: Any) -> Any:
        if log is None:
            return None
        times = {"t_ns", "arrival_ns"} & set(log._fields)
        return log._replace(**{k: _scale_times(getattr(log, k), first, rate_ratio) for k in times})

    # The search uses the time scale of the file, so that it converges; the verdict is REFUSED in any case.
    sensors = {name: scale_log(channel) for name, channel in run.sensors.items()}
    t_ns = _scale_times(run.t_ns, first, rate_ratio)
    if np.any(np.diff(t_ns) <= 0):
        return run, [message]
    rescaled_run = replace(
        run, t_ns=t_ns, sensors=sensors, truth=scale_log(run.truth), estimate=None, reference=None
    )
    return rescaled_run, [message]


def _scale_times(t_ns: np.ndarray, first: int, rate_ratio: float) -> np.ndarray:
    return first + np.rint((t_ns - first) / rate_ratio).astype(np.int64)


def _is_burst(t_ns: np.ndarray) -> bool:
    steps = np.diff(t_ns)
    if np.min(steps) >= SHORT_STEP_RATIO * np.max(steps):
        return False
    usual_steps = steps[steps <= np.quantile(steps, 0.99)]
    return len(usual_steps) > MIN_SAMPLES and bool(
        np.mean(usual_steps < SHORT_STEP_RATIO * np.mean(usual_steps)) > LARGE_SHARE
    )


def spread_bursts(t_ns: np.ndarray) -> np.ndarray:
    """Return the timestamps with bursts spread evenly: each burst ends at the timestamp of its last sample."""
    steps = np.diff(t_ns)
    usual_steps = steps[steps <= np.quantile(steps, 0.99)]
    ends = np.flatnonzero(np.concatenate([steps >= 0.5 * np.mean(usual_steps), [True]]))
    uniform_ns = np.interp(np.arange(len(t_ns)), ends, t_ns[ends].astype(float) - float(t_ns[0]))
    is_before_first = np.arange(len(t_ns)) < ends[0]
    uniform_ns[is_before_first] -= np.median(np.diff(uniform_ns)) * (
        ends[0] - np.arange(len(t_ns))[is_before_first]
    )
    uniform_ns = np.rint(uniform_ns).astype(np.int64) + int(t_ns[0])
    return np.maximum.accumulate(uniform_ns)


def _spread_all_bursts(run: Run) -> tuple[Run, list[Diagnostic]]:
    messages = []
    if _is_burst(run.t_ns) and np.all(np.diff(t_ns := spread_bursts(run.t_ns)) > 0):
        messages.append(_burst_note("ticks", run.t_ns, t_ns))
        sensors = {}
        for name, c in run.sensors.items():
            moved_ns, arrival_ns = (_move_to_ticks(x, run.t_ns, t_ns) for x in (c.t_ns, c.arrival_ns))
            sensors[name] = c._replace(t_ns=moved_ns, arrival_ns=arrival_ns)
        run = replace(run, t_ns=t_ns, sensors=sensors)
    channels = dict(run.sensors)
    for name, c in channels.items():
        if len(c.t_ns) > MIN_SAMPLES and np.all(np.diff(c.t_ns) >= 0) and _is_burst(c.t_ns):
            channels[name] = c._replace(t_ns=spread_bursts(c.t_ns))
            messages.append(_burst_note(name, c.t_ns, channels[name].t_ns))
    return replace(run, sensors=channels) if messages else run, messages


def _burst_note(subject: str, old_ns: np.ndarray, new_ns: np.ndarray) -> Diagnostic:
    shift_ms = 1e3 * float(np.quantile(np.abs(new_ns - old_ns), 0.95)) / NANOSECONDS
    return note("time.bursts", Severity.WARNING, subject=subject, shift_ms=shift_ms)


def _move_to_ticks(timestamps: np.ndarray, old_ticks: np.ndarray, new_ticks: np.ndarray) -> np.ndarray:
    """Return `timestamps`, which refer to the ticks `old_ticks`, moved to the ticks `new_ticks`."""
    origin = int(old_ticks[0])
    shift = np.interp(
        (timestamps - origin).astype(float),
        (old_ticks - origin).astype(float),
        (new_ticks - old_ticks).astype(float),
    )
    return np.maximum.accumulate(timestamps + np.rint(shift).astype(np.int64))


def _check_stamps(name: str, c: Channel) -> tuple[Channel, list[Diagnostic]]:
    """Return the channel and the findings. Samples are removed if their timestamp is far from their arrival, or not
    after the previous timestamps."""
    if len(c.t_ns) < MIN_SAMPLES:
        return c, []
    late_s = (c.arrival_ns - c.t_ns) / NANOSECONDS
    is_far = np.abs(late_s - np.median(late_s)) > MAX_LATENESS_S
    is_backward = np.zeros(len(is_far), bool)
    latest_ns = np.maximum.accumulate(np.where(is_far, np.iinfo(np.int64).min, c.t_ns))
    is_backward[1:] = (c.t_ns[1:] <= latest_ns[:-1]) & ~is_far[1:]
    figures = {"time.stamps-far": {"limit_s": MAX_LATENESS_S}, "time.stamps-back": {}}
    messages = [
        note(code, _severity(is_lost), subject=name, count=int(is_lost.sum()), **details)
        for is_lost, (code, details) in zip((is_far, is_backward), figures.items(), strict=True)
        if is_lost.any()
    ]
    is_kept = ~(is_far | is_backward)
    return (log_rows(c, is_kept), messages) if messages else (c, [])


def _severity(loss: np.ndarray) -> Severity:
    return Severity.WARNING if loss.mean() > LARGE_SHARE else Severity.INFO


def _segments(run: Run) -> tuple[list[Run], list[Diagnostic]]:
    """Return the segments of the run between pauses, and a message if the run was split. Segments below MIN_SEGMENT_S
    are dropped. If all are too short, the whole run is returned with an error message."""
    steps_s = np.diff(run.t_ns) / NANOSECONDS
    pause_s = max(MIN_PAUSE_S, PAUSE_STEPS * float(np.median(steps_s)))
    cuts = np.flatnonzero(steps_s > pause_s)
    if not len(cuts):
        return [run], []
    edges, segments = [0, *(cuts + 1).tolist(), len(run.t_ns)], []
    for a, b in pairwise(edges):
        if (run.t_ns[b - 1] - run.t_ns[a]) / NANOSECONDS >= MIN_SEGMENT_S:
            segments.append(_segment(run, a, b))
    figures = {"jumps": len(cuts), "max_s": float(steps_s.max()), "min_s": MIN_SEGMENT_S}
    if not segments:
        return [run], [note("time.jump-throughout", Severity.ERROR, **figures)]
    return segments, [note("time.jump", Severity.INFO, pieces=len(segments), **figures)]


def _segment(run: Run, a: int, b: int) -> Run:
    """Return ticks a to b − 1 of the run, and the samples measured during them. If a > 0, the samples of the first
    SETTLE_S are excluded."""
    low, high = int(run.t_ns[a]), int(run.t_ns[b - 1])
    begin_ns = low + round(SETTLE_S * NANOSECONDS) * (a > 0)

    def cut_log(log: Any) -> Any:
        return None if log is None else log_rows(log, (log.t_ns >= begin_ns) & (log.t_ns <= high))

    return replace(
        run, t_ns=run.t_ns[a:b], applied_commands=run.applied_commands[a:b], requested_commands=None,
        sent_commands=None, estimate=None, reference=None,
        truth=cut_log(run.truth), sensors={name: cut_log(c) for name, c in run.sensors.items()},
        name=f"{run.name} from {(low - int(run.t_ns[0])) / NANOSECONDS:.0f} s",
    )  # fmt: skip
