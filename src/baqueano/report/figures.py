"""Draw the figures of a run and of a fit: each function takes arrays and returns a matplotlib figure.

Measured is blue, the model green, as in the paper's figures; truth is black, the reference grey.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.messages.language import translate as _
from baqueano.report.libraries import panel, panels, set_log_scale, with_style
from baqueano.report.style import LEGEND_ABOVE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASUREMENT, MODEL, TRUTH, REFERENCE, ALARM = "#3b6fb6", "#238b45", "#1d2128", "#a3a9b2", "#c2410c"
SECOND_COLOUR = "#7c3aed"  # the estimate of another run
MAX_POINTS = 1600
MAX_PERCENT = 100.0  # %: a longer interval is cut off in the figure of estimates


def decimate(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return at most about MAX_POINTS points that keep every peak: the minimum and the maximum of each span."""
    if len(t) <= MAX_POINTS:
        return t, y
    width = -(-2 * len(t) // MAX_POINTS)
    rows = len(t) // width * width
    spans, span_starts = y[:rows].reshape(-1, width), np.arange(0, rows, width)
    is_missing = np.isnan(spans)
    minima = span_starts + np.argmin(np.where(is_missing, np.inf, spans), axis=1)
    maxima = span_starts + np.argmax(np.where(is_missing, -np.inf, spans), axis=1)
    kept_rows = np.unique(
        np.concatenate([minima, maxima, span_starts[is_missing.all(axis=1)], np.arange(rows, len(t))])
    )
    return t[kept_rows], y[kept_rows]


def most_motion(t_s: np.ndarray, y: np.ndarray, span_s: float) -> slice:
    """Return the rows of the `span_s` seconds in which y (N, m) varies most, or all rows if the data are not longer.

    The spans begin at whole seconds. The measure is the sum over channels of the variance within the span, relative
    to the variance over the whole time. Values beyond its 1st and 99th percentile are clipped, so that a spike is not
    treated as motion.
    """
    over_s = float(t_s[-1] - t_s[0]) - span_s
    y = y[:, np.isfinite(y).any(axis=0)]
    if over_s <= 0.0 or y.size == 0:
        return slice(0, len(t_s))
    starts = t_s[0] + np.arange(int(over_s) + 1)
    begin_rows, end_rows = np.searchsorted(t_s, starts), np.searchsorted(t_s, starts + span_s, side="right")
    is_finite = np.isfinite(y)
    y = np.clip(y, *np.nanpercentile(y, (1.0, 99.0), axis=0))
    y = np.where(is_finite, y - np.nanmean(y, axis=0), 0.0)

    def total(x: np.ndarray) -> np.ndarray:
        upto = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
        return upto[end_rows] - upto[begin_rows]

    total_power = np.sum(y**2, axis=0)
    span_power = total(y**2) - total(y) ** 2 / np.maximum(total(is_finite), 1)
    best_span = int(np.argmax(np.sum(span_power / np.where(total_power > 0.0, total_power, 1.0), axis=1)))
    return slice(int(begin_rows[best_span]), int(end_rows[best_span]))


@with_style
def channels(t_s: np.ndarray, measured: np.ndarray, model: np.ndarray, names: Sequence[str]) -> "Figure":
    """Draw the measurements of the sensors and the model's predictions, a panel per channel.

    t_s (N,), measured (N, m) and model (N, m); names like "a_x [m/s²]".
    """
    figure, axes = panels(len(names), 1, (9.2, 1.75 * len(names) + 0.5), sharex=True)
    for k, axis in enumerate(axes[:, 0]):
        axis.plot(*decimate(t_s, measured[:, k]), color=MEASUREMENT, lw=0.8, alpha=0.75, label=_("measured"))
        axis.plot(*decimate(t_s, model[:, k]), color=MODEL, lw=1.4, label=_("model"))
        axis.set_ylabel(names[k])
    axes[0, 0].legend(**LEGEND_ABOVE)
    axes[-1, 0].set_xlabel(_("time [s]"))
    return figure


@with_style
def residuals(residual: np.ndarray, names: Sequence[str], lags: int = 60) -> "Figure":
    """Draw the standardised residuals against the normal density, and their autocorrelation with its 95 % band.

    residual (N, m), in standard deviations; NaN is ignored. The panel of a channel without finite values stays empty.
    """
    figure, axes = panels(len(names), 2, (9.2, 1.9 * len(names) + 0.3))
    grid = np.linspace(-4.5, 4.5, 200)
    for k, (left, right) in enumerate(axes):
        r = residual[np.isfinite(residual[:, k]), k]
        name = names[k].partition(" [")[0]
        left.set_title(_("{name}: residual / σ", name=name))
        right.set_title(_("{name}: autocorrelation", name=name))
        left.set_ylabel(_("density"))
        if len(r) < 2:
            continue
        left.hist(np.clip(r, -4.5, 4.5), bins=60, density=True, color=MEASUREMENT, alpha=0.6)
        left.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color=TRUTH, lw=1)
        rho = autocorrelation(r, lags)
        right.bar(np.arange(1, len(rho) + 1), rho, width=0.8, color=MEASUREMENT)
        right.axhspan(-1.96 / np.sqrt(len(r)), 1.96 / np.sqrt(len(r)), color=REFERENCE, alpha=0.35)
        axis_limit = 1.0 if np.abs(rho).max(initial=0.0) > 0.5 else 0.5
        right.set_ylim(-axis_limit, axis_limit)
    axes[-1, 1].set_xlabel(_("lag (samples)"))
    return figure


