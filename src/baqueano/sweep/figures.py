"""Compute the figures of a drive, and the segments (pieces.py) of each rms figure, by which two drives are compared.
    effort          e_t = |u_t / limit| / √m,   m entries of the command with a limit                      (1)
    roughness       e_t = |u_t − u_{t−1}| / limit / (√m δ)   [1/s]                                         (2)
    joined          the length of the reference after which the vehicle stays within JOINED_M of its path  (3)
    laps            complete laps before it is LOST_M from its path, or stops                              (4)

Cross-track, speed, ATE and RPE are computed as in compare/. The motion of the vehicle is the truth if it is known, else
the estimate. NEES and NIS are means per degree of freedom, 1 if consistent.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.compare import errors, evenness
from baqueano.compare.filter_consistency import filter_consistency
from baqueano.messages.language import mark as N_
from baqueano.runs.interpolated import at_times, poses_at
from baqueano.signals import seconds
from baqueano.sweep.pieces import Pieces, pieces_of

if TYPE_CHECKING:
    from baqueano.contracts.values import Tree
    from baqueano.runs.run import Run

JOINED_M, LOST_M = 0.03, 0.10
NAN = float("nan")


class SweepFigure(NamedTuple):
    """The heading, unit and scale of a figure in a table."""

    heading: str
    unit: str
    scale: float  # of the unit


SUMMED = {  # rms figures, compared by segments
    "across_rms_m": SweepFigure(N_("across"), "cm rms", 100.0),
    "speed_error_m_s": SweepFigure(N_("speed error"), "cm/s rms", 100.0),
    "effort": SweepFigure(N_("effort"), "%", 100.0),
    "roughness_1_s": SweepFigure(N_("roughness"), "1/s", 1.0),
    "ate_m": SweepFigure("ATE", "cm", 100.0),
    "ate_heading_rad": SweepFigure("ATE ψ", "°", 180.0 / np.pi),
    "rpe_m": SweepFigure("RPE", "cm", 100.0),
    "rpe_heading_rad": SweepFigure("RPE ψ", "°", 180.0 / np.pi),
}
SINGLE = {
    "across_max_m": SweepFigure(N_("across"), "cm max", 100.0),
    "joined_m": SweepFigure(N_("joined"), "m", 1.0),
    "laps": SweepFigure(N_("laps"), "", 1.0),
    "nees_pose": SweepFigure("NEES η", "", 1.0),
    "nees_velocity": SweepFigure("NEES ν", "", 1.0),
    "nis": SweepFigure("NIS", "", 1.0),
}


def figures_of(
    run: "Run", laps: int = 1, alignment: str = "none", over_s: float = 1.0
) -> tuple[dict[str, float], dict[str, Pieces]]:
    """Return the figures of a drive or a replay by name (SUMMED and SINGLE), and the segments of the figures
    in SUMMED."""
    series = _of_estimate(run, alignment, over_s)
    single = dict.fromkeys(SINGLE, NAN)
    if run.metadata.get("kind") != "replay":
        more, of_path = _of_drive(run, laps)
        series |= more
        single |= of_path
    spans = {"rpe_m": over_s, "rpe_heading_rad": over_s}
    pieces = {name: pieces_of(*series[name], spans.get(name, 0.0)) for name in SUMMED if name in series}
    consistency = filter_consistency(run, alignment)
    single |= {name: getattr(consistency, name).mean for name in ("nees_pose", "nees_velocity", "nis")}
    return {name: errors.rms(series[name][1]) if name in series else NAN for name in SUMMED} | single, pieces


def _of_estimate(run: "Run", alignment: str, over_s: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return figure → times and errors of the estimate against the truth; {} if one of them is not known."""
    est, truth = run.estimate, run.truth
    if est is None or truth is None or len(truth.t_ns) < 2:
        return {}
    eta_true = poses_at(est.t_ns, truth.t_ns, truth.eta)
    eta = errors.align_trajectory(est.eta, eta_true, alignment)
    off, drift = errors.absolute(eta, eta_true), errors.relative(est.t_ns, eta, eta_true, over_s)
    start_ns = est.t_ns[: len(drift.position_m)]
    return {
        "ate_m": (est.t_ns, off.position_m), "ate_heading_rad": (est.t_ns, off.heading_rad),
        "rpe_m": (start_ns, drift.position_m), "rpe_heading_rad": (start_ns, drift.heading_rad),
    }  # fmt: skip


