"""Compare sensors and commands with the motion that other sensors measured, each by a signal map (signal_map.py).

    measured       compared with                         accepted
    (ω_z), (v)     (ω), (v) of the truth                 scale within 1.25                                 (1)
    (v_r − v_l)    (ω) of the truth, else of the gyro    track of 0.03 to 5 m                              (2)
    (a_x, a_y)     (v̇, v ω)                              scale within 2.5                                  (3)
    (ω)            (u_steering v, u_throttle v)          any scale                                         (4)
    (v)            sign of (u_drive)                     v ≥ 0 does not rise both with u > 0 and u < 0     (5)

(3) depends on the units of v and, without a truth, of the gyro. Gyro and wheels can show opposite directions. If (3)
then also contradicts the gyro, the gyro is inverted. Otherwise swapped wheels and an IMU upside down look the same.
"""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.motion import LoggedMotion
from baqueano.runs.diagnostics.signal_map import (
    MIN_GAIN,
    MIN_WINDOWS,
    Hypothesis,
    MappedChannel,
    channel_regression,
    signal_map,
    unit_ratios,
)
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.runs.maps.columns import ColumnMap, Entry

    Imu = tuple[Entry, ...]  # a_x, a_y, ω

Truth = Callable[[float], np.ndarray]
# range of the offset of two clocks; it doubles while the best is at its end
SEARCH_S, MAX_SEARCH_S = 0.25, 4.0
MIN_OFFSET_S = 0.02  # the least offset reported
# least standard deviations for a comparison
MIN_SPEED_STD, MIN_TURN_STD_RAD_S, MIN_ACCELERATION_STD_M_S2 = 0.05, 0.1, 0.2
MAX_SCALE, MAX_ACCEL_SCALE = 1.25, 2.5  # the least scales are the inverse values
# of the largest command and acceleration, and of the largest speed; windows in which the speed rises
BACKWARD_SHARE, NOISE_SHARE, MIN_RISING = 0.2, 0.05, 10
TRACK_RANGE_M = (0.03, 5.0)  # of the vehicles that baqueano is for; a skidding vehicle appears twice as wide


def motion_findings(run: Run, m: "ColumnMap") -> list[ImportFinding]:
    """Return the findings about sensors and commands that contradict each other."""
    motion, findings = LoggedMotion(run, m), []
    if len(motion.rate) < MIN_WINDOWS:
        return []
    entries = {name: signal.entries for name, signal in m.sensors.items()}
    imu = entries[motion.imu_name] if motion.imu_name else ()
    if motion.wheels_name:
        findings += _wheel_findings(motion, imu)
    is_opposed = run.truth is None and any(d.code == "inverted" for d in findings)
    speed = entries[motion.speed_name][0] if motion.speed_name else None
    gyro_clock = _clock_of(motion.imu[:, 2], motion.true_rate) if imu else None
    speed_clock = _clock_of(motion.speed, motion.true_speed) if speed else None
    if imu and gyro_clock is not None:
        findings += _clock_findings(motion, imu[2], gyro_clock, "recording.write-shift")
    elif speed and speed_clock is not None:
        findings += _clock_findings(motion, speed, speed_clock, "recording.write-shift-without-slip")
    if imu:
        findings += _truth_findings(imu[2], motion.imu[:, 2], motion.true_rate, gyro_clock, "angular rate")
    if speed:
        findings += _truth_findings(speed, motion.speed, motion.true_speed, speed_clock, "speed")
    findings += _accelerometer_findings(motion, imu, speed, is_opposed) if imu else []
    compasses = [(name, s[0]) for name, s in entries.items() if m.sensors[name].kind == "compass"]
    findings += [
        f for name, entry in compasses if imu for f in _compass_findings(motion, name, entry, imu[2])
    ]
    return findings + _steering_findings(motion) + _direction_findings(motion)


def _finding(hypothesis: Hypothesis, entry: "Entry", code: str, default: Diagnostic) -> ImportFinding:
    """Return an error that contradicts the map, with the corrected line of the map, or `default` if it is unknown."""
    line = hypothesis.meaning or default
    if hypothesis.code == "inverted":
        scale_note = note("recording.write-scale", scale=f"{-entry.scale:g}")
        line = (
            note("recording.pair", first=scale_note, second=hypothesis.meaning)
            if hypothesis.meaning
            else scale_note
        )
    return ImportFinding(hypothesis.code, "error", _finding_reason(hypothesis, entry, code), line)


