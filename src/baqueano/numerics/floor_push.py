"""Estimate the error of a vehicle's speed on a sloping floor from its accelerometers.

    ė = −λ e + g_x,   a_x = −λ e + b_x,   a_y = ω e − g_y + b_y,   (g_x, g_y) = J(ψ)ᵀ g                    (1)
    mean |g|² = mean of ĝ_kᵀ ĝ_{k+1} over neighbouring blocks of BLOCK_S,   |e| ≈ |g|/λ                    (2)

g is the push of the floor, λ the rate at which the speed decays, a are residuals of the accelerometers. They do not
measure the push, but the force of the wheels that balances it. The push is constant in the map, so it follows the
heading ψ, the integral of the yaw rate ω of a gyro. A bias b does not follow it. Each block has its own b and ĝ. The
noise of neighbouring blocks is independent, so it does not change the mean (2). A slow drift of ψ has little effect.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

BLOCK_S, MIN_PAIRS, MIN_SIGMA = 5.0, 4, 2.0  # least number of pairs, and of standard errors of (2)
CLIP, MAX_CONDITION = 5.0, 10.0  # median absolute values of a residual; of the regressors of a block


class AccelerometerResiduals(NamedTuple):
    """Residuals of the accelerometers in one run, and the yaw rate of the gyro, in the body frame."""

    t_s: np.ndarray  # (N,)
    a: np.ndarray  # (N, 2) m/s², forward and to the left
    yaw_rate: np.ndarray  # (N,) rad/s

    @classmethod
    def at_times(cls, t_s: np.ndarray, *series: tuple[np.ndarray, np.ndarray]) -> "AccelerometerResiduals":
        """Return the three `series` (times, values) at the times `t_s` (N,), by linear interpolation."""
        ahead, left, yaw_rate = (np.interp(t_s, *values) for values in series)
        return cls(t_s, np.stack([ahead, left], axis=1), yaw_rate)


def slope_speed_error(runs: Sequence[AccelerometerResiduals], decay_rate: float) -> float:
    """Return the amplitude |e| [m/s], or 0 if the data do not show a slope; `decay_rate` is λ [1/s].  (2)"""
    products = [a @ b for run in runs for a, b in pairwise(block_pushes(run, decay_rate))]
    if len(products) < MIN_PAIRS:
        return 0.0
    mean, std_error = np.mean(products), np.std(products) / np.sqrt(len(products) - 1)
    return float(np.sqrt(mean) / decay_rate) if mean > MIN_SIGMA * std_error else 0.0


def block_pushes(run: AccelerometerResiduals, decay_rate: float) -> list[np.ndarray]:
    """Return ĝ (2,) [m/s²] of each block by least squares, on axes that have the first heading as x.  (1)"""
    t_s, a, yaw_rate = run
    dt_s = np.diff(t_s, prepend=t_s[:1])
    psi = np.cumsum(yaw_rate * dt_s)
    forward_axis = np.stack([np.cos(psi), np.sin(psi)], axis=1)
    left_axis = np.stack([-np.sin(psi), np.cos(psi)], axis=1)
    e, decay = np.zeros((len(t_s), 2)), np.exp(-decay_rate * dt_s)
    for k in range(1, len(t_s)):
        e[k] = decay[k] * e[k - 1] + (1.0 - decay[k]) / decay_rate * forward_axis[k - 1]
    # (N, 2, 2): reading, axis of the map
    X = np.stack([-decay_rate * e, yaw_rate[:, None] * e - left_axis], axis=1)
    limit = CLIP * np.median(np.abs(a - np.median(a, axis=0)), axis=0)
    a = np.clip(a - np.median(a, axis=0), -limit, limit)
    scale = 1.0 / np.maximum(np.std(a, axis=0), 1e-12)
    pushes = []
    count = int((t_s[-1] - t_s[0]) / BLOCK_S) if len(t_s) else 0
    for rows in np.array_split(np.arange(len(t_s)), count) if count else ():
        x, y = (z[rows] - np.mean(z[rows], axis=0) for z in (X, a))
        x, y = (x * scale[:, None]).reshape(-1, 2), (y * scale).ravel()
        if np.linalg.cond(x) < MAX_CONDITION:
            pushes.append(np.linalg.lstsq(x, y, rcond=None)[0])
    return pushes
