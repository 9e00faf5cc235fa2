"""`baqueano study identification`: evaluate the errors, intervals and verdicts of simulated fits (trials.py).

    rmse_i / bound_i = √(mean (p̂_i − p_i)²) / √(mean b_i²)      both means over the same fits              (1)

b is the bound of bound.py. If the true value of a parameter is its lower limit, its error can be below the bound, so
this parameter is not pooled. An interval is included if the fit was not refused and the parameter is identifiable. A
parameter is named if a reason of the verdict states its possible error. With normal noise, Huber's estimator has an
error of 1.026 bounds (an efficiency of 95 %).
"""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.contracts.result import Result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.messages import verdict_line
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.study.identification.trials import CASES, DRIVE_S, TrialJob, TrialOutcome, fit_job
from baqueano.study.wrong_estimates import wrong_mask
from baqueano.sweep.workers import run_in_batches

SEEDS, BATCH = 200, 8  # number of robots; number of robots that are simulated together
POOL = "pooled"
LOWER_BOUND_PARAMETERS = ("model.friction.quadratic[1]",)  # its true value is 0
LIMIT_SIGMA = 3.0  # standard errors; they widen the limits for few seeds


class CaseLimits(NamedTuple):
    """The limits of a case: fractions of intervals, ratios to the bound, fractions of fits."""

    coverage: float = 0.0  # of all intervals, at least
    max_coverage: float = 1.0
    coverage_each: float = 0.0  # of the intervals of one parameter, at least
    rmse: float = np.inf
    rmse_each: float = np.inf
    width: float = np.inf  # median of standard error / bound
    usable: float = 0.0
    covered_or_named: float = 0.0
    named_fraction: float = 1.0  # largest fraction of the fits that name a parameter


LIMITS = {
    "clean": CaseLimits(0.93, 0.97, 0.88, 1.10, 1.25, usable=0.95),
    "rough": CaseLimits(0.92, width=1.5),
    "floor": CaseLimits(0.92, usable=0.80),
    "floor, innovations": CaseLimits(0.92, usable=0.80),
    "low-passed": CaseLimits(),
    "wrong start": CaseLimits(),
    "matched": CaseLimits(0.85, named_fraction=0.10),
    "understeer": CaseLimits(covered_or_named=0.85),
}


@dataclass(frozen=True)
class Identification(Result):
    """The outcomes of all fits; fewer than requested after an interruption."""

    outcomes: tuple[TrialOutcome, ...]
    requested_seeds: int

    @property
    def seeds(self) -> int:
        """Return the number of seeds that have outcomes."""
        return len({o.seed for o in self.outcomes})

    def case_outcomes(self, case: str) -> list[TrialOutcome]:
        """Return the outcomes of a case."""
        return [o for o in self.outcomes if o.case == case]

    def normalised_errors(self) -> np.ndarray:
        """Return all errors (K,) of the case "clean", each divided by its standard error."""
        return np.concatenate([np.zeros(0), *(_outcome_z(o) for o in self.case_outcomes("clean"))])

    def rows(self) -> list[TableRow]:
        """Return a flat row for each case and parameter, and a pooled row for each case."""
        return [
            row for case in CASES if self.case_outcomes(case) for row in _rows(case, self.case_outcomes(case))
        ]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each limit that is exceeded."""
        return tuple(reason for row in self.rows() for reason in _reasons(row))

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a limit is exceeded, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return a text table of each case, and of the parameters of the first case."""
        rows, head = self.rows(), [_("fits"), _("coverage"), _("rmse"), _("std")]
        cases = (
            [_(row["case"]), *_figures(row), f"{number(100 * row['usable']):.0f} %", str(row["wrongly_usable"]),
             f"{number(100 * row['report_share']):.0f} %"]
            for row in rows if row["name"] == POOL
        )  # fmt: skip
        first, parameters = rows[0]["case"], (row for row in rows if row["name"] != POOL)
        lines = [
            _("{seeds} of {requested} seeds", seeds=self.seeds, requested=self.requested_seeds),
            *text_table("<>>>>>>>", [_("case"), *head, _("usable"), _("wrong"), _("named")], *cases),
            "",
            f"{_(first)}:",
            *text_table("<>>>>", ["", *head], *(
                [row["name"].removeprefix("model."), *_figures(row)] for row in parameters if row["case"] == first
            )),
        ]  # fmt: skip
        message = _("every limit is met, within the scatter of {seeds} seeds", seeds=self.seeds)
        lines += [
            "",
            _(
                "coverage: of the 95 % intervals. rmse, std: in Cramér-Rao bounds. wrong: wrong fits "
                "with the verdict USABLE."
            ),
        ]
        return "\n".join([*lines, verdict_line(self.verdict, self.reasons, message)])


