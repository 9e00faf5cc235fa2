"""Find values that a small vehicle cannot reach. They show a wrong unit from only one signal.

    speed, rate    the largest 1 % beyond 60 m/s, 35 rad/s (2000 deg/s, the range of small gyros)
    tyres          means of a_x, a_y over WINDOW_S, minus their median, beyond 2 g: tyres transmit about 1 g      (1)
    at rest        before the first command the bias of a small gyro is below 0.35 rad/s (20 deg/s, data sheet of the
                   MPU-6050) and its noise below 0.02 rad/s (1.1 deg/s, ten times its data sheet)             (2)
    in g           a digital accelerometer has 2^k counts per g, so steps of 2^-k are in g. The noise of the quietest
                   chips (70 µg/√Hz) at 44 Hz is 0.0046 m/s²; less than 0.004 at rest is in g                 (3)
    turning        the speed v of a curve, by a_y = v ω, beyond 20 m/s                                        (4)
    commands       a full command is 1; full scales of 255, 1000, … and servo pulses of 1000 to 2000 µs are known

(1) below 4 g, (2), (3), (4) and a rate of more than two turns per second give findings that do not stop an import.
"""

from collections.abc import Iterator

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.messages.language import mark as N_
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.samples import channel_resolution
from baqueano.runs.diagnostics.signal_map import MIN_SCALE_GAIN, channel_regression
from baqueano.runs.interpolation import window_means
from baqueano.runs.maps.columns import KINDS, ColumnMap, ColumnSignal
from baqueano.runs.maps.units import unit
from baqueano.runs.run import Channel, Run
from baqueano.signals import NANOSECONDS

MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S = 60.0, 35.0  # of the vehicles that baqueano is for; 35 rad/s is 2000 deg/s
KIND_LIMITS = {
    "acceleration": (300.0, "m/s²", N_("counts?")),
    "angular rate": (MAX_YAW_RATE_RAD_S, "rad/s", 'unit = "deg/s"'),
    "speed": (MAX_SPEED_M_S, "m/s", 'unit = "mm/s"'),
    "length": (1e6, "m", 'unit = "mm"'),
    "rangefinder": (100.0, "m", 'unit = "cm"'),
}
MAX_USUAL_TURN_RAD_S = 4.0 * np.pi  # two turns per second
MAX_GRIP_M_S2, WINDOW_S = 20.0, 0.3
MIN_REST_S, MAX_BIAS_RAD_S, MAX_REST_STD_RAD_S = 1.0, 0.35, 0.02
LEAST_REST_STD_M_S2 = 0.004
MAX_QUIET_PEAK = 4.0  # largest acceleration of a small vehicle in g, and so of values that are in g
MIN_BITS_PER_G, STEP_TOLERANCE, MIN_STEP_SHARE = 5, 0.01, 0.98
MAX_CURVE_SPEED_M_S, MIN_WINDOWS = 20.0, 50
FULL_COMMANDS = (100.0, 255.0, 400.0, 1000.0, 1023.0, 4095.0, 32767.0, 65535.0)  # usual full commands
PULSE_RANGE_US = (500.0, 2500.0)  # of a servo
MAX_COMMAND_RATIO = 1.2  # times a full command: rounding and trims stay below it
MIN_COMMAND = 0.03  # a command too small to move a motor


def limit_findings(signal: ColumnSignal, channel: Channel, run: Run) -> Iterator[ImportFinding]:
    """Yield the findings about the unit of a sensor, from this sensor only."""
    peak = [_peak(z) for z in channel.z.T]
    is_outside, measurement_kind = False, signal.kind or ""
    for value, measures, entry in zip(peak, KINDS.get(measurement_kind, ()), signal.entries, strict=False):
        limit, limit_text, guess = KIND_LIMITS.get(measurement_kind) or KIND_LIMITS.get(
            measures, (np.inf, "", "")
        )
        if value > limit:
            is_outside = True
            reason = note(
                "recording.too-much", key=entry.key, unit_name=entry.unit, value=value, quantity=limit_text
            )
            yield ImportFinding("unit", "error", reason, note("recording.possible-line", line=guess))
    if signal.kind == "imu" and not is_outside:
        yield from _grip_findings(signal, channel)
        yield from _gyro_findings(signal, channel, run)
        yield from _accelerometer_findings(signal, channel, run)
        yield from _curve_findings(signal, channel)


def _grip_findings(signal: ColumnSignal, channel: Channel) -> Iterator[ImportFinding]:
    """Yield a finding about the unit if an acceleration exceeds the grip of tyres.  (1)"""
    for a, entry in zip(_window_means(channel).T[:2], signal.entries, strict=False):
        a = a[np.isfinite(a)]
        if not len(a):
            continue
        peak_acceleration = _peak(a - np.median(a))
        if peak_acceleration > MAX_GRIP_M_S2:
            level = "error" if peak_acceleration > 2.0 * MAX_GRIP_M_S2 else "warning"
            reason = note(
                "recording.tyres",
                key=entry.key,
                unit_name=entry.unit,
                maximum=peak_acceleration,
                window_s=WINDOW_S,
            )
            suggestion = note("recording.possible-line", line='unit = "m/s^2"')
            if entry.unit == "m/s^2":
                suggestion = note("recording.perhaps-smaller")
            yield ImportFinding("unit", level, reason, suggestion)


