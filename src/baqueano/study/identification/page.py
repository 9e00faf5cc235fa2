"""Write the page of `baqueano study identification`: table, histogram of errors, coverage."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.report import Drawing, Headline, Page, Section, Table, draw
from baqueano.report.figures import MEASUREMENT, MODEL, REFERENCE, TRUTH
from baqueano.report.libraries import panel, with_style
from baqueano.study.identification.result import LIMITS, POOL, Identification

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CASES = (
    "case", "fits", "coverage", "coverage_or_report", "rmse", "std", "usable", "wrongly_usable", "silent_failures",
    "fits_with_reports",
)  # fmt: skip
PARAMETERS = ("case", "name", "intervals", "coverage", "report_share", "rmse", "std")
ABOUT_TEXT = N_(
    "coverage: fraction of the 95 % intervals that contain the truth. rmse: root mean square error divided by "
    "the Cramér-Rao bound of the same runs. std: median of the standard error divided by that bound. report_share: "
    "fraction of the fits whose verdict names the parameter. wrongly_usable: fits called USABLE although a "
    "parameter has an error above 5 standard errors and 5 %."
)
Z_TEXT = N_(
    "Clean: each error divided by its own standard error ({} estimates), and the normal density. Values "
    "beyond 4.5 are drawn at the edge."
)
COVERAGE_TEXT = N_(
    "Clean: fraction of the 95 % intervals that contain the truth, with twice its standard deviation; the "
    "band is the requirement."
)
BARS_TEXT = N_(
    "Clean: errors and standard errors, in units of the Cramér-Rao bound. An error must stay below the line."
)


def identification_page(study: Identification) -> Page:
    """Return the page with table, verdicts and figures of the study."""
    rows = study.rows()
    seeds_text = _("{seeds:,} seeds", seeds=study.seeds)
    seeds_text += (
        _(" of {requested:,}, stopped from the keyboard", requested=study.requested_seeds)
        if study.seeds < study.requested_seeds
        else ""
    )
    undamaged_rows = [row for row in rows if row["case"] == rows[0]["case"] and row["name"] != POOL]
    page_parts: list[Table | Drawing] = [draw(coverage(undamaged_rows), _(COVERAGE_TEXT))]
    if len(z := study.normalised_errors()):
        page_parts = [
            draw(histogram(z), _(Z_TEXT).format(z.size)),
            *page_parts,
            draw(efficiency(undamaged_rows), _(BARS_TEXT)),
        ]
    pool_rows = [row for row in rows if row["name"] == POOL]
    parameter_rows = [row for row in rows if row["name"] != POOL]
    wrong_count = sum(row["wrongly_usable"] for row in pool_rows)
    return Page(
        title=_("Errors of the fits compared with the theoretical limit"),
        subtitle=_("Robots and cars of an independent simulator, 60 s each, {over}", over=seeds_text),
        verdict=study.verdict,
        headlines=[
            Headline(
                _("error / bound"),
                f"{number(rows[0]['rmse'] or np.nan):.2f}",
                _("{case}, all parameters", case=rows[0]["case"]),
            ),
            Headline(
                _("within the interval"), f"{number(100 * rows[0]['coverage']):.1f} %", _("95 % are expected")
            ),
            Headline(
                Verdict.USABLE,
                f"{number(100 * rows[0]['usable']):.0f} %",
                _("of the fits, {case}", case=rows[0]["case"]),
            ),
            Headline(_("wrong and USABLE"), f"{wrong_count}", _("in all cases")),
        ],
        sections=[
            Section("Cases", "\n".join(study.reasons), [Table(_columns(pool_rows, CASES), _(ABOUT_TEXT))]),
            Section("Parameters", "", [Table(_columns(parameter_rows, PARAMETERS))]),
            Section("Figures", "", page_parts),
        ],
        reproduce=baqueano_command("study", "identification", "--seeds", study.requested_seeds),
    )


def _columns(rows: list[TableRow], names: tuple[str, ...]) -> list[TableRow]:
    return [{name: row[name] for name in names} for row in rows]


@with_style
def histogram(z: np.ndarray) -> "Figure":
    """Draw the histogram of all errors z (K,) with the normal density."""
    figure, axis = panel((9.2, 2.8))
    grid = np.linspace(-4.5, 4.5, 200)
    axis.hist(np.clip(z, -4.5, 4.5), bins=60, range=(-4.5, 4.5), density=True, color=MEASUREMENT, alpha=0.6)
    axis.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color=TRUTH, lw=1)
    axis.set_xlabel(_("(estimate − truth) / standard error"))
    return figure


@with_style
def coverage(rows: list[dict[str, float]]) -> "Figure":
    """Draw the fraction of the intervals that contain the truth, by parameter."""
    covered_fraction = np.array([row["coverage"] for row in rows])
    count = np.array([max(row["intervals"], 1) for row in rows])
    figure, axis = panel((9.2, 3.4))
    axis.axhspan(100 * LIMITS["clean"].coverage_each, 100.0, color=REFERENCE, alpha=0.25)
    scatter = 200 * np.sqrt(0.05 * 0.95 / count)
    axis.errorbar(range(len(rows)), 100 * covered_fraction, yerr=scatter, fmt="o", color=MODEL, capsize=3)
    axis.axhline(95.0, color=TRUTH, lw=1)
    axis.set_xticks(range(len(rows)), _names(rows), rotation=90, fontsize=7)
    axis.set_ylabel(_("inside [%]"))
    return figure


@with_style
def efficiency(rows: list[dict[str, float]]) -> "Figure":
    """Draw errors and standard errors divided by their bounds, by parameter."""
    figure, axis = panel((9.2, 3.4))
    positions = np.arange(len(rows))
    axis.bar(positions - 0.2, [row["rmse"] or 0.0 for row in rows], width=0.38, color=MODEL, label="error")
    axis.bar(
        positions + 0.2,
        [row["std"] or 0.0 for row in rows],
        width=0.38,
        color=MEASUREMENT,
        label=_("standard error"),
    )
    axis.axhline(LIMITS["clean"].rmse_each, color=TRUTH, lw=1)
    axis.set_xticks(positions, _names(rows), rotation=90, fontsize=7)
    axis.set_ylabel(_("in bounds"))
    axis.legend(loc="lower right")
    return figure


def _names(rows: list[dict[str, float]]) -> list[str]:
    return [str(row["name"]).removeprefix("model.").removeprefix("sensors.") for row in rows]
