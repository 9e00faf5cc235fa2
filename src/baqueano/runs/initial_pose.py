"""Find the initial pose of a replay from the run.

A run of baqueano contains its initial pose. For an external recording it is interpolated from the truth. If the truth
is without velocities (a camera), the velocity is

    ν = J(ψ)ᵀ (η(t₀ + T) − η(t₀)) / T,   ψ in the middle                                                  (1)
    ν = 0  if  |ν_i(t₀)| < 0.1 max |ν_i| until t₀ + T  on every axis that moves                            (2)
    ν(t₀ − δ) = ν_1 − (1/2 + 2 δ/T) (ν_2 − ν_1)      of a camera: (1) over both halves of T, tick δ        (3)

(2) treats a motion that begins with the first command as a start from rest. The reason is that an estimator assumes
that the motors of a moving vehicle have had their command for a long time. A camera needs (3) and a share of 0.25.
"""

import numpy as np

from baqueano.geometry import map_from_body, wrap
from baqueano.runs.logs import log_rows
from baqueano.runs.run import Run, TruthLog
from baqueano.signals import NANOSECONDS

START_SPAN_S = 0.2  # T: a camera error of 1 mm gives a speed error of 1 cm/s
START_SPEED_SHARE = 0.1  # of the speed after T: a slower vehicle has just started
CAMERA_SPEED_SHARE = 0.25  # (3) has four times the error of (1)
CAMERA_ERROR = np.array([3e-3, 3e-3, 1e-2])  # m, m, rad: less is not a motion
MAX_LATE_S = 0.5  # a truth that begins later does not contain the start


def initial_pose(run: Run) -> np.ndarray:
    """Return the pose (3,) [m, m, rad], or pose and velocity (6,), at the first tick. Return zeros (3,) if the run does
    not contain them, or if its truth begins more than MAX_LATE_S later.
    """
    if "start" in run.metadata:
        return np.array([float(x) for x in run.metadata["start"].split()])
    truth = None if run.truth is None else log_rows(run.truth, np.isfinite(run.truth.eta).all(axis=1))
    if truth is None or not len(run.t_ns) or len(truth.t_ns) < 2:
        return np.zeros(3)
    first = int(max(run.t_ns[0], truth.t_ns[0]))
    if first - run.t_ns[0] > MAX_LATE_S * NANOSECONDS:
        return np.zeros(3)
    eta = _pose(first, truth)
    if np.isfinite(truth.nu).all():
        nu = _interpolate_instant(first, truth.t_ns, truth.nu)
        first_nu = truth.nu[(truth.t_ns >= first) & (truth.t_ns <= first + START_SPAN_S * NANOSECONDS)]
        is_starting = np.abs(nu) < START_SPEED_SHARE * np.max(np.abs(first_nu), axis=0, initial=0.0)
        return np.concatenate([eta, np.where(np.all(is_starting | (nu == 0.0)), 0.0, nu)])  # (2)
    end_ns = int(min(first + START_SPAN_S * NANOSECONDS, truth.t_ns[-1]))
    middle_ns = (first + end_ns) // 2
    nu_1, nu_2 = _mean_velocity(truth, first, middle_ns), _mean_velocity(truth, middle_ns, end_ns)
    tick_part = float(np.median(np.diff(run.t_ns))) / max(end_ns - first, 1) if len(run.t_ns) > 1 else 0.0
    nu_0 = nu_1 - (0.5 + 2.0 * tick_part) * (nu_2 - nu_1)  # (3)
    is_starting = np.abs(nu_0) < CAMERA_SPEED_SHARE * np.abs(nu_2)
    is_still = (np.abs([nu_1, nu_2]) < CAMERA_ERROR * 2.0 / START_SPAN_S).all(axis=0)
    if np.all(is_starting | is_still):
        return np.concatenate([eta, np.zeros(3)])
    return np.concatenate([eta, _mean_velocity(truth, first, end_ns)])


def _mean_velocity(truth: TruthLog, first_ns: int, end_ns: int) -> np.ndarray:
    """Return the mean velocity ν (3,) of the truth between two times.  (1)"""
    eta = _pose(first_ns, truth)
    shift = _pose(end_ns, truth) - eta
    shift[2] = wrap(shift[2])
    return map_from_body(eta[2] + 0.5 * shift[2]).T @ shift * (NANOSECONDS / max(end_ns - first_ns, 1))


def _pose(t_ns: int, truth: TruthLog) -> np.ndarray:
    """Return the pose η (3,) of the truth at one time, interpolated between two samples."""
    unwrapped_eta = truth.eta.copy()
    unwrapped_eta[:, 2] = np.unwrap(unwrapped_eta[:, 2])
    x, y, psi = _interpolate_instant(t_ns, truth.t_ns, unwrapped_eta)
    return np.array([x, y, wrap(psi)])


def _interpolate_instant(t_ns: int, sample_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return `rows` (K, 3), sampled at the times `sample_ns` (K,), interpolated at one time: (3,)."""
    elapsed_ns = sample_ns - sample_ns[0]  # small enough to be exact as a float
    return np.array([np.interp(t_ns - sample_ns[0], elapsed_ns, column) for column in rows.T])
