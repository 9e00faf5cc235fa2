"""Measure the noise of the positions of a route.

    d_k = Δ³ p_k,    σ = median |d| / (Φ⁻¹(¾) √20)          var d = 20 σ² for white noise, d ≈ 0 for a smooth path  (1)
    mean sign(d_k d_{k−1}) < MAX_SIGN                       −0.54 for white noise, near 1 for a smooth path        (2)

p: x and y at every n-th pose, for each n of STRIDES, because the poses of a slow camera are interpolated. The median
ignores single jumps and corners. (2) tells noise from a curve with few poses. Source of (1): Gasser, Sroka and
Jennen-Steinmetz, Biometrika, 1986, with third in place of second differences.
"""

import numpy as np

from baqueano.guides.route import Route

STRIDES = (1, 2, 4, 8)
MAX_SIGN = -0.3
MIN_COUNT = 30  # a median of fewer differences is not reliable
NORMAL_QUARTILE = 0.6745  # Φ⁻¹(¾)


def position_noise(route: Route) -> float:
    """Return σ [m], the standard deviation of the noise of x and y; 0 without noise, or with too few poses.  (1)"""
    return max(_noise(route.eta[::stride, :2]) for stride in STRIDES)


def _noise(xy: np.ndarray) -> float:
    d = np.diff(xy, 3, axis=0)
    if len(d) < MIN_COUNT or not np.isfinite(d).all():
        return 0.0
    if np.mean(np.sign(d[1:] * d[:-1])) > MAX_SIGN:  # (2)
        return 0.0
    return float(np.median(np.abs(d)) / (NORMAL_QUARTILE * np.sqrt(20.0)))
