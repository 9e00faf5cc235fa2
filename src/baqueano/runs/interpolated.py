"""Interpolate a log between its samples; in a gap the result is NaN.

Speed is ν_x. If the truth is without velocities, a parabola is fitted to its positions within ± HALF_S. The speed is
then the parabola's slope along the heading.
"""

import numpy as np

from baqueano.geometry import wrap
from baqueano.runs.run import TruthLog
from baqueano.signals import NANOSECONDS, seconds

LONGEST_GAP_S = 0.5  # longest gap that is interpolated
HALF_S = 0.15  # of the parabola


def at_times(t_ns: np.ndarray, of_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return `rows` (K, m), sampled at `of_ns` (K,), interpolated at `t_ns` (N,): (N, m).

    The result is NaN before the first sample, after the last one, and in gaps longer than LONGEST_GAP_S.
    """
    out = np.column_stack([np.interp(t_ns, of_ns, column, np.nan, np.nan) for column in rows.T])
    after = np.clip(np.searchsorted(of_ns, t_ns, side="left"), 1, max(len(of_ns) - 1, 1))
    exact = np.isin(t_ns, of_ns)
    gap = (of_ns[np.minimum(after, len(of_ns) - 1)] - of_ns[after - 1]) / NANOSECONDS > LONGEST_GAP_S
    out[gap & ~exact] = np.nan
    return out


def poses_at(t_ns: np.ndarray, of_ns: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return poses (K, 3) interpolated at other times: (N, 3). The heading takes the shorter direction across ±π."""
    smooth = eta.copy()
    valid = np.isfinite(smooth[:, 2])
    smooth[valid, 2] = np.unwrap(smooth[valid, 2])
    out = at_times(t_ns, of_ns, smooth)
    out[:, 2] = wrap(out[:, 2])
    return out


def true_speed(t_ns: np.ndarray, truth: TruthLog) -> np.ndarray:
    """Return ν_x (N,) [m/s] of the truth, from its positions if it lacks velocities; NaN if it is not known."""
    if np.isfinite(truth.nu[:, 0]).any():
        return at_times(t_ns, truth.t_ns, truth.nu)[:, 0]
    eta = truth.eta[keep := np.isfinite(truth.eta).all(axis=1)]
    of_ns, out = truth.t_ns[keep], np.full(len(t_ns), np.nan)
    since_s = seconds(of_ns, t_ns[0])
    for i, t_s in enumerate(seconds(t_ns, t_ns[0])):
        a, b = np.searchsorted(since_s, [t_s - HALF_S, t_s + HALF_S])
        near = since_s[a:b] - t_s
        if len(near) >= 5 and near[0] < -0.5 * HALF_S and near[-1] > 0.5 * HALF_S:
            slope = np.linalg.lstsq(np.vander(near, 3), eta[a:b, :2], rcond=None)[0][1]
            psi = eta[a + int(np.argmin(np.abs(near))), 2]
            out[i] = slope @ [np.cos(psi), np.sin(psi)]
    return out
