"""Estimate errors of the speed that the innovations of a filter do not show: slip of the wheels, and lasting errors.

    B = (r_v(t + τ) − 2 r_v(t) + r_v(t − τ))/τ,   A = (∫ r_a from t to t + τ − ∫ r_a from t − τ to t)/τ   (1)
    φ = Σ w A B / Σ w (B² − 6 q/τ²),   q the variance of white noise in r_v, w = 1/mean A² of each τ     (2)

In the innovations of the wheels, slip and an unmodelled force look the same. A filter that treats slip as a force
follows the slip. The forward accelerometer separates them: r_v are residuals of the wheels' speed, r_a of the
accelerometer. φ is 1 if the accelerometer measures the whole error, 0 if only the wheels do; its noise does not change
the mean. An accelerometer does not measure the push of a sloping floor. That push depends on the heading, so the part
of B that cos ψ, sin ψ and their integrals explain is removed. The upper end of the 95 % interval of φ is used, from
blocks drawn with replacement. So an error stays unless it is clearly contradicted. No sensor on board shows the lasting
errors of the model's speed; they follow from the errors of the fit (`with_speed_error`) and last for the whole drive.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.blocks import Sensor
from baqueano.estimators.augmented.motion import MIN_SPEED_M_S
from baqueano.estimators.augmented.state import layout, start_std
from baqueano.estimators.augmented_ekf import SCALE_INDEX, AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import measurement_jacobian
from baqueano.estimators.readings.velocity_readings import velocity_readings
from baqueano.identify.data.added_channels import TRUTH
from baqueano.identify.data.record import make_record
from baqueano.identify.residuals.motion import motion_rows, open_loop
from baqueano.numerics.autocorrelation import RegressionSignal, lag_sums
from baqueano.numerics.floor_push import AccelerometerResiduals, slope_speed_error
from baqueano.numerics.statistics import enclosing_cov, lines_by_sign, white_std
from baqueano.runs.interpolation import HALF_WINDOW_S, TimeSeries, true_speed
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS
from baqueano.symbolic import with_value

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

WINDOWS_S = (0.4, 0.8, 1.6)  # τ: longer than the delay of wheels, shorter than changes of a bias
MIN_WINDOW_SAMPLES = 4  # of the wheels in a window, at least
BLOCK_S, MIN_BLOCKS, DRAWS = 2.0, 8, 1000  # length of a block, least number of blocks, draws
UPPER_QUANTILE, MIN_SHARE = 0.975, 1e-3  # quantile of φ; least φ, so that a filter can still follow a misfit
FORWARD, YAW, FORWARD_DOT = 0, 2, 6  # of ν; of (η, ν, ν̇)
SCALES = [SCALE_INDEX, SCALE_INDEX + 1]  # of speed and yaw rate
MAX_SPEED_PER_GYRO_SCALE = 10.0  # a larger c belongs to a model that diverged
SCALES_INCLUDED = "identifiability.accelerometer-scale"  # of a fit whose errors contain those of the scales
MIN_FADE_S, MAX_FADE_S = 0.3, 30.0  # limits of T; faster changes belong to the walk of ν
MIN_STD_M_S = 1e-4
CLIP_SIGMA, MOTOR_LAGS_S = 4.0, (0.02, 0.05, 0.1, 0.2, 0.4)  # σ of a residual, and τ, for (7)
TRUTH_LAGS_S, MIN_PAIRS = (2.0 * HALF_WINDOW_S, 10.0), 100  # of (6)


def forward_accelerometer(ekf: AugmentedEkf, inertial: set[str]) -> tuple[str, int, float] | None:
    """Return sensor, entry and derivative of the inertial reading that depends most on ν̇_x, or None."""
    return _strongest(ekf, inertial, lambda sensor: measurement_jacobian(sensor)[:, FORWARD_DOT])


def sideways_accelerometer(ekf: AugmentedEkf, inertial: set[str]) -> tuple[str, int, float] | None:
    """Return sensor, entry and derivative of the inertial reading that depends most on ν_x ν_ψ, or None."""
    at_rest, turning = np.zeros(9), np.eye(9)[3 + YAW]

    def slopes(sensor: Sensor) -> np.ndarray:
        return (measurement_jacobian(sensor, turning) - measurement_jacobian(sensor, at_rest))[:, 3 + FORWARD]

    return _strongest(ekf, inertial, slopes)


def _strongest(
    ekf: AugmentedEkf, inertial: set[str], slopes: Callable[[Sensor], np.ndarray]
) -> tuple[str, int, float] | None:
    """Return sensor, entry and slope of the inertial reading with the largest of `slopes`, or None if all are 0."""
    readings = [
        (name, i, float(slope))
        for name in sorted(inertial)
        for i, slope in enumerate(slopes(getattr(ekf.sensors, name)))
    ]
    strongest = max(readings, key=lambda reading: abs(reading[2]), default=None)
    return strongest if strongest and strongest[2] != 0.0 else None


def speed_signals(
    ekf: AugmentedEkf, fit: "Fit", inertial: set[str], *, forward: bool
) -> list[RegressionSignal]:
    """Return the residuals of the forward accelerometer (g = 1) or of the sideways one (g = ω) in each run, clipped,
    with the predictions that describe the effect of the commands. The errors of the fit contain this effect:

        a, ω, ω², ω̇                         errors of the sensor's scales, axes and place                     (7)
        a_x(t − τ), |ω| a_x, ω ω̇, ω̇ sgn ω   ė of a motor's lag, and of e proportional to |ω| ν_x, ω², |ω|
        ω a_x(t − τ), |ω| a_y, ω³, ω |ω|     ω e of the same errors; also |ω| sgn a_y, of a wrong dead zone
    """
    ahead, signals = forward_accelerometer(ekf, inertial), []
    channel = ahead if forward else sideways_accelerometer(ekf, inertial)
    if channel is None or ahead is None:
        return []
    name, entry, slope = channel
    yaw = int(np.argmax(np.abs(measurement_jacobian(getattr(ekf.sensors, name), np.zeros(9))[:, 3 + YAW])))
    for channels in fit.channels_by_run:
        h = {c.entry: c.predictions for c in channels if c.sensor == name}
        for c in (c for c in channels if (c.sensor, c.entry) == (name, entry)):
            t_s, zeros, a = c.t_s, np.zeros(len(c.t_s)), h[entry] / slope
            w, a_x = h.get(yaw, zeros), h.get(ahead[1], zeros)
            g, w_dot = zeros + 1.0 if forward else w, np.gradient(w)
            X = [np.abs(w) * a_x, w * w_dot, np.sign(w) * w_dot]
            if not forward:
                X = [np.abs(w) * a, w**3, w * np.abs(w), np.abs(w) * np.sign(a)]
            X += [g * np.interp(t_s - late_s, t_s, a_x) for late_s in MOTOR_LAGS_S]
            r = np.clip(c.residuals, -CLIP_SIGMA * c.sigma, CLIP_SIGMA * c.sigma) / slope
            X = [*h.values(), *X, zeros + 1.0, w**2, w_dot]
            signals.append(RegressionSignal(r, g, np.stack(X, axis=1)))
    return signals


def accelerometer_share(ekf: AugmentedEkf, fit: "Fit", inertial: set[str]) -> float:
    """Return the upper end of the 95 % interval of φ over all runs, in [MIN_SHARE, 1], or 1 with too few data.  (2)"""
    readings = velocity_readings(ekf.sensors, layout(ekf).names)
    wheels = next((r for r in readings if FORWARD in r.entries and r.name not in inertial), None)
    ahead = forward_accelerometer(ekf, inertial)
    if ahead is None or wheels is None:
        return 1.0
    weights = [(wheels.name, k, wheels.inverse[FORWARD, j]) for j, k in enumerate(wheels.rows)]
    series = _residual_series(fit, [weights, [(*ahead[:2], 1.0 / ahead[2])]])
    sums = np.concatenate([np.zeros((0, 2)), *(block_sums(*x) for x in series)])
    if len(sums) < MIN_BLOCKS or not np.sum(sums[:, 1]) > 0.0:
        return 1.0
    draws = np.random.default_rng(0).integers(0, len(sums), (DRAWS, len(sums)))
    products, squares = np.moveaxis(sums[draws].sum(axis=1), 1, 0)
    share = np.where(squares > 0.0, products / np.where(squares > 0.0, squares, 1.0), 1.0)
    return float(np.clip(np.quantile(share, UPPER_QUANTILE), MIN_SHARE, 1.0))


def block_sums(speed: TimeSeries, acceleration: TimeSeries, rate: TimeSeries) -> np.ndarray:
    """Return Σ w A B and Σ w (B² − 6 q/τ²) for each block (K, 2), over all τ; `rate` is the yaw rate.  (1), (2)"""
    begin, end = (
        cut(reading.t_s[k] for reading in (speed, acceleration, rate)) for cut, k in ((max, 0), (min, -1))
    )
    velocity, psi = acceleration.integral(), rate.integral()
    regressors = [TimeSeries(psi.t_s, np.cos(psi.x)), TimeSeries(psi.t_s, np.sin(psi.x))]
    regressors += [series.integral() for series in regressors]
    white_variance = white_std([speed.x]) ** 2
    min_window_s = MIN_WINDOW_SAMPLES * float(np.median(np.diff(speed.t_s)))
    sums = np.zeros((int((end - begin) / BLOCK_S), 2))
    for tau in (window_s for window_s in WINDOWS_S if len(sums) and window_s >= min_window_s):
        t_s = np.arange(begin, end, 0.5 * tau)
        A, B, *nuisances = (
            (x[4:] - 2.0 * x[2:-2] + x[:-4]) / tau
            for x in (signal.interpolate(t_s) for signal in (velocity, speed, *regressors))
        )
        X = np.stack(nuisances, axis=1)
        B = B - X @ np.linalg.lstsq(X, B, rcond=None)[0]
        block = np.minimum(((t_s[2:-2] - begin) / BLOCK_S).astype(int), len(sums) - 1)
        terms = np.stack([A * B, B**2 - 6.0 * white_variance / tau**2]) / np.mean(A**2)
        sums += np.stack([np.bincount(block, x, len(sums)) for x in terms], axis=1)
    return sums


def _residual_series(
    fit: "Fit", signals: Sequence[Sequence[tuple[str, int, float]]]
) -> Iterator[list[TimeSeries]]:
    """Yield for each run the weighted sums of residuals `signals` (sensor, entry, weight), and the gyro's yaw rate."""
    gyro = next((reading for reading in velocity_readings(fit.vehicle_file.sensors) if reading.is_gyro), None)
    if gyro is None:
        return
    for channels in fit.channels_by_run:
        channel_map, turn = {(c.sensor, c.entry): c for c in channels}, [(gyro.name, k) for k in gyro.rows]
        if not {*turn, *((name, k) for signal in signals for name, k, _ in signal)} <= channel_map.keys():
            continue
        z = np.stack([channel_map[key].measurements for key in turn], axis=1) - gyro.at_rest
        sums = [np.sum([w * channel_map[n, k].residuals for n, k, w in signal], axis=0) for signal in signals]
        times = [channel_map[key].t_s for key in (*(signal[0][:2] for signal in signals), turn[0])]
        pairs = zip(times, [*sums, z @ gyro.inverse[YAW]], strict=True)
        series = [TimeSeries(t_s[np.isfinite(x)], x[np.isfinite(x)]) for t_s, x in pairs]
        if min(len(signal.t_s) for signal in series) >= 2 * MIN_WINDOW_SAMPLES:
            yield series


