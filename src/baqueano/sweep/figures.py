"""Compute the results of a drive, and the error segments of each rms value, by which two drives are compared.
    effort          e_t = |u_t / limit| / √m,   m commands that have a limit                              (1)
    roughness       e_t = |u_t − u_{t−1}| / limit / (√m δ)   [1/s]                                         (2)
    joined          the length of the reference after which the vehicle stays within MAX_JOINED_M of its path (3)
    laps            complete laps before it is MAX_LAP_DISTANCE_M from its path, or stops                  (4)

Cross-track, speed, ATE and RPE are computed as in compare/. The motion of the vehicle is the truth if it is known, else
the estimate. NEES and NIS are means per degree of freedom, 1 if consistent.
"""

from typing import NamedTuple

import numpy as np

from baqueano.compare import errors, evenness
from baqueano.compare.filter_consistency import filter_consistency
from baqueano.contracts.values import Tree
from baqueano.messages.language import mark as N_
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows
from baqueano.runs.run import Run
from baqueano.signals import seconds
from baqueano.sweep.error_segments import ErrorSegments, error_segments

MAX_JOINED_M, MAX_LAP_DISTANCE_M = 0.03, 0.10
NAN = float("nan")


class SweepFigure(NamedTuple):
    """The heading, unit, scale and meaning of a result in a table."""

    heading: str
    unit: str
    scale: float  # of the unit
    meaning: str


_ACROSS = N_("distance of the vehicle from its path")
_ATE = N_("absolute error of the estimated position and heading ψ, rms")
_RPE = N_("error of the estimated motion and turn in 1 s, rms")
_NEES = N_("squared error of pose η and velocity ν divided by its predicted variance; 1 if consistent")
RMS_FIGURES = {  # rms values, compared by segments
    "across_rms_m": SweepFigure(N_("cross-track"), "cm rms", 100.0, _ACROSS),
    "speed_error_m_s": SweepFigure(N_("speed error"), "cm/s rms", 100.0, N_("error of the forward speed")),
    "effort": SweepFigure(N_("effort"), "%", 100.0, N_("command relative to its limit, rms")),
    "roughness_1_s": SweepFigure(N_("roughness"), "1/s", 1.0, N_("change of the command per second, rms")),
    "ate_m": SweepFigure("ATE", "cm", 100.0, _ATE),
    "ate_heading_rad": SweepFigure("ATE ψ", "°", 180.0 / np.pi, _ATE),
    "rpe_m": SweepFigure("RPE", "cm", 100.0, _RPE),
    "rpe_heading_rad": SweepFigure("RPE ψ", "°", 180.0 / np.pi, _RPE),
}
SINGLE_FIGURES = {
    "across_max_m": SweepFigure(N_("cross-track"), "cm max", 100.0, _ACROSS),
    "joining_m": SweepFigure(
        N_("joined"), "m", 1.0, N_("distance after which the vehicle stays within 3 cm of its path")
    ),
    "laps": SweepFigure(N_("laps"), "", 1.0, N_("complete laps")),
    "nees_pose": SweepFigure("NEES η", "", 1.0, _NEES),
    "nees_velocity": SweepFigure("NEES ν", "", 1.0, _NEES),
    "nis": SweepFigure(
        "NIS", "", 1.0, N_("squared innovation divided by its predicted variance; 1 if consistent")
    ),
}
ALL_FIGURES = {**RMS_FIGURES, **SINGLE_FIGURES}


def drive_figures(
    run: Run, laps: int = 1, alignment: str = "none", window_s: float = 1.0
) -> tuple[dict[str, float], dict[str, ErrorSegments]]:
    """Return the results of a drive or a replay by name, and the segments of those in RMS_FIGURES."""
    run = run.without_rest
    series = _estimate_errors(run, alignment, window_s)
    single = dict.fromkeys(SINGLE_FIGURES, NAN)
    if run.metadata.get("kind") != "replay":
        drive_series, path_figures = _drive_errors(run, laps)
        series |= drive_series
        single |= path_figures
    spans = {"rpe_m": window_s, "rpe_heading_rad": window_s}
    pieces = {
        name: error_segments(*series[name], spans.get(name, 0.0)) for name in RMS_FIGURES if name in series
    }
    consistency = filter_consistency(run, alignment)
    single |= {name: getattr(consistency, name).mean for name in ("nees_pose", "nees_velocity", "nis")}
    return {
        name: errors.rms(series[name][1]) if name in series else NAN for name in RMS_FIGURES
    } | single, pieces