def _finding_reason(hypothesis: Hypothesis, entry: "Entry", code: str) -> Diagnostic:
    r = hypothesis.regression
    return note(code, key=entry.key, slope=r.slope, correlation=r.correlation)


def _ratio_lines(measures: str, entry: "Entry", *codes: str) -> dict[float, Diagnostic]:
    """Return ratio → map line for each other unit that `entry` can have."""
    units = unit_ratios(measures, entry.unit).items()
    return {
        r: note("recording.write-unit", column_unit=unit, key=entry.key)
        for r, unit in units
        if not codes or unit in codes
    }


class Clock(NamedTuple):
    """The shift of the truth in time that agrees best with a sensor, and both correlations."""

    shift_s: float
    correlation: float  # without the shift
    shifted_correlation: float


def _clock_of(z: np.ndarray, true_motion: Truth) -> Clock | None:
    """Return the best shift of the truth, or None if the sensor does not show it."""
    if not _is_comparable(z, true_motion):
        return None
    search_s = SEARCH_S
    while search_s <= MAX_SEARCH_S:
        lags = 0.01 * np.arange(-round(100 * search_s), round(100 * search_s) + 1)
        regressions = [channel_regression(z, true_motion(float(lag))) for lag in lags]
        r = np.array([regression.correlation for regression in regressions])
        k = int(np.argmax(np.abs(r) - 1e-4 * np.abs(lags)))
        if 0 < k < len(lags) - 1:
            clock = Clock(float(lags[k]), float(r[len(lags) // 2]), float(r[k]))
            return clock if regressions[k].is_clear() else None
        search_s *= 2.0
    return None  # the end of the range is not a maximum


def _is_comparable(z: np.ndarray, true_motion: Truth) -> bool:
    return bool(np.std(true_motion(0.0)) > MIN_SPEED_STD and np.isfinite(z).all())


def _clock_findings(
    motion: LoggedMotion, entry: "Entry", clock: Clock, line_code: str
) -> list[ImportFinding]:
    """Return a finding if the shift is at least MIN_OFFSET_S and halves the variance of the residual.

    All sensors have one clock, and the gyro shows it best: the speed of wheels leads by the lag of their slip.
    """
    is_better = 1.0 - clock.shifted_correlation**2 < 0.5 * (1.0 - clock.correlation**2)
    if motion.m.truth is None or abs(clock.shift_s) < MIN_OFFSET_S or not is_better:
        return []
    code = "recording.clock-later" if clock.shift_s > 0.0 else "recording.clock-earlier"
    correlations: JsonObject = {
        "correlation": clock.correlation,
        "shifted_correlation": clock.shifted_correlation,
    }
    reason = note(code, key=entry.key, shift_ms=1e3 * abs(clock.shift_s), **correlations)
    line = note(line_code, shift_s=f"{motion.m.truth.mount.shift_s + clock.shift_s:.3g}")
    return [ImportFinding("clock", "info", reason, line)]


def _truth_findings(
    entry: "Entry", z: np.ndarray, true_motion: Truth, clock: Clock | None, measures: str
) -> list[ImportFinding]:
    """Return the findings about a sensor compared with the truth of the same quantity: sign, unit, scale.  (1)

    The truth is shifted in time, because a clock offset makes the estimated slope too small.
    """
    if not _is_comparable(z, true_motion):
        return []
    truth = true_motion(0.0 if clock is None else clock.shift_s)
    units = _ratio_lines(measures, entry)
    double_units = {
        1.0 / r: note("recording.unit-ratio", unit_name=entry.unit, ratio=r) for r in units if r > 1.0
    }
    (hypothesis,) = signal_map(
        z[:, None], truth[:, None], [MappedChannel(1.0 / MAX_SCALE, MAX_SCALE, double_units | units)]
    )
    r, reason = hypothesis.regression, _finding_reason(hypothesis, entry, "recording.against-truth")
    if hypothesis.code:
        check = note("recording.check-unit-and-scale")
        return [_finding(hypothesis, entry, "recording.against-truth", check)]
    if hypothesis.is_clear:
        return [ImportFinding("scale", "info", reason)] if abs(r.slope - 1.0) > 0.02 else []
    if np.all(z >= 0.0) and channel_regression(z, np.abs(truth)).is_clear():
        return [ImportFinding("no sign", "info", note("recording.no-sign", key=entry.key))]
    return [ImportFinding("unrelated", "warning", reason)] if r.gain < MIN_GAIN else []


def _wheel_findings(motion: LoggedMotion, imu: "Imu") -> list[ImportFinding]:
    """Return the findings about left and right wheel compared with the truth, or else with the gyro.  (2)"""
    difference, rate = motion.wheels[:, 1] - motion.wheels[:, 0], motion.rate
    if not np.std(rate) > MIN_TURN_STD_RAD_S or not np.isfinite(difference).all():
        return []
    (hypothesis,) = signal_map(difference[:, None], rate[:, None], [MappedChannel(*TRACK_RANGE_M)])
    r, wheels = hypothesis.regression, f"[sensors.{motion.wheels_name}]"
    figures: JsonObject = {
        "wheels": wheels,
        "reference": "[truth]" if motion.run.truth else imu[2].key,
        "correlation": r.correlation,
    }
    if hypothesis.code == "inverted":
        return [_opposite_sign_finding(motion, note("recording.yaw-rates-opposite", **figures), wheels, imu)]
    if hypothesis.code:
        line = note("recording.check-track", wheels=wheels, reference=figures["reference"])
        return [ImportFinding("track", "error", note("recording.track", **figures, track_m=r.slope), line)]
    if r.gain < MIN_GAIN and np.std(difference) > 0.0:
        return [ImportFinding("unrelated", "warning", note("recording.yaw-rates-disagree", **figures))]
    return []


def _compass_findings(
    motion: LoggedMotion, name: str, compass: "Entry", gyro: "Entry"
) -> Iterator[ImportFinding]:
    """Yield a finding if compass and gyro turn in opposite directions."""
    h, z = motion.imu[:, 2], motion.heading_rate(name)
    (hypothesis,) = signal_map(z[:, None], h[:, None], [MappedChannel()])
    if hypothesis.code == "inverted" and np.nanstd(h) > MIN_TURN_STD_RAD_S:
        figures: JsonObject = {"wheels": compass.key, "reference": gyro.key}
        reason = note(
            "recording.yaw-rates-opposite", **figures, correlation=hypothesis.regression.correlation
        )
        scales: JsonObject = {
            "scale": f"{-compass.scale:g}",
            "gyro": gyro.key,
            "second_scale": f"{-gyro.scale:g}",
        }
        line = note("recording.write-compass", compass=compass.key, **scales)
        yield ImportFinding("inverted", "error", reason, line)


def _opposite_sign_finding(
    motion: LoggedMotion, reason: Diagnostic, wheels: str, imu: "Imu"
) -> ImportFinding:
    """Return an error about the gyro if the sideways acceleration contradicts the gyro, else about gyro or wheels.
    With a truth the error is about the wheels.
    """
    if motion.run.truth is not None:
        return ImportFinding("inverted", "error", reason, note("recording.swap-wheels", wheels=wheels))
    figures: JsonObject = {"wheels": wheels, "gyro": imu[2].key, "scale": f"{-imu[2].scale:g}"}
    sideways = channel_regression(motion.imu[:, 1], motion.wheels.mean(axis=1) * motion.imu[:, 2])
    if sideways.is_clear() and sideways.slope < 0.0:
        both_reasons = note(
            "recording.cause-and-contradiction",
            cause=reason,
            key=imu[1].key,
            correlation=sideways.correlation,
        )
        return ImportFinding("inverted", "error", both_reasons, note("recording.write-gyro", **figures))
    line = note("recording.swap-or-gyro", **figures)
    if sideways.is_clear():
        line = note(
            "recording.swap-or-upside-down", **figures, key=imu[1].key, second_scale=f"{-imu[1].scale:g}"
        )
    return ImportFinding("inverted", "error", reason, line)


def _accelerometer_findings(
    motion: LoggedMotion, imu: "Imu", speed: "Entry | None", is_opposed: bool
) -> list[ImportFinding]:
    """Return the findings if a_x and a_y are swapped, inverted, or in another unit.  (3)
    If `is_opposed` is True, gyro and wheels contradict each other. Then a_y is not checked here, because another
    finding reports it.
    """
    a, centripetal, (x, y, gyro) = motion.imu[:, :2], motion.speed * motion.rate, imu
    if not max(np.std(centripetal), np.std(a[:, 1])) > MIN_ACCELERATION_STD_M_S2 or not np.isfinite(a).all():
        return []
    speed_lines = {1.0 / r: line for r, line in _ratio_lines("speed", speed).items()} if speed else {}
    lines_by_axis = [
        _ratio_lines("acceleration", x) | speed_lines,
        _ratio_lines("acceleration", y) | speed_lines,
    ]
    if motion.run.truth is None:
        g_lines = _ratio_lines("acceleration", y, "g")
        for r, line in _ratio_lines("angular rate", gyro, "rad/s", "deg/s").items():
            lines_by_axis[1] |= {1.0 / r: line} | {
                unit_value / r: note("recording.list", first=line, second=further_findings)
                for unit_value, further_findings in g_lines.items()
                if r > 1.0
            }
    channels = [MappedChannel(1.0 / MAX_ACCEL_SCALE, MAX_ACCEL_SCALE, lines) for lines in lines_by_axis]
    relation_x, relation_y = signal_map(a, np.stack([motion.v_dot, centripetal], axis=1), channels)
    if relation_x.code == "swapped":
        first, second = relation_x.regression.correlation, relation_y.regression.correlation
        reason = note("recording.axes-swapped", first_key=x.key, second_key=y.key, first=first, second=second)
        return [ImportFinding("swapped", "error", reason, note("recording.swap-axes"))]
    source = f"[sensors.{motion.speed_name}]" if motion.speed_name else "[truth]"
    check = note("recording.check-with-speed", source=source)
    candidates = [(relation_x, x)] if is_opposed else [(relation_y, y), (relation_x, x)]
    return [
        _finding(hypothesis, entry, "recording.against-motion", check)
        for hypothesis, entry in candidates
        if hypothesis.code
    ]


def _steering_findings(motion: LoggedMotion) -> list[ImportFinding]:
    """Return a finding if the command named steering does not turn the vehicle but the other command does.  (4)
    Also return a finding if positive steering turns the vehicle to the right. Only a run with two commands is checked.
    """
    names, run, rate = motion.m.names, motion.run, motion.rate
    steering_indices = [i for i, name in enumerate(names) if names_steering(name)]
    if len(names) != 2 or len(steering_indices) != 1 or not np.std(rate) > 2.0 * MIN_TURN_STD_RAD_S:
        return []
    order = [steering_indices[0], 1 - steering_indices[0]]
    u = np.stack([motion.mean(run.t_ns, run.applied_commands[:, i]) for i in order], axis=1)
    if not np.std(u[:, 0]) > MIN_SPEED_STD:
        return []
    (hypothesis,) = signal_map(rate[:, None], u * motion.speed[:, None], [MappedChannel()])
    steering, other_name = (names[i] for i in order)
    figures: JsonObject = {"steering": steering, "correlation": hypothesis.regression.correlation}
    if hypothesis.code == "swapped":
        reason = note("recording.other-steering", **figures, command=other_name)
        return [ImportFinding("swapped", "error", reason, note("recording.swap-commands"))]
    if hypothesis.code == "inverted":
        entry = motion.m.command.entries[steering_indices[0]]
        line = note(
            "recording.write-steering",
            scale=f"{-entry.scale:g}",
            offset=f"{0.0 - entry.offset:g}",
            key=entry.key,
        )
        return [ImportFinding("sign", "info", note("recording.turns-right", **figures), line)]
    return []


def names_steering(command_name: str) -> bool:
    """Return True for the name of a steering angle or of its servo."""
    return "steer" in command_name.lower() or "servo" in command_name.lower()


def _direction_findings(motion: LoggedMotion) -> list[ImportFinding]:
    """Return a finding if the speed is never negative, but rises with forward and with backward commands.  (5)"""
    run, names = motion.run, motion.m.names
    indices = [i for i, name in enumerate(names) if not names_steering(name)]
    if not motion.speed_name or not indices or not np.isfinite(motion.speed).any():
        return []
    u, speed = motion.mean(run.t_ns, run.applied_commands[:, indices[0]]), motion.speed
    max_speed, min_u = float(np.nanmax(np.abs(speed))), BACKWARD_SHARE * np.max(np.abs(u), initial=0.0)
    if not (max_speed > MIN_SPEED_STD and float(np.nanmin(speed)) > -NOISE_SHARE * max_speed):
        return []
    is_rising = motion.v_dot > BACKWARD_SHARE * np.nanquantile(np.abs(motion.v_dot), 0.95)
    if min(np.sum(is_rising & (u > min_u)), np.sum(is_rising & (u < -min_u))) < MIN_RISING:
        return []
    key = motion.m.sensors[motion.speed_name].entries[0].key
    return [
        ImportFinding(
            "no sign", "warning", note("recording.no-sign", key=key), note("recording.log-direction")
        )
    ]