def with_speed_error(ekf: AugmentedEkf, fit: "Fit", runs: Sequence[Run]) -> AugmentedEkf:
    """Return the filter with the lasting error of the speed of a model with free parameters, unless it is measured.

        ∂|ν_x|/∂θ ≈ a |ν_x| + b + d ω sgn ν_x,   a, b, d (p,) by least squares, forward and backward apart    (3)
        C = Σ_i w_i [a b d]ᵢᵀ P [a b d]ᵢ + diag(σ_s², 0, 0),   w_i the share of the direction i in the rows
        var ν_x = C_aa ν_x² + 2 C_ab |ν_x| + C_bb + C_dd ω² = σ₀² + σ₁² (|ν_x| − v₀)² + σ_y² ω²               (4)
        c = Σ_i w_i a_iᵀ ∂θ/∂κ_ψ

    P is the covariance of the parameters of the model, without shifts by effects that it lacks. C gains the ellipsoid
    that encloses the change of |ν_x| by each effect and its shift, which cancel for the most part. σ_s is the relative
    error of the speed by the scales of the accelerometers, 0 if P contains it. κ_ψ is the error of the gyro's scale: if
    it reads too much, the speed is too low, because the fit compares ν_x ω with a_y. σ_y is a lateral error of the
    centre of the turns. A factor of C_aa, C_ab, C_bb restores the variance beside that of a |ν_x| + b.
    """
    entries = [k for k, n in enumerate(fit.names) if n.startswith("model.") and np.isfinite(fit.std[k])]
    if layout(ekf).speed_is_measured or not entries:
        return ekf
    paths, P = tuple(fit.names[k] for k in entries), fit.cov[np.ix_(entries, entries)]
    P = P - bool(len(fit.unmodelled_shifts)) * fit.unmodelled_cov[np.ix_(entries, entries)]
    kernel, theta = open_loop(fit.blocks.model, paths, lambda motion: motion.nu[::2], fit.backend)
    outputs = [kernel.sensitivities(motion_rows(make_record(run, {})), theta) for run in runs]
    nu, derivatives = (np.concatenate(columns) for columns in zip(*outputs, strict=True))
    C, c, modelled_sum, total, unmodelled_cov = np.zeros((3, 3)), 0.0, 0.0, 0.0, np.zeros((3, 3))
    gyro_shift, shifts = fit.fixed.gyro_shift(), fit.unmodelled_shifts[:, entries]
    for k, (weight, X, D, B) in enumerate(lines_by_sign(nu, derivatives[:, 0], MIN_SPEED_M_S)):
        C += weight * (B @ P @ B.T)
        c -= weight * float(B[0] @ gyro_shift[entries])
        modelled_sum += np.einsum("ni,ij,nj->", X[:, :2] @ B[:2], P, X[:, :2] @ B[:2])
        total += np.einsum("ni,ij,nj->", D, P, D)
        unmodelled_cov += weight * enclosing_cov(shifts @ B.T + fit.unmodelled_speeds[:, k])
    C[:2, :2] *= total / modelled_sum if modelled_sum > 0.0 else 1.0
    C += unmodelled_cov
    if any(message.code == SCALES_INCLUDED for message in fit.always_unobservable):
        c = 0.0
    else:
        speed_var, gyro_var = start_std(replace(ekf, speed_error_std=np.zeros(2)))[SCALES] ** 2
        C[0, 0] += speed_var if c == 0.0 else max(speed_var - gyro_var, 0.0)
    least_error_speed = float(np.clip(-C[0, 1] / C[0, 0], -100.0, 100.0)) if C[0, 0] > 0.0 else 0.0
    std = np.sqrt(np.maximum([C[1, 1] + least_error_speed * C[0, 1], C[0, 0]], 0.0))  # C_bb − C_ab²/C_aa
    if not (np.isfinite(std).all() and abs(c) < MAX_SPEED_PER_GYRO_SCALE):
        return ekf
    ekf = replace(ekf, speed_error_std=std, least_error_speed_m_s=least_error_speed, speed_per_gyro_scale=c)
    return replace(ekf, lateral_offset_std_m=float(np.sqrt(C[2, 2])))


