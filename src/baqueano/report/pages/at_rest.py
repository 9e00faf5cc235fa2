"""Write a page about a sensor at rest: the table, and the Allan deviation of each sensor."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.at_rest import RestChannel, RestMeasurement
from baqueano.messages import texts
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.report.libraries import panel, set_log_scale, with_style
from baqueano.report.page import Headline, Page, Section, Table, draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#3b6fb6", "#238b45", "#c2410c", "#7c3aed", "#a16207", "#0e7490")


def rest_page(result: RestMeasurement) -> Page:
    """Return the page of `at_rest`."""
    sections = [Section(_("Figures"), "\n".join(texts(result.findings)), [Table(result.rows())])]
    for sensor, channels in sensor_channels(result).items():
        caption = _(
            "Overlapping Allan deviation with its 95 % interval; dashed: the coefficients that explain it."
        )
        sections.append(
            Section(
                _("Allan deviation: {sensor}", sensor=sensor), "", [draw(allan_curves(channels), caption)]
            )
        )
    return Page(
        title=_("{run} at rest", run=result.run),
        subtitle=_("{duration_s:.0f} s without a command", duration_s=result.duration_s),
        verdict=result.verdict,
        headlines=[
            Headline(
                f"{c.sensor}[{c.entry}]",
                f"{number(c.std):.3g}",
                _("bias {mean:.3g} ± {mean_std:.1g}", mean=c.mean, mean_std=c.mean_std),
            )
            for c in result.channels[:4]
        ],
        sections=sections,
        reproduce=baqueano_command("runs", "noise", result.run),
    )


def sensor_channels(rest: RestMeasurement) -> dict[str, list[RestChannel]]:
    """Return the channels of each sensor."""
    sensors = dict.fromkeys(c.sensor for c in rest.channels)
    return {sensor: [c for c in rest.channels if c.sensor == sensor] for sensor in sensors}


@with_style
def allan_curves(channels: Sequence[RestChannel]) -> "Figure":
    """Draw the Allan deviation of each channel, and the coefficients that explain it."""
    figure, axis = panel((9.2, 4.2))
    for c, colour in zip(channels, COLOURS * len(channels), strict=False):
        tau = c.curve.tau_s
        axis.fill_between(tau, c.curve.low, c.curve.high, color=colour, alpha=0.15, lw=0)
        axis.plot(tau, c.curve.deviation, "o-", ms=3, color=colour, label=f"{c.sensor}[{c.entry}]")
        W, B, K = c.coefficients.value
        model = np.sqrt(W**2 / tau + 2.0 * np.log(2.0) / np.pi * B**2 + K**2 * tau / 3.0)
        axis.plot(tau, model, "--", lw=1.0, color=colour)
    set_log_scale(axis.xaxis)
    set_log_scale(axis.yaxis)
    axis.set_xlabel(_("averaging time τ [s]"))
    axis.set_ylabel(_("Allan deviation [unit of the sensor]"))
    axis.legend()
    axis.grid(True, which="both", alpha=0.25)
    return figure