def _estimate_errors(run: Run, alignment: str, window_s: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return, for each result, times and errors of the estimate against the truth; {} if one of them is not known."""
    est, truth = run.estimate, run.truth
    if est is None or truth is None or len(truth.t_ns) < 2:
        return {}
    eta_true = interpolate_poses(est.t_ns, truth.t_ns, truth.eta)
    eta = errors.align_trajectory(est.eta, eta_true, alignment)
    absolute_error = errors.absolute_pose_errors(eta, eta_true)
    drift = errors.relative_pose_errors(est.t_ns, eta, eta_true, window_s)
    start_ns = est.t_ns[: len(drift.position_m)]
    return {
        "ate_m": (est.t_ns, absolute_error.position_m), "ate_heading_rad": (est.t_ns, absolute_error.heading_rad),
        "rpe_m": (start_ns, drift.position_m), "rpe_heading_rad": (start_ns, drift.heading_rad),
    }  # fmt: skip


def _drive_errors(run: Run, laps: int) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], dict[str, float]]:
    """Return, for each result, times and errors of the vehicle; and the single values of its path."""
    log: Tree = run.truth if run.truth is not None else run.estimate
    ref = run.guide_reference
    if log is None or ref is None or len(ref.t_ns) < 2 or not np.ptp(ref.eta[:, :2], axis=0).any():
        return {}, {}
    k = evenness.active_mask(log.t_ns, ref)
    t_ns, eta, speed = log.t_ns[k], log.eta[k], log.nu[k, 0]
    cross_track = errors.cross_track(t_ns, eta[:, :2], ref.t_ns, ref.eta[:, :2])
    speed_reference = interpolate_rows(t_ns, ref.t_ns, ref.nu[:, :1])[:, 0]
    is_driving = evenness.is_driving(t_ns, speed_reference)
    path_length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ref.eta[:, :2], axis=0).T))])
    path_position = np.interp(t_ns, ref.t_ns, path_length)
    series = {
        "across_rms_m": (t_ns, cross_track),
        "speed_error_m_s": (t_ns[is_driving], (speed - speed_reference)[is_driving]),
    }
    single_figures = {
        "across_max_m": float(np.max(np.abs(cross_track))), "joining_m": joining_distance(path_position, cross_track),
        "laps": _laps(run, t_ns, cross_track, path_position / path_length[-1] if path_length[-1] else path_position,
        laps),
    }  # fmt: skip
    return series | _command_series(run, run.t_ns <= t_ns[-1]), single_figures


def joining_distance(along_m: np.ndarray, across_m: np.ndarray) -> float:
    """Return the path length [m] after which all distances (N,) are within MAX_JOINED_M, or NaN without such a
    length.  (3)
    """
    outside_rows = np.flatnonzero(~(np.abs(across_m) <= MAX_JOINED_M))
    if not outside_rows.size:
        return 0.0
    return float(along_m[outside_rows[-1] + 1] - along_m[0]) if outside_rows[-1] + 1 < len(along_m) else NAN


def _laps(run: Run, t_ns: np.ndarray, cross_track: np.ndarray, path_fraction: np.ndarray, laps: int) -> float:
    """Return the complete laps, of `laps`, within MAX_LAP_DISTANCE_M and before a stop.

    `path_fraction` (N,) is the fraction of the route.  (4)
    """
    stops = [event.t_ns for event in run.events if event.level == "error"]
    if not stops and np.all(np.abs(cross_track) <= MAX_LAP_DISTANCE_M):
        return float(laps)
    lost_ns = [int(t_ns[k]) for k in np.flatnonzero(~(np.abs(cross_track) <= MAX_LAP_DISTANCE_M))[:1]]
    fractions = path_fraction[t_ns <= min([*stops, *lost_ns])]
    return float(np.floor(laps * fractions[-1] - 1e-9)) if fractions.size and fractions[-1] > 0.0 else 0.0


def _command_series(run: Run, k: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the effort and the roughness of the sent command, with their times; {} without limits.  (1), (2)
    If no sent command was logged, the applied command is used.
    """
    limits = evenness.read_limits(run.vehicle_text)
    u = (run.applied_commands if run.sent_commands is None else run.sent_commands)[k]
    if limits is None or u.shape[1] != len(limits.command):
        return {}
    is_limited = (limits.command > 0.0) & np.isfinite(limits.command)
    if not is_limited.any() or len(u) < 2:
        return {}
    relative_command = u[:, is_limited] / limits.command[is_limited]
    change = np.diff(relative_command, axis=0) / np.maximum(np.diff(seconds(run.t_ns[k], 0)), 1e-9)[:, None]
    m = np.sqrt(np.count_nonzero(is_limited))
    magnitudes = [np.sqrt(np.sum(x * x, axis=1)) / m for x in (relative_command, change)]
    return {"effort": (run.t_ns[k], magnitudes[0]), "roughness_1_s": (run.t_ns[k][1:], magnitudes[1])}