def with_slope(ekf: AugmentedEkf, fit: "Fit", inertial: set[str], decay_rate: float) -> AugmentedEkf:
    """Return the filter with σ_φ of a sloping floor (numerics/floor_push.py), unless a sensor measures the speed.
    A fit can exchange the lag of the motors and 1/λ. So the smaller rate counts, which states the larger error."""
    axes = [a for a in (forward_accelerometer(ekf, inertial), sideways_accelerometer(ekf, inertial)) if a]
    if layout(ekf).speed_is_measured or len(axes) < 2 or not decay_rate > 0.0:
        return ekf
    runs = [
        AccelerometerResiduals.at_times(ahead.t_s, ahead, left, rate)
        for ahead, left, rate in _residual_series(fit, [[(*axis[:2], 1.0 / axis[2])] for axis in axes])
    ]
    lag_s = float(np.max(ekf.vehicle.drivetrain.lag_s))
    amplitude = slope_speed_error(runs, min(decay_rate, 1.0 / max(lag_s, 1e-9)))
    return replace(ekf, slope_speed_std_m_s=amplitude / np.sqrt(2.0))


def with_truth_misfit(ekf: AugmentedEkf, fit: "Fit", runs: Sequence[Run]) -> AugmentedEkf:
    """Return the filter of a kinematic model with σ_d and T of the speed, or unchanged without a truth in the runs.

        e(t) = ν_x(t) − ν̂_x(t),   ν_x by the truth of a run, ν̂_x by the fitted model                       (5)
        (σ_d, T) = arg min Σ_τ (c(τ) − σ_d² e^(−τ/T))²,   c the autocovariance of e                        (6)

    The disturbance of a kinematic model is a velocity, so it has the statistics of e. No reading on board shows
    them. The lags begin beyond the window over which a speed is computed from positions.
    """
    lags = np.arange(round(TRUTH_LAGS_S[0] * ekf.rate_hz), round(TRUTH_LAGS_S[1] * ekf.rate_hz) + 1)
    errors = [_speed_errors(fit, run, k, 1.0 / ekf.rate_hz) for k, run in enumerate(runs)]
    products, count = lag_sums(errors, lags)
    is_sufficient = count > MIN_PAIRS
    if not is_sufficient.any():
        return ekf
    c, tau_s = products[is_sufficient] / count[is_sufficient], lags[is_sufficient] / ekf.rate_hz
    fades_s = np.geomspace(MIN_FADE_S, MAX_FADE_S, 60)
    shapes = np.exp(-tau_s / fades_s[:, None])
    variances = np.maximum(shapes @ c / np.sum(shapes**2, axis=1), MIN_STD_M_S**2)
    best = int(np.argmin(np.sum((c - variances[:, None] * shapes) ** 2, axis=1)))
    ekf = with_value(ekf, "disturbance_std[0]", float(np.sqrt(variances[best])))
    return with_value(ekf, "disturbance_fade_s[0]", float(fades_s[best]))


def _speed_errors(fit: "Fit", run: Run, number: int, step_s: float) -> np.ndarray:
    """Return e (N,) [m/s] of a run at even steps, NaN without a truth.  (5) `number` is the index of the run."""
    if run.truth is None or not len(run.truth.t_ns):
        return np.zeros(0)
    clock, late_s = f"clock.{TRUTH}", 0.0
    if clock in fit.run_entry_names:
        late_s = float(fit.run_entries[number, fit.run_entry_names.index(clock)])
    record = make_record(run, {})
    kernel, theta = open_loop(fit.blocks.model, (), lambda motion: motion.nu[:1], fit.backend)
    speed = np.asarray(kernel.run(motion_rows(record), theta)[1])[:, FORWARD]
    t_s = np.arange(0.0, record.t_s[-1], step_s)
    t_ns = run.t_ns[0] + np.rint((t_s - late_s) * NANOSECONDS).astype(np.int64)
    return true_speed(t_ns, run.truth) - np.interp(t_s, record.t_s, speed)
