"""Calibrate gyro, odometer and clocks against a truth, without a model of the vehicle.

A camera measures the pose (p, ψ) at t_i of its own clock. For many windows [t_i, t_i + T], T = 2 s:

    ψ(t_i + T) − ψ(t_i) = a ∫ z_g(t + o) dt − c T                    a = 1/scale, c = bias/scale           (1)
    p(t_i + T) − p(t_i) = ∫ R(ψ(t)) (k_x, k_y) z_o(t + o) dt + (R(ψ(t_i + T)) − R(ψ(t_i))) l              (2)

o is the offset of the truth's clock, z_g the gyro, z_o the odometer, R a rotation. (k_x, k_y) is 1/scale, turned by
the angle between the mark and the rolling direction. l is the position of the mark from the point without side slip.
For a given o both are linear. Gauss-Newton starts from the best offset of a grid. numerics/statistics.py
computes the errors.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baqueano.calibration.result import (
    GRID_S,
    MAX_OFFSET_S,
    CalibratedNumber,
    Calibration,
    sensor_axis_warnings,
)
from baqueano.contracts.optional import has_field
from baqueano.errors import UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.numerics.statistics import batch_covariance, huber_regression, student_quantile
from baqueano.runs.interpolation import TimeSeries
from baqueano.runs.run import Run
from baqueano.signals import seconds
from baqueano.vehicle_file import VehicleFile

WINDOW_S, STEP_S, GAP_S = 2.0, 0.1, 0.25  # of windows: length, step, and the longest gap between measurements
BATCH_S, BATCHES = 5.0, 8  # the longest batch, and the least number of them


class Windows(NamedTuple):
    """Windows of a camera on the clock of the truth, from frame `a` to frame `b`."""

    t_s: np.ndarray  # (K,) of the frames
    eta: np.ndarray  # (K, 3) heading unwrapped
    a: np.ndarray  # (N,)
    b: np.ndarray  # (N,)
    batch: np.ndarray  # (N,)

    def window_change(self, x: np.ndarray) -> np.ndarray:
        """Return the change x(b) − x(a) (N, …) of a quantity x (K, …) per frame."""
        return x[self.b] - x[self.a]


Equations = tuple[np.ndarray, np.ndarray, np.ndarray]  # y, derivatives, their change per second of offset


class WindowRegression(NamedTuple):
    """Result of a regression over windows."""

    x: np.ndarray  # (p,) linear coefficients
    offset_s: float
    cov: np.ndarray  # (p + 1, p + 1), the offset last; (p, p) if it was given
    rms: float
    freedom: int


def calibrate(run: Run, vehicle_file: VehicleFile) -> Calibration:
    """Return scale and bias of the gyro, scale of the odometer, position of the mark, and clock offset of the truth.
    `vehicle_file` names the sensors. Raise UsageError if the run is too short, lacks a pose of a truth, or lacks both
    sensors."""
    gyro = find_channel(run, vehicle_file, "gyro_scale", -1)
    odometer = find_channel(run, vehicle_file, "scale", 0)
    if gyro is None and odometer is None:
        raise UsageError.of("truth.no-sensor", "--vehicle FILE", run=run.name, vehicle=vehicle_file.name)
    frames = _frames(run)
    calibrated_sensors, residuals, offset = [], {}, None
    if gyro is not None:
        name, signal = gyro
        windows = _windows(run, frames, signal)
        fit = _best_regression(lambda o: _turn_equations(windows, signal, o), windows)
        offset = fit.offset_s
        calibrated_sensors += _clock_offset(fit) + _gyro(fit, name, vehicle_file)
        residuals["heading_rad"] = fit.rms
    if odometer is not None:
        name, signal = odometer
        windows = _windows(run, frames, signal)
        fit = _best_regression(lambda o: _motion_equations(windows, signal, o), windows, offset)
        calibrated_sensors += _clock_offset(fit) if offset is None else []
        calibrated_sensors += _odometer(fit, name, vehicle_file)
        residuals["distance_m"] = fit.rms
    warnings = sensor_axis_warnings(run)
    return Calibration(run.name, tuple(calibrated_sensors), residuals, axis_warnings=warnings)


def find_channel(
    run: Run, vehicle_file: VehicleFile, field: str, entry: int
) -> tuple[str, TimeSeries] | None:
    """Return the first sensor of the run whose block has `field`, and its channel `entry`, or None. Samples of an
    IMU that repeat the previous sample in all entries are excluded: they come from the driver, not the chip."""
    for name, block in vehicle_file.sensors._asdict().items():
        channel = run.sensors.get(name)
        if not has_field(block, field) or channel is None or np.isfinite(channel.z[:, entry]).sum() < 10:
            continue
        is_finite = np.isfinite(channel.z[:, entry])
        is_finite[1:] &= np.diff(channel.t_ns) > 0
        if channel.z.shape[1] >= 3:
            is_finite[1:] &= np.any(channel.z[1:] != channel.z[:-1], axis=1)
        t_s = seconds(channel.t_ns[is_finite], run.t_ns[0])
        return name, TimeSeries(t_s, channel.z[is_finite, entry])
    return None


def _frames(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Return times (K,) and poses (K, 3) of the truth, with the heading unwrapped. Raise UsageError without a pose."""
    eta = None if run.truth is None else run.truth.eta
    if eta is not None and np.isfinite(eta[:, :2]).any() and np.isnan(eta[:, 2]).all():
        use = "--use", "imu", "--use", "truth", "--clock", "truth", "--free", "+sensors.truth.lever_arm_m"
        raise UsageError.of("truth.no-heading", baqueano_command("identify", run.name, *use), run=run.name)
    if run.truth is None or not np.isfinite(run.truth.eta).all(axis=1).any():
        raise UsageError.of("truth.none", "baqueano runs import MAP.toml FILE", run=run.name)
    is_finite = np.asarray(np.isfinite(run.truth.eta).all(axis=1))
    is_finite[1:] &= np.diff(run.truth.t_ns) > 0
    eta = run.truth.eta[is_finite].copy()
    eta[:, 2] = np.unwrap(eta[:, 2])
    return seconds(run.truth.t_ns[is_finite], run.t_ns[0]), eta