def _window_means(channel: Channel) -> np.ndarray:
    """Return means (windows, m) over WINDOW_S or three samples, against vibration; empty if the channel is short."""
    t = (channel.t_ns - channel.t_ns[0]) / NANOSECONDS
    if len(t) < MIN_WINDOWS or t[-1] < 10.0 * WINDOW_S:
        return np.zeros((0, channel.z.shape[1]))
    return window_means(channel, int(channel.t_ns[0]), max(WINDOW_S, 3.0 * t[-1] / len(t)))[1]


def _rest_mask(run: Run, channel: Channel) -> np.ndarray:
    """Return a mask (M,): True for the samples before the first command.
    It is False everywhere if these samples are too few, or cover less than MIN_REST_S.
    """
    in_motion = np.any(np.nan_to_num(run.applied_commands) != 0.0, axis=1)
    first = run.t_ns[max(int(np.argmax(in_motion)) - 1, 0)] if in_motion.any() else run.t_ns[-1]
    at_rest = channel.t_ns < first
    is_long = at_rest.any() and channel.t_ns[at_rest][-1] - channel.t_ns[0] > MIN_REST_S * NANOSECONDS
    return at_rest if is_long and np.count_nonzero(at_rest) > 5 else np.zeros(len(at_rest), dtype=bool)


def _gyro_findings(signal: ColumnSignal, channel: Channel, run: Run) -> Iterator[ImportFinding]:
    """Yield the findings about the gyro: its rate, and (2) at rest."""
    entry, rate, at_rest = signal.entries[2], channel.z[:, 2], _rest_mask(run, channel)
    remedy = (
        note("recording.unit-entry", unit_name="deg/s")
        if entry.unit != "deg/s"
        else note("recording.check-scale")
    )
    peak_rate = _peak(rate)
    rest_rates = rate[at_rest][np.isfinite(rate[at_rest])]
    bias, std = (
        (abs(float(np.median(rest_rates))), _robust_std(rest_rates)) if len(rest_rates) > 5 else (0.0, 0.0)
    )
    figures: JsonObject = {"key": entry.key, "unit_name": entry.unit}
    if bias > MAX_BIAS_RAD_S or std > MAX_REST_STD_RAD_S:
        yield ImportFinding(
            "gyro at rest",
            "warning",
            note("recording.gyro-at-rest", **figures, mean_rad_s=bias, std=std),
            remedy,
        )
    elif peak_rate > MAX_USUAL_TURN_RAD_S:
        reason = note("recording.fast-turns", **figures, maximum=peak_rate, turns=peak_rate / (2.0 * np.pi))
        yield ImportFinding("fast turns", "warning", reason, remedy)


def _accelerometer_findings(signal: ColumnSignal, channel: Channel, run: Run) -> Iterator[ImportFinding]:
    """Yield a finding for each accelerometer that is read in m/s², but whose steps or noise are typical of g.  (3)"""
    at_rest = _rest_mask(run, channel)
    for k, entry in enumerate(signal.entries[:2]):
        is_present = np.isfinite(channel.z[:, k])
        a, rest = channel.z[is_present, k], channel.z[is_present & at_rest, k]
        if entry.unit != "m/s^2" or not len(a) or np.max(np.abs(a)) > MAX_QUIET_PEAK:
            continue
        counts, std = _power_of_two(a / entry.scale), _robust_std(rest) if len(rest) else 0.0
        figures: JsonObject = {"key": entry.key, "unit_name": entry.unit}
        if counts:
            reason = note("recording.counts-per-g", **figures, counts=counts)
            yield ImportFinding("counts per g", "info", reason, note("recording.unit-entry", unit_name="g"))
        elif 0.0 < std < LEAST_REST_STD_M_S2:
            reason = note("recording.quiet", **figures, std=std)
            yield ImportFinding(
                "quiet accelerometer", "info", reason, note("recording.unit-entry", unit_name="g")
            )


def _power_of_two(values: np.ndarray) -> int:
    """Return the number of steps per 1 if all values (M,) are multiples of one step 2^-k, within 1 %; else 0."""
    step = channel_resolution(values).step
    if step <= 0.0:
        return 0
    steps_apart, k = np.diff(np.unique(values)) / step, -np.log2(step)
    is_multiple = np.abs(steps_apart - np.round(steps_apart)) < STEP_TOLERANCE * np.maximum(steps_apart, 1.0)
    is_power = abs(k - round(k)) < STEP_TOLERANCE and k > MIN_BITS_PER_G
    return 2 ** round(k) if is_power and is_multiple.mean() > MIN_STEP_SHARE else 0


