"""A page about a sensor at rest: the table, and the Allan deviation of each sensor."""

from typing import Any

import numpy as np

from baqueano.messages import texts
from baqueano.printable import typed
from baqueano.report.lab import panel, styled
from baqueano.report.page import Headline, Page, Section, Table, draw

COLOURS = ("#3b6fb6", "#238b45", "#c2410c", "#7c3aed", "#a16207", "#0e7490")


def page_of_rest(found: Any) -> Page:
    """The page of `at_rest`."""
    sensors = list(dict.fromkeys(c.sensor for c in found.channels))
    sections = [Section("Figures", "\n".join(texts(found.doubts)), [Table(found.rows())])]
    for sensor in sensors:
        channels = [c for c in found.channels if c.sensor == sensor]
        caption = (
            "Overlapping Allan deviation with its 95 % interval; dashed: the coefficients that explain it."
        )
        sections.append(Section(f"Allan deviation: {sensor}", "", [draw(_curves(channels), caption)]))
    return Page(
        title=f"{found.run} at rest",
        subtitle=f"{found.duration_s:.0f} s without a command",
        verdict=found.verdict,
        headlines=[
            Headline(f"{c.sensor}[{c.entry}]", f"{c.sd:.3g}", f"bias {c.mean:.3g} ± {c.mean_sd:.1g}")
            for c in found.channels[:4]
        ],
        sections=sections,
        reproduce=typed("runs", "noise", found.run),
    )


@styled
def _curves(channels: list[Any]) -> Any:
    figure, axis = panel((9.2, 4.2))
    for c, colour in zip(channels, COLOURS * len(channels), strict=False):
        tau = c.curve.tau_s
        axis.fill_between(tau, c.curve.low, c.curve.high, color=colour, alpha=0.15, lw=0)
        axis.loglog(tau, c.curve.deviation, "o-", ms=3, color=colour, label=f"{c.sensor}[{c.entry}]")
        W, B, K = c.coefficients.value
        model = np.sqrt(W**2 / tau + 2.0 * np.log(2.0) / np.pi * B**2 + K**2 * tau / 3.0)
        axis.loglog(tau, model, "--", lw=1.0, color=colour)
    axis.set_xlabel("averaging time τ [s]")
    axis.set_ylabel("Allan deviation [unit of the sensor]")
    axis.legend()
    axis.grid(True, which="both", alpha=0.25)
    return figure
