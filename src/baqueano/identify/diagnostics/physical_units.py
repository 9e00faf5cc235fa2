"""Test the units of commands and readings against physics, and the gyro against other measures of turning.

    |u_j| ≤ limit_j of the vehicle file        |ω_z| ≤ 35 rad/s, 2000 °/s        |a| ≤ 300 m/s²            (1)
    mean of a_x, a_y at rest ≈ bias + 9.8 sin(tilt),  both small for an IMU that lies flat                (2)
    ω_w = (v_r − v_l)/b    of two wheels b apart             ω_z = r ω_w                                   (3)
    a_y = v ω              of a vehicle that does not slide  a_y = v ω_z / r                               (4)
    ω_h = h(θ_0)           of the vehicle file's own numbers ω_z = r ω_h                                   (5)

(3) to (5) are signal maps (runs/diagnostics/signal_map.py). (3) and (4) use means over WINDOW_S or four samples, (5)
uses samples. r is 1 if the units are right, else 180/π or its inverse. A wrong unit is reported if r is within a factor
NEAR of its value. The factor is large because wheels that skid and a guessed file give an r nearer to 1. A gyro that
agrees with wheels or model is cleared. (4) cannot separate a gyro from an accelerometer in another unit, and reports
both.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.diagnostics import channel_map
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import Free, value
from baqueano.identify.parameters.setup import first_theta
from baqueano.runs.diagnostics.physical_limits import FASTEST_RAD_S
from baqueano.runs.diagnostics.signal_map import NOTHING, Hypothesis, MappedChannel, signal_map
from baqueano.runs.run import Channel as Log
from baqueano.runs.run import Run
from baqueano.runs.windows import means
from baqueano.signals import NANOSECONDS, STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit
    from baqueano.vehicle_file import VehicleFile
if TYPE_CHECKING:
    from baqueano.runs.run import Run
    from baqueano.vehicle_file import VehicleFile

CURVE = "gyro.or-accelerometer"  # the code of a message that names two suspects
NEAR = 2.0  # either way: the tolerances of data sheet and scale together
WINDOW_S, SAMPLES = 0.2, 4.0
FEW = 20  # rows
TOO_FAST = {np.degrees(1.0): "deg/s", np.radians(1.0): "rad/s"}  # r → unit of the gyro
TOO_SLOW = {1.0 / r: unit for r, unit in TOO_FAST.items()}  # and by 1/r
HARDEST_M_S2 = 300.0  # the largest acceleration on a small vehicle, apart from shocks
TILTED_M_S2 = 3.0  # of gravity in the plane: mounted 18° off
OVER = 1.2  # times the limit: rounding and trims are less
FEW_AT_REST = 20  # ticks at rest
FULL = ((200.0, 256.0, "PWM (0 … 255)"), (90.0, 101.0, "%"))  # from, to


def check_gyro_unit(run: Run, file: "VehicleFile", name: str) -> list[Diagnostic]:
    """Return a message if the gyro is in another unit than the wheels, or than speed and sideways acceleration.

    Return no message if the wheels of a sensor show the same yaw rate as the gyro. If only a curve shows the fault,
    the message names gyro or accelerometer.  (3), (4)
    """
    sensors, by_wheels, curves = file.sensors._asdict(), [], []
    for sensor_name, channel in run.sensors.items():
        block: Tree = sensors.get(sensor_name)
        wheels = has_field(block, "track_m")
        if not (wheels or has_field(block, "scale")) or channel.z.shape[1] != block.size:
            continue
        if (both := _windows(run.sensors[name], channel)) is None:
            continue
        imu, wheel_speeds = both
        if wheels:
            by_wheels.append(
                (
                    _map(imu[:, 2], (wheel_speeds[:, 1] - wheel_speeds[:, 0]) / block.track_m, TOO_FAST),
                    sensor_name,
                )
            )
        curves.append((_map(imu[:, 1], wheel_speeds.mean(axis=1) * imu[:, 2], TOO_SLOW), sensor_name))
    if any(_near(hypothesis) for hypothesis, _ in by_wheels):
        return []
    messages = [
        _wrong_unit(
            name, hypothesis, abs(hypothesis.relation.slope), note("gyro.as-wheels", subject=sensor_name)
        )
        for hypothesis, sensor_name in by_wheels
    ]
    messages += [_of_a_curve(name, hypothesis, sensor_name) for hypothesis, sensor_name in curves]
    return [message for message in messages if message is not None][:1]


def _of_a_curve(name: str, curve: Hypothesis, speed_name: str) -> Diagnostic | None:
    """Return a message if a_y = v ω_z / r shows a wrong unit, else None. The test cannot separate a wrong gyro from
    a wrong accelerometer.  (4)"""
    slope = abs(curve.relation.slope) or np.nan
    message = _wrong_unit(
        name, curve, 1.0 / slope, note("gyro.as-curve", subject=f"{name}[1]", speed=speed_name)
    )
    if message is None:
        return None
    return note(CURVE, Severity.ERROR, subject=f"{name}[1]", gyro=message, times=slope)


def against_model(end: "FinishedFit") -> tuple[list[Diagnostic], bool]:
    """Return messages on gyros in another unit than the file's predictions, and True if all gyros are cleared.

    A gyro is cleared if it agrees with the file, with the wheels, or with a converged fit that keeps the file's
    gains. The start of the search is not evidence, so it is not used.  (3), (5)
    """
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    unbounded = [end.requested[k]._replace(low=-np.inf, high=np.inf) for k in end.in_theta]
    by_file, _, _ = first_theta(end.blocks, unbounded, problem.shape, problem.records, FitOptions())
    at = dict(zip(problem.names, np.cumsum([0, *problem.sizes[:-1]]), strict=True))
    z, h = channel_map.measurements(problem), channel_map.predictions(problem, by_file)
    wheels = [(k, sensors[name]) for name, k in at.items() if has_field(sensors[name], "track_m")]
    wheel_rates = [(z[:, k + 1] - z[:, k]) / block.track_m for k, block in wheels]
    fitted = [channel_map.predictions(problem, end.search.solution.theta)] if _as_promised(end) else []
    messages, is_cleared = [], True
    for name in (name for name in at if has_field(sensors[name], "gyro_scale")):
        i = at[name] + 2
        of = h[:, i], *wheel_rates, *(fit[:, i] for fit in fitted)
        model, *rest = (_map(z[:, i], omega, TOO_FAST) for omega in of)
        if not any(map(_near, (model, *rest))):
            slope, is_cleared = abs(model.relation.slope), False
            messages.append(_wrong_unit(name, model, slope, note("gyro.as-commands")))
    return [message for message in messages if message is not None], is_cleared


def _as_promised(end: "FinishedFit") -> bool:
    """Return True if a converged fit left the turning gains, and the known numbers on which they act, near their
    values in the file. A fit in which none of these is identifiable is not evidence."""
    free = end.free
    now, is_identifiable = end.search.solution.theta[: len(free)], end.identifiability.mask[: len(free)]
    was = [value(end.blocks, parameter.path) if _turns(parameter) else 0.0 for parameter in free]
    ratios = [
        x / x_0 for x, x_0, free_here in zip(now, was, is_identifiable, strict=True) if free_here and x_0
    ]
    identifiable = bool(ratios) or not any(was)
    return (
        end.search.solution.converged
        and identifiable
        and all(1.0 / NEAR < abs(ratio) < NEAR for ratio in ratios)
    )


def _turns(parameter: Free) -> bool:
    """Return True for a gain or a measure of the vehicle on which its turning depends."""
    is_gain = parameter.of.role in ("gain", "known") and parameter.path.startswith("model.")
    return is_gain and parameter.axis in (None, 2) and not parameter.unit.startswith("m/s")


def _map(z: np.ndarray, h: np.ndarray, units: dict[float, str]) -> Hypothesis:
    """Return the signal map from h (N,) to z (N,)."""
    z, h = (channel_map.clip(x[:, None]) for x in (z, h))
    return signal_map(z, h, [MappedChannel(1.0 / NEAR, NEAR, units)], NOTHING)[0]


def _near(hypothesis: Hypothesis) -> bool:
    return hypothesis.is_clear and hypothesis.ratio == 1.0


def _wrong_unit(name: str, hypothesis: Hypothesis, r: float, source: Diagnostic) -> Diagnostic | None:
    if not hypothesis.meaning:
        return None
    units = {"given": hypothesis.meaning, "read": "rad/s" if hypothesis.meaning == "deg/s" else "deg/s"}
    return note("gyro.unit", Severity.ERROR, subject=f"{name}[2]", times=r, by=source, **units)


def _windows(log: Log, second_log: Log) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the means (W, m) of both logs over the windows in which both have samples, or None if one has fewer
    than FEW samples."""
    if min(len(log.t_ns), len(second_log.t_ns)) < FEW:
        return None
    usual_s = max(float(np.median(np.diff(c.t_ns))) for c in (log, second_log)) / NANOSECONDS
    width = max(WINDOW_S, SAMPLES * usual_s)
    origin = int(min(log.t_ns[0], second_log.t_ns[0]))
    both = [means(c, origin, width) for c in (log, second_log)]
    same = np.intersect1d(both[0][0], both[1][0])
    first, second = (mean[np.searchsorted(windows, same)] for windows, mean in both)
    return first, second


