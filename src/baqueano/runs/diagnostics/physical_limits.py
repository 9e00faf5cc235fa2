"""Find numbers that a small vehicle cannot reach: they show a wrong unit from one signal only.

    speed, rate    the largest 1 % beyond 60 m/s, 35 rad/s (2000 deg/s, the range of small gyros)
    tyres          means of a_x, a_y over WINDOW_S, minus their median, beyond 2 g: tyres hold about 1 g      (1)
    at rest        before the first command the bias of a small gyro is below 0.35 rad/s (20 deg/s, data sheet of the
                   MPU-6050) and its noise below 0.02 rad/s (1.1 deg/s, ten times its data sheet);            (2)
                   the noise of an accelerometer is above 0.02 m/s² (2 mg; its data sheet at 44 Hz: 2.7 mg)   (3)
    turning        the speed v of a curve, by a_y = v ω, beyond 20 m/s                                        (4)
    commands       a full command is 1; full scales of 255, 1000, … and servo pulses of 1000 to 2000 µs are known

(1) below 4 g, (2), (3), (4) and a rate of more than two turns a second give findings that do not stop an import.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import Diagnostic, note
from baqueano.messages.language import mark as N_
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.signal_map import relation
from baqueano.runs.maps.columns import KINDS
from baqueano.runs.maps.units import unit
from baqueano.runs.run import Channel, Run
from baqueano.runs.windows import means
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.runs.maps.columns import ColumnMap, ColumnSignal

FASTEST_M_S, FASTEST_RAD_S = 60.0, 35.0  # of the vehicles that baqueano is for; 35 rad/s is 2000 deg/s
LIMITS = {
    "acceleration": (300.0, "m/s²", N_("counts?")),
    "angular rate": (FASTEST_RAD_S, "rad/s", 'unit = "deg/s"'),
    "speed": (FASTEST_M_S, "m/s", 'unit = "mm/s"'),
    "length": (1e6, "m", 'unit = "mm"'),
    "rangefinder": (100.0, "m", 'unit = "cm"'),
}
TURNS_RAD_S = 4.0 * np.pi  # two turns a second
TYRES_M_S2, WINDOW_S = 20.0, 0.3
STILL_S, BIAS_RAD_S, TREMBLE_RAD_S, TREMBLE_M_S2 = 1.0, 0.35, 0.02, 0.02
CURVE_M_S, ENOUGH = 20.0, 50
FULL = (100.0, 255.0, 400.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)  # usual full commands
PULSE_US = (500.0, 2500.0)  # of a servo
OVER = 1.2  # times a full command: rounding and trims stay below it
TINY = 0.03  # a command too small to move a motor


def plausible(signal: "ColumnSignal", channel: Channel, run: Run) -> Iterator[ImportFinding]:
    """Yield the findings about the unit of a sensor, from this sensor only."""
    most = np.quantile(np.abs(channel.z), 0.99, axis=0)
    beyond, kind = False, signal.kind or ""
    for value, measures, entry in zip(most, KINDS.get(kind, ()), signal.entries, strict=False):
        limit, limit_text, guess = LIMITS.get(kind) or LIMITS.get(measures, (np.inf, "", ""))
        if value > limit:
            beyond = True
            reason = note(
                "recording.too-much", key=entry.key, unit_read=entry.unit, value=value, shown=limit_text
            )
            yield ImportFinding("unit", "error", None, reason, note("recording.perhaps", line=guess))
    if signal.kind == "imu" and not beyond:
        yield from _tyres(signal, channel)
        yield from _gyro(signal, channel, run)
        yield from _curve(signal, channel)


def _tyres(signal: "ColumnSignal", channel: Channel) -> Iterator[ImportFinding]:
    """Yield a finding about the unit if an acceleration exceeds the grip of tyres.  (1)"""
    for a, entry in zip(_means(channel).T[:2], signal.entries, strict=False):
        if not len(a) or not np.isfinite(a).all():
            continue
        most = float(np.quantile(np.abs(a - np.median(a)), 0.99))
        if most > TYRES_M_S2:
            level = "error" if most > 2.0 * TYRES_M_S2 else "warning"
            reason = note(
                "recording.tyres", key=entry.key, unit_read=entry.unit, most=most, window_s=WINDOW_S
            )
            smaller = note("recording.perhaps", line='unit = "m/s^2"')
            if entry.unit == "m/s^2":
                smaller = note("recording.perhaps-smaller")
            yield ImportFinding("unit", level, None, reason, smaller)


def _means(channel: Channel) -> np.ndarray:
    """Return means (windows, m) over WINDOW_S or three samples, without vibration; empty if the channel is short."""
    t = (channel.t_ns - channel.t_ns[0]) / NANOSECONDS
    if len(t) < ENOUGH or t[-1] < 10.0 * WINDOW_S:
        return np.zeros((0, channel.z.shape[1]))
    return means(channel, int(channel.t_ns[0]), max(WINDOW_S, 3.0 * t[-1] / len(t)))[1]


def _at_rest(run: Run, channel: Channel) -> np.ndarray:
    """Return a mask (M,): True for the samples before the first command; all False if they are too few or too short."""
    in_motion = np.any(np.nan_to_num(run.applied) != 0.0, axis=1)
    first = run.t_ns[max(int(np.argmax(in_motion)) - 1, 0)] if in_motion.any() else run.t_ns[-1]
    at_rest = channel.t_ns < first
    long = at_rest.any() and channel.t_ns[at_rest][-1] - channel.t_ns[0] > STILL_S * NANOSECONDS
    return at_rest if long and np.count_nonzero(at_rest) > 5 else np.zeros(len(at_rest), dtype=bool)


def _gyro(signal: "ColumnSignal", channel: Channel, run: Run) -> Iterator[ImportFinding]:
    """Yield the findings about the gyro (its rate, and (2) at rest), and about a quiet accelerometer (3)."""
    entry, rate, at_rest = signal.entries[2], channel.z[:, 2], _at_rest(run, channel)
    cure = (
        note("recording.if-in", in_unit="deg/s") if entry.unit != "deg/s" else note("recording.check-scale")
    )
    most = float(np.quantile(np.abs(rate), 0.99)) if np.isfinite(rate).all() else 0.0
    rest = rate[at_rest][np.isfinite(rate[at_rest])]
    off, sd = (abs(float(np.median(rest))), _spread(rest)) if len(rest) > 5 else (0.0, 0.0)
    of: JsonObject = {"key": entry.key, "unit_read": entry.unit}
    if off > BIAS_RAD_S or sd > TREMBLE_RAD_S:
        yield ImportFinding(
            "gyro at rest", "warning", None, note("recording.gyro-at-rest", **of, off=off, sd=sd), cure
        )
    elif most > TURNS_RAD_S:
        reason = note("recording.fast-turns", **of, most=most, turns=most / (2.0 * np.pi))
        yield ImportFinding("fast turns", "warning", None, reason, cure)
    for entry, a in zip(signal.entries[:2], channel.z[at_rest, :2].T, strict=True):
        most = float(np.quantile(np.abs(channel.z[:, int(entry.key[-2])]), 0.99))
        if len(a) and np.isfinite(a).all() and 0.0 < _spread(a) < TREMBLE_M_S2 and most < TYRES_M_S2 / 10.0:
            reason = note("recording.quiet", key=entry.key, unit_read=entry.unit, sd=_spread(a), most=most)
            yield ImportFinding(
                "quiet accelerometer", "info", None, reason, note("recording.if-in", in_unit="g")
            )


def _spread(x: np.ndarray) -> float:
    """Return the standard deviation, estimated as 1.4826 times the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))


