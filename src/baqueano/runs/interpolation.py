"""Interpolate a log between its samples, with NaN in gaps, or average it over windows.

The speed is ν_x. If the truth is without velocities, a parabola is fitted to its positions within ± h, at least
± HALF_WINDOW_STEPS. The speed is then the parabola's slope along the heading. Positions with the white noise σ at
intervals δ give it the variance (1). A fine camera needs only a short window, which follows the start of a motion.

    σ_v² = 3 σ² δ / (2 h³),   h = (3 σ² δ / (2 SPEED_STD²))^(1/3) ≤ HALF_WINDOW_S                         (1)
"""

from typing import NamedTuple

import numpy as np

from baqueano.geometry import wrap
from baqueano.numerics.statistics import white_std
from baqueano.runs.run import Channel, TruthLog
from baqueano.signals import NANOSECONDS, seconds

MAX_GAP_S = 0.5  # longest gap that is interpolated
SPEED_STD = 0.005  # m/s, σ_v
HALF_WINDOW_S, HALF_WINDOW_STEPS, MAX_HALF_WINDOW_S = 0.15, 3.0, 0.6  # of the parabola


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

    def integral_until(self, t_s: np.ndarray) -> np.ndarray:
        """Return the integral (K,) from the first time to the times `t_s` (K,), for a quantity linear between samples.

        >>> TimeSeries(np.array([0.0, 2.0]), np.array([0.0, 4.0])).integral_until(np.array([1.0, 2.0])).tolist()
        [1.0, 4.0]
        """
        k = np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 2)
        h = t_s - self.t_s[k]
        slope = (self.x[k + 1] - self.x[k]) / (self.t_s[k + 1] - self.t_s[k])
        return self.integral().x[k] + h * (self.x[k] + 0.5 * h * slope)


def interpolate_rows(t_ns: np.ndarray, sample_ns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return `rows` (K, m), sampled at `sample_ns` (K,), interpolated at `t_ns` (N,): (N, m).

    The result is NaN before the first sample, after the last sample, and in gaps longer than MAX_GAP_S.
    """
    if not len(sample_ns):
        return np.full((len(t_ns), rows.shape[1]), np.nan)
    values = np.column_stack([np.interp(t_ns, sample_ns, column, np.nan, np.nan) for column in rows.T])
    next_rows = np.clip(np.searchsorted(sample_ns, t_ns, side="left"), 1, max(len(sample_ns) - 1, 1))
    is_exact = np.isin(t_ns, sample_ns)
    is_in_gap = (
        sample_ns[np.minimum(next_rows, len(sample_ns) - 1)] - sample_ns[next_rows - 1]
    ) / NANOSECONDS > MAX_GAP_S
    values[is_in_gap & ~is_exact] = np.nan
    return values


def interpolate_poses(t_ns: np.ndarray, sample_ns: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Return poses (K, 3) interpolated at other times: (N, 3). The heading takes the shorter direction across ±π."""
    unwrapped_eta = eta.copy()
    is_known = np.isfinite(unwrapped_eta[:, 2])
    unwrapped_eta[is_known, 2] = np.unwrap(unwrapped_eta[is_known, 2])
    poses = interpolate_rows(t_ns, sample_ns, unwrapped_eta)
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def true_speed(t_ns: np.ndarray, truth: TruthLog) -> np.ndarray:
    """Return ν_x (N,) [m/s] of the truth, from its positions if it lacks velocities; NaN if it is not known."""
    if np.isfinite(truth.nu[:, 0]).any():
        return interpolate_rows(t_ns, truth.t_ns, truth.nu)[:, 0]
    eta = truth.eta[has_pose := np.isfinite(truth.eta).all(axis=1)]
    sample_ns, speeds = truth.t_ns[has_pose], np.full(len(t_ns), np.nan)
    since_s = seconds(sample_ns, t_ns[0])
    step_s = float(np.median(np.diff(since_s))) if len(since_s) > 1 else 0.0
    sigma_m = max(white_std([x]) for x in eta[:, :2].T)
    half_s = min((1.5 * sigma_m**2 * step_s / SPEED_STD**2) ** (1.0 / 3.0), HALF_WINDOW_S)  # (1)
    half_s = min(max(half_s, HALF_WINDOW_STEPS * step_s), MAX_HALF_WINDOW_S)
    for i, t_s in enumerate(seconds(t_ns, t_ns[0])):
        a, b = np.searchsorted(since_s, [t_s - half_s, t_s + half_s])
        near_s = since_s[a:b] - t_s
        if len(near_s) >= 5 and near_s[0] < -0.5 * half_s and near_s[-1] > 0.5 * half_s:
            velocity = np.linalg.lstsq(np.vander(near_s, 3), eta[a:b, :2], rcond=None)[0][1]
            psi = eta[a + int(np.argmin(np.abs(near_s))), 2]
            speeds[i] = velocity @ [np.cos(psi), np.sin(psi)]
    return speeds


def window_means(channel: Channel, origin_ns: int, width_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (W,) of the windows that contain rows, counted from `origin_ns`, and their means (W, m).
    A mean includes only finite entries; it is NaN without a finite entry.
    """
    window_numbers = ((channel.t_ns - origin_ns) / NANOSECONDS / width_s).astype(np.int64)
    windows, row = np.unique(window_numbers, return_inverse=True)
    is_known = np.isfinite(channel.z)
    sums, counts = np.zeros((len(windows), channel.z.shape[1])), np.zeros((len(windows), channel.z.shape[1]))
    np.add.at(sums, row, np.where(is_known, channel.z, 0.0))
    np.add.at(counts, row, is_known)
    return windows, np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan)
