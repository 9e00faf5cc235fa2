"""Find the time at which an estimate diverges or fails, and the ticks at which its covariance is not valid.

diverged   |p − p*| > MAX_PATH_SIZES · max(1 m, size of the true path),
           or without a truth  |p − p₀| > MAX_SPEED_M_S (t + 1 s)                                                    (1)
a valid covariance P has eigenvalues λ ≥ −ROUNDING_SHARE max |λ|                                                     (2)

p is the estimated position at the time t, p₀ the first one, p* the true position, moved so that both paths begin at p₀.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, StopReason, note
from baqueano.messages.printable import baqueano_command
from baqueano.runs.interpolation import interpolate_poses
from baqueano.runs.run import Run
from baqueano.signals import seconds

MAX_PATH_SIZES = 5.0  # largest error, in sizes of the true path
MAX_SPEED_M_S = 100.0
FAULTS = (StopReason.BLOCK_RAISED, StopReason.BLOCK_RAISED_IN_INIT, StopReason.BLOCK_RETURNED)  # of a block
ROUNDING_SHARE = 1e-9  # fraction of the largest eigenvalue


class InvalidCovariance(NamedTuple):
    """The number of ticks of a run at which the covariance is not valid, and the number of all ticks."""

    ticks: int
    total: int
    start_s: float  # time of the first of these ticks


def divergence_s(run: Run) -> float:
    """Return the time from the beginning of a run until its estimate diverged [s]; NaN without divergence.  (1)"""
    log = run.estimate
    if log is None or not len(log.t_ns):
        return float("nan")
    t_s = seconds(log.t_ns, run.start_ns)
    p, limit = log.eta[:, :2], MAX_SPEED_M_S * (t_s + 1.0)
    distances = np.hypot(*(p - p[0]).T)
    if run.truth is not None and len(run.truth.t_ns) > 1:
        true_xy = interpolate_poses(log.t_ns, run.truth.t_ns, run.truth.eta)[:, :2]
        finite_positions = true_xy[np.isfinite(true_xy).all(axis=1)]
        if len(finite_positions):
            path_size = float(np.hypot(*np.ptp(finite_positions, axis=0)))
            # the map of a recording can have another origin
            errors_m = np.hypot(*(p - true_xy - (p[0] - finite_positions[0])).T)
            distances = np.where(np.isfinite(errors_m), errors_m, distances)
            limit = MAX_PATH_SIZES * max(1.0, path_size) * np.ones(len(t_s))
    is_lost = ~(distances <= limit)  # NaN is also a divergence
    return float(t_s[np.argmax(is_lost)]) if is_lost.any() else float("nan")


def estimator_failure(run: Run, start_ns: int) -> Diagnostic | None:
    """Return the error that ended the estimator of a run, its time after `start_ns`, and the command that tests the
    estimator; None without an error."""
    for event in run.events:
        cause = event.diagnostic
        if cause is not None and cause.code in FAULTS and cause.figures.get("role") == "estimator":
            fix = baqueano_command("blocks", "check", str(cause.figures["kind"]))
            # an error in the rest ends the drive at its start
            t_s = max(0.0, float(seconds(event.t_ns, start_ns)))
            return note("compare.estimator-failed", fix=fix, t_s=t_s, cause=cause)
    return None


def cut_at_divergence(run: Run) -> Run:
    """Return the run with its estimate cut at the time of divergence."""
    log, end_s = run.estimate, divergence_s(run)
    if log is None or not end_s > 0.0:
        return run
    is_valid = seconds(log.t_ns, run.start_ns) < end_s
    return replace(run, estimate=log._make(None if x is None else x[is_valid] for x in log))


def invalid_covariance(run: Run) -> InvalidCovariance | None:
    """Return the ticks at which the covariance of (η, ν) is not positive semidefinite; None if it always is.  (2)"""
    log = run.estimate
    if log is None or not len(log.t_ns):
        return None
    is_finite = np.asarray(np.isfinite(log.cov).all(axis=(1, 2)))
    values = np.linalg.eigvalsh(np.where(is_finite[:, None, None], log.cov, 0.0))
    is_invalid = np.logical_not(is_finite) | (values[:, 0] < -ROUNDING_SHARE * np.abs(values).max(axis=1))
    if not is_invalid.any():
        return None
    return InvalidCovariance(
        int(is_invalid.sum()), len(is_invalid), float(seconds(log.t_ns, run.start_ns)[np.argmax(is_invalid)])
    )