def _curve(signal: "ColumnSignal", channel: Channel) -> Iterator[ImportFinding]:
    """Yield a finding if a_y and ω_z imply a curve at an impossible speed.  (4)"""
    curve = relation(*_means(channel).T[1:])
    if curve.is_clear() and (v := abs(curve.slope)) > CURVE_M_S:
        first, last = signal.entries[1], signal.entries[2]
        reason = note("recording.curve", first=first.key, last=last.key, unit_read=last.unit, speed_m_s=v)
        cure = note("recording.check-both-units")
        if last.unit == "deg/s":
            cure = note("recording.perhaps-gyro", line='unit = "rad/s"')
        yield ImportFinding("curve", "warning", None, reason, cure)


def commands(run: Run, m: "ColumnMap") -> Iterator[ImportFinding]:
    """Yield the findings about the unit of the commands."""
    wheels = run.applied[:, [0, 0]] + run.applied[:, [-1, -1]] * [-1.0, 1.0]
    columns, names = (wheels, ("left", "right")) if m.wheels else (run.applied, m.names)
    entries = m.command.entries
    counts, percents = (
        [u / si for u, e in zip(columns.T, entries, strict=True) if e.unit == name]
        for name, si in (("1", 1.0), ("%", 0.01))
    )
    for name, u, entry in zip(names, columns.T, entries, strict=True):
        if np.ptp(u) == 0.0 and entry.constant is None:
            yield ImportFinding(
                "constant", "warning", None, note("recording.constant-command", name=name, value=u[0])
            )
        most, unit_of_entry, cure = _largest([u]), unit(entry.unit), None
        if most > OVER and entry.unit == "1":
            cure = _full(counts)
        elif 0.0 < most < TINY and entry.unit == "%":
            cure = _of_parts(u / 0.01, percents)
        elif 0.0 < most < TINY and unit_of_entry is not None and unit_of_entry.measures == "time":
            cure = _full([c / unit_of_entry.si for c in columns.T], 'unit = "raw", ')
        if cure:
            reason = note(
                "recording.command-range", key=entry.key, name=name, most=most, unit_read=entry.unit
            )
            yield ImportFinding("command range", "error", int(run.t_ns[np.argmax(np.abs(u))]), reason, cure)


def _of_parts(u: np.ndarray, percents: list[np.ndarray]) -> Diagnostic | None:
    """Return the map line for a tiny command whose unit is one of `percents`; None if the command is really small."""
    together = percents if _largest(percents) < 100.0 * TINY else [u]
    if _largest(together) <= OVER:
        return note("recording.write", line='unit = "1"')
    return _full(percents, 'unit = "1", ') if together is percents else None


def _largest(columns: list[np.ndarray]) -> float:
    return max(float(np.max(np.abs(u))) for u in columns)


def _full(counts: list[np.ndarray], unit_of_it: str = "") -> Diagnostic:
    """Return the map line for commands in counts.
    All commands of a vehicle share one full scale, which is named only if the commands are not too small for it.
    """
    least, most = min(float(np.min(u)) for u in counts), _largest(counts)
    if PULSE_US[0] <= least and most <= PULSE_US[1]:
        return note("recording.write-pulses", line=f"{unit_of_it}scale = 0.002, offset = -3.0")
    if most < TINY * FULL[0]:
        return note(
            "recording.write-largest", line=f"{unit_of_it}scale = {1.0 / most:.6g}", most=f"{most:.6g}"
        )
    percent = most <= FULL[0]
    full = next((full for full in FULL[percent:] if most <= full), most)
    scale: JsonObject = {"line": f"{unit_of_it}scale = {1.0 / full:.6g}", "full": f"{full:g}"}
    if not percent:
        return note("recording.write-full", **scale)
    if most < TINY * full:
        return note("recording.write", line='unit = "%"')
    return note("recording.write-percent-or-full", **scale)
