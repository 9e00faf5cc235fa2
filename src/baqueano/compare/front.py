"""Measure each run of a comparison: the errors of its estimate and of its vehicle, and the figures of its commands.

Fits are compared by their parameters, with the test for a change of `validation`, a layer above all results.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from baqueano.compare import errors, evenness
from baqueano.compare.comparison import Comparison, PathDistances, RunComparison
from baqueano.compare.corridor import run_corridor
from baqueano.compare.divergence import cut_at_divergence, divergence_s, estimator_failure, invalid_covariance
from baqueano.compare.filter_consistency import filter_consistency
from baqueano.compare.laps import run_laps
from baqueano.contracts.calls import checked_call, flatten_arguments
from baqueano.contracts.result import Result, Result as Fit
from baqueano.diagnostics import Diagnostic
from baqueano.errors import Misuse, UsageError, error_cause
from baqueano.monitor import rejections_in
from baqueano.on_demand import registered_function
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.compare.evenness import SpeedErrors

UNKNOWN_DISTANCES = PathDistances(float("nan"), float("nan"), float("nan"))


@overload
def compare(
    *runs: "Run | Sequence[Run] | Mapping[str, Run]",
    alignment: str = "none",
    interval_s: float = 1.0,
    skip_s: float = 0.0,
    names: Sequence[str] | None = None,
) -> Comparison:
    """Compare runs by their errors and the consistency of their filter."""


@overload
def compare(*runs: Fit | Sequence[Fit] | Mapping[str, Fit], names: Sequence[str] | None = None) -> Result:
    """Compare fits by their parameters."""


@checked_call("bq.compare(first, second)")
def compare(
    *runs: "Run | Fit | Sequence[Run | Fit] | Mapping[str, Run | Fit]",  # checked_call reads the names
    alignment: str = "none",
    interval_s: float = 1.0,
    skip_s: float = 0.0,
    names: Sequence[str] | None = None,
) -> Comparison | Result:
    """Compare runs by their errors and the consistency of their filter, or fits by their parameters.

    Parameters
    ----------
    *runs : Run or Fit
        One after the other, in a list, or in a dict with their names. Runs are compared with the path of the first.
    alignment : str
        Alignment of estimate and truth: "none" (both in one map), "start" or "rigid"; only "none" allows a NEES.
    interval_s : float
        Time span of the relative error.
    skip_s : float
        Seconds at the start that are ignored; the rest before a drive is always ignored.
    names : sequence of str, optional
        Names that replace the names of the runs. Equal names are numbered.

    Returns
    -------
    Comparison or ParameterHistory
        A row per run; for fits the parameters of each fit, in this order, and the ones that changed.

    Raises
    ------
    UsageError
        For another alignment, a span that is not above 0, no `runs`, or another number of names.
    Misuse
        For runs beside fits.

    Examples
    --------
    >>> from baqueano.drive import repeat
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> errors = compare(repeat(load("small"), circle(0.3, 0.2))).runs[0]
    >>> print(f"{100 * errors.across_true.rms_m:.0f} cm rms across its route, NIS {errors.consistency.nis.mean:.1f}")
    0 cm rms across its route, NIS 0.8
    """
    items = flatten_arguments(runs)
    if not items:
        raise UsageError.of("compare.no-runs")
    labels = [name for part in runs if isinstance(part, Mapping) for name in part] if names is None else names
    if labels and len(labels) != len(items):
        raise UsageError.of("compare.names", names=len(labels), runs=len(items))
    run_list = [item for item in items if isinstance(item, Run)]
    if not run_list:
        return registered_function("compare_fits")(items, labels)
    if len(run_list) < len(items):
        raise Misuse.of("compare.mixed", "bq.compare(run, other)")
    return _compare_runs(
        run_list, alignment, interval_s, skip_s, _distinct(labels or [run.name for run in run_list])
    )


def _distinct(names: Sequence[str]) -> list[str]:
    """Return the names, with a number behind a name that occurs again.

    >>> _distinct(["repeat", "replay", "repeat"])
    ['repeat', 'replay', 'repeat 2']
    """
    counts = [names[: k + 1].count(name) for k, name in enumerate(names)]
    return [name if n == 1 else f"{name} {n}" for name, n in zip(names, counts, strict=True)]


def _compare_runs(
    run_list: Sequence[Run], alignment: str, interval_s: float, skip_s: float, labels: Sequence[str]
) -> Comparison:
    if not (interval_s > 0.0 and skip_s >= 0.0):
        raise UsageError.of("compare.times", interval_s=interval_s, skip_s=skip_s)
    errors.align_trajectory(np.zeros((0, 3)), np.zeros((0, 3)), alignment)
    cut_runs = [run.cut(skip_s) if skip_s else run for run in (r.without_rest for r in run_list)]
    failures = [estimator_failure(run, cut.start_ns) for run, cut in zip(run_list, cut_runs, strict=True)]
    return Comparison(
        tuple(
            _run_comparison(run, name, cut_runs[0], alignment, interval_s, failure)
            for run, name, failure in zip(cut_runs, labels, failures, strict=True)
        ),
        alignment,
        interval_s,
        all(run.metadata.get("kind") != "replay" for run in cut_runs),
    )


def _run_comparison(
    run: Run, name: str, first: Run, alignment: str, interval_s: float, failure: Diagnostic | None
) -> RunComparison:
    end_s, run = float("nan") if failure else divergence_s(run), cut_at_divergence(run)
    figures = dict.fromkeys(
        ("ate_m", "ate_heading_rad", "rpe_m", "rpe_heading_rad", "speed_error_m_s", "yaw_rate_error_rad_s",
         "end_error_m"), float("nan"))  # fmt: skip
    if run.estimate is not None and run.truth is not None and len(run.truth.t_ns) > 1:
        figures = _truth_errors(run, alignment, interval_s)
    return RunComparison(
        name, run.duration_s, **figures,
        across_true=_path_distances(run.truth, run), across_estimate=_path_distances(run.estimate, run),
        across_first=_run_distances(run, first), pace_true=_speed_errors(run.truth, run),
        pace_estimate=_speed_errors(run.estimate, run),
        **_command_figures(run), consistency=filter_consistency(run, alignment),
        refusals=rejections_in(run.events), laps=run_laps(run), corridor=run_corridor(run), divergence_s=end_s,
        invalid_covariance=invalid_covariance(run), failure=failure)  # fmt: skip


def _truth_errors(run: Run, alignment: str, interval_s: float) -> dict[str, float]:
    est, truth = run.estimate, run.truth
    assert est is not None
    assert truth is not None
    eta_true = interpolate_poses(est.t_ns, truth.t_ns, truth.eta)
    nu_true = interpolate_rows(est.t_ns, truth.t_ns, truth.nu)
    try:
        eta = errors.align_trajectory(est.eta, eta_true, alignment)
    except UsageError as error:
        raise UsageError.of("compare.of-run", run=run.name, cause=error_cause(error)) from error
    pose_errors = errors.absolute_pose_errors(eta, eta_true)
    drift = errors.relative_pose_errors(est.t_ns, eta, eta_true, interval_s)
    finite_errors = pose_errors.position_m[np.isfinite(pose_errors.position_m)]
    e_nu = est.nu - nu_true
    return {
        "ate_m": errors.rms(pose_errors.position_m),
        "ate_heading_rad": errors.rms(pose_errors.heading_rad),
        "rpe_m": errors.rms(drift.position_m),
        "rpe_heading_rad": errors.rms(drift.heading_rad),
        "speed_error_m_s": errors.rms(np.hypot(e_nu[:, 0], e_nu[:, 1])),
        "yaw_rate_error_rad_s": errors.rms(e_nu[:, 2]),
        "end_error_m": float(finite_errors[-1]) if finite_errors.size else float("nan"),
    }


def _path_distances(log: Any, run: Run) -> PathDistances:
    """Return the distances of a log from the reference path of its run, until the guide finished."""
    ref = run.guide_reference
    if log is None or ref is None or len(ref.t_ns) < 2 or not len(log.t_ns):
        return UNKNOWN_DISTANCES
    if not np.ptp(ref.eta[:, :2], axis=0).any():  # open loop, without a reference path
        return UNKNOWN_DISTANCES
    rows = evenness.active_mask(log.t_ns, ref)
    return _distance_statistics(
        errors.cross_track(log.t_ns[rows], log.eta[rows, :2], ref.t_ns, ref.eta[:, :2])
    )


def _speed_errors(log: Any, run: Run) -> "SpeedErrors":
    """Return the errors of the forward speed of a log against the reference speed, until the guide finished."""
    ref = run.guide_reference
    if log is None or ref is None or not len(ref.t_ns):
        return evenness.UNKNOWN_SPEED_ERRORS
    k = evenness.active_mask(log.t_ns, ref)
    reference_speed = interpolate_rows(log.t_ns[k], ref.t_ns, ref.nu[:, :1])[:, 0]
    return evenness.speed_errors(log.t_ns[k], log.nu[k, 0], reference_speed)


def _command_figures(run: Run) -> dict[str, float]:
    """Return the share at a limit of the sent command until the guide finished, and its sign changes until it brakes.

    If the sent command was not recorded, use the applied command.
    """
    ref, limits = run.guide_reference, evenness.read_limits(run.vehicle_text)
    t_ns, u = run.t_ns, run.applied_commands if run.sent_commands is None else run.sent_commands
    drives = slice(None)
    if ref is not None and len(ref.t_ns):
        k = evenness.active_mask(t_ns, ref)
        t_ns, u = t_ns[k], u[k]
        drives = evenness.is_driving(t_ns, interpolate_rows(t_ns, ref.t_ns, ref.nu[:, :1])[:, 0], 0.0)
    changes = evenness.sign_changes(t_ns[drives], u[drives, 0]) if u.size else float("nan")
    return {"sign_changes_per_s": changes, "saturated_fraction": evenness.share_at_limit(u, limits)}


def _run_distances(run: Run, first: Run) -> PathDistances:
    """Return the distances of the vehicle from the path of another run; times begin with each run."""
    if run is first:
        return UNKNOWN_DISTANCES
    a, b = (r.truth if r.truth is not None else r.estimate for r in (run, first))
    if a is None or b is None or len(b.t_ns) < 2 or not len(a.t_ns):
        return UNKNOWN_DISTANCES
    a_ns, b_ns = a.t_ns - a.t_ns[0], b.t_ns - b.t_ns[0]
    is_common = a_ns <= b_ns[-1]
    return _distance_statistics(errors.cross_track(a_ns[is_common], a.eta[is_common, :2], b_ns, b.eta[:, :2]))


def _distance_statistics(distance: np.ndarray) -> PathDistances:
    d = np.abs(distance[np.isfinite(distance)])
    if d.size:
        return PathDistances(errors.rms(d), float(np.percentile(d, 95)), float(np.max(d)))
    return UNKNOWN_DISTANCES