def _windows(run: Run, frames: tuple[np.ndarray, np.ndarray], signal: TimeSeries) -> Windows:
    """Return all windows without a long gap in truth or sensor at any offset. Raise UsageError for too few."""
    t_s, eta = frames
    begin, end = max(t_s[0], signal.t_s[0] + MAX_OFFSET_S), min(t_s[-1], signal.t_s[-1] - MAX_OFFSET_S)
    if not end - begin >= BATCHES * WINDOW_S:
        overlap_s, needed_s = max(0.0, end - begin), BATCHES * WINDOW_S
        raise UsageError.of(
            "truth.short-overlap", run=run.name, overlap_s=overlap_s, min_s=needed_s, windows=BATCHES
        )
    a = np.unique(np.searchsorted(t_s, np.arange(begin, end - WINDOW_S, STEP_S)))
    b = np.minimum(np.searchsorted(t_s, t_s[a] + WINDOW_S), len(t_s) - 1)
    silent_spans = _gaps(t_s, 0.0) + _gaps(signal.t_s, MAX_OFFSET_S)
    is_valid = (t_s[b] - t_s[a] < 1.5 * WINDOW_S) & (t_s[b] <= end)
    for first, last in silent_spans:
        is_valid &= (t_s[b] <= first) | (t_s[a] >= last)
    a, b = a[is_valid], b[is_valid]
    batch_s = min(BATCH_S, (end - begin) / BATCHES)
    batch = np.unique(((t_s[a] - begin) / batch_s).astype(int), return_inverse=True)[1]
    if len(a) == 0 or batch.max() + 1 < BATCHES:
        raise UsageError.of("truth.silent", run=run.name, windows=len(a), window_s=WINDOW_S, batches=BATCHES)
    return Windows(t_s, eta, a, b, batch)


def _gaps(t_s: np.ndarray, min_gap_s: float) -> list[tuple[float, float]]:
    long_gaps = np.flatnonzero(np.diff(t_s) > GAP_S)
    return [(t_s[k] - min_gap_s, t_s[k + 1] + min_gap_s) for k in long_gaps]


def _turn_equations(w: Windows, gyro: TimeSeries, offset_s: float) -> Equations:
    """Return (1): y (N,), derivatives (N, 2) by (a, −c), and their change per second of offset (N, 2)."""
    t = w.t_s + offset_s
    jacobian = np.stack([w.window_change(gyro.integral_until(t)), w.window_change(w.t_s)], axis=1)
    return (
        w.window_change(w.eta[:, 2]),
        jacobian,
        np.stack([w.window_change(gyro.interpolate(t)), np.zeros(len(w.a))], axis=1),
    )


def _motion_equations(w: Windows, odometer: TimeSeries, offset_s: float) -> Equations:
    """Return (2): y (2N,), derivatives (2N, 4) by (k_x, k_y, l_x, l_y), and their change per second of offset."""
    c, s = np.cos(w.eta[:, 2]), np.sin(w.eta[:, 2])

    def displacement(v: np.ndarray) -> np.ndarray:
        rate = np.stack([v * c, v * s], axis=1)  # R e_x v
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(w.t_s)[:, None]
        return w.window_change(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))  # (N, 2)

    def with_sideways(path: np.ndarray) -> np.ndarray:
        return np.stack([path, np.stack([-path[:, 1], path[:, 0]], axis=1)], axis=2)

    t = w.t_s + offset_s
    lever = np.stack(
        [
            np.stack([w.window_change(c), w.window_change(s)], axis=1),
            np.stack([-w.window_change(s), w.window_change(c)], axis=1),
        ],
        axis=2,
    )
    jacobian = np.concatenate([with_sideways(displacement(odometer.interpolate(t))), lever], axis=2)
    h = 0.5 * GRID_S
    velocity = (displacement(odometer.interpolate(t + h)) - displacement(odometer.interpolate(t - h))) / (
        2.0 * h
    )
    change = np.concatenate([with_sideways(velocity), np.zeros((len(w.a), 2, 2))], axis=2)
    return w.window_change(w.eta[:, :2]).ravel(), jacobian.reshape(-1, 4), change.reshape(-1, 4)


