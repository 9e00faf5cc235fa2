"""A page about a vehicle that ages: what moved, and each parameter over the runs."""

from typing import Any

import numpy as np

from baqueano.identify.covariance.quantiles import QUANTILE_95
from baqueano.language import number, shown_unit
from baqueano.language import translated as _
from baqueano.messages import text
from baqueano.printable import typed
from baqueano.report.lab import panels, styled
from baqueano.report.page import Headline, Page, Section, Table, draw


def page_of_wear(found: Any) -> Page:
    """The page of `over_time`."""
    said = "\n".join(text(one.message) for one in found.moved) or _("Nothing moved beyond its error bars.")
    shown = [i for i in range(len(found.names)) if np.isfinite(found.single[:, i]).sum() > 1]
    caption = _("Each run by itself with its 95 % interval (blue), and what all runs say together (green).")
    return Page(
        title=_("{vehicle} over {runs} runs", vehicle=found.last.file.name, runs=len(found.runs)),
        subtitle=_(
            "{first} to {last}", first=found.when[0] or found.runs[0], last=found.when[-1] or found.runs[-1]
        ),
        verdict=found.verdict,
        headlines=[
            Headline(
                one.name.removeprefix("model."),
                f"{number(one.after):.3g} {shown_unit(one.unit)}",
                _("was {before:.3g}", before=one.before),
            )
            for one in found.moved[:4]
        ],
        sections=[
            Section(_("What moved"), said, []),
            Section(_("Run by run"), "", [draw(_curves(found, shown), caption)] if shown else []),
            Section(_("Figures"), "", [Table(found.rows())]),
        ],
        reproduce=typed("runs", "wear", *found.runs),
    )


@styled
def _curves(found: Any, shown: list[int]) -> Any:
    columns = 2 if len(shown) > 1 else 1
    rows = -(-len(shown) // columns)
    figure, axes = panels(rows, columns, (9.2, 2.0 * rows + 0.5), sharex=True)
    moved = {one.name for one in found.moved}
    at = np.arange(len(found.runs))
    for axis, i in zip(axes.ravel(), shown, strict=False):
        low, high = (found.smoothed[:, i] + s * QUANTILE_95 * found.smoothed_sd[:, i] for s in (-1, 1))
        axis.fill_between(at, low, high, color="#238b45", alpha=0.2, lw=0)
        axis.plot(at, found.smoothed[:, i], color="#238b45", lw=1.4)
        half = QUANTILE_95 * found.single_sd[:, i]
        axis.errorbar(at, found.single[:, i], half, fmt="o", ms=3, color="#3b6fb6", lw=1.0)
        name = found.names[i].removeprefix("model.")
        axis.set_title(name, fontsize=9, color="#c2410c" if found.names[i] in moved else "#1d2128")
        axis.set_ylabel(found.units[i], fontsize=8)
    for axis in axes.ravel()[len(shown) :]:
        axis.set_visible(False)
    for axis in axes[-1]:
        axis.set_xlabel(_("run"))
    return figure
