"""Compare runs by the errors of estimate and vehicle, and by the consistency of the filter.

Each run has a row with the errors of the estimate against the truth (errors.py) and of the vehicle against its
reference. The row also contains the evenness of the drive (evenness.py), NEES and NIS (filter_consistency.py), and the
corridor at the end (corridor.py). A value that the run does not determine is NaN, never 0. With two or more runs of the
same route, each row also contains the distance of the run's vehicle from the first run's path.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.compare.corridor import Corridor, corridor_row
from baqueano.compare.divergence import InvalidCovariance
from baqueano.compare.filter_consistency import FilterConsistency
from baqueano.compare.laps import DriveLap
from baqueano.compare.table import table, table_sections
from baqueano.contracts.result import PrintedTable, Result, shorten, wrap_sentences
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import text, verdict_line
from baqueano.messages.language import mark as N_, number
from baqueano.messages.text_table import LINE_LETTERS
from baqueano.monitor import Rejections

if TYPE_CHECKING:
    from baqueano.compare.evenness import SpeedErrors


class PathDistances(NamedTuple):
    """The distances of a vehicle from a path over a run: rms, 95 % quantile, and largest value."""

    rms_m: float
    p95_m: float
    max_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RunComparison:
    """The errors of a run, and the consistency of its filter."""

    name: str
    duration_s: float
    ate_m: float  # estimate against truth, rms
    ate_heading_rad: float
    rpe_m: float  # over `interval_s`, rms
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
    # how often the estimator rejected each channel; empty: rejections are not recorded
    refusals: tuple[Rejections, ...] = ()
    failure: Diagnostic | None = None  # of the estimator: the error that ended it
    laps: tuple[DriveLap, ...] = ()  # laps of a route that returns to its beginning

    @property
    def verdict(self) -> str:
        """Return FAILED or DIVERGED if the estimator did, else NOT_DEFINITE if a covariance is not valid.
        Otherwise return the consistency of the estimate, by NEES if the truth is known, else by NIS.
        """
        if self.failure is not None or np.isfinite(self.divergence_s):
            return FAILED if self.failure else DIVERGED
        return self.consistency.verdict if self.invalid_covariance is None else NOT_DEFINITE

    @property
    def is_overconfident(self) -> bool:
        """Return True if the errors of the estimate are larger than its covariance predicts."""
        return self.verdict == "too sure"

    def row(self) -> JsonObject:
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

    def errors_line(self, has_drive: bool = True) -> str:
        """Return a line with the known errors of the run [cm rms]; without `has_drive` only those of the estimate."""
        errors = (
            ("front.across-true", self.across_true.rms_m), ("front.across-estimate", self.across_estimate.rms_m),
            ("front.position-off", self.ate_m), ("front.across-first", self.across_first.rms_m),
        )  # fmt: skip
        shown_errors = errors if has_drive else errors[2:3]
        sentences = [text(note(code, cm=100.0 * m)) for code, m in shown_errors if np.isfinite(m)]
        head = f"{self.name}, {number(self.duration_s):.1f} s"
        return ": ".join(filter(None, [head, ", ".join(sentences)]))

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return sentences on the laps, the corridor at the end and consistency.
        If the estimator failed or diverged, or a covariance is not valid, return only a sentence about this.
        """
        if self.failure is not None:
            return (text(self.failure),)
        if np.isfinite(self.divergence_s):
            return (text(note("compare.diverged", t_s=self.divergence_s)),)
        if self.invalid_covariance is not None:
            return (text(note("compare.no-covariance", **self.invalid_covariance._asdict())),)
        return (*self._lap_sentences(), *self._corridor_sentences(), self.consistency.sentence)

    def _corridor_sentences(self) -> tuple[str, ...]:
        """Return a sentence on the expected error at the end, beside the true one if it is known."""
        if self.corridor is None:
            return ()
        if not np.isfinite(self.end_error_m):
            return (self.corridor.sentence,)
        error_cm = 100.0 * self.end_error_m
        return (text(note("corridor.with-truth", corridor=self.corridor.message, error_cm=error_cm)),)

    def _lap_sentences(self) -> tuple[str, ...]:
        """Return a sentence about the laps if there were at least two, else an empty tuple."""
        if len(self.laps) < 2:
            return ()
        first, last, worst_lap = self.laps[0], self.laps[-1], max(self.laps, key=lambda lap: lap.max_m)
        figures = {"first_cm": first.rms_m, "last_cm": last.rms_m, "max_cm": worst_lap.max_m}
        figures |= {"gap_cm": max(lap.gap_m for lap in self.laps)}
        figures = {name: 100.0 * m for name, m in figures.items()}
        values = {"laps": len(self.laps), "worst": worst_lap.number, "seconds": last.duration_s}
        values["quantity"] = N_("true path") if np.isfinite(self.across_true.rms_m) else N_("estimated path")
        return (text(note("compare.laps", **figures, **values)),)