def _best_regression(
    equations: Callable[[float], Equations], w: Windows, offset_s: float | None = None
) -> WindowRegression:
    """Return the regression at the offset of least residual, or at `offset_s` if it is given."""
    is_offset_free = offset_s is None
    if offset_s is None:
        grid = np.arange(-MAX_OFFSET_S, MAX_OFFSET_S + 0.5 * GRID_S, GRID_S)
        offset_s = float(grid[np.argmin([_residual_std(*equations(o)[:2]) for o in grid])])
    for _round in range(20 if is_offset_free else 0):
        y, jacobian, change = equations(offset_s)
        x, weights = huber_regression(jacobian, y)
        step = huber_regression(np.column_stack([jacobian, change @ x]), y)[0][-1]
        offset_s = float(np.clip(offset_s + np.clip(step, -GRID_S, GRID_S), -MAX_OFFSET_S, MAX_OFFSET_S))
        if abs(step) < 1e-6:
            break
    y, jacobian, change = equations(offset_s)
    x, weights = huber_regression(jacobian, y)
    J = np.column_stack([jacobian, change @ x]) if is_offset_free else jacobian
    residuals = y - jacobian @ x
    batch = np.repeat(w.batch, len(y) // len(w.batch))
    cov = batch_covariance(J, residuals, weights, batch)
    freedom = max(5, int(w.batch.max()) + 1 - J.shape[1])
    return WindowRegression(x, offset_s, cov, float(np.sqrt(np.mean(residuals**2))), freedom)


def _residual_std(y: np.ndarray, jacobian: np.ndarray) -> float:
    x, _ = huber_regression(jacobian, y, iterations=3)
    return float(np.mean(np.abs(y - jacobian @ x)))


def _number(
    fit: WindowRegression,
    name: str,
    f: Callable[[np.ndarray], float],
    unit: str,
    file_value: float | None,
    remark: str,
) -> CalibratedNumber:
    """Return a calibrated number with its error bar: `f` is its function of coefficients and offset (p + 1,)."""
    x = np.array([*fit.x, fit.offset_s])
    steps = 1e-6 * np.eye(len(x)) * np.maximum(np.abs(x), 1e-3)
    with np.errstate(divide="ignore", invalid="ignore"):  # a constant channel does not determine a scale
        gradient = np.array([(f(x + h) - f(x - h)) / (2.0 * h.sum()) for h in steps])[: len(fit.cov)]
        value, variance = float(f(x)), float(gradient @ fit.cov @ gradient)
    std = variance**0.5 if np.isfinite(variance) and np.isfinite(value) else np.inf
    half_width = student_quantile(0.975, fit.freedom) * std
    return CalibratedNumber(name, value, std, half_width, unit, file_value, remark)


def _clock_offset(regression: WindowRegression) -> list[CalibratedNumber]:
    remark = _("to be added to the truth's timestamps")
    return [_number(regression, "clock.truth", lambda x: x[-1], "s", None, remark)]


def _gyro(fit: WindowRegression, name: str, vehicle_file: VehicleFile) -> list[CalibratedNumber]:
    block, path = getattr(vehicle_file.sensors, name), f"sensors.{name}.gyro"
    remark = _("the true rotation is {ratio:.4f} × that of the gyro", ratio=float(fit.x[0]))
    return [
        _number(fit, f"{path}_scale", lambda x: 1.0 / x[0], "1", float(block.gyro_scale), remark),
        _number(fit, f"{path}_bias", lambda x: -x[1] / x[0], "rad/s", float(block.gyro_bias), ""),
    ]


def _odometer(fit: WindowRegression, name: str, vehicle_file: VehicleFile) -> list[CalibratedNumber]:
    """Return the odometer's scale, and the mark's position and heading in body axes, with x along the rolling
    direction."""
    scale, path = float(getattr(vehicle_file.sensors, name).scale), f"sensors.{name}.scale"
    remark = _("the true distance is {ratio:.4f} × that of the odometer", ratio=float(np.hypot(*fit.x[:2])))

    def rotate(x: np.ndarray, lx: float, ly: float) -> float:
        return float((x[0] * lx + x[1] * ly) / np.hypot(x[0], x[1]))

    forward = _("the mark ahead of the axle that does not slip")
    sideways = _("the mark to the left of that axle's middle")
    heading = _("heading of the mark, to the left of the rolling direction of the wheels")
    return [
        _number(fit, path, lambda x: 1.0 / float(np.hypot(x[0], x[1])), "1", scale, remark),
        _number(fit, "mark.x_m", lambda x: rotate(x, x[2], x[3]), "m", None, forward),
        _number(fit, "mark.y_m", lambda x: rotate(x, x[3], -x[2]), "m", None, sideways),
        _number(fit, "mark.heading_rad", lambda x: -float(np.arctan2(x[1], x[0])), "rad", None, heading),
    ]
