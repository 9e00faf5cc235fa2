"""Create figures that a notebook shows, or that are written as SVG, PDF or PNG at the width of a printed page.

This module is imported only when a figure is drawn, because it loads matplotlib.
"""

import io
from textwrap import fill
from typing import Any

from matplotlib import rc_context, rcParams
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import ScalarFormatter

from baqueano.diagnostics import fault, nearest
from baqueano.errors import UsageError

WIDTHS_MM = {"column": 88.0, "page": 181.0}  # of a journal of two columns
MM = 1.0 / 25.4
NARROW_FACTOR = 0.7  # of the width for which a figure was drawn: below it text and lines are smaller
TEXT_FACTOR = 0.8
HEIGHT_EXPONENT = 0.5  # a narrow figure over time keeps more of its height than of its width
MAX_LABEL_LETTERS = 28  # characters of a title or a label of a narrow figure


class CommaFormatter(ScalarFormatter):
    """A formatter that writes the numbers of an axis with a decimal comma."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x, pos).replace(".", ",")

    def get_offset(self) -> str:
        """Return the factor at the end of the axis as text, with a decimal comma."""
        return super().get_offset().replace(".", ",")


class Canvas(Figure):
    """A figure without a window: a notebook shows it if it is the last expression of a cell."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write the figure in the format of the file extension or of `format`; text stays text."""
        salt = rcParams["svg.hashsalt"] or "baqueano"
        with rc_context({"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": salt}):
            super().savefig(fname, **options)

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, for a notebook."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=110, facecolor="white")
        return buffer.getvalue()


def at_width(figure: Figure, width: str | float | None) -> Figure:
    """Resize a figure to `width`, "column", "page" or millimetres, with legible text, and return it.

    Raise UsageError for another width.
    """
    if width is None:
        return figure
    width_in, height_in = figure.get_size_inches()
    factor = width_mm(width) * MM / width_in
    square = any(axes.get_aspect() != "auto" for axes in figure.axes)
    figure.set_size_inches(factor * width_in, height_in * (factor if square else factor**HEIGHT_EXPONENT))
    if factor < NARROW_FACTOR:
        _shrink_text(figure)
    return figure


def width_mm(width: str | float) -> float:
    """Return a width in millimetres. Raise UsageError for an unknown name, or a number that is out of range."""
    if isinstance(width, str):
        if width not in WIDTHS_MM:
            raise UsageError(fault("front.width-unknown", found=width, near=nearest(width, WIDTHS_MM)))
        return WIDTHS_MM[width]
    if not 20.0 <= width <= 2000.0:
        raise UsageError(fault("front.width-mm", found=float(width)))
    return float(width)


def _shrink_text(figure: Figure) -> None:
    """Reduce text and lines, and break long labels."""
    specs = [axes.get_subplotspec() for axes in figure.axes]
    columns = max((spec.get_gridspec().ncols for spec in specs if spec is not None), default=1)
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(TEXT_FACTOR * float(text.get_fontsize()))
        if text.get_rotation() == 0.0:
            text.set_text(fill(text.get_text(), MAX_LABEL_LETTERS // columns + 4))
    for line in figure.findobj(Line2D):
        assert isinstance(line, Line2D)
        line.set_linewidth(TEXT_FACTOR * line.get_linewidth())
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            size = min((float(label.get_fontsize()) for label in axis.get_ticklabels()), default=8.0)
            axis.set_tick_params(labelsize=size)
