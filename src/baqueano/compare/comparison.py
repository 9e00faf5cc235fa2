"""Compare runs by the errors of estimate and vehicle, and by the consistency of the filter.

Each run has a row with the errors of the estimate against the truth (errors.py) and of the vehicle against its
reference. The row also contains the evenness of the drive (evenness.py), NEES and NIS (filter_consistency.py), and the
corridor at the end (corridor.py). A value that the run does not determine is NaN, never 0. With two or more runs of the
same route, each row also contains the distance of the run's vehicle from the first run's path.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.compare import errors, evenness
from baqueano.compare.corridor import Corridor, corridor_of, corridor_row
from baqueano.compare.divergence import InvalidCovariance, cut_at_divergence, divergence_s, invalid_covariance
from baqueano.compare.filter_consistency import FilterConsistency, filter_consistency
from baqueano.compare.laps import DriveLap, laps_of
from baqueano.compare.table import table
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result, shorten
from baqueano.diagnostics import Diagnostic, Severity, Verdict, fault, note
from baqueano.errors import UsageError, cause_of
from baqueano.messages import text, verdict_line
from baqueano.messages.language import number
from baqueano.messages.text_table import LINE_LETTERS
from baqueano.monitor import Rejections, rejections_in
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows

if TYPE_CHECKING:
    from baqueano.compare.evenness import SpeedErrors
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.runs.run import Run


class PathDistances(NamedTuple):
    """The distances of a vehicle from a path over a run: rms, 95 % quantile, and largest value."""

    rms_m: float
    p95_m: float
    max_m: float


UNKNOWN_DISTANCES = PathDistances(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True, slots=True, eq=False)
class RunComparison:
    """The errors of a run, and the consistency of its filter."""

    name: str
    duration_s: float
    ate_m: float  # estimate against truth, rms
    ate_heading_rad: float
    rpe_m: float  # over `over_s`, rms
    rpe_heading_rad: float
    speed_error_m_s: float  # ν_x, ν_y of the estimate against the truth, rms
    yaw_rate_error_rad_s: float
    end_error_m: float  # estimate against truth at the last time of both
    across_true: PathDistances  # cross-track error of the vehicle, by the truth
    across_estimate: PathDistances  # the same, by the estimate
    across_first: PathDistances  # cross-track distance of the vehicle from the path of the first run
    pace_true: "SpeedErrors"  # forward speed against the reference speed, by the truth
    pace_estimate: "SpeedErrors"  # the same, by the estimate
    sign_changes_per_s: float  # of the forward command that was sent
    saturated_fraction: float  # share of ticks at which a sent command, or a wheel, is at its limit
    consistency: FilterConsistency
    corridor: Corridor | None  # None: the estimator does not report a covariance of the pose
    divergence_s: float  # time from which the estimate has diverged; NaN: never
    invalid_covariance: InvalidCovariance | None  # None: the covariance is valid at every tick
    refusals: tuple[
        Rejections, ...
    ] = ()  # how often the estimator rejected each channel; empty: rejections are not recorded
    laps: tuple[DriveLap, ...] = ()  # laps of a route that returns to its beginning

    @property
    def verdict(self) -> str:
        """Return DIVERGED if the estimate diverged, else NOT_DEFINITE if a covariance is not valid.
        Otherwise return the consistency of the estimate, by NEES if the truth is known, else by NIS.
        """
        if np.isfinite(self.divergence_s):
            return DIVERGED
        return self.consistency.verdict if self.invalid_covariance is None else NOT_DEFINITE

    @property
    def is_overconfident(self) -> bool:
        """Return True if the errors of the estimate are larger than its covariance predicts."""
        return self.verdict == "too sure"

    def row(self) -> "JsonObject":
        """Return a flat row in SI units for programs."""
        row: TableRow = {"run": self.name, "duration_s": self.duration_s}
        for name in ("ate_m", "ate_heading_rad", "rpe_m", "rpe_heading_rad", "speed_error_m_s"):
            row[name] = getattr(self, name)
        row |= {"yaw_rate_error_rad_s": self.yaw_rate_error_rad_s, "end_error_m": self.end_error_m}
        for name in ("across_true", "across_estimate", "across_first", "pace_true", "pace_estimate"):
            row |= {f"{name}_{key}": value for key, value in getattr(self, name)._asdict().items()}
        row |= {"sign_changes_per_s": self.sign_changes_per_s, "saturated_fraction": self.saturated_fraction}
        row |= self.consistency.row()
        for refusal in self.refusals:
            row |= {
                f"rejections_{refusal.name}": refusal.rejected_count,
                f"readings_{refusal.name}": refusal.reading_count,
            }
        row |= {"laps": len(self.laps)}
        row |= {"verdict": self.verdict, "sentence": self.sentences[-1], "divergence_s": self.divergence_s}
        return row | corridor_row(self.corridor)

    def lines(self) -> list[str]:
        """Return lines with the known errors of the run [cm rms], and with its sentences."""
        errors = (
            ("front.across-true", self.across_true.rms_m), ("front.across-estimate", self.across_estimate.rms_m),
            ("front.position-off", self.ate_m), ("front.across-first", self.across_first.rms_m),
        )  # fmt: skip
        sentences = [text(note(code, cm=100.0 * m)) for code, m in errors if np.isfinite(m)]
        return [
            f"{self.name}, {number(self.duration_s):.1f} s: {', '.join(sentences)}",
            *(f"  {sentence}" for sentence in self.sentences),
        ]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return sentences on the laps, the corridor at the end and consistency.
        If the estimate diverged or a covariance is not valid, return only a sentence about this.
        """
        if np.isfinite(self.divergence_s):
            return (text(note("compare.diverged", t_s=self.divergence_s)),)
        if self.invalid_covariance is not None:
            return (text(note("compare.no-covariance", **self.invalid_covariance._asdict())),)
        corridor_sentences = () if self.corridor is None else (self.corridor.sentence,)
        return (*self._lap_sentences(), *corridor_sentences, self.consistency.sentence)

    def _lap_sentences(self) -> tuple[str, ...]:
        """Return a sentence about the laps if there were at least two, else an empty tuple."""
        if len(self.laps) < 2:
            return ()
        first, last, worst_lap = self.laps[0], self.laps[-1], max(self.laps, key=lambda lap: lap.max_m)
        figures = {"first_cm": first.rms_m, "last_cm": last.rms_m, "most_cm": worst_lap.max_m}
        figures |= {"gap_cm": max(lap.gap_m for lap in self.laps)}
        figures = {name: 100.0 * m for name, m in figures.items()}
        values = {"laps": len(self.laps), "worst": worst_lap.number, "seconds": last.duration_s}
        return (text(note("compare.laps", **figures, **values)),)


