"""Estimate the disturbance of a kinematic model from the true speed, if only the model gives the speed of the filter.

    e(t) = ν_x(t) − ν̂_x(t),   ν_x by the truth of a run, ν̂_x by the fitted model                           (1)
    (σ_d, T) = arg min Σ_τ (c(τ) − σ_d² e^(−τ/T))²,   c the autocovariance of e                            (2)

The disturbance of a kinematic model is a velocity, so its statistics are those of e. No reading on board shows them.
The lags begin beyond the window over which a speed is computed from positions.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.identify.data.added_channels import TRUTH
from baqueano.identify.data.record import record_of
from baqueano.identify.residuals.motion import motion_rows, open_loop
from baqueano.numerics.autocorrelation import fourier_length, lag_products
from baqueano.runs.interpolation import HALF_WINDOW_S, true_speed
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS
from baqueano.symbolic import with_value

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit

MIN_FADE_S, MAX_FADE_S = 0.3, 30.0  # of T; faster changes belong to the walk of ν
MIN_STD_M_S = 1e-4
LAGS_S, MIN_PAIRS = (2.0 * HALF_WINDOW_S, 10.0), 100
FORWARD = 0  # entry of ν


def with_misfit_from_truth(ekf: AugmentedEkf, fit: "Fit", runs: Sequence[Run]) -> AugmentedEkf:
    """Return the filter with σ_d and T of the speed, or unchanged without a truth in the runs.  (2)"""
    lags = np.arange(round(LAGS_S[0] * ekf.rate_hz), round(LAGS_S[1] * ekf.rate_hz) + 1)
    products, count = np.zeros(len(lags)), np.zeros(len(lags))
    for k, run in enumerate(runs):
        e = _speed_errors(fit, run, k, 1.0 / ekf.rate_hz)
        has, within, length = np.isfinite(e), lags[lags < len(e)], fourier_length(len(e))
        if len(within):
            products[: len(within)] += lag_products(np.where(has, e, 0.0), length)[within]
            count[: len(within)] += lag_products(has.astype(float), length)[within]
    enough = count > MIN_PAIRS
    if not enough.any():
        return ekf
    c, tau_s = products[enough] / count[enough], lags[enough] / ekf.rate_hz
    fades_s = np.geomspace(MIN_FADE_S, MAX_FADE_S, 60)
    shapes = np.exp(-tau_s / fades_s[:, None])
    variances = np.maximum(shapes @ c / np.sum(shapes**2, axis=1), MIN_STD_M_S**2)
    best = int(np.argmin(np.sum((c - variances[:, None] * shapes) ** 2, axis=1)))
    ekf = with_value(ekf, "disturbance_std[0]", float(np.sqrt(variances[best])))
    return with_value(ekf, "disturbance_fade_s[0]", float(fades_s[best]))


def _speed_errors(fit: "Fit", run: Run, number: int, step_s: float) -> np.ndarray:
    """Return e (N,) [m/s] of a run at even steps, NaN without a truth.  (1) `number` is the index of the run."""
    if run.truth is None or not len(run.truth.t_ns):
        return np.zeros(0)
    clock, late_s = f"clock.{TRUTH}", 0.0
    if clock in fit.run_entry_names:
        late_s = float(fit.run_entries[number, fit.run_entry_names.index(clock)])
    record = record_of(run, {})
    kernel, theta = open_loop(fit.blocks.model, (), lambda motion: motion.nu[:1], fit.backend)
    speed = np.asarray(kernel.run(motion_rows(record), theta)[1])[:, FORWARD]
    t_s = np.arange(0.0, record.t_s[-1], step_s)
    t_ns = run.t_ns[0] + np.rint((t_s - late_s) * NANOSECONDS).astype(np.int64)
    return true_speed(t_ns, run.truth) - np.interp(t_s, record.t_s, speed)
