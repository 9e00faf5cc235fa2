"""Compute errors of a trajectory against another one: absolute, relative, and across a path.

    ATE     √ mean |A p − p*|²,  heading √ mean wrap(ψ + a − ψ*)²;  A the alignment, a its angle           (1)
    RPE     E_i = (T*_i⁻¹ T*_{i+Δ})⁻¹ (T_i⁻¹ T_{i+Δ}),   √ mean |trans E_i|²,   √ mean angle(E_i)²         (2)
    cross-track   the distance from a position to the nearest point of the reference path, left positive   (3)

p, ψ is the estimate, p*, ψ* the truth at the same times, T the pose as a rigid transform of the plane. (1) and (2) are
by Sturm et al. 2012, and as in the tool `evo`: the alignment is rigid, without scale. (3) searches only within
`window_s` of the time of the reference. So it does not use the wrong branch of a path that crosses itself.

A position error can be small by chance, so report the heading error too. Usually RPE is suitable for an estimator with
only an IMU, and ATE for an estimator with a sensor that measures the pose.
"""

from typing import NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.geometry import align, wrap

ALIGNMENTS = ("none", "start", "rigid")
NANOSECONDS = 1e9


class PoseErrors(NamedTuple):
    """The errors of poses at N times."""

    position_m: np.ndarray  # (N,) distance, never negative
    heading_rad: np.ndarray  # (N,) wrapped, signed


def align_trajectory(eta: np.ndarray, eta_true: np.ndarray, alignment: str = "none") -> np.ndarray:
    """Return `eta` (N, 3) aligned to `eta_true` (N, 3): unchanged, by the first pose, or by all positions ("rigid").

    "rigid" does not need a true heading. Raise UsageError for another name, and for "start" without a true heading.
    """
    if alignment not in ALIGNMENTS:
        raise UsageError.of("compare.alignment", value=alignment, valid=ALIGNMENTS)
    is_finite = np.isfinite(eta) & np.isfinite(eta_true)
    is_valid = np.all(is_finite[:, :2], axis=1)
    if alignment == "none" or not np.any(is_valid):
        return eta
    if alignment == "start":
        is_valid &= is_finite[:, 2]
        if not np.any(is_valid):
            raise UsageError.of("compare.no-first-heading", "--align rigid")
        first = int(np.argmax(is_valid))
        angle = eta_true[first, 2] - eta[first, 2]
        shift = eta_true[first, :2] - _rotate(eta[first : first + 1, :2], angle)[0]
    else:
        angle, shift = align(eta[is_valid, :2], eta_true[is_valid, :2])
    return np.column_stack([_rotate(eta[:, :2], angle) + shift, wrap(eta[:, 2] + angle)])


def absolute_pose_errors(eta: np.ndarray, eta_true: np.ndarray) -> PoseErrors:
    """Return the errors of poses (N, 3) that are already aligned.  (1)"""
    d = eta - eta_true
    return PoseErrors(np.hypot(d[:, 0], d[:, 1]), wrap(d[:, 2]))


def relative_pose_errors(
    t_ns: np.ndarray, eta: np.ndarray, eta_true: np.ndarray, span_s: float = 1.0
) -> PoseErrors:
    """Return the errors (M,) of the motion over `span_s`, from each time with a sample `span_s` later.  (2)"""
    span_ns = round(span_s * NANOSECONDS)
    later_rows = np.searchsorted(t_ns, t_ns + span_ns)
    first_rows = np.flatnonzero(later_rows < len(t_ns))
    later_rows = later_rows[first_rows]
    # a gap is not a motion over `span_s`
    is_on_time = np.abs(t_ns[later_rows] - t_ns[first_rows] - span_ns) < 0.1 * span_ns
    first_rows, later_rows = first_rows[is_on_time], later_rows[is_on_time]
    motion = _relative_pose(eta[first_rows], eta[later_rows])
    true_motion = _relative_pose(eta_true[first_rows], eta_true[later_rows])
    E = _relative_pose(true_motion, motion)
    return PoseErrors(np.hypot(E[:, 0], E[:, 1]), E[:, 2])


def cross_track(
    t_ns: np.ndarray, xy: np.ndarray, ref_ns: np.ndarray, ref_xy: np.ndarray, window_s: float = 2.0
) -> np.ndarray:
    """Return the signed distance (N,) [m] of `xy` (N, 2) from the path `ref_xy` (K, 2), positive to the left.  (3)
    Raise UsageError for a path of fewer than two points.
    """
    if len(ref_xy) < 2:
        raise UsageError.of("compare.reference-short", points=len(ref_xy))
    reach_rows = max(1, round(window_s * NANOSECONDS / max(float(np.median(np.diff(ref_ns))), 1.0)))
    centre_rows = np.clip(np.searchsorted(ref_ns, t_ns), 0, len(ref_ns) - 1)
    stride = max(1, reach_rows // 100)  # at most about 200 segments are searched for a position
    row_offsets = np.arange(-reach_rows, reach_rows + stride, stride)
    distances = np.empty(len(t_ns))
    for i in range(0, len(t_ns), 4096):
        corners = np.clip(centre_rows[i : i + 4096, None] + row_offsets, 0, len(ref_xy) - 1)
        distances[i : i + 4096] = _signed_distance(xy[i : i + 4096], ref_xy[corners])
    return distances


def rms(x: np.ndarray) -> float:
    """Return the root mean square of the finite values; NaN if all are NaN or x is empty."""
    finite_values = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(finite_values**2))) if finite_values.size else float("nan")


def _signed_distance(xy: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the signed distance (N,) from xy (N, 2) to the nearest segment between corners (N, s, 2)."""
    a, d = corners[:, :-1], np.diff(corners, axis=1)
    r = xy[:, None] - a
    length2 = np.sum(d * d, axis=2)
    has_no_length = length2 == 0.0
    fraction = np.clip(np.sum(r * d, axis=2) / np.where(has_no_length, 1.0, length2), 0.0, 1.0)
    offset = r - fraction[..., None] * d
    squared_distance = np.where(has_no_length, np.inf, np.sum(offset * offset, axis=2))
    nearest_segment = np.argmin(squared_distance, axis=1)
    rows = np.arange(len(xy))
    (d_x, d_y), (r_x, r_y) = d[rows, nearest_segment].T, r[rows, nearest_segment].T
    side = np.sign(d_x * r_y - d_y * r_x)
    distance = np.sqrt(squared_distance[rows, nearest_segment])
    # distance to the point, if the reference does not move in the window
    corner_distance = np.hypot(*(xy - corners[:, 0]).T)
    return np.where(np.isinf(distance), corner_distance, distance * np.where(side == 0.0, 1.0, side))


def _rotate(xy: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


def _relative_pose(eta_a: np.ndarray, eta_b: np.ndarray) -> np.ndarray:
    """Return the relative poses T_a⁻¹ T_b of poses (N, 3) and (N, 3)."""
    d = eta_b[:, :2] - eta_a[:, :2]
    c, s = np.cos(eta_a[:, 2]), np.sin(eta_a[:, 2])
    turn = wrap(eta_b[:, 2] - eta_a[:, 2])
    return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], turn])
