"""Estimate the noise of the recommended filter: the error of the model and the noise of the sensors.

    J(q) = Σ_t ½ (log |S_t| + ρ(y_tᵀ S_t⁻¹ y_t)),   q = log (σ_d, T, walk of ν, σ of correcting channels) (1)
    inertial:  max(s σ₂², σ² at rest) ≤ σ² ≤ σ₂² = ⅙ (1.48 median |r_{k+1} − 2 r_k + r_{k−1}|)²            (2)
    c(τ) = σ_d² (λ e^(−λτ) − a e^(−aτ)) a/(λ² − a²),  a = 1/T of the file;   walk of ν_x ≤ σ √δ             (3)
    Q = σ_m² [1 1; 1 1] + σ_t² [1 −1; −1 1]  of a left and a right wheel                                   (4)

y and S are the innovations of the filter, r the residuals of the fit, ρ is in gaussian_likelihood.py. The second
differences in (2) remove slow errors of the model, but not the jerks of a rough floor; s is their white share. Without
s, J has a second minimum at σ = 0, where d explains the noise too. A rest with more scatter than σ₂ is not used. A
channel that does not correct the motion has the noise of its residuals; a sensor with few readings keeps its noise.
Quantised velocities have σ² ≥ step²/12. With only an IMU, (3) estimates d from the forward accelerometer: its r is the
rate of change of the speed error, which the drag λ limits to d/λ. speed_error.py estimates the d of a kinematic model,
and slip of wheels. In (4) an error of the track has opposite signs at the two wheels. The least `course_std`
is the angle from heading to course. docs/derivations/kalman.md derives (3) and (4).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Sensor, SensorBlocks
from baqueano.contracts.optional import has_field, is_dynamic
from baqueano.contracts.values import Tree, Value
from baqueano.estimators.augmented.motion import has_motor_lag
from baqueano.estimators.augmented.state import FORWARD_STATES, TURNING_STATES, Layout, layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import measurement_jacobian
from baqueano.identify.data.averaging import durations_s, is_average
from baqueano.identify.noise.process_noise import TICKS, total_cost
from baqueano.identify.noise.speed_error import (
    MAX_FADE_S,
    MIN_FADE_S,
    accelerometer_share,
    speed_signals,
    with_slope,
    with_speed_error,
    with_truth_misfit,
)
from baqueano.numerics.autocorrelation import correlated_variance, speed_error_autocorrelations
from baqueano.numerics.gaussian_likelihood import log_det_and_square, robust_square
from baqueano.numerics.quasi_newton import minimise_logarithms
from baqueano.numerics.statistics import expected_variance, largest_white_share, white_std
from baqueano.runs.diagnostics.samples import ROUNDING
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.runs.run import Run
from baqueano.signals import Tick
from baqueano.symbolic import scan, value_at_path, with_value
from baqueano.vehicles.state import tick_effort

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.identify.result.fit_result import Fit

FORWARD_NOISE = (
    ("disturbance_std[0]", 1e-4, 1e2),
    ("disturbance_fade_s[0]", MIN_FADE_S, MAX_FADE_S),
    ("velocity_walk_std[0]", 1e-4, 10.0),
)
TURNING_NOISE = (
    ("disturbance_std[1]", 1e-4, 1e3),
    ("disturbance_fade_s[1]", MIN_FADE_S, MAX_FADE_S),
    ("velocity_walk_std[2]", 1e-4, 30.0),
)
SIDEWAYS_NOISE = ("velocity_walk_std[1]", 1e-4, 10.0)
MOTOR_LAG_NOISE = (("motor_lag_std_s", 1e-3, 1.0),)
FIELDS = (
    "disturbance_std", "disturbance_fade_s", "motor_lag_std_s", "velocity_walk_std", "course_std",
    "speed_error_std", "least_error_speed_m_s", "speed_per_gyro_scale", "lateral_offset_std_m",
    "slope_speed_std_m_s",
)  # fmt: skip
ROBUST_SIGMA = 6.0  # ρ is a square up to this limit, so that the long tails of model errors do not enlarge σ
LOG_RANGE = 5.0  # range of the logarithm of a sensor's σ, on both sides of the file's value
MIN_RESIDUALS = 30  # residuals for (2), (3), readings for the noise of a sensor
MIN_READINGS = 6  # readings for the magnitude of a misfit, with an error of 30 %
MAX_LEVEL_SHARE = 0.5  # fraction of the readings: with fewer levels they are quantised
# lags of (3): beyond the noise, from LAGS_S[0] seconds or 1/λ if it is less, to LAGS_S[1] times T
LAGS_S, MIN_LAG_S = (0.1, 2.0), 0.03
# of standard errors: sideslip and tilt also act sideways, so this accelerometer is used only if it shows far more
SIDEWAYS_FACTOR = 2.0
STRAIGHT_S, MIN_SPEED_M_S = 1.0, 0.02  # of the drive that shows a model's course
TOE_RAD = 0.01  # angle error of wheels that are mounted by hand
WHEEL_PATTERNS = np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([[1.0, -1.0], [-1.0, 1.0]])  # (4)


class FreeNoise(NamedTuple):
    """A noise parameter of the filter that the likelihood determines."""

    path: str
    low: float
    high: float
    power: float  # exponent of the value at `path`: 2 for a variance
    pattern: np.ndarray | None = None  # (m, m) a term of a covariance, which is the sum of its terms


def filter_noise(
    fit: "Fit",
    runs: Sequence[Run],
    q: Mapping[str, np.ndarray],
    rest: Mapping[str, np.ndarray | None],
    backend: str,
    speed_from: tuple[str, ...],
) -> AugmentedEkf:
    """Return the filter of the fitted file, with the noise of the model and of its sensors. `q` (in motion) and `rest`
    are the sensors' covariances from the residuals of the fit. `speed_from` is the field of the filter."""
    estimator = replace(fit.file.estimator(), speed_from=speed_from, noise_gain=0.0)
    filter_layout = layout(estimator)
    inertial = {bias.sensor for bias in filter_layout.biases}
    used_rows = [
        c for c, E in zip(filter_layout.channel_entries, filter_layout.corrects_motion, strict=True) if E
    ]
    sensors, fit_sensors, rounding = estimator.sensors, fit.vehicle_file.sensors, {}
    sensor_runs = {name: [run for run in runs if name in run.sensors] for name in filter_layout.names}
    readings = {name: sum(len(run.sensors[name].z) for run in sensor_runs[name]) for name in sensor_runs}
    for name in filter_layout.names:
        sensor = getattr(fit_sensors, name)
        Q = q.get(name, sensor.cov) if readings[name] >= MIN_RESIDUALS else sensor.cov
        variance = np.array(np.diagonal(Q), dtype=float)
        for _, i in [c for c in used_rows if c[0] == name and name in inertial]:
            rounding[name, i] = _variance_range(fit, name, i, rest.get(name), variance[i])
            variance[i] = rounding[name, i][1]
        Q = Q if _is_wheel_pair(sensor, filter_layout, name) else np.diag(variance)
        sensors = sensors._replace(**{name: replace(sensor, measurement_noise_cov=Q)})
    ekf = replace(estimator, vehicle=fit.blocks.model, sensors=sensors)
    rounding |= _rounding(filter_layout, inertial, runs)
    free = _free_noise(ekf, inertial, rounding, readings)
    example = example_filter_tick(ekf)
    kernel = scan(_likelihood(ekf, free), ekf.init(), example, np.zeros(len(free)), backend=backend)
    ticks = [make_ticks(run, ekf, TICKS.get(kernel.backend, 600) // len(runs)) for run in runs]
    low, high = (np.log([getattr(entry, side) for entry in free]) for side in ("low", "high"))
    start = np.clip([_start(ekf, entry) for entry in free], low, high)
    x = minimise_logarithms(total_cost(kernel, ticks), start, low, high) if free else start
    ekf = _with_noise(ekf, free, [float(value) for value in x])
    speed_is_measured = filter_layout.correction_mask(FORWARD_STATES[0]).any()
    if is_dynamic(ekf.vehicle):
        if speed_is_measured:
            ekf = _without_wheel_slip(ekf, fit, inertial)
        else:
            rate = _straight_drive(fit, _rms_forward_command(runs))[1]
            ekf = _with_accelerometer_misfit(ekf, fit, inertial, rate)
    elif not speed_is_measured:
        ekf = with_truth_misfit(ekf, fit, runs)
    nu, decay_rate = _half_speed(fit, runs)
    crab_rad = np.arctan2(abs(nu[1]), abs(nu[0])) if abs(nu[0]) > MIN_SPEED_M_S else 0.0
    ekf = with_slope(with_speed_error(ekf, fit, runs), fit, inertial, decay_rate)
    return replace(ekf, course_std=float(np.hypot(TOE_RAD, crab_rad)))


def _rms_forward_command(runs: Sequence[Run]) -> float:
    """Return the rms of the first command over the ticks in which it is not 0, or 0 if it never is."""
    u = np.concatenate([run.applied_commands[:, 0] for run in runs])
    return float(np.sqrt(np.mean(u[u != 0.0] ** 2))) if np.any(u != 0.0) else 0.0


def _straight_drive(fit: "Fit", command: float) -> tuple[np.ndarray, float]:
    """Return ν (3,) of the fitted model after STRAIGHT_S with a forward `command`, and the decay rate λ = −∂ν̇_x/∂ν_x
    [1/s] there, which is 0 for a kinematic model."""
    vehicle, dt_s = fit.blocks.model, 1.0 / fit.file.rate_hz
    u, state, motion, effort = np.zeros(vehicle.commands), vehicle.init(), None, None
    u[0] = command
    for _ in range(round(STRAIGHT_S / dt_s)):
        effort = tick_effort(vehicle, state.drivetrain, state.eta[2], state.nu, u, dt_s)[1]
        state, motion = vehicle.step(state, u, dt_s, np.zeros(3))
    nu, step = np.asarray(motion.nu if motion else np.zeros(3), dtype=float), np.array([1e-4, 0.0, 0.0])
    if effort is None or not is_dynamic(vehicle):
        return nu, 0.0
    accelerations = [float(vehicle.nu_dot(nu + side * step, effort.last, 0.0)[0]) for side in (-1.0, 1.0)]
    return nu, max(0.0, (accelerations[0] - accelerations[1]) / (2.0 * step[0]))


def _half_speed(fit: "Fit", runs: Sequence[Run]) -> tuple[np.ndarray, float]:
    """Return ν (3,) and the decay rate of a straight drive at half the largest command."""
    limit = fit.file.command.limit[0]
    return _straight_drive(fit, 0.5 * limit if np.isfinite(limit) else _rms_forward_command(runs))


def _without_wheel_slip(ekf: AugmentedEkf, fit: "Fit", inertial: set[str]) -> AugmentedEkf:
    """Return the filter without the part of the speed error that is slip of wheels (speed_error.py)."""
    share = np.sqrt(accelerometer_share(ekf, fit, inertial))
    for path, low, _ in (FORWARD_NOISE[0], FORWARD_NOISE[2]):
        ekf = with_value(ekf, path, max(low, float(share * value_at_path(ekf, path))))
    return ekf


def _with_accelerometer_misfit(
    ekf: AugmentedEkf, fit: "Fit", inertial: set[str], decay_rate: float
) -> AugmentedEkf:
    """Return the filter with the disturbance from the residuals of the forward accelerometer or, if it shows clearly
    more, of the sideways one. With too few residuals the filter is unchanged. (3) White noise gives the estimated
    variance a standard error (`expected_variance`)."""
    dt_s, T = 1.0 / ekf.rate_hz, float(ekf.disturbance_fade_s[0])
    first_s = max(MIN_LAG_S, min(LAGS_S[0], 1.0 / max(decay_rate, 1e-3)))
    tau_s, first = dt_s * np.arange(max(1, round(LAGS_S[1] * T / dt_s)) + 1), max(1, round(first_s / dt_s))
    speed_c, acceleration_c = speed_error_autocorrelations(tau_s, T, decay_rate)
    ahead, sideways = (
        correlated_variance(speed_signals(ekf, fit, inertial, forward=forward), c, first)
        for c, forward in ((acceleration_c, True), (speed_c, False))
    )
    variance, std_error, _ = sideways if SIDEWAYS_FACTOR * sideways[1] < ahead[1] else ahead
    if not np.isfinite(std_error):
        return ekf
    std = np.sqrt(expected_variance(variance, std_error))
    low, high = FORWARD_NOISE[0][1:]
    ekf = with_value(ekf, "disturbance_std[0]", float(np.clip(std, low, high)))
    walk = ahead[2] * np.sqrt(dt_s) if np.isfinite(ahead[1]) else np.inf
    return with_value(ekf, "velocity_walk_std[0]", float(min(ekf.velocity_walk_std[0], walk)))


def _free_noise(
    ekf: AugmentedEkf,
    inertial: set[str],
    rounding: Mapping[tuple[str, int], tuple[float, float]],
    readings: Mapping[str, int],
) -> list[FreeNoise]:
    """Return the noise parameters that the measurements can determine. `rounding` contains the least and greatest
    variance of some entries, `readings` the number of readings of each sensor."""
    filter_layout = layout(ekf)
    counts = np.array([readings[name] for name, _ in filter_layout.channel_entries])
    free_noise = []
    turning_noise = TURNING_NOISE + (MOTOR_LAG_NOISE if has_motor_lag(ekf.vehicle) else ())
    for state, paths in ((FORWARD_STATES[0], FORWARD_NOISE), (TURNING_STATES[2], turning_noise)):
        max_count = np.max(counts * filter_layout.correction_mask(state), initial=0)
        count = len(paths) if max_count >= MIN_RESIDUALS else int(max_count >= MIN_READINGS)
        free_noise += [FreeNoise(*path, 1.0) for path in paths[:count]]
    if np.max(counts * filter_layout.measures_sideways, initial=0) >= MIN_RESIDUALS:
        free_noise.append(FreeNoise(*SIDEWAYS_NOISE, 1.0))
    pairs = [n for n in filter_layout.names if _is_wheel_pair(getattr(ekf.sensors, n), filter_layout, n)]
    for name in (name for name in pairs if readings[name] >= MIN_RESIDUALS):
        low = np.sqrt(0.5 * max(rounding.get((name, i), (0.0, 0.0))[0] for i in (0, 1)))
        for pattern in WHEEL_PATTERNS:
            std = np.sqrt(_pattern_variance(getattr(ekf.sensors, name).cov, pattern))
            limits = max(low, std * np.exp(-LOG_RANGE)), std * np.exp(LOG_RANGE)
            free_noise.append(FreeNoise(f"sensors.{name}.measurement_noise_cov", *limits, 2.0, pattern))
    for name, i in (channel for channel in filter_layout.channel_entries if channel[0] not in pairs):
        std = float(np.sqrt(getattr(ekf.sensors, name).cov[i, i]))
        low, high = np.sqrt(rounding.get((name, i), (0.0, 0.0)))
        if name not in inertial:
            low, high = max(low, std * np.exp(-LOG_RANGE)), std * np.exp(LOG_RANGE)
        if low < high and readings[name] >= MIN_RESIDUALS:
            path = f"sensors.{name}.measurement_noise_cov[{i},{i}]"
            free_noise.append(FreeNoise(path, float(low), float(high), 2.0))
    return free_noise


def _is_wheel_pair(sensor: Sensor, layout: Layout, name: str) -> bool:
    """Return True if both entries of a sensor are used, and measure the speeds of a left and a right wheel.  (4)"""
    if [i for n, i in layout.channel_entries if n == name] != [0, 1] or sensor.size != 2:
        return False
    speed, yaw_rate = measurement_jacobian(sensor, np.zeros(9))[:, [3, 5]].T
    return bool(speed[0] * speed[1] > 0.0 and yaw_rate[0] * yaw_rate[1] < 0.0)


def _pattern_variance(Q: np.ndarray, pattern: np.ndarray) -> float:
    """Return the coefficient of the `pattern` (2, 2) in Q (2, 2), at least a hundredth of the mean variance.  (4)"""
    return max(0.25 * float(np.sum(pattern * Q)), 0.005 * float(np.trace(Q)))


def _start(ekf: AugmentedEkf, parameter: FreeNoise) -> float:
    """Return the value at the start of the search: a logarithm.  (1)"""
    value = value_at_path(ekf, parameter.path)
    value = value if parameter.pattern is None else _pattern_variance(value, parameter.pattern)
    return float(np.log(max(value, parameter.low**parameter.power))) / parameter.power


def _with_noise(
    ekf: AugmentedEkf, free: Sequence[FreeNoise], x: Sequence[Value] | np.ndarray
) -> AugmentedEkf:
    """Return the filter with the noise parameters `free` at their logarithms x.  (1), (4)"""
    values: dict[str, Value] = {}
    for k, parameter in enumerate(free):
        term = np.exp(parameter.power * x[k])
        term = term if parameter.pattern is None else term * parameter.pattern
        values[parameter.path] = values[parameter.path] + term if parameter.path in values else term
    for path, value in values.items():
        ekf = with_value(ekf, path, value)
    return ekf


def _rounding(
    layout: Layout, inertial: set[str], runs: Sequence[Run]
) -> dict[tuple[str, int], tuple[float, float]]:
    """Return the least and greatest variance of quantised entries that measure a velocity, for example of a counter.
    The rate of a counter over varying intervals times its interval is quantised."""
    channels, variances = layout.channel_entries, {}
    positions = {channels[k] for group in layout.pose_groups for k in group}  # repeated by a tag
    for name, i in (c for c in channels if c[0] not in inertial and c not in positions):
        of_name = [run for run in runs if name in run.sensors and len(run.sensors[name].z) > 1]
        z = np.concatenate([np.zeros(0), *(run.sensors[name].z[:, i] for run in of_name)])
        counted_s = np.concatenate([np.zeros(0), *(_counted_s(run, name) for run in of_name)])
        for interval_s in (np.ones(len(z)), counted_s):
            counts = (z * interval_s)[np.isfinite(z)]
            gaps = np.diff(np.unique(counts))
            gaps = gaps[gaps > ROUNDING * np.max(np.abs(counts), initial=0.0)]
            if 0 < len(gaps) < MAX_LEVEL_SHARE * len(counts) - 1:
                min_variance = float(np.median(gaps) / np.median(interval_s)) ** 2 / 12.0
                variances[name, i] = max(min_variance, variances.get((name, i), (0.0, np.inf))[0]), np.inf
    return variances


def _counted_s(run: Run, name: str) -> np.ndarray:
    """Return the interval (M,) of each rate that the import derived [s]; 1 for other readings."""
    return durations_s(run, name) if is_average(run, name, None) else np.ones(len(run.sensors[name].z))


def _likelihood(ekf: AugmentedEkf, free: Sequence[FreeNoise]) -> Callable[..., Tree]:
    """Return the scan step from the logarithms of the free noise to the term of J of the correcting channels.  (1)"""
    is_correcting = layout(ekf).corrects_motion

    def step(x: np.ndarray, belief: Tree, tick: Tick) -> tuple[Tree, Tree]:
        belief, estimate = _with_noise(ekf, free, x).row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        is_used = np.where(is_correcting & np.isfinite(y), 1.0, 0.0)
        log_det, square = log_det_and_square(S, y, is_used)
        m = np.maximum(np.sum(is_used), 1.0)
        return belief, 0.5 * (log_det + robust_square(square, ROBUST_SIGMA * np.sqrt(m)))

    return step


def _variance_range(
    fit: "Fit", name: str, entry: int, rest: np.ndarray | None, default: float
) -> tuple[float, float]:
    """Return the least and the greatest variance of an inertial channel, `default` with few residuals.  (2)"""
    residuals = [c.residuals for c in fit.channels if (c.sensor, c.entry) == (name, entry)]
    residuals = [r[np.isfinite(r)] for r in residuals]
    count = sum(max(0, len(r) - 2) for r in residuals)
    max_variance = (white_std(residuals) ** 2 if count >= MIN_RESIDUALS else 0.0) or default
    min_variance = largest_white_share(residuals) * max_variance
    variance_at_rest = 0.0 if rest is None else float(rest[entry, entry])
    return max(min_variance, variance_at_rest if variance_at_rest < max_variance else 0.0), max_variance


def simulated_noise(sensors: SensorBlocks, Q: Mapping[str, np.ndarray]) -> "JsonObject":
    """Return the keys of the file for the white noise of each sensor whose file does not contain it, from Q (m, m)."""
    values: JsonObject = {}
    for name in (name for name in sensors._fields if name in Q):
        sensor, std = getattr(sensors, name), np.sqrt(np.diagonal(Q[name]))
        values_by_key: JsonObject = {}
        if has_field(sensor, "gyro_noise_std"):
            values_by_key = {"accel_noise_std": std[:2].tolist(), "gyro_noise_std": float(std[2])}
        elif has_field(sensor, "noise_std"):
            values_by_key = {"noise_std": float(np.sqrt(np.mean(std**2)))}
        if not any(np.any(getattr(sensor, key)) for key in values_by_key):
            values |= {f"sensors.{name}.{key}": value for key, value in values_by_key.items()}
    return values
