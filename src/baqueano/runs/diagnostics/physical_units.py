"""Test the units of commands and readings against physics, and the gyro against other measures of turning.

    |u_j| ≤ limit_j of the vehicle file        |ω_z| ≤ 35 rad/s, 2000 °/s        |a| ≤ 300 m/s²            (1)
    mean of a_x, a_y at rest ≈ bias + 9.8 sin(tilt),  both small for an IMU that lies flat                (2)
    ω_w = (v_r − v_l)/b    of two wheels b apart             ω_z = r ω_w                                   (3)
    a_y = v ω              of a vehicle that does not slide  a_y = v ω_z / r                               (4)

(3) and (4) are signal maps (signal_map.py) of means over WINDOW_S or four samples. A fit compares the gyro with its
model in the same way (identify/diagnostics/file_consistency.py). r is 1 if the units are correct, else 180/π or its
inverse. A wrong unit is reported if r is within a factor MAX_UNIT_RATIO of that value. The factor is large because r
is nearer to 1 if wheels skid, or if values of the file are guesses. A gyro that agrees with the wheels is confirmed.
(4) cannot separate a gyro from an accelerometer in another unit, and reports both.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.runs.diagnostics.physical_limits import KIND_LIMITS, MAX_YAW_RATE_RAD_S
from baqueano.runs.diagnostics.signal_map import MIN_WINDOWS, MappedChannel, clip, signal_map
from baqueano.runs.interpolation import window_means
from baqueano.runs.run import Channel as Log, Run
from baqueano.sensors.sampling import is_imu
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY
from baqueano.vehicle_file import VehicleFile

CURVE_CODE = "gyro.or-accelerometer"  # the code of a message that names two possible causes
MAX_UNIT_RATIO = 2.0  # either way: the tolerances of data sheet and scale together
WINDOW_S, WINDOW_SAMPLES = 0.2, 4.0
RATIO_UNITS = {np.degrees(1.0): "deg/s", np.radians(1.0): "rad/s"}  # r → unit of the gyro
TILT_M_S2 = 3.0  # component of gravity in the plane: the mount is tilted by 18°
LIMIT_TOLERANCE = 1.2  # times the limit: rounding and trims are less
MIN_REST_TICKS = 20  # ticks at rest
FULL_SCALES = ((200.0, 256.0, "PWM (0 … 255)"), (90.0, 101.0, "%"))  # from, to


def check_gyro_unit(run: Run, vehicle_file: VehicleFile, name: str) -> list[Diagnostic]:
    """Return a list with at most one message: the gyro is in another unit than the wheels, or than speed and sideways
    acceleration. The list is empty if the wheels of a sensor show the same yaw rate as the gyro. If only (4) shows the
    fault, the message names gyro or accelerometer. (3), (4)"""
    sensors, wheel_comparisons, curve_comparisons = vehicle_file.sensors._asdict(), [], []
    for sensor_name, channel in run.sensors.items():
        block: Tree = sensors.get(sensor_name)
        is_wheels = has_field(block, "track_m")
        if not (is_wheels or has_field(block, "scale")) or channel.z.shape[1] != block.size:
            continue
        if min(len(run.sensors[name].t_ns), len(channel.t_ns)) < MIN_WINDOWS:
            continue
        imu, speed = _window_means(run.sensors[name], channel)
        if is_wheels:
            rate = (speed[:, 1] - speed[:, 0]) / block.track_m
            source = note("gyro.as-wheels", subject=sensor_name)
            wheel_comparisons.append(compare_gyro(name, imu[:, 2], rate, source))
        source = note("gyro.as-curve", subject=f"{name}[1]", speed=sensor_name)
        curve_comparisons.append(compare_gyro(name, imu[:, 1], speed.mean(axis=1) * imu[:, 2], source, -1))
    if any(comparison.is_near for comparison in wheel_comparisons):
        return []
    messages = [comparison.message for comparison in wheel_comparisons if comparison.message]
    for comparison in curve_comparisons:
        if comparison.message:  # the test cannot separate a wrong gyro from a wrong accelerometer
            figures: JsonObject = {"gyro": comparison.message, "ratio": comparison.slope}
            messages.append(note(CURVE_CODE, Severity.ERROR, subject=f"{name}[1]", **figures))
    return messages[:1]


class GyroComparison(NamedTuple):
    """The comparison of a gyro with another measure of turning."""

    is_near: bool  # the unit is confirmed
    slope: float
    message: Diagnostic | None  # of a wrong unit


def compare_gyro(
    name: str, z: np.ndarray, h: np.ndarray, source: Diagnostic, power: int = 1
) -> GyroComparison:
    """Return the signal map from h (N,) to z (N,). Their ratio is r for a `power` of 1, or 1/r for −1."""
    z, h = (clip(x[:, None]) for x in (z, h))
    units = {r**power: unit for r, unit in RATIO_UNITS.items()}
    (channel,) = signal_map(z, h, [MappedChannel(1.0 / MAX_UNIT_RATIO, MAX_UNIT_RATIO, units)])
    slope, message = abs(channel.regression.slope), None
    if channel.meaning:
        unit_name = next(unit for unit in RATIO_UNITS.values() if unit != channel.meaning)
        figures: JsonObject = {
            "ratio": slope**power,
            "source": source,
            "true_unit": channel.meaning,
            "assumed_unit": unit_name,
        }
        message = note("gyro.unit", Severity.ERROR, subject=f"{name}[2]", **figures)
    return GyroComparison(channel.is_clear and channel.ratio == 1.0, slope, message)


def _window_means(log: Log, second_log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Return the means (W, m) of both logs over the windows in which both have samples."""
    typical_s = max(float(np.median(np.diff(c.t_ns))) for c in (log, second_log)) / NANOSECONDS
    width, origin = max(WINDOW_S, WINDOW_SAMPLES * typical_s), int(min(log.t_ns[0], second_log.t_ns[0]))
    (windows, mean), (second_windows, second_mean) = (
        window_means(c, origin, width) for c in (log, second_log)
    )
    _, rows, second_rows = np.intersect1d(windows, second_windows, return_indices=True)
    return mean[rows], second_mean[second_rows]


