"""Measure the laps of a drive: distance from the route, duration, and closure of each lap.

    lap   from a passage of the reference through the end of its route to the next passage                (1)
    gap   |p(end) − p(begin)|,  ψ(end) − ψ(begin)      of the vehicle                                      (2)

A passage is the point at which the reference is nearest to the end of the route, with the heading of the end.
So the crossing of a figure eight is not a passage.
If a drive begins with a lead-in to the route, the first lap begins with the drive.
"""

from typing import NamedTuple

import numpy as np

from baqueano.compare import errors
from baqueano.contracts.values import JsonObject
from baqueano.geometry import wrap
from baqueano.runs.interpolation import interpolate_poses
from baqueano.runs.run import Run
from baqueano.signals import seconds

MAX_END_DISTANCE_M, MAX_END_ANGLE_RAD = 0.02, 0.3
WINDOW = 5  # steps of the reference; their median ignores a jump
MIN_LAP_M = 0.3  # smallest length of a lap


class DriveLap(NamedTuple):
    """A lap of a vehicle, by the truth if it is known, else by the estimate.

    Attributes
    ----------
    number : int
        Number of the lap, from 1.
    start_s, duration_s : float
        Beginning since the start of the run, and duration.
    rms_m, max_m : float
        Distance from the path of the reference.
    gap_m, gap_rad : float
        Difference between the poses at the beginning and at the end of the lap.
    """

    number: int
    start_s: float
    duration_s: float
    rms_m: float
    max_m: float
    gap_m: float
    gap_rad: float

    def row(self) -> JsonObject:
        """Return a flat row in SI units for programs."""
        names = {"number": "lap", "rms_m": "across_rms_m", "max_m": "across_max_m"}
        return {names.get(name, name): value for name, value in self._asdict().items()}


def run_laps(run: Run) -> tuple[DriveLap, ...]:
    """Return the laps of a run; an empty tuple if its reference does not return to the beginning.

    Examples
    --------
    >>> run = bq.repeat(bq.load("small"), bq.guides.shapes.circle(0.3, 0.2), laps=2)
    >>> [f"{lap.duration_s:.1f} s" for lap in run_laps(run)]
    ['9.8 s', '9.8 s']
    """
    ref, log = run.guide_reference, run.truth if run.truth is not None else run.estimate
    if ref is None or log is None or len(ref.t_ns) < 3 or len(log.t_ns) < 2:
        return ()
    end_indices = _end_passages(ref.eta, bool(ref.at_end[-1] > 0.0))
    if len(end_indices) < 2:  # the reference does not return
        return ()
    end_indices = end_indices if end_indices[0] == 0 else [0, *end_indices]
    cross_track_m = errors.cross_track(log.t_ns, log.eta[:, :2], ref.t_ns, ref.eta[:, :2])
    end_poses = interpolate_poses(ref.t_ns[end_indices], log.t_ns, log.eta)
    laps = []
    for k, (a, b) in enumerate(zip(ref.t_ns[end_indices][:-1], ref.t_ns[end_indices][1:], strict=True)):
        d = np.abs(cross_track_m[(log.t_ns >= a) & (log.t_ns <= b)])
        d = d[np.isfinite(d)]
        closure_gap = end_poses[k + 1] - end_poses[k]
        max_distance = float(np.max(d)) if d.size else float("nan")
        begin_and_duration = float(seconds(a, run.start_ns)), float(seconds(b, a))
        closure = float(np.hypot(closure_gap[0], closure_gap[1])), float(wrap(closure_gap[2]))
        laps.append(DriveLap(k + 1, *begin_and_duration, errors.rms(d), max_distance, *closure))
    return tuple(laps)


def _end_passages(eta: np.ndarray, is_complete: bool) -> list[int]:
    """Return the indices at which the reference poses (N, 3) pass the end of the route.  (1)"""
    end = eta[-1] if is_complete else eta[0]
    moves = np.flatnonzero(np.append(True, np.any(np.diff(eta[:, :2], axis=0), axis=1)))
    if len(moves) < 2:
        return []
    eta = eta[moves]
    distances = np.hypot(eta[:, 0] - end[0], eta[:, 1] - end[1])
    padded_step = np.pad(np.hypot(*np.diff(eta[:, :2], axis=0).T), WINDOW // 2, mode="edge")
    step = np.median(np.lib.stride_tricks.sliding_window_view(padded_step, WINDOW), axis=1)  # without jumps
    is_near = (distances < np.maximum(MAX_END_DISTANCE_M, 2.0 * np.append(step, step[-1]))) & (
        np.abs(wrap(eta[:, 2] - end[2])) < MAX_END_ANGLE_RAD
    )
    s = np.append(0.0, np.cumsum(step))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_near, [False]]).astype(int)))
    passages: list[int] = []
    for a, b in edges.reshape(-1, 2):
        k = int(a + np.argmin(distances[a:b]))
        if not passages or s[k] - s[passages[-1]] > MIN_LAP_M:
            passages.append(k)
    return moves[passages].tolist()
