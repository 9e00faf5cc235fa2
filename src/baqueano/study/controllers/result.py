"""The table of `study controllers`: each controller in three evaluations, compared with a PD that is tuned as much."""

from dataclasses import dataclass

import numpy as np

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import verdict_line
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.study.controllers.drives import ComparedController
from baqueano.sweep.result import SweepResult

EVALUATIONS = (N_("pose"), N_("estimate"), N_("truth"))
FIGURE = "across_rms_m"
MAX_RATIO = 1.0 / 3.0  # to the PD tuned over draws: the limit for the best controller if the pose is known


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Controllers(Result):
    """The drives of all robots by all controllers, grouped by evaluation.

    Attributes
    ----------
    drives : dict of SweepResult
        "pose", "estimate" and "truth" → drives; their ratios refer to the PD tuned over draws, if it drove.
    controllers : tuple of ComparedController
        The controllers and their gains, in the order of the rows.
    robots : int
        Number of robots, including those whose fit was refused.
    refused_robots : tuple of int
        Seeds of robots whose fit was refused: they did not drive.
    """

    drives: dict[str, SweepResult]
    controllers: tuple[ComparedController, ...]
    robots: int
    refused_robots: tuple[int, ...]

    @property
    def reference(self) -> str:
        """Return the label of the controller to which the ratios refer."""
        return self.drives["pose"].reference

    def rows(self) -> list[TableRow]:
        """Return a flat row per controller: median, 95 % quantile and ratio with its interval, by evaluation."""
        table_rows = []
        for controller in self.controllers:
            row: TableRow = {
                "controller": controller.label,
                "tuned": ", ".join(controller.gains),
                "at_bound": ", ".join(controller.bound_gains),
            }
            for view, drives in self.drives.items():
                own_drives = [d for d in drives.drives if d.combination.label == controller.label]
                x = np.array([d.figures.get(FIGURE, np.nan) for d in own_drives])
                x = x[np.isfinite(x)]
                ratio = drives.difference(controller.label, FIGURE)
                row |= {
                    f"{view}_median_m": float(np.median(x)) if x.size else float("nan"),
                    f"{view}_p95_m": float(np.quantile(x, 0.95)) if x.size else float("nan"),
                    f"{view}_ratio": ratio.ratio, f"{view}_low": ratio.low, f"{view}_high": ratio.high,
                    f"{view}_stopped": sum(bool(d.stop_code) for d in own_drives),
                }  # fmt: skip
            table_rows.append(row)
        return table_rows

    @property
    def verdict(self) -> Verdict:
        """Return WARN if there are reasons, else USABLE."""
        return Verdict.of(self.reasons)

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return a warning for a best ratio above the limit, and for gains at a bound, stops and refused fits."""
        reasons, rows = [], self.rows()
        rivals = [
            row for row, controller in zip(rows, self.controllers, strict=True)
            if controller.kind != "pd" and controller.label != self.reference
        ]  # fmt: skip
        best_row = min(rivals, key=lambda row: np.nan_to_num(row["pose_ratio"], nan=np.inf), default=None)
        if best_row is not None and not np.isfinite(best_row["pose_high"]):
            if not best_row["pose_stopped"]:  # stopped drives do not have a ratio, and are reported below
                count = self.robots - len(self.refused_robots)
                reasons.append(note("study.no-interval", Severity.UNKNOWN, robots=count))
        elif best_row is not None and best_row["pose_high"] > MAX_RATIO:
            figures = {
                "ratio": best_row["pose_ratio"],
                "high": best_row["pose_high"],
                "reference": self.reference,
            }
            reasons.append(
                note("study.not-a-third", Severity.WARNING, subject=best_row["controller"], **figures)
            )
        for row in rows:
            if row["at_bound"]:
                message = note(
                    "study.gain-at-bound", Severity.WARNING, subject=row["controller"], gains=row["at_bound"]
                )
                reasons.append(message)
            if stops := sum(row[f"{view}_stopped"] for view in ("pose", "truth")):
                reasons.append(
                    note("study.stopped", Severity.WARNING, subject=row["controller"], count=stops)
                )
        if self.refused_robots:
            reasons.append(note("study.fits-refused", Severity.WARNING, robots=self.refused_robots))
        return tuple(reasons)

    def table(self) -> str:
        """Return the rows as a text table."""
        views = list(self.drives)
        rows = [["", *(name for _view in views for name in (_("median p95 mm"), _("ratio")))]]
        for row in self.rows():
            cells = [row["controller"][:15]]
            for view in views:
                median, p95 = (number(1e3 * row[f"{view}_{q}_m"]) for q in ("median", "p95"))
                cells += [f"{median:.1f} {p95:5.1f}", _ratio(row, view)]
            rows.append(cells)
        head = [_("controller"), *(cell for view in views for cell in (_(view), ""))]
        lines = [
            _("{robots} robots, {routes} drives each; ratio to {first}, with its 95 % interval",
              robots=self.robots - len(self.refused_robots), routes=2, first=self.reference),
            *text_table("<" + ">>" * len(views), head, *rows),
        ]  # fmt: skip
        return "\n".join([*lines, "", verdict_line(self.verdict, self.reasons)])


def _ratio(row: TableRow, view: str) -> str:
    low, ratio, high = (row[f"{view}_{end}"] for end in ("low", "ratio", "high"))
    if not np.isfinite(low):
        return f"{number(ratio):.2f}"
    return f"{number(ratio):.2f} {number(low):.2f}-{number(high):.2f}"
