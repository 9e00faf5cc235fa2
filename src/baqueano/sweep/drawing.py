"""Draw the figures and the page of a sweep."""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.result import Result
from baqueano.diagnostics import note
from baqueano.messages import text
from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.report.card import Card, make_card
from baqueano.report.figures import MEASUREMENT, MODEL, REFERENCE
from baqueano.report.libraries import panel, set_log_scale, with_style
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw
from baqueano.report.pages.result_page import build_page
from baqueano.report.plots import make_drawings
from baqueano.sweep.result import ALL_FIGURES, BLOCKS, RMS_FIGURES, SweepResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from baqueano.contracts.values import TableRow


@cache
def register() -> None:
    """Register `.plot()`, a notebook card and a page for the results of sweeps."""
    make_drawings.register(
        SweepResult,
        lambda result: {"drives": lambda: draw_spread(result), "differences": lambda: draw_ratios(result)},
    )
    make_card.register(SweepResult, _card)
    build_page.register(SweepResult, lambda result, alignment="none": sweep_page(result))


def _card(result: Result) -> Card:
    assert isinstance(result, SweepResult)
    names = result.figure_names()[:6]
    rows = [
        {
            "combination": row["combination"],
            **{_head(name): row[name] * ALL_FIGURES[name].scale for name in names},
        }
        for row in result.combinations()
    ]
    title = text(note("sweep.head", drives=max((row["drives"] for row in result.combinations()), default=0)))
    return Card(title, result.verdict, rows, [text(reason) for reason in result.reasons])


def sweep_page(result: SweepResult) -> Page:
    """Return a page with the table, the spread over the drives and the differences."""
    main, rows = result.main_figure(), result.combinations()
    finite = [row for row in rows if np.isfinite(row[main])]
    best_row = min(finite, key=lambda row: row[main]) if finite else None
    headlines = [
        Headline(_("combinations"), str(len(rows)), ""),
        Headline(_("drives"), str(len(result.drives)), ""),
    ]
    if best_row is not None:
        value = f"{number(best_row[main] * ALL_FIGURES[main].scale):.3g} {ALL_FIGURES[main].unit}"
        headlines.append(Headline(_("smallest error"), value, best_row["combination"]))
    page_parts: list[Table | Drawing] = [draw(draw_spread(result), text(note("sweep.spread")))]
    if len(rows) > 1:
        page_parts.append(draw(draw_ratios(result), text(note("sweep.ratios", reference=result.reference))))
    figure_names, differences = result.figure_names(), _differences(result, rows)
    blocks = [[name for name in block if name in figure_names] for block in BLOCKS]
    tables: list[Table | Drawing] = [_medians(rows, names) for names in blocks if names]
    tables.append(Table([{"figure": heading, "meaning": meaning} for heading, meaning in result.meanings()]))
    return Page(
        _("Sweep"),
        text(note("sweep.head", drives=max((row["drives"] for row in rows), default=0))),
        result.verdict,
        headlines,
        [
            Section(_("Combinations"), "; ".join(text(reason) for reason in result.reasons), tables),
            Section(_("Figures"), "", page_parts),
            *(
                [Section(_("Differences"), text(note("sweep.interval")), [Table(differences)])]
                if differences
                else []
            ),
        ],
    )


def _medians(rows: "list[TableRow]", names: list[str]) -> Table:
    """Return a table with the median of some results for each combination."""
    return Table([
        {"combination": row["combination"]}
        | {_head(name): _plain_text(row[name] * ALL_FIGURES[name].scale) for name in names}
        for row in rows
    ])  # fmt: skip


def _differences(result: SweepResult, rows: "list[TableRow]") -> "list[TableRow]":
    drawings = []
    for row in rows:
        for name in RMS_FIGURES:
            difference = result.difference(row["combination"], name)
            if row["combination"] != result.reference and np.isfinite(difference.ratio):
                drawings.append({
                    "combination": row["combination"], "figure": _(RMS_FIGURES[name].heading),
                    "ratio": difference.ratio,
                    "from": _plain_text(difference.low), "to": _plain_text(difference.high),
                    _("blocks"): difference.blocks,
                })  # fmt: skip
    return drawings


def _head(name: str) -> str:
    figure = ALL_FIGURES[name]
    return f"{_(figure.heading)} [{figure.unit}]" if figure.unit else _(figure.heading)


def _plain_text(value: float) -> float | None:
    return value if np.isfinite(value) else None


@with_style
def draw_spread(result: SweepResult) -> "Figure":
    """Draw the main figure of each drive, and the median of each combination."""
    main, rows = result.main_figure(), result.combinations()
    figure, axes = panel((7.2, 0.45 * len(rows) + 1.2))
    for k, row in enumerate(reversed(rows)):
        x = [
            d.figures.get(main, np.nan) * ALL_FIGURES[main].scale
            for d in result.drives
            if d.combination.label == row["combination"]
        ]
        axes.plot(x, np.full(len(x), k), "o", ms=4, color=MEASUREMENT, alpha=0.4)
        axes.plot([row[main] * ALL_FIGURES[main].scale], [k], "|", ms=16, mew=2.5, color=MODEL)
    axes.set_yticks(range(len(rows)), [row["combination"] for row in reversed(rows)])
    axes.set_ylim(-0.6, max(len(rows), 1) - 0.4)
    set_log_scale(axes.xaxis)
    axes.set_xlabel(_head(main))
    return figure


@with_style
def draw_ratios(result: SweepResult) -> "Figure":
    """Draw the main figure of each combination divided by the reference's, with its interval."""
    main = result.main_figure()
    rows = [row for row in result.combinations() if row["combination"] != result.reference]
    figure, axes = panel((7.2, 0.45 * max(len(rows), 1) + 1.2))
    for k, row in enumerate(reversed(rows)):
        difference = result.difference(row["combination"], main)
        axes.hlines([k], [difference.low], [difference.high], color=REFERENCE, lw=5)
        axes.plot([difference.ratio], [k], "o", ms=5, color=MODEL)
    axes.axvline(1.0, color=MEASUREMENT, lw=1)
    axes.set_yticks(range(len(rows)), [row["combination"] for row in reversed(rows)])
    axes.set_ylim(-0.6, max(len(rows), 1) - 0.4)
    set_log_scale(axes.xaxis)
    axes.set_xlabel(f"{_(ALL_FIGURES[main].heading)} / {result.reference}")
    return figure
