"""Sample the motion of a run at a few hundred instants: true pose, estimated pose, and its uncertainty."""

import tomllib
from dataclasses import dataclass

import numpy as np

from baqueano.compare.corridor import run_corridor
from baqueano.errors import AnswerNo
from baqueano.messages.printable import baqueano_command
from baqueano.runs import Run
from baqueano.runs.interpolation import interpolate_poses
from baqueano.signals import NANOSECONDS, seconds

INSTANTS_PER_LAP, MAX_INSTANTS = 72, 216  # instants of a lap, of a run
RADIUS_M = 0.07  # radius of the body, if the vehicle file does not contain its size


@dataclass(frozen=True)
class Scene:
    """Poses (M, 3) at M equally spaced instants; data are None if the run does not contain them."""

    t_s: np.ndarray  # (M,) since the first tick
    estimated_poses: np.ndarray | None  # (M, 3)
    true_poses: np.ndarray | None  # (M, 3)
    half_m: np.ndarray | None  # (M,) half-width of the corridor, 95 %; NaN if the position is too uncertain
    route: np.ndarray | None  # (K, 2) one lap of the reference path
    laps: int
    radius_m: float

    @property
    def vehicle_poses(self) -> np.ndarray:
        """Return the poses (M, 3) at which the vehicle is drawn: the
        true poses, or the estimated poses without a truth.
        """
        poses = self.estimated_poses if self.true_poses is None else self.true_poses
        assert poses is not None
        return poses


def scene(run: Run) -> Scene:
    """Return the scene of a run; a log without a complete pose, such as a GPS without heading, is not drawn.
    Raise AnswerNo for a run without a pose, or with less than two ticks.
    """
    no_motion = AnswerNo.of("report.nothing-moves", baqueano_command("replay", run.name), name=run.name)
    run = run.without_rest
    if len(run.t_ns) < 2:
        raise no_motion
    corridor = run_corridor(run) if run.estimate is not None else None
    end_s = float(seconds(run.t_ns[-1], run.t_ns[0]))
    lap_s = corridor.lap_s if corridor is not None and np.isfinite(corridor.lap_s) else end_s
    laps = max(1, round(end_s / lap_s))
    t_s = np.linspace(0.0, end_s, min(INSTANTS_PER_LAP * laps, MAX_INSTANTS) + 1)
    t_ns = run.t_ns[0] + np.round(t_s * NANOSECONDS).astype(np.int64)
    logs = [
        None if log is None else _without_gaps(interpolate_poses(t_ns, log.t_ns, log.eta))
        for log in (run.estimate, run.truth)
    ]
    if all(log is None for log in logs):
        raise no_motion
    half_width = None
    if corridor is not None and len(corridor.t_s) > 1:
        half_width = np.interp(t_s, corridor.t_s, corridor.across_m, right=np.nan)
    route = None
    if run.guide_reference is not None and len(run.guide_reference.t_ns) > 1:
        is_first_lap = seconds(run.guide_reference.t_ns, run.guide_reference.t_ns[0]) <= lap_s
        route = run.guide_reference.eta[is_first_lap, :2][:: max(1, int(is_first_lap.sum()) // 160)]
    return Scene(t_s, logs[0], logs[1], half_width, route, laps, _radius_m(run))


def _without_gaps(poses: np.ndarray) -> np.ndarray | None:
    """Return the poses; each gap contains the previous pose, and a gap at the start the first pose.
    Return None without a complete pose.
    """
    finite_rows = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if not len(finite_rows):
        return None
    last_finite = np.clip(np.searchsorted(finite_rows, np.arange(len(poses)), side="right") - 1, 0, None)
    return poses[finite_rows[last_finite]]


def _radius_m(run: Run) -> float:
    """Return half the width of the body [m], from the vehicle file in the run."""
    geometry = tomllib.loads(run.vehicle_text).get("geometry", {})
    if "radius_m" in geometry:
        return float(geometry["radius_m"])
    return float(geometry.get("width_m", geometry.get("track_m", 2 * RADIUS_M))) / 2