def _peak(x: np.ndarray) -> float:
    """Return the magnitude that 1 % of the finite values of x (M,) exceed; 0 without one."""
    return float(np.quantile(np.abs(x[np.isfinite(x)]), 0.99)) if np.isfinite(x).any() else 0.0


def _robust_std(x: np.ndarray) -> float:
    """Return the standard deviation, estimated as 1.4826 times the median absolute deviation."""
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))


def _curve_findings(signal: ColumnSignal, channel: Channel) -> Iterator[ImportFinding]:
    """Yield a finding if a_y and ω_z imply a curve at an impossible speed.  (4)"""
    curve = channel_regression(*_window_means(channel).T[1:])
    if curve.is_clear(MIN_SCALE_GAIN) and (v := abs(curve.slope)) > MAX_CURVE_SPEED_M_S:
        first, last = signal.entries[1], signal.entries[2]
        reason = note("recording.curve", first=first.key, last=last.key, unit_name=last.unit, speed_m_s=v)
        remedy = note("recording.check-both-units")
        if last.unit == "deg/s":
            remedy = note("recording.possible-gyro-line", line='unit = "rad/s"')
        yield ImportFinding("curve", "warning", reason, remedy)


def commands(run: Run, m: ColumnMap) -> Iterator[ImportFinding]:
    """Yield the findings about the unit of the commands."""
    wheels = run.applied_commands[:, [0, 0]] + run.applied_commands[:, [-1, -1]] * [-1.0, 1.0]
    columns, names = (wheels, ("left", "right")) if m.wheels else (run.applied_commands, m.names)
    entries = m.command.entries
    counts, percents = (
        [u / si for u, e in zip(columns.T, entries, strict=True) if e.unit == name]
        for name, si in (("1", 1.0), ("%", 0.01))
    )
    for name, u, entry in zip(names, columns.T, entries, strict=True):
        if np.ptp(u) == 0.0 and entry.constant is None:
            yield ImportFinding(
                "constant", "warning", note("recording.constant-command", name=name, value=u[0])
            )
        max_count, entry_unit, remedy = _largest_magnitude([u]), unit(entry.unit), None
        if max_count > MAX_COMMAND_RATIO and entry.unit == "1":
            remedy = _full_command_line(counts)
        elif 0.0 < max_count < MIN_COMMAND and entry.unit == "%":
            remedy = _percent_line(u / 0.01, percents)
        elif 0.0 < max_count < MIN_COMMAND and entry_unit is not None and entry_unit.measures == "time":
            remedy = _full_command_line([c / entry_unit.si_factor for c in columns.T], 'unit = "raw", ')
        if remedy:
            reason = note(
                "recording.command-range", key=entry.key, name=name, maximum=max_count, unit_name=entry.unit
            )
            yield ImportFinding(
                "command range", "error", reason, remedy, t_ns=int(run.t_ns[np.argmax(np.abs(u))])
            )


def _percent_line(u: np.ndarray, percents: list[np.ndarray]) -> Diagnostic | None:
    """Return the map line for a small command `u` (N,), in the numbers of the file, that the map reads in percent.
    `percents` are all commands that the map reads in percent. Return None if the command is small in its true unit.
    """
    candidates = percents if _largest_magnitude(percents) < 100.0 * MIN_COMMAND else [u]
    if _largest_magnitude(candidates) <= MAX_COMMAND_RATIO:
        return note("recording.write", line='unit = "1"')
    return _full_command_line(percents, 'unit = "1", ') if candidates is percents else None


def _largest_magnitude(columns: list[np.ndarray]) -> float:
    return max(float(np.max(np.abs(u))) for u in columns)


def _full_command_line(counts: list[np.ndarray], unit_setting: str = "") -> Diagnostic:
    """Return the map line for commands in counts.
    All commands of a vehicle share one full scale. It is named only if the commands are not too small for it.
    """
    min_count, max_count = min(float(np.min(u)) for u in counts), _largest_magnitude(counts)
    if PULSE_RANGE_US[0] <= min_count and max_count <= PULSE_RANGE_US[1]:
        return note("recording.write-pulses", line=f"{unit_setting}scale = 0.002, offset = -3.0")
    if max_count < MIN_COMMAND * FULL_COMMANDS[0]:
        return note(
            "recording.write-largest",
            line=f"{unit_setting}scale = {1.0 / max_count:.6g}",
            maximum=f"{max_count:.6g}",
        )
    percent = max_count <= FULL_COMMANDS[0]
    full_command = next(
        (full_command for full_command in FULL_COMMANDS[percent:] if max_count <= full_command), max_count
    )
    scale: JsonObject = {
        "line": f"{unit_setting}scale = {1.0 / full_command:.6g}",
        "full_command": f"{full_command:g}",
    }
    if not percent:
        return note("recording.write-full", **scale)
    if max_count < MIN_COMMAND * full_command:
        return note("recording.write", line='unit = "%"')
    return note("recording.write-percent-or-full", **scale)
