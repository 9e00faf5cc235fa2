"""The initial pose of a replay, as the run gives it.

A run of ours tells its start. In somebody else's recording it is read off the truth: the pose between two of
its samples, and, where the truth lacks velocities (a camera),

    ν = J(ψ)ᵀ (η(t₀ + T) − η(t₀)) / T,   ψ in the middle                                                  (1)
    ν = 0  where  |ν_i(t₀)| < 0.1 max |ν_i| until t₀ + T  on every axis that moves                         (2)

A motion that begins with the first command is a start from rest (2): estimators take whoever moves for one whose motors
have had that command for long.
"""

import numpy as np

from baqueano.geometry import map_from_body, wrap
from baqueano.runs.run import Run, TruthLog
from baqueano.signals import NANOSECONDS

SPAN_S = 0.2  # T: a camera that is off by 1 mm tells the speed to 1 cm/s
STARTING = 0.1  # of its speed after T: a vehicle that has less has just been started
FAR_S = 0.5  # a truth that begins later does not tell the start


def initial_pose(run: Run) -> np.ndarray:
    """(3,) pose, or (6,) pose and velocity, at the first tick; zeros where the run does not tell it."""
    if "start" in run.metadata:
        return np.array([float(x) for x in run.metadata["start"].split()])
    truth = None if run.truth is None else _with_pose(run.truth)
    if truth is None or not len(run.t_ns) or len(truth.t_ns) < 2:
        return np.zeros(3)
    first = int(max(run.t_ns[0], truth.t_ns[0]))
    if first - run.t_ns[0] > FAR_S * NANOSECONDS:
        return np.zeros(3)
    eta = _pose(first, truth)
    if np.isfinite(truth.nu).all():
        nu = _at(first, truth.t_ns, truth.nu)
        soon = truth.nu[(truth.t_ns >= first) & (truth.t_ns <= first + SPAN_S * NANOSECONDS)]
        starts = np.abs(nu) < STARTING * np.max(np.abs(soon), axis=0, initial=0.0)
        return np.concatenate([eta, np.where(np.all(starts | (nu == 0.0)), 0.0, nu)])  # (2)
    later = int(min(first + SPAN_S * NANOSECONDS, truth.t_ns[-1]))
    shift = _pose(later, truth) - eta
    shift[2] = wrap(shift[2])
    nu = map_from_body(eta[2] + 0.5 * shift[2]).T @ shift * (NANOSECONDS / max(later - first, 1))  # (1)
    return np.concatenate([eta, nu])


def _with_pose(truth: TruthLog) -> TruthLog:
    """Return the truth without the rows that lack a pose."""
    keep = np.isfinite(truth.eta).all(axis=1)
    return TruthLog(*(column[keep] for column in truth))


def _pose(t_ns: int, truth: TruthLog) -> np.ndarray:
    """η (3,) at one time, between two samples."""
    smooth = truth.eta.copy()
    smooth[:, 2] = np.unwrap(smooth[:, 2])
    x, y, psi = _at(t_ns, truth.t_ns, smooth)
    return np.array([x, y, wrap(psi)])


def _at(t_ns: int, of_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Rows (K, 3) at one time, (3,)."""
    since = of_ns - of_ns[0]  # small enough for a float to hold it exactly
    return np.array([np.interp(t_ns - of_ns[0], since, column) for column in rows.T])