def implausible_values(run: Run, vehicle_file: VehicleFile, sensors: dict[str, Tree]) -> list[Diagnostic]:
    """Return messages on commands and readings that no small vehicle reaches, or that exceed the limits in its file."""
    messages = _command_messages(run, vehicle_file)
    for name, block in sensors.items():
        is_recorded = name in run.sensors and run.sensors[name].z.shape[1] == block.size
        if is_recorded and is_imu(block):
            messages += _imu_messages(run, name, block) + check_gyro_unit(run, vehicle_file, name)
    return messages


def _command_messages(run: Run, vehicle_file: VehicleFile) -> list[Diagnostic]:
    command, messages = vehicle_file.command, []
    for j, (name, limit) in enumerate(zip(command.names, command.limit, strict=True)):
        peak = float(np.nanmax(np.abs(run.applied_commands[:, j]), initial=0.0))
        if not np.isfinite(limit) or peak <= LIMIT_TOLERANCE * limit or peak == 0.0:
            continue
        if limit == 0.0:
            messages.append(note("command.limit-zero", Severity.WARNING, subject=name, maximum=peak))
            continue
        guess = next((unit for low, high, unit in FULL_SCALES if low <= peak <= high), "V")
        details = {"maximum": peak, "limit": float(limit), "file_unit": command.unit, "guess": guess}
        messages.append(note("command.unit", Severity.ERROR, subject=name, **details))
    return messages


def _imu_messages(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    z, messages = run.sensors[name].z, []
    magnitudes, max_m_s2 = np.abs(z[np.isfinite(z).all(axis=1)]), KIND_LIMITS["acceleration"][0]
    if not len(magnitudes):
        return []
    is_implausible = np.any(magnitudes > [max_m_s2, max_m_s2, MAX_YAW_RATE_RAD_S])
    peaks = np.quantile(magnitudes, 0.99, axis=0) if is_implausible else np.zeros(3)
    if peaks[2] > MAX_YAW_RATE_RAD_S:
        rates: JsonObject = {"max_rad_s": float(peaks[2]), "fastest_rad_s": MAX_YAW_RATE_RAD_S}
        messages.append(note("gyro.too-fast", Severity.ERROR, subject=f"{name}[2]", **rates))
    for i in np.flatnonzero(peaks[:2] > max_m_s2):
        figures = {"subject": f"{name}[{i}]", "max_m_s2": float(peaks[i])}
        messages.append(note("accelerometer.unit", Severity.ERROR, **figures))
    return messages + _gravity_messages(run, name, block)


def _gravity_messages(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    channel = run.sensors[name]
    tick = np.minimum(np.searchsorted(run.t_ns, channel.t_ns), len(run.t_ns) - 1)
    at_rest = ~np.any(run.applied_commands != 0.0, axis=1)[tick]
    has_rest = at_rest.sum() >= MIN_REST_TICKS
    rows = at_rest if has_rest else np.ones(len(tick), bool)
    phi, theta = block.tilt_rad
    gravity = STANDARD_GRAVITY * np.array([-np.sin(theta), np.sin(phi) * np.cos(theta)])
    expected_reading = block.accel_bias + gravity
    messages = []
    for i in range(2):
        x = channel.z[rows, i]
        x = x[np.isfinite(x)]
        offset = float(np.median(x)) - float(expected_reading[i]) if len(x) else 0.0
        if abs(offset) > TILT_M_S2:
            is_full_gravity = has_rest and abs(abs(offset) - STANDARD_GRAVITY) < 0.1 * STANDARD_GRAVITY
            severity = Severity.ERROR if is_full_gravity else Severity.WARNING
            code = "gravity.at-rest" if has_rest else "gravity.all-the-time"
            messages.append(note(code, severity, subject=f"{name}[{i}]", error_m_s2=offset))
    return messages