def implausible(run: Run, file: "VehicleFile", sensors: dict[str, Tree]) -> list[Diagnostic]:
    """Return messages on commands and readings that no small vehicle reaches, or that exceed the limits in its file."""
    messages = _commands(run, file)
    for name, block in sensors.items():
        if (
            has_field(block, "gyro_scale")
            and name in run.sensors
            and run.sensors[name].z.shape[1] == block.size
        ):
            messages += _imu(run, name, block)
            messages += check_gyro_unit(run, file, name)
    return messages


def _commands(run: Run, file: "VehicleFile") -> list[Diagnostic]:
    messages = []
    for j, (name, limit) in enumerate(zip(file.command.names, file.command.limit, strict=True)):
        most = float(np.nanmax(np.abs(run.applied[:, j]), initial=0.0))
        if not np.isfinite(limit) or most <= OVER * limit or most == 0.0:
            continue
        if limit == 0.0:
            messages.append(note("command.beyond-zero", Severity.WARNING, subject=name, most=most))
            continue
        guess = next((unit for low, high, unit in FULL if low <= most <= high), "V")
        details = {"most": most, "limit": float(limit), "of_file": file.command.unit, "guess": guess}
        messages.append(note("command.unit", Severity.ERROR, subject=name, **details))
    return messages