def autocorrelation(r: np.ndarray, lags: int) -> np.ndarray:
    """Return the sample autocorrelation of r (N,) at lags 1 … lags."""
    r = r - r.mean()
    power = float(r @ r) or 1.0
    return np.array([float(r[k:] @ r[:-k]) / power for k in range(1, min(lags, len(r) - 1) + 1)])


@with_style
def estimates(
    names: Sequence[str], value: np.ndarray, std: np.ndarray, truth: np.ndarray | None = None
) -> "Figure":
    """Draw each estimate with its 95 % interval relative to the truth [%]; without a truth, the half-width of the
    interval relative to the estimate. An entry that is not finite, or relative to 0, is not drawn."""
    base = value if truth is None else truth
    scale = np.where(np.abs(base) > 0, np.abs(base), np.nan)
    centre, half_width = 100 * (value - base) / scale, 100 * 1.96 * std / scale
    is_finite = np.isfinite(centre) & (half_width > 0.0) & np.isfinite(half_width)
    labels = [name for name, k in zip(names, is_finite, strict=True) if k]
    figure, axis = panel((9.2, 0.32 * len(labels) + 1.1))
    rows = np.arange(len(labels))[::-1]
    axis.set_yticks(rows, labels)
    if truth is None:
        widths = half_width[is_finite]
        set_log_scale(axis.xaxis)
        axis.set_xlim(
            10.0 ** np.floor(np.log10(widths.min(initial=1.0))), max(200.0, 1.2 * widths.max(initial=0.0))
        )
        axis.barh(rows, widths, height=0.55, color=np.where(widths > MAX_PERCENT, ALARM, MODEL))
        axis.axvline(MAX_PERCENT, color=TRUTH, lw=1)
        axis.set_xlabel(_("± 95 % [% of the estimate]"), loc="right")
        return figure
    axis.errorbar(centre[is_finite], rows, xerr=half_width[is_finite], fmt="o", ms=4, color=MODEL, capsize=3)
    axis.axvline(0, color=TRUTH, lw=1)
    reach = np.abs(centre[is_finite]) + half_width[is_finite]
    if np.any(reach > MAX_PERCENT):  # a very wide interval would hide the widths of the others
        axis_limit = 1.05 * max(float(np.max(reach[reach <= MAX_PERCENT], initial=0.0)), 10.0)
        axis.set_xlim(-axis_limit, axis_limit)
        for row in rows[reach > axis_limit]:
            axis.annotate(_("beyond"), (axis_limit, row), ha="right", va="bottom", fontsize=7, color=ALARM)
    axis.set_xlabel(_("estimate − truth [%]"), loc="right")
    return figure