NOT_DEFINITE, DIVERGED, FAILED = "not definite", "diverged", N_("failed")
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
    interval_s : float
        Time span of the relative error.
    has_drives : bool
        False if a run is a replay, because its vehicle drove with another estimate.

    Examples
    --------
    >>> still = bq.simulate(bq.load("small"), np.zeros((20, 3)))
    >>> [row["duration_s"] for row in bq.compare(still).rows()]
    [0.19]
    """

    runs: tuple[RunComparison, ...]
    alignment: str
    interval_s: float
    has_drives: bool

    def __repr__(self) -> str:
        rows = [*(run.errors_line(self.has_drives) for run in self.runs), *self.sentences]
        return shorten([], rows, [verdict_line(self.verdict, self.reasons)])

    def rows(self) -> list[TableRow]:
        """Return a flat row for each run."""
        return [run.row() for run in self.runs]

    def printed_table(self) -> PrintedTable:
        """Return the printed table as data, with a column for each run."""
        return PrintedTable(tuple(run.name for run in self.runs), table_sections(self))

    def laps(self) -> list[TableRow]:
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
            note("compare.inconsistent", Severity.WARNING, subject=run.name, verdict=run.verdict)
            for run in self.runs
            if run.verdict in (*ADVICE_CODES, NOT_DEFINITE, DIVERGED, FAILED)
        )

    def table(self) -> str:
        """Return a text, 80 columns wide: a table with a column for each run, then the sentences about each run."""
        return self._text(table(self))

    def short_table(self) -> str:
        """Return the text of `table` with only the main rows.

        Returns
        -------
        str
            At most 80 columns wide; the sentences below the table are the same as in `table`.

        Examples
        --------
        >>> comparison = bq.compare(bq.simulate(bq.load("small"), np.zeros((10, 3))))
        >>> len(comparison.short_table()) <= len(comparison.table())
        True
        """
        return self._text(table(self, is_short=True))

    def _text(self, rows: str) -> str:
        sentences = [*self.sentences, verdict_line(self.verdict, self.reasons), *self._advice()]
        return "\n".join([rows, "", *wrap_sentences(sentences, LINE_LETTERS)])

    @property
    def sentences(self) -> list[str]:
        """Return the sentences of each run, after its name."""
        return [f"{run.name}: {sentence}" for run in self.runs for sentence in run.sentences]

    def _advice(self) -> list[str]:
        """Return advice for each kind of inconsistent covariance, after the names of its runs if there are several."""
        names = {v: [run.name for run in self.runs if run.verdict == v] for v in ADVICE_CODES}
        heads = {
            v: f"{', '.join(of_verdict)}: " if len(self.runs) > 1 else "" for v, of_verdict in names.items()
        }
        return [heads[v] + text(note(code)) for v, code in ADVICE_CODES.items() if names[v]]