def _rows(case: str, outcomes: list[TrialOutcome]) -> list[TableRow]:
    names = list(dict.fromkeys(name for o in outcomes for name in o.names))
    parameter_rows = [_row(case, name, outcomes, (name,)) for name in names]
    return [_row(case, POOL, outcomes, tuple(names)), *parameter_rows]


def _row(case: str, name: str, outcomes: list[TrialOutcome], names: tuple[str, ...]) -> JsonObject:
    accepted_fits = [o for o in outcomes if o.verdict != Verdict.REFUSED]
    z, reports, ratios, widths = [], [], [], []
    for parameter in names:
        entries = [(o, o.names.index(parameter)) for o in accepted_fits if parameter in o.names]
        entries = [(o, k) for o, k in entries if np.isfinite(o.std[k]) and np.isfinite(o.estimate[k])]
        z += [(o.estimate[k] - o.truth[k]) / o.std[k] for o, k in entries]
        reports += [_is_reported(o, parameter) for o, _ in entries]
        if entries and np.isfinite(bound := np.array([o.bound[k] for o, k in entries])).all():
            error = np.array([o.estimate[k] - o.truth[k] for o, k in entries])
            widths.append(float(np.median([o.std[k] / o.bound[k] for o, k in entries])))
            if parameter not in LOWER_BOUND_PARAMETERS or len(names) == 1:
                ratios.append(float(np.sqrt(np.mean(error**2) / np.mean(bound**2))))
    is_covered, is_reported = np.abs(np.array(z)) <= QUANTILE_95, np.array(reports, dtype=bool)
    usable = [o for o in outcomes if o.verdict == Verdict.USABLE]
    return {
        "case": case, "name": name, "fits": len(outcomes), "intervals": len(z), "coverage": _mean(is_covered),
        "coverage_or_report": _mean(is_covered | is_reported), "report_share": _mean(is_reported),
        "rmse": float(np.sqrt(np.mean(np.square(ratios)))) if ratios else None,
        "std": float(np.median(widths)) if widths else None, "usable": len(usable) / len(outcomes),
        "wrongly_usable": sum(bool(np.any(wrong_mask(o.estimate, o.std, o.truth))) for o in usable),
        "silent_failures": sum(not o.is_same_optimum and o.verdict != Verdict.REFUSED for o in outcomes),
        "fits_with_reports": _mean(np.array([any(_is_reported(o, name) for name in o.names) for o in outcomes])),
    }  # fmt: skip


