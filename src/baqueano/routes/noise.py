"""Measure the noise of the positions of a route.

    d_k = Σ w_i p_i / |w|,  w_i = Π 1 / (t_i − t_j)        i, j: four successive poses, the third divided difference
    σ = median |d| / Φ⁻¹(¾)                                  var d = σ² for white noise, d ≈ 0 for a smooth path   (1)
    mean sign(d_k d_{k−1}) < MAX_SIGN                       −0.54 for white noise, near 1 for a smooth path        (2)

p: x and y at the time t of every n-th pose, for each n of STRIDES, because the poses of a slow camera are interpolated.
The median ignores single jumps and corners. (2) separates noise from a curve of few poses. Source of (1): Gasser, Sroka
and Jennen-Steinmetz, Biometrika, 1986, with third instead of second differences.
"""

import numpy as np

from baqueano.guides.route import Route

STRIDES = (1, 2, 4, 8)
MAX_SIGN = -0.3
MIN_COUNT = 30  # a median of fewer differences is not reliable
NORMAL_QUARTILE = 0.6745  # Φ⁻¹(¾)


def position_noise(route: Route) -> float:
    """Return σ [m], the standard deviation of the noise of x and y; 0 without noise, or with too few poses.  (1)"""
    return max(_noise(route.t_s[::stride], route.eta[::stride, :2]) for stride in STRIDES)


def _noise(t_s: np.ndarray, xy: np.ndarray) -> float:
    if len(t_s) < MIN_COUNT or not np.isfinite(xy).all() or not np.all(np.diff(t_s) > 0.0):
        return 0.0
    windows = np.lib.stride_tricks.sliding_window_view(t_s, 4)
    steps = windows[:, :, None] - windows[:, None, :] + np.eye(4)
    w = 1.0 / np.prod(steps, axis=2)
    w = w / np.linalg.norm(w, axis=1, keepdims=True)
    d = np.einsum("ki,kji->kj", w, np.lib.stride_tricks.sliding_window_view(xy, 4, axis=0))
    if np.mean(np.sign(d[1:] * d[:-1])) > MAX_SIGN:  # (2)
        return 0.0
    return float(np.median(np.abs(d)) / NORMAL_QUARTILE)