NOT_DEFINITE, DIVERGED = "not definite", "diverged"
ADVICE_CODES = {"too sure": "compare.advice-too-sure", "too cautious": "compare.advice-too-cautious"}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Comparison(Result):
    """The comparison of one or more runs by the same measures.

    Attributes
    ----------
    runs : tuple of RunComparison
        The measures of each run.
    alignment : str
        Alignment of the estimate with the truth: "none", "start" or "rigid".
    over_s : float
        Time span of the relative error.
    of_drives : bool
        False if a run is a replay, because its vehicle drove with another estimate.

    Examples
    --------
    >>> still = bq.simulate(bq.load("small"), np.zeros((20, 3)))
    >>> [row["duration_s"] for row in compare(still).rows()]
    [0.19]
    """

    runs: tuple[RunComparison, ...]
    alignment: str
    over_s: float
    of_drives: bool

    def __repr__(self) -> str:
        rows = [line for run in self.runs for line in run.lines()]
        return shorten([], rows, [verdict_line(self.verdict, self.reasons)])

    def rows(self) -> list["TableRow"]:
        """Return a flat row for each run."""
        return [run.row() for run in self.runs]

    def laps(self) -> list["TableRow"]:
        """Return a flat row for each lap of each run. Only routes that return to their beginning have laps."""
        return [{"run": run.name, **lap.row()} for run in self.runs for lap in run.laps]

    @property
    def verdict(self) -> Verdict:
        """Return INCONSISTENT if `reasons` is not empty, and NOT REPORTED if all verdicts are "not reported".
        Otherwise return CONSISTENT if all reported verdicts are consistent, else CANNOT TELL.
        """
        if self.reasons:
            return Verdict.INCONSISTENT
        verdicts = {run.verdict for run in self.runs} - {"not reported"}
        if not verdicts:
            return Verdict.NOT_REPORTED
        return Verdict.CONSISTENT if verdicts == {"consistent"} else Verdict.CANNOT_TELL

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return a warning with the verdict for each run that is inconsistent."""
        return tuple(
            note("compare.inconsistent", Severity.WARNING, subject=run.name, how=run.verdict)
            for run in self.runs
            if run.verdict in (*ADVICE_CODES, NOT_DEFINITE, DIVERGED)
        )

    def table(self) -> str:
        """Return a text, 80 columns wide: a table with a column for each run, then the sentences about each run."""
        sentences = [f"{run.name}: {sentence}" for run in self.runs for sentence in run.sentences]
        sentences += [verdict_line(self.verdict, self.reasons), *self._advice()]
        return "\n".join(
            [
                table(self),
                "",
                *(fill(sentence, LINE_LETTERS, subsequent_indent="  ") for sentence in sentences),
            ]
        )

    def _advice(self) -> list[str]:
        """Return advice for each kind of inconsistent covariance that occurred."""
        return [
            text(note(ADVICE_CODES[verdict]))
            for verdict in dict.fromkeys(run.verdict for run in self.runs)
            if verdict in ADVICE_CODES
        ]


@checked_call("bq.compare([first, second])")
def compare(
    runs: "Sequence[Run] | Run",
    alignment: str = "none",
    over_s: float = 1.0,
    skip_s: float = 0.0,
    names: Sequence[str] | None = None,
) -> Comparison:
    """Measure the errors of each estimate and vehicle, and the consistency of the filter.

    Parameters
    ----------
    runs : Run or sequence of Run
        The runs; across_first is the distance from the path of the first run.
    alignment : str
        Alignment of estimate and truth: "none" (both in one map), "start" or "rigid"; only "none" allows a NEES.
    over_s : float
        Time span of the relative error.
    skip_s : float
        Seconds at the start that are ignored; the rest before a drive is always ignored.
    names : sequence of str, optional
        Names that replace the names of the runs.

    Returns
    -------
    Comparison
        A row per run.

    Raises
    ------
    UsageError
        For another alignment, a span that is not above 0, an empty `runs`, or another number of names than of runs.

    Examples
    --------
    >>> from baqueano.drive import repeat
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> errors = compare(repeat(load("small"), circle(0.3, 0.2))).runs[0]
    >>> print(f"{100 * errors.across_true.rms_m:.0f} cm rms across its route, NIS {errors.consistency.nis.mean:.1f}")
    0 cm rms across its route, NIS 0.7
    """
    run_list = [runs] if not isinstance(runs, Sequence) else list(runs)
    if not run_list:
        raise UsageError(fault("compare.no-runs"))
    if not (over_s > 0.0 and skip_s >= 0.0):
        raise UsageError(fault("compare.times", over_s=over_s, skip_s=skip_s))
    errors.align_trajectory(np.zeros((0, 3)), np.zeros((0, 3)), alignment)
    cut_runs = [run.cut(skip_s) if skip_s else run for run in (r.without_rest for r in run_list)]
    labels = list(names) if names else [run.name for run in run_list]
    if len(labels) != len(run_list):
        raise UsageError(fault("compare.names", names=len(labels), runs=len(run_list)))
    return Comparison(
        tuple(
            _run_comparison(run, name, cut_runs[0], alignment, over_s)
            for run, name in zip(cut_runs, labels, strict=True)
        ),
        alignment,
        over_s,
        all(run.metadata.get("kind") != "replay" for run in cut_runs),
    )


def _run_comparison(run: "Run", name: str, first: "Run", alignment: str, over_s: float) -> RunComparison:
    end_s, run = divergence_s(run), cut_at_divergence(run)  # the errors are those before the divergence
    figures = dict.fromkeys(
        ("ate_m", "ate_heading_rad", "rpe_m", "rpe_heading_rad", "speed_error_m_s", "yaw_rate_error_rad_s",
         "end_error_m"), float("nan"))  # fmt: skip
    if run.estimate is not None and run.truth is not None and len(run.truth.t_ns) > 1:
        figures = _against_truth(run, alignment, over_s)
    return RunComparison(
        name, run.duration_s, **figures,
        across_true=_path_distances(run.truth, run), across_estimate=_path_distances(run.estimate, run),
        across_first=_distances_between_runs(run, first), pace_true=_speed_errors(run.truth, run),
        pace_estimate=_speed_errors(run.estimate, run),
        **_command_figures(run), consistency=filter_consistency(run, alignment),
        refusals=rejections_in(run.events), laps=laps_of(run), corridor=corridor_of(run), divergence_s=end_s,
        invalid_covariance=invalid_covariance(run))  # fmt: skip


def _against_truth(run: "Run", alignment: str, over_s: float) -> dict[str, float]:
    est, truth = run.estimate, run.truth
    assert est is not None
    assert truth is not None
    eta_true = interpolate_poses(est.t_ns, truth.t_ns, truth.eta)
    nu_true = interpolate_rows(est.t_ns, truth.t_ns, truth.nu)
    try:
        eta = errors.align_trajectory(est.eta, eta_true, alignment)
    except UsageError as error:
        raise UsageError(fault("compare.of-run", run=run.name, cause=cause_of(error))) from error
    pose_errors = errors.absolute_pose_errors(eta, eta_true)
    drift = errors.relative_pose_errors(est.t_ns, eta, eta_true, over_s)
    known_errors = pose_errors.position_m[np.isfinite(pose_errors.position_m)]
    e_nu = est.nu - nu_true
    return {
        "ate_m": errors.rms(pose_errors.position_m),
        "ate_heading_rad": errors.rms(pose_errors.heading_rad),
        "rpe_m": errors.rms(drift.position_m),
        "rpe_heading_rad": errors.rms(drift.heading_rad),
        "speed_error_m_s": errors.rms(np.hypot(e_nu[:, 0], e_nu[:, 1])),
        "yaw_rate_error_rad_s": errors.rms(e_nu[:, 2]),
        "end_error_m": float(known_errors[-1]) if known_errors.size else float("nan"),
    }


def _path_distances(log: Any, run: "Run") -> PathDistances:
    """Return the distances of a log from the reference path of its run, until the guide finished."""
    ref = run.guide_reference
    if log is None or ref is None or len(ref.t_ns) < 2 or not len(log.t_ns):
        return UNKNOWN_DISTANCES
    if not np.ptp(ref.eta[:, :2], axis=0).any():  # open loop: the run has no reference path
        return UNKNOWN_DISTANCES
    rows = _until_done(log.t_ns, ref)
    return _distance_statistics(
        errors.cross_track(log.t_ns[rows], log.eta[rows, :2], ref.t_ns, ref.eta[:, :2])
    )


def _speed_errors(log: Any, run: "Run") -> "SpeedErrors":
    """Return the errors of the forward speed of a log against the reference speed, until the guide finished."""
    ref = run.guide_reference
    if log is None or ref is None or not len(ref.t_ns):
        return evenness.UNKNOWN_SPEED_ERRORS
    k = _until_done(log.t_ns, ref)
    reference_speed = interpolate_rows(log.t_ns[k], ref.t_ns, ref.nu[:, :1])[:, 0]
    return evenness.speed_errors(log.t_ns[k], log.nu[k, 0], reference_speed)


def _command_figures(run: "Run") -> dict[str, float]:
    """Return the share at a limit of the sent command until the guide finished, and its sign changes until it brakes.

    If the sent command was not recorded, use the applied command.
    """
    ref, limits = run.guide_reference, evenness.limits_of(run.vehicle_text)
    t_ns, u = run.t_ns, run.applied_commands if run.sent_commands is None else run.sent_commands
    drives = slice(None)
    if ref is not None and len(ref.t_ns):
        k = _until_done(t_ns, ref)
        t_ns, u = t_ns[k], u[k]
        drives = evenness.is_driving(t_ns, interpolate_rows(t_ns, ref.t_ns, ref.nu[:, :1])[:, 0], 0.0)
    changes = evenness.sign_changes(t_ns[drives], u[drives, 0]) if u.size else float("nan")
    return {"sign_changes_per_s": changes, "saturated_fraction": evenness.share_at_limit(u, limits)}


def _until_done(t_ns: np.ndarray, ref: Any) -> np.ndarray:
    """Return a mask (N,): True until the guide finished, or until the last reference if it did not finish."""
    done_ns = ref.t_ns[ref.done > 0.0]
    return t_ns <= (done_ns[0] if done_ns.size else ref.t_ns[-1])


def _distances_between_runs(run: "Run", first: "Run") -> PathDistances:
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
    return (
        PathDistances(errors.rms(d), float(np.percentile(d, 95)), float(np.max(d)))
        if d.size
        else UNKNOWN_DISTANCES
    )