def _reasons(row: TableRow) -> list[str]:
    """Return a sentence for each limit that a row exceeds by more than chance explains for its number of seeds."""
    limit, is_pool, n = LIMITS[row["case"]], row["name"] == POOL, max(row["fits"], 1)
    tolerance = LIMIT_SIGMA * np.sqrt(0.95 * 0.05 / max(row["intervals"], 1))
    chance_rmse = 1.0 + LIMIT_SIGMA / np.sqrt(2.0 * max(row["intervals"], 1))
    min_coverage, rmse = (limit.coverage, limit.rmse) if is_pool else (limit.coverage_each, limit.rmse_each)
    reasons = []
    if row["coverage"] < min(min_coverage, 0.95 - tolerance) or (
        is_pool and row["coverage"] > max(limit.max_coverage, 0.95 + tolerance)
    ):
        reasons.append(_("{holds:.1f} % of the intervals contain the truth", holds=100 * row["coverage"]))
    if row["rmse"] is not None and row["rmse"] > max(rmse, chance_rmse):
        reasons.append(_("rmse {rmse:.3f} bounds", rmse=row["rmse"]))
    if is_pool:
        if row["std"] is not None and row["std"] > limit.width:
            reasons.append(_("standard errors of {std:.2f} bounds", std=row["std"]))
        if row["usable"] < limit.usable - LIMIT_SIGMA * np.sqrt(limit.usable * (1.0 - limit.usable) / n):
            reasons.append(
                _(
                    "{usable:.0f} % USABLE, expected {expected:.0f} %",
                    usable=100 * row["usable"],
                    expected=100 * limit.usable,
                )
            )
        if row["coverage_or_report"] < min(limit.covered_or_named, 0.95 - tolerance):
            reasons.append(
                _(
                    "{percent:.0f} % of the parameters are in their interval or named",
                    percent=100 * row["coverage_or_report"],
                )
            )
        if row["fits_with_reports"] > limit.named_fraction + LIMIT_SIGMA * np.sqrt(
            limit.named_fraction * (1.0 - limit.named_fraction) / n
        ):
            reasons.append(
                _("{percent:.0f} % of the fits name a parameter", percent=100 * row["fits_with_reports"])
            )
        if row["wrongly_usable"]:
            reasons.append(
                _("{wrongly_usable} wrong fits were called USABLE", wrongly_usable=row["wrongly_usable"])
            )
        if row["silent_failures"]:
            reasons.append(
                _("{silent} ended in another minimum without a warning", silent=row["silent_failures"])
            )
    return [f"{_(row['case'])}, {row['name'].removeprefix('model.')}: {text}" for text in reasons]


def identification(
    seeds: int = SEEDS, first: int = 0, backend: str = "auto", processes: int = 1,
    advance: Callable[[int], None] | None = None, *, cases: Sequence[str] = CASES, duration_s: float = DRIVE_S,
    drives_folder: Path | None = None,
) -> Identification:  # fmt: skip
    """Return the outcomes of the fits of vehicles `first` … `first + seeds − 1` of each case. The fits run in
    `processes` processes.

    `advance` is called with the number of seeds that have just finished. Ctrl-C ends the study with the finished
    results, and raises KeyboardInterrupt before the first result. Outcomes are stored in `drives_folder`, and not
    computed again.
    """
    if drives_folder is not None:
        drives_folder.mkdir(parents=True, exist_ok=True)
    work = partial(
        _batch_outcomes,
        cases=tuple(cases),
        backend=backend,
        duration_s=duration_s,
        drives_folder=drives_folder,
    )
    finished_batches = run_in_batches(work, range(first, first + seeds), BATCH, processes, advance)
    if not finished_batches:
        raise KeyboardInterrupt
    outcomes = sorted(
        (o for batch in finished_batches for o in batch), key=lambda o: (CASES.index(o.case), o.seed)
    )
    return Identification(tuple(outcomes), seeds)


def _batch_outcomes(
    seeds: range, cases: tuple[str, ...], backend: str, duration_s: float, drives_folder: Path | None
) -> list[TrialOutcome]:
    """Return the outcomes of the seeds, read from `drives_folder` if they are stored there."""
    job = TrialJob(tuple(seeds), cases, backend, duration_s)
    if drives_folder is None:
        return fit_job(job)
    numbers = "-".join(str(CASES.index(case)) for case in cases)
    path = drives_folder / f"{seeds[0]}to{seeds[-1]}_cases{numbers}_{duration_s:g}s.pickle"
    if not path.exists():
        replace_file(path, pickle.dumps(fit_job(job)))
    return pickle.loads(path.read_bytes())


# reasons that name the parameter which they would change
MISSING_TERM_CODES = ("residual.missing", "residual.missing-free")


def _outcome_z(o: TrialOutcome) -> np.ndarray:
    identifiable = np.isfinite(o.std) & np.isfinite(o.estimate) & (o.verdict != Verdict.REFUSED)
    return (o.estimate[identifiable] - o.truth[identifiable]) / o.std[identifiable]


def _is_reported(o: TrialOutcome, name: str) -> bool:
    return any(code in MISSING_TERM_CODES and name == subject for code, subject in o.reasons)


def _mean(x: np.ndarray) -> float:
    return float(np.mean(x)) if len(x) else 0.0


def _figures(row: TableRow) -> list[str]:
    ratios = ("" if row[key] is None else f"{number(row[key]):.2f}" for key in ("rmse", "std"))
    return [str(row["fits"]), f"{number(100 * row['coverage']):.1f} %", *ratios]
