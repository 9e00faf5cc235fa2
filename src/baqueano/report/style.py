"""Define the style of the figures: colours, fonts, and the place of a legend."""

from typing import Any

from baqueano.contracts.values import JsonObject

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "baqueano",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a8f98",
    "axes.labelcolor": "#3d434c",
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e7eb",
    "grid.linewidth": 0.8,
    "xtick.color": "#5c636e",
    "ytick.color": "#5c636e",
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.constrained_layout.use": True,
    "path.simplify_threshold": 0.5,
}
LEGEND_ABOVE: JsonObject = {
    "loc": "lower left",
    "bbox_to_anchor": (0.0, 1.0),
    "ncols": 4,
    "borderaxespad": 0.2,
}