def _of_drive(run: "Run", laps: int) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], dict[str, float]]:
    """Return figure → times and errors of the vehicle, and the single figures of its path."""
    log: Tree = run.truth if run.truth is not None else run.estimate
    ref = run.guide_reference
    if log is None or ref is None or len(ref.t_ns) < 2 or not np.ptp(ref.eta[:, :2], axis=0).any():
        return {}, {}
    over = ref.t_ns[ref.done > 0.0]
    k = log.t_ns <= (over[0] if over.size else ref.t_ns[-1])
    t_ns, eta, speed = log.t_ns[k], log.eta[k], log.nu[k, 0]
    across = errors.cross_track(t_ns, eta[:, :2], ref.t_ns, ref.eta[:, :2])
    speed_reference = at_times(t_ns, ref.t_ns, ref.nu[:, :1])[:, 0]
    late = seconds(t_ns, t_ns[0]) >= evenness.AFTER_S
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ref.eta[:, :2], axis=0).T))])
    at = np.interp(t_ns, ref.t_ns, way)
    series = {
        "across_rms_m": (t_ns, across),
        "speed_error_m_s": (t_ns[late], (speed - speed_reference)[late]),
    }
    single = {
        "across_max_m": float(np.max(np.abs(across))), "joined_m": joining_distance(at, across),
        "laps": _laps(run, t_ns, across, at / way[-1] if way[-1] else at, laps),
    }  # fmt: skip
    return series | _of_command(run, run.t_ns <= t_ns[-1]), single


def joining_distance(way_m: np.ndarray, across_m: np.ndarray) -> float:
    """Return the path length [m] after which all distances (N,) are within JOINED_M; NaN if the last distance is not.
    (3)
    """
    outside = np.flatnonzero(~(np.abs(across_m) <= JOINED_M))
    if not outside.size:
        return 0.0
    return float(way_m[outside[-1] + 1] - way_m[0]) if outside[-1] + 1 < len(way_m) else NAN


def _laps(run: "Run", t_ns: np.ndarray, across: np.ndarray, part: np.ndarray, laps: int) -> float:
    """Return the complete laps, of `laps`, within LOST_M and before a stop; `part` (N,) is the fraction of the route.
    (4)
    """
    stops = [event.t_ns for event in run.events if event.level == "error"]
    if not stops and np.all(np.abs(across) <= LOST_M):
        return float(laps)
    lost_ns = [int(t_ns[k]) for k in np.flatnonzero(~(np.abs(across) <= LOST_M))[:1]]
    until = part[t_ns <= min([*stops, *lost_ns])]
    return float(np.floor(laps * until[-1] - 1e-9)) if until.size and until[-1] > 0.0 else 0.0


def _of_command(run: "Run", k: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the effort and the roughness of the sent command, with their times; {} without limits.  (1), (2)
    If no sent command was logged, the applied command is used.
    """
    limits = evenness.limits_of(run.vehicle_text)
    u = (run.applied if run.sent is None else run.sent)[k]
    if limits is None or u.shape[1] != len(limits.command):
        return {}
    limited = (limits.command > 0.0) & np.isfinite(limits.command)
    if not limited.any() or len(u) < 2:
        return {}
    part = u[:, limited] / limits.command[limited]
    change = np.diff(part, axis=0) / np.maximum(np.diff(seconds(run.t_ns[k], 0)), 1e-9)[:, None]
    m = np.sqrt(np.count_nonzero(limited))
    size = [np.sqrt(np.sum(x * x, axis=1)) / m for x in (part, change)]
    return {"effort": (run.t_ns[k], size[0]), "roughness_1_s": (run.t_ns[k][1:], size[1])}
