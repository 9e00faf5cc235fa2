"""Find the time at which an estimate diverges, and the ticks at which its covariance is not valid.

diverged   |p − p*| > FAR · max(1 m, size of the true path),  or without a truth  |p − p₀| > FASTEST_M_S (t + 1 s)  (1)
a valid covariance P has eigenvalues λ ≥ −ROUNDING max |λ|                                                          (2)

p is the estimated position at the time t, p₀ the first one, p* the true position, moved so that both paths begin at p₀.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.runs.interpolated import poses_at
from baqueano.runs.run import Run
from baqueano.signals import seconds

FAR = 5.0  # sizes of the true path
FASTEST_M_S = 100.0
ROUNDING = 1e-9  # of the largest eigenvalue


class NoCovariance(NamedTuple):
    """The ticks of a run at which the covariance is not valid."""

    ticks: int
    of: int
    from_s: float  # time of the first of them


def diverged_s(run: Run) -> float:
    """Return the time from the beginning of a run until its estimate diverged [s]; NaN without divergence.  (1)"""
    log = run.estimate
    if log is None or not len(log.t_ns):
        return float("nan")
    t_s = seconds(log.t_ns, run.t_ns[0])
    p, limit = log.eta[:, :2], FASTEST_M_S * (t_s + 1.0)
    off = np.hypot(*(p - p[0]).T)
    if run.truth is not None and len(run.truth.t_ns) > 1:
        true = poses_at(log.t_ns, run.truth.t_ns, run.truth.eta)[:, :2]
        finite = true[np.isfinite(true).all(axis=1)]
        if len(finite):
            size = float(np.hypot(*np.ptp(finite, axis=0)))
            aside = np.hypot(*(p - true - (p[0] - finite[0])).T)  # the map of a recording begins elsewhere
            off, limit = np.where(np.isfinite(aside), aside, off), FAR * max(1.0, size) * np.ones(len(t_s))
    is_lost = ~(off <= limit)  # NaN is lost too
    return float(t_s[np.argmax(is_lost)]) if is_lost.any() else float("nan")


def until_diverged(run: Run) -> Run:
    """Return the run with its estimate cut at the time of divergence."""
    log, at_s = run.estimate, diverged_s(run)
    if log is None or not at_s > 0.0:
        return run
    keep = seconds(log.t_ns, run.t_ns[0]) < at_s
    return replace(run, estimate=log._make(None if x is None else x[keep] for x in log))


def no_covariance(run: Run) -> NoCovariance | None:
    """Return the ticks at which the covariance of (η, ν) is not positive semidefinite; None if it always is.  (2)"""
    log = run.estimate
    if log is None or not len(log.t_ns):
        return None
    finite = np.asarray(np.isfinite(log.cov).all(axis=(1, 2)))
    values = np.linalg.eigvalsh(np.where(finite[:, None, None], log.cov, 0.0))
    wrong = np.logical_not(finite) | (values[:, 0] < -ROUNDING * np.abs(values).max(axis=1))
    if not wrong.any():
        return None
    return NoCovariance(int(wrong.sum()), len(wrong), float(seconds(log.t_ns, run.t_ns[0])[np.argmax(wrong)]))