@with_style
def correlation(names: Sequence[str], matrix: np.ndarray) -> "Figure":
    """Draw the correlation matrix (n, n) of the estimates; a minus marks values below −0.5, for a print in grey."""
    n = len(names)
    figure, axis = panel((min(8.2, 0.38 * n + 3.2), min(6.6, 0.3 * n + 1.4)))
    image = axis.imshow(matrix, vmin=-1, vmax=1, cmap="RdBu_r", aspect="auto")
    ticks = range(0, n, 1 + n // 13)
    axis.set_xticks(ticks, [str(k + 1) for k in ticks], fontsize=8)
    axis.set_yticks(range(n), [f"{name}  {k + 1}" for k, name in enumerate(names)], fontsize=8)
    axis.grid(False)
    for row, column in np.argwhere(matrix < -0.5):
        axis.text(column, row, "−", color="white", ha="center", va="center", fontsize=8)
    figure.colorbar(image, ax=axis, orientation="horizontal", shrink=0.6, aspect=40, ticks=[-1, 0, 1])
    return figure


@with_style
def paths(
    lines: dict[str, np.ndarray], band: np.ndarray | None = None, end: np.ndarray | None = None
) -> "Figure":
    """Draw paths in the map. lines: "reference", "estimate", "truth" → (N, 2) [m].

    Two areas are shaded: `band` (M, 2, 2), the left and right edge along the path, and `end` (K, 2), a closed curve.
    """
    style = {
        "reference": {"color": REFERENCE, "lw": 4.5, "solid_capstyle": "round"},
        "estimate": {"color": MODEL, "lw": 1.3},
        "truth": {"color": TRUTH, "lw": 1.3},
    }
    figure, axis = panel((7.2, 6.2))
    if band is not None and len(band) > 1:
        axis.add_patch(_band_patch(band))
        axis.update_datalim(band.reshape(-1, 2))
    if end is not None:
        axis.plot(*end.T, color=MODEL, lw=0.9, ls=(0, (4, 3)), label=_("95 % at its end"))
    for name, xy in lines.items():
        axis.plot(xy[:, 0], xy[:, 1], label=_(name), **style.get(name, {"color": SECOND_COLOUR, "lw": 1.3}))
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _band_patch(band: np.ndarray) -> Any:
    """Return one patch of the triangles between the edges (M, 2, 2).

    All triangles have the same orientation, so that overlaps are not darker.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    left_edge, right_edge = band[:, 0], band[:, 1]
    first_triangles = (left_edge[:-1], right_edge[:-1], right_edge[1:])
    second_triangles = (left_edge[:-1], right_edge[1:], left_edge[1:])
    # (2 M − 2, 3, 2)
    corners = np.concatenate([np.stack(points, axis=1) for points in (first_triangles, second_triangles)])
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0.0
    corners[clockwise] = corners[clockwise, ::-1]
    outlines = np.concatenate([corners, corners[:, :1]], axis=1)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(outlines))
    shape = Path(outlines.reshape(-1, 2), codes)
    return PathPatch(shape, facecolor=MODEL, alpha=0.15, lw=0, label=_("corridor, 95 %"))


def ellipse(centre: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return 73 points (73, 2) of the curve that contains 95 % of a plane normal distribution."""
    eigenvalues, axes = np.linalg.eigh(cov)
    turn = np.linspace(0, 2 * np.pi, 73)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    return centre + (axes @ (np.sqrt(CHI_SQUARE_95 * np.clip(eigenvalues, 0, None))[:, None] * circle)).T


@with_style
def draw_time_series(
    curves: Sequence[tuple[str, dict[str, tuple[np.ndarray, np.ndarray]]]], height_in: float = 1.75
) -> "Figure":
    """Draw curves over time, a panel of `height_in` each: (label of the axis, {name of the curve: (t_s, y)}).

    A curve named "±2σ" is drawn as a band around zero, "limit" as
    dashed lines at ± its value, and "at its limit" as points.
    """
    figure, axes = panels(len(curves), 1, (9.2, height_in * len(curves) + 0.5), sharex=True)
    for axis, (label, lines) in zip(axes[:, 0], curves, strict=True):
        for name, (t, y) in lines.items():
            _curve(axis, name, t, y)
        axis.set_ylabel(label)
        if len(lines) > 1 and axis is axes[0, 0]:
            axis.legend(**LEGEND_ABOVE)
    axes[-1, 0].set_xlabel(_("time [s]"))
    return figure


CURVE_COLOURS = {
    "measured": MEASUREMENT,
    "applied": MEASUREMENT,
    "sent": MEASUREMENT,
    "residual": MEASUREMENT,
    "estimate": MODEL,
    "truth": TRUTH,
    "reference": REFERENCE,
    "requested": REFERENCE,
}
LINE_WIDTHS = {"requested": 2.6, "reference": 2.0, "truth": 1.8}


def _curve(axis: "Axes", name: str, t: np.ndarray, y: np.ndarray) -> None:
    """Draw a curve of a panel in the style of its name."""
    if name == "limit":
        for k, edge in enumerate((y, -y)):
            axis.plot(
                t[[0, -1]], edge[[0, -1]], color=ALARM, lw=0.9, ls=(0, (5, 4)), label="" if k else _(name)
            )
        return
    if name == "at its limit":
        axis.plot(t, y, ".", color=ALARM, ms=3, label=_(name))
        return
    t, y = decimate(t, y)
    if name == "±2σ":
        axis.fill_between(t, -y, y, color=MODEL, alpha=0.15, lw=0, label=name)
        for edge in (-y, y):  # before a dense curve
            axis.plot(t, edge, color=MODEL, lw=1.0, zorder=3)
    else:
        axis.plot(
            t, y, color=CURVE_COLOURS.get(name, SECOND_COLOUR), lw=LINE_WIDTHS.get(name, 1.1), label=_(name)
        )
