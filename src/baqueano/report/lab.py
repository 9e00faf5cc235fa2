"""The two libraries of the laptop that a report needs, loaded when one is written."""

from typing import Any

from baqueano.diagnostics import fault
from baqueano.errors import UsageError

LAB = 'pip install "baqueano[lab]"'

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


def pyplot() -> Any:
    """matplotlib.pyplot without a window, in the style of our figures.  Raises UsageError where it is missing."""
    try:
        import matplotlib
    except ImportError as error:
        raise UsageError(fault("lab.missing", LAB, name="matplotlib")) from error
    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams.update(STYLE)
    return plt


def jinja2() -> Any:
    """The template engine.  Raises UsageError, with what to install, where it is missing."""
    try:
        import jinja2
    except ImportError as error:
        raise UsageError(fault("lab.missing", LAB, name="jinja2")) from error
    return jinja2
