"""Estimate which part of the error of the wheels the accelerometer also measures; the remainder is slip of the wheels.

In the innovations of the wheels, slip and an unmodelled force look alike. A filter that treats slip as a force
follows the slip. The forward accelerometer separates them. With the residuals r_v of the wheels' speed and r_a of the
accelerometer, over two consecutive windows of τ,

    B = (r_v(t + τ) − 2 r_v(t) + r_v(t − τ))/τ,   A = (∫ r_a from t to t + τ − ∫ r_a from t − τ to t)/τ   (1)
    φ = Σ w A B / Σ w (B² − 6 q/τ²),   q the variance of white noise in r_v, w = 1/mean A² of each τ     (2)

φ is 1 if the accelerometer measures the whole error, 0 if only the wheels do; its noise does not change the mean. An
accelerometer does not measure the push of a sloping floor. That push depends on the heading, so the part of B that cos
ψ, sin ψ and their integrals explain is removed. The upper end of the 95 % interval of φ is used, from blocks drawn with
replacement. So an error stays unless it is clearly contradicted.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.estimators.augmented.state import layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.sensor_numbers import measurement_jacobian
from baqueano.estimators.readings.velocity_readings import velocity_readings
from baqueano.numerics.statistics import white_std

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

WINDOWS_S = (0.4, 0.8, 1.6)  # τ: longer than the delay of wheels, shorter than changes of a bias
MIN_WINDOW_SAMPLES = 4  # of the wheels in a window, at least
BLOCK_S, MIN_BLOCKS, DRAWS = 2.0, 8, 1000  # length of a block, least number of blocks, draws
UPPER_QUANTILE, MIN_SHARE = 0.975, 1e-3  # quantile of φ; least φ, so that a filter can still follow a misfit
FORWARD, YAW, FORWARD_DOT = 0, 2, 6  # of ν; of (η, ν, ν̇)


class TimeSeries(NamedTuple):
    """A quantity of one run over time."""

    t_s: np.ndarray  # (N,)
    x: np.ndarray  # (N,)

    def interpolate(self, t_s: np.ndarray) -> np.ndarray:
        """Return the quantity at the times `t_s` (K,), by linear interpolation."""
        return np.interp(t_s, *self)

    def integral(self) -> "TimeSeries":
        """Return the integral from the first time on."""
        steps = 0.5 * (self.x[1:] + self.x[:-1]) * np.diff(self.t_s)
        return TimeSeries(self.t_s, np.concatenate([[0.0], np.cumsum(steps)]))


def forward_accelerometer(ekf: AugmentedEkf, inertial: set[str]) -> tuple[str, int, float] | None:
    """Return sensor, entry and derivative of the inertial reading that depends most on ν̇_x, or None."""
    readings = [
        (name, i, float(slope[FORWARD_DOT]))
        for name in sorted(inertial)
        for i, slope in enumerate(measurement_jacobian(getattr(ekf.sensors, name)))
    ]
    strongest = max(readings, key=lambda reading: abs(reading[2]), default=None)
    return strongest if strongest and strongest[2] != 0.0 else None


def accelerometer_share(ekf: AugmentedEkf, fit: "Fit", inertial: set[str]) -> float:
    """Return the upper end of the 95 % interval of φ over all runs, in [MIN_SHARE, 1], or 1 with too few data.  (2)"""
    sums = np.concatenate([np.zeros((0, 2)), *(block_sums(*each) for each in _series(ekf, fit, inertial))])
    if len(sums) < MIN_BLOCKS or not np.sum(sums[:, 1]) > 0.0:
        return 1.0
    pick = np.random.default_rng(0).integers(0, len(sums), (DRAWS, len(sums)))
    products, by_wheels = np.moveaxis(sums[pick].sum(axis=1), 1, 0)
    share = np.where(by_wheels > 0.0, products / np.where(by_wheels > 0.0, by_wheels, 1.0), 1.0)
    return float(np.clip(np.quantile(share, UPPER_QUANTILE), MIN_SHARE, 1.0))


def block_sums(speed: TimeSeries, acceleration: TimeSeries, rate: TimeSeries) -> np.ndarray:
    """Return Σ w A B and Σ w (B² − 6 q/τ²) for each block (K, 2), over all τ; `rate` is the yaw rate.  (1), (2)"""
    begin, end = (
        cut(each.t_s[k] for each in (speed, acceleration, rate)) for cut, k in ((max, 0), (min, -1))
    )
    velocity, psi = acceleration.integral(), rate.integral()
    regressors = [TimeSeries(psi.t_s, np.cos(psi.x)), TimeSeries(psi.t_s, np.sin(psi.x))]
    regressors += [series.integral() for series in regressors]
    white_variance = white_std([speed.x]) ** 2
    min_window_s = MIN_WINDOW_SAMPLES * float(np.median(np.diff(speed.t_s)))
    sums = np.zeros((int((end - begin) / BLOCK_S), 2))
    for tau in (window_s for window_s in WINDOWS_S if len(sums) and window_s >= min_window_s):
        t_s = np.arange(begin, end, 0.5 * tau)
        A, B, *of_floor = (
            (x[4:] - 2.0 * x[2:-2] + x[:-4]) / tau
            for x in (signal.interpolate(t_s) for signal in (velocity, speed, *regressors))
        )
        X = np.stack(of_floor, axis=1)
        B = B - X @ np.linalg.lstsq(X, B, rcond=None)[0]
        block = np.minimum(((t_s[2:-2] - begin) / BLOCK_S).astype(int), len(sums) - 1)
        each = np.stack([A * B, B**2 - 6.0 * white_variance / tau**2]) / np.mean(A**2)
        sums += np.stack([np.bincount(block, x, len(sums)) for x in each], axis=1)
    return sums


def _series(
    ekf: AugmentedEkf, fit: "Fit", inertial: set[str]
) -> Iterator[tuple[TimeSeries, TimeSeries, TimeSeries]]:
    """Yield for each run the residuals of the wheels' speed and of the forward accelerometer, and the gyro's yaw
    rate."""
    accelerometer = forward_accelerometer(ekf, inertial)
    readings = velocity_readings(ekf.sensors, layout(ekf).names)
    wheels = next(
        (reading for reading in readings if FORWARD in reading.entries and reading.name not in inertial), None
    )
    gyro = next((reading for reading in readings if reading.is_gyro), None)
    if accelerometer is None or wheels is None or gyro is None:
        return
    for channels in fit.channels_by_run:
        channel_of = {(c.sensor, c.entry): c for c in channels}
        if (
            not {accelerometer[:2], *((reading.name, k) for reading in (wheels, gyro) for k in reading.rows)}
            <= channel_of.keys()
        ):
            continue
        acceleration, slope = channel_of[accelerometer[:2]], accelerometer[2]
        of_gyro, of_wheels = ([channel_of[one.name, k] for k in one.rows] for one in (gyro, wheels))
        z = np.stack([c.measurements for c in of_gyro], axis=1) - gyro.at_rest
        r = np.stack([c.measurements - c.predictions for c in of_wheels], axis=1)
        pairs = (
            (of_wheels[0].t_s, r @ wheels.inverse[FORWARD]),
            (acceleration.t_s, (acceleration.measurements - acceleration.predictions) / slope),
            (of_gyro[0].t_s, z @ gyro.inverse[YAW]),
        )
        series = [TimeSeries(t_s[np.isfinite(x)], x[np.isfinite(x)]) for t_s, x in pairs]
        if min(len(signal.t_s) for signal in series) >= 2 * MIN_WINDOW_SAMPLES:
            yield series[0], series[1], series[2]
