"""Write a page about a checked route: its path in the room, and its demands on the vehicle along the path."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.geometry import map_from_body
from baqueano.guides.route import Route
from baqueano.messages import texts
from baqueano.messages.language import number, translate as _
from baqueano.report import figures
from baqueano.report.figures import MODEL, REFERENCE
from baqueano.report.libraries import panel, panels, with_style
from baqueano.report.page import Headline, Page, Section, draw
from baqueano.report.style import LEGEND_ABOVE
from baqueano.routes.examine import RouteReport
from baqueano.routes.path import distances_along

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARROWS = 12  # along the path, so that its direction is visible
HEADING_SHARE = 0.06  # length of the heading at the start, as a share of the route's extent


def route_page(result: RouteReport) -> Page:
    """Return the page of `route check`."""
    caption = _("Arrows: direction of travel. Crosses: places of the findings.")
    limits = _("Dashed: the largest values that the identified vehicle can drive.")
    path = draw(plot_examined_route(result), caption)
    return Page(
        title=_("Check of a route"),
        subtitle=_("length {m:.2f} m, {s:.1f} s", m=result.length_m, s=result.duration_s),
        verdict=result.verdict,
        headlines=[
            Headline(name, f"{number(value):.2f} {unit}")
            for name, value, unit in (
                (_("largest speed"), result.max_speed_m_s, "m/s"),
                (_("smallest radius"), result.min_radius_m, "m"),
                (_("command"), 100.0 * result.command_share, "%"),
                (_("to the walls"), result.clearance_m, "m"),
            )
            if np.isfinite(value)
        ],
        sections=[
            Section(_("Path"), "\n".join(texts(result.findings)), [path]),
            Section(_("Demands"), "", [draw(plot_demand(result), limits)]),
        ],
    )


@with_style
def plot_route(result: Route) -> "Figure":
    """Draw the path of a route with its direction, and its start pose."""
    figure, axes = panel((7.2, 6.2))
    _draw_path(axes, result)
    axes.legend(**LEGEND_ABOVE)
    return figure


@with_style
def plot_examined_route(result: RouteReport) -> "Figure":
    """Draw the path with its direction, the places of the findings and, in a room, the limits of the vehicle."""
    figure, axes = panel((7.2, 6.2))
    route = result.placed_route
    _draw_path(axes, route)
    s = distances_along(route.eta[:, :2])
    for k, finding in enumerate(f for f in result.findings if "position_m" in f.figures):
        x, y = (np.interp(finding.figures["position_m"], s, column) for column in route.eta[:, :2].T)
        axes.plot(x, y, "x", ms=10, mew=2.5, color=figures.ALARM, label="" if k else _("finding"))
    if result.room is not None:
        x, y = result.room.free_half_width_m
        corners = np.array([(x, y), (-x, y), (-x, -y), (x, -y), (x, y)])
        axes.plot(
            *corners.T, color=figures.ALARM, lw=0.9, ls=(0, (5, 4)), label=_("limit of the vehicle's origin")
        )
    axes.legend(**LEGEND_ABOVE | {"ncols": 2})
    return figure


def _draw_path(axes: "Axes", route: Route) -> None:
    xy = route.eta[:, :2]
    axes.plot(xy[:, 0], xy[:, 1], color=REFERENCE, lw=1.6)
    s = distances_along(xy)
    for place_m in s[-1] * (np.arange(ARROWS) + 0.5) / ARROWS:
        k = min(int(np.searchsorted(s, place_m)), len(s) - 1)
        direction = np.sign(route.nu[k, 0]) * map_from_body(route.eta[k, 2])[:2, 0]
        axes.annotate(
            "", xy[k] + 1e-3 * direction, xy[k], arrowprops={"arrowstyle": "-|>", "color": REFERENCE}
        )
    length_m = HEADING_SHARE * float(np.max(np.ptp(xy, axis=0)))
    nose = xy[0] + length_m * map_from_body(route.eta[0, 2])[:2, 0]
    axes.plot(*np.column_stack([xy[0], nose]), color=MODEL, lw=2.4)
    axes.plot(*xy[0], "o", ms=6, color=MODEL, label=_("start"))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


@with_style
def plot_demand(result: RouteReport) -> "Figure":
    """Draw speed, yaw rate and command along a route; dashed: the largest values that the vehicle can drive."""
    motion, (max_speed, turn) = result.demand(), result.limits()
    curves = [
        (_("speed [m/s]"), motion.speed_m_s, (max_speed,)),
        (_("yaw rate [rad/s]"), motion.yaw_rate_rad_s, (turn, -turn)),
    ]
    if result.capability is not None:
        curves.append((_("command [%]"), 100.0 * motion.share, (np.full(len(motion.share), 100.0),)))
    figure, axes = panels(len(curves), 1, (7.2, 1.75 * len(curves) + 0.5), sharex=True)
    for axis, (label_, values, limits) in zip(axes[:, 0], curves, strict=True):
        axis.plot(motion.s_m, values, color=REFERENCE, lw=2.0, label=_("route"))
        for k, limit in enumerate(limits if result.capability is not None else ()):
            name = "" if k else _("limit of the vehicle")
            axis.plot(motion.s_m, limit, color=figures.ALARM, lw=0.9, ls=(0, (5, 4)), label=name)
        axis.set_ylabel(label_.replace(" [", "\n["))
        if len(limits) == 1:  # speed and command are not negative
            axis.set_ylim(bottom=0.0)
    axes[0, 0].legend(**LEGEND_ABOVE)
    axes[-1, 0].set_xlabel(_("distance [m]"))
    return figure