def _imu(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    z, messages = run.sensors[name].z, []
    size = np.abs(z[np.isfinite(z).all(axis=1)])
    if not len(size):
        return []
    far = np.any(size > [HARDEST_M_S2, HARDEST_M_S2, FASTEST_RAD_S])
    most = np.quantile(size, 0.99, axis=0) if far else np.zeros(3)
    if most[2] > FASTEST_RAD_S:
        rates: JsonObject = {"most_rad_s": float(most[2]), "fastest_rad_s": FASTEST_RAD_S}
        messages.append(note("gyro.too-fast", Severity.ERROR, subject=f"{name}[2]", **rates))
    for i in np.flatnonzero(most[:2] > HARDEST_M_S2):
        figures = {"subject": f"{name}[{i}]", "most_m_s2": float(most[i])}
        messages.append(note("accelerometer.unit", Severity.ERROR, **figures))
    return messages + _gravity(run, name, block)


def _gravity(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    channel = run.sensors[name]
    tick = np.minimum(np.searchsorted(run.t_ns, channel.t_ns), len(run.t_ns) - 1)
    rest = ~np.any(run.applied != 0.0, axis=1)[tick]
    rows = rest if rest.sum() >= FEW_AT_REST else np.ones(len(tick), bool)
    phi, theta = block.tilt_rad
    expected = block.accel_bias + STANDARD_GRAVITY * np.array([-np.sin(theta), np.sin(phi) * np.cos(theta)])
    messages = []
    for i in range(2):
        x = channel.z[rows, i]
        x = x[np.isfinite(x)]
        tilted_rows = np.count_nonzero(
            np.abs(x - expected[i]) > TILTED_M_S2
        )  # fewer than half move no median
        off = float(np.median(x)) - float(expected[i]) if tilted_rows and 2 * tilted_rows >= len(x) else 0.0
        if abs(off) > TILTED_M_S2:
            whole = abs(abs(off) - STANDARD_GRAVITY) < 0.1 * STANDARD_GRAVITY and rest.sum() >= FEW_AT_REST
            code = "gravity.at-rest" if rest.sum() >= FEW_AT_REST else "gravity.all-the-time"
            grave = Severity.ERROR if whole else Severity.WARNING
            messages.append(note(code, grave, subject=f"{name}[{i}]", off_m_s2=off))
    return messages
