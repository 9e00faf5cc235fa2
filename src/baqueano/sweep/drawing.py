"""Draw the figures and the page of a sweep."""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import note
from baqueano.messages import text, texts
from baqueano.messages.language import number, translate as _
from baqueano.report.card import Card, make_card
from baqueano.report.figures import MEASUREMENT, MODEL, REFERENCE, TRUTH
from baqueano.report.libraries import panel, set_log_scale, with_style
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw
from baqueano.report.pages.result_page import build_page
from baqueano.report.plots import make_drawings
from baqueano.sweep.columns import ratio_cell, short_labels
from baqueano.sweep.figures import ALL_FIGURES, RMS_FIGURES
from baqueano.sweep.result import BLOCKS, SweepResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MAX_HIGH_ROWS = 12  # more rows are drawn closer together


@cache
def register() -> None:
    """Register `.plot()`, a notebook card and a page for the results of sweeps."""
    make_drawings.register(
        SweepResult,
        lambda result: {
            "drives": lambda: draw_spread(result),
            "differences": lambda: draw_ratios(result),
            "vehicles": lambda: draw_vehicles(result),
        },
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
    """Return a page with the best combination first: figures, medians and differences."""
    main, rows = result.main_figure(), _ranked(result, result.combinations())
    stopped_count = sum(bool(drive.stop_code) for drive in result.drives)
    headlines = [
        Headline(_("combinations"), str(len(rows)), ""),
        Headline(_("drives"), str(len(result.drives)), ""),
    ]
    if stopped_count:
        headlines.append(Headline(_("stopped drives"), str(stopped_count), ""))
    if np.isfinite(rows[0][main]):
        value = f"{number(rows[0][main] * ALL_FIGURES[main].scale):.3g} {ALL_FIGURES[main].unit}"
        headlines.append(Headline(_("smallest error"), value, _names(result)[rows[0]["combination"]]))
    page_parts: list[Table | Drawing] = []
    if len(result.vehicles()) > 1:
        page_parts.append(draw(draw_vehicles(result), text(note("sweep.vehicles", heading=_head(main)))))
    page_parts.append(draw(draw_spread(result), text(note("sweep.spread"))))
    if len(rows) > 1:
        reference = _names(result)[result.reference]
        page_parts.append(draw(draw_ratios(result), text(note("sweep.ratios", reference=reference))))
    figure_names = result.figure_names()
    blocks = [[name for name in block if name in figure_names] for block in BLOCKS]
    tables: list[Table | Drawing] = [_medians(result, rows, names) for names in blocks if names]
    tables.append(Table([{"figure": heading, "meaning": meaning} for heading, meaning in result.meanings()]))
    differences = _differences(result, rows)
    remarks = texts([*result.notes, *result.reasons])
    return Page(
        _("Sweep"),
        text(note("sweep.head", drives=max((row["drives"] for row in rows), default=0))),
        result.verdict,
        headlines,
        [
            Section(_("Figures"), "", page_parts),
            Section(_("Combinations"), "", tables, remarks),
            *(
                [Section(_("Differences"), text(note("sweep.interval")), [Table(differences)])]
                if differences
                else []
            ),
        ],
    )


def _ranked(result: SweepResult, rows: list[TableRow]) -> list[TableRow]:
    rows_by_label = {row["combination"]: row for row in rows}
    return [rows_by_label[label] for label in result.ranking()]


def _names(result: SweepResult) -> dict[str, str]:
    return short_labels(list(dict.fromkeys(drive.combination.label for drive in result.drives)))


def _medians(result: SweepResult, rows: list[TableRow], figure_names: list[str]) -> Table:
    """Return a table with the median of some results for each combination."""
    names, is_first = _names(result), figure_names[0] == result.main_figure()
    has_stops = is_first and any(row["stopped"] for row in rows)
    return Table([
        {"combination": names[row["combination"]]}
        | ({_("stopped"): row["stopped"]} if has_stops else {})
        | {_head(name): _plain_text(row[name] * ALL_FIGURES[name].scale) for name in figure_names}
        for row in rows
    ])  # fmt: skip


def _differences(result: SweepResult, rows: list[TableRow]) -> list[TableRow]:
    """Return a row per combination with the ratio of each result to the reference, and its interval."""
    names, table_rows = _names(result), []
    for row in (row for row in rows if row["combination"] != result.reference):
        ratios = {
            _(RMS_FIGURES[name].heading): ratio_cell(row, name, result.reference)
            for name in RMS_FIGURES
            if np.isfinite(row[f"{name}_ratio"])
        }
        if ratios:
            table_rows.append({"combination": names[row["combination"]], **ratios})
    return table_rows


def _head(name: str) -> str:
    figure = ALL_FIGURES[name]
    return f"{_(figure.heading)} [{figure.unit}]" if figure.unit else _(figure.heading)


def _plain_text(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _panel_of(labels: list[str], result: SweepResult) -> tuple["Figure", "Axes"]:
    """Return a figure with a row per combination, the first at the top."""
    row_in = 0.45 if len(labels) <= MAX_HIGH_ROWS else 0.22
    figure, axes = panel((7.2, row_in * max(len(labels), 1) + 1.2))
    names = _names(result)
    axes.set_yticks(range(len(labels)), [names[label] for label in labels])
    axes.set_ylim(max(len(labels), 1) - 0.4, -0.6)
    return figure, axes


@with_style
def draw_spread(result: SweepResult) -> "Figure":
    """Draw the main figure of each drive that was not stopped, and the median of each combination."""
    main, rows = result.main_figure(), _ranked(result, result.combinations())
    figure, axes = _panel_of([row["combination"] for row in rows], result)
    for k, row in enumerate(rows):
        x = [
            d.figures.get(main, np.nan) * ALL_FIGURES[main].scale
            for d in result.drives
            if d.combination.label == row["combination"] and not d.stop_code
        ]
        axes.plot(x, np.full(len(x), k), "o", ms=4, color=MEASUREMENT, alpha=0.4)
        axes.plot([row[main] * ALL_FIGURES[main].scale], [k], "|", ms=12, mew=2.5, color=MODEL)
    set_log_scale(axes.xaxis)
    axes.set_xlabel(_head(main))
    return figure


@with_style
def draw_ratios(result: SweepResult) -> "Figure":
    """Draw the main figure of each combination divided by the reference's, with its interval."""
    main = result.main_figure()
    labels = [label for label in result.ranking() if label != result.reference]
    figure, axes = _panel_of(labels, result)
    for k, label in enumerate(labels):
        difference = result.difference(label, main)
        axes.hlines([k], [difference.low], [difference.high], color=REFERENCE, lw=5)
        axes.plot([difference.ratio], [k], "o", ms=5, color=MODEL)
    axes.axvline(1.0, color=MEASUREMENT, lw=1)
    set_log_scale(axes.xaxis)
    axes.set_xlabel(f"{_(ALL_FIGURES[main].heading)} / {_names(result)[result.reference]}")
    return figure


@with_style
def draw_vehicles(result: SweepResult) -> "Figure":
    """Draw a table of the median of the main result for each combination and vehicle, with a colour for each cell."""
    figure_of_table, vehicles = ALL_FIGURES[result.main_figure()], result.vehicles()
    rows = _ranked(result, result.by_vehicle())
    x = np.array([[row[name] for name in vehicles] for row in rows]) * figure_of_table.scale
    figure, axes = _panel_of([row["combination"] for row in rows], result)
    shades = np.log10(np.where(x > 0.0, x, np.nan))
    axes.imshow(shades, cmap="YlOrBr", aspect="auto")
    limit = np.nanmean([np.nanmin(shades), np.nanmax(shades)]) if np.isfinite(shades).any() else 0.0
    for (row, column), value in np.ndenumerate(x):
        words = f"{number(value):.2g}" if np.isfinite(value) else "–"
        colour = "white" if shades[row, column] > limit else TRUTH
        axes.text(column, row, words, color=colour, ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(vehicles)), vehicles, rotation=45, ha="right", fontsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(False)
    return figure
