"""Write a page about a vehicle that ages: the changed parameters, and each parameter over the runs."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.messages import text
from baqueano.messages.language import number, shown_unit, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.report.libraries import panels, with_style
from baqueano.report.page import Headline, Page, Section, Table, draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from baqueano.validation.parameter_drift import ParameterHistory


def drift_page(history: "ParameterHistory") -> Page:
    """Return the page about a `ParameterHistory`."""
    sentences = "\n".join(text(change.message) for change in history.changes) or _(
        "No parameter changed beyond its error bars."
    )
    entries = curve_parameters(history)
    caption = _("Each run by itself with its 95 % interval (blue), and the estimate from all runs (green).")
    return Page(
        title=_("{vehicle} over {runs} runs", vehicle=history.last.file.name, runs=len(history.runs)),
        subtitle=_(
            "{first} to {last}",
            first=history.when[0] or history.runs[0],
            last=history.when[-1] or history.runs[-1],
        ),
        verdict=history.verdict,
        headlines=[
            Headline(
                change.name.removeprefix("model."),
                f"{number(change.last_value):.3g} {shown_unit(change.unit)}",
                _("was {first_value:.3g}", first_value=change.first_value),
            )
            for change in history.changes[:4]
        ],
        sections=[
            Section(_("Changed parameters"), sentences, []),
            Section(_("Run by run"), "", [draw(curves(history, entries), caption)] if entries else []),
            Section(_("Figures"), "", [Table(history.rows())]),
        ],
        reproduce=baqueano_command("runs", "wear", *history.runs),
    )


def curve_parameters(history: "ParameterHistory") -> list[int]:
    """Return the indices of the parameters with estimates from at least two runs."""
    return [i for i in range(len(history.names)) if np.isfinite(history.single[:, i]).sum() > 1]


@with_style
def curves(history: "ParameterHistory", entries: list[int]) -> "Figure":
    """Draw these parameters over the runs."""
    columns = 2 if len(entries) > 1 else 1
    rows = -(-len(entries) // columns)
    figure, axes = panels(rows, columns, (9.2, 2.0 * rows + 0.5), sharex=True)
    names_moved = {change.name for change in history.changes}
    run_numbers = np.arange(len(history.runs))
    for axis, i in zip(axes.ravel(), entries, strict=False):
        low, high = (
            history.smoothed_values[:, i] + s * QUANTILE_95 * history.smoothed_std[:, i] for s in (-1, 1)
        )
        axis.fill_between(run_numbers, low, high, color="#238b45", alpha=0.2, lw=0)
        axis.plot(run_numbers, history.smoothed_values[:, i], color="#238b45", lw=1.4)
        half_width = QUANTILE_95 * history.single_std[:, i]
        axis.errorbar(run_numbers, history.single[:, i], half_width, fmt="o", ms=3, color="#3b6fb6", lw=1.0)
        name = history.names[i].removeprefix("model.")
        axis.set_title(name, fontsize=9, color="#c2410c" if history.names[i] in names_moved else "#1d2128")
        axis.set_ylabel(history.units[i], fontsize=8)
    for axis in axes.ravel()[len(entries) :]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel(_("run"))
    return figure
