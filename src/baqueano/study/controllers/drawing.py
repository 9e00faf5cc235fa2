"""Draw the figure of `study controllers`, and its card in a notebook."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.messages import texts
from baqueano.messages.language import translate as _
from baqueano.report.card import MAX_SENTENCES, Card, make_card
from baqueano.report.figures import MEASUREMENT, MODEL, REFERENCE
from baqueano.report.libraries import panels, with_style
from baqueano.report.plots import Draw, make_drawings
from baqueano.study.controllers.result import Controllers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCALES = {"errors": 1e3, "ratios": 1.0}  # of the drawn values


@make_drawings.register(Controllers)
def _drawings(result: Controllers) -> dict[str, Draw]:
    return {kind: partial(draw_evaluations, result, kind) for kind in SCALES}


@make_card.register(Controllers)
def _card(result: Controllers) -> Card:
    heads = {view: (f"{_(view)}, {_('median [mm]')}", f"{_(view)}, {_('ratio')}") for view in result.drives}
    rows = []
    for row in result.rows():
        cells: TableRow = {"controller": row["controller"]}
        for view, (median, ratio) in heads.items():
            cells |= {median: 1e3 * row[f"{view}_median_m"], ratio: row[f"{view}_ratio"]}
        rows.append(cells)
    title = result.table().partition("\n")[0]
    return Card(title, result.verdict, rows, texts(result.reasons)[:MAX_SENTENCES])


@with_style
def draw_evaluations(result: Controllers, kind: str = "errors") -> "Figure":
    """Draw a panel for each evaluation, with a row for each controller.

    "errors": median and 95 % quantile of the distance from the path. "ratios": ratio to the reference, with its 95 %
    interval.
    """
    rows = result.rows()
    names = ("low", "ratio", "high") if kind == "ratios" else ("median_m", "median_m", "p95_m")
    heights = np.arange(len(rows))[::-1]
    figure, axes = panels(
        len(result.drives), 1, (7.2, (0.28 * len(rows) + 0.7) * len(result.drives)), sharex=True
    )
    for axis, view in zip(axes[:, 0], result.drives, strict=True):
        low, middle, high = (
            SCALES[kind] * np.array([row[f"{view}_{name}"] for row in rows]) for name in names
        )
        axis.hlines(heights, low, high, color=REFERENCE, lw=4, zorder=1)
        axis.plot(middle, heights, "o", ms=5, color=MODEL)
        axis.set_yticks(heights, [row["controller"] for row in rows])
        axis.set_ylim(-0.6, len(rows) - 0.4)
        axis.set_title(_(view))
        axis.set_xlim(left=0.0)
        if kind == "ratios":
            axis.axvline(1.0, color=MEASUREMENT, lw=1)
    label = _("ratio to {first}", first=result.reference) if kind == "ratios" else _("median to 95 % [mm]")
    axes[-1, 0].set_xlabel(label)
    return figure
