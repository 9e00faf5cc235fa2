"""Create figures that a notebook shows, or that are written as SVG, PDF or PNG at the width of a printed page.

This module is imported only when a figure is drawn, because it loads matplotlib.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from textwrap import fill
from typing import Any

from matplotlib import rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import LogFormatterSciNotation, ScalarFormatter

from baqueano.diagnostics import nearest
from baqueano.errors import UsageError
from baqueano.messages.language import number
from baqueano.report.style import LEGEND_ABOVE

WIDTHS_MM = {"column": 88.0, "page": 181.0}  # of a journal of two columns
MM = 1.0 / 25.4
NARROW_FACTOR = 0.7  # share of the width that a figure was drawn for: below it letters and lines are smaller
TEXT_FACTOR = 0.8  # scale of text and lines at the width of a column; in proportion if a figure is narrower
HEIGHT_EXPONENT = 0.5  # a narrow figure over time keeps more of its height than of its width
MAX_LABEL_LETTERS = 28  # letters of a title or a label of a narrow figure
MAX_LEGEND_SHARE = 0.75  # fraction of the width of a narrow figure, for a legend


class CommaFormatter(ScalarFormatter):
    """A formatter that writes the numbers of an axis with a decimal comma."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x, pos).replace(".", ",")

    def get_offset(self) -> str:
        """Return the factor at the end of the axis as text, with a decimal comma."""
        return super().get_offset().replace(".", ",")


class DecimalLogFormatter(LogFormatterSciNotation):
    """A formatter that writes the numbers of a logarithmic axis as 0.2, not as 2 × 10⁻¹."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        words = super().__call__(x, pos)
        return f"{number(x):.6g}" if words and 1e-4 < x < 1e5 else words


class Canvas(Figure):
    """A figure without a window: a notebook shows it if it is the last expression of a cell."""

    _is_saving = False

    def savefig(self, fname: Any, **options: Any) -> None:
        """Write the figure in the format of the file extension or of `format`; text stays text."""
        salt = rcParams["svg.hashsalt"] or "baqueano"
        self._is_saving = options.get("bbox_inches") != "tight"
        try:
            with rc_context({"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": salt}):
                super().savefig(fname, **options)
        finally:
            self._is_saving = False

    def draw(self, renderer: Any) -> None:
        """Draw the figure. `savefig` first draws it without output, only for its layout: then compute the layout."""
        layout = self.get_layout_engine()
        if self._is_saving and isinstance(layout, ConstrainedLayoutEngine):
            layout.execute(self)
        else:
            super().draw(renderer)

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, for a notebook."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=110, facecolor="white")
        return buffer.getvalue()


def resize_figure(figure: Figure, width: str | float | None) -> Figure:
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
        _shrink_text(figure, TEXT_FACTOR * min(1.0, width_mm(width) / WIDTHS_MM["column"]))
    return figure


@contextmanager
def with_width(figure: Figure, width: str | float | None) -> Iterator[Figure]:
    """Resize a figure as `resize_figure` does, and restore its size, text and lines afterwards."""
    wide_in, high_in = figure.get_size_inches()
    artists = figure.findobj()
    texts = [(text, text.get_text(), text.get_fontsize()) for text in artists if isinstance(text, Text)]
    lines = [(line, line.get_linewidth()) for line in artists if isinstance(line, Line2D)]
    legends = [(place, _find_legend(place)) for place in (figure, *figure.axes)]
    ticks = [(axis, _tick_size(axis)) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    try:
        yield resize_figure(figure, width)
    finally:
        figure.set_size_inches(wide_in, high_in)
        for place, legend in legends:
            _set_legend(place, legend)
        for text, words, letters in texts:
            text.set_text(words)
            text.set_fontsize(letters)
        for line, thickness in lines:
            line.set_linewidth(thickness)
        for axis, letters in ticks:
            axis.set_tick_params(labelsize=letters)


@contextmanager
def with_narrow_legends(figure: Figure) -> Iterator[None]:
    """Give each legend that is wider than the figure fewer columns, and restore the legends afterwards."""
    places = figure, *figure.axes
    legends = [(place, _find_legend(place)) for place in places]
    try:
        for place in places:
            _fit_legend(place, MAX_LEGEND_SHARE * figure.get_figwidth() * figure.dpi)
        yield
    finally:
        for place, legend in legends:
            _set_legend(place, legend)


def width_mm(width: str | float) -> float:
    """Return a width in millimetres. Raise UsageError for an unknown name, or a number that is out of range."""
    if isinstance(width, str):
        if width not in WIDTHS_MM:
            raise UsageError.of("front.width-unknown", value=width, suggestion=nearest(width, WIDTHS_MM))
        return WIDTHS_MM[width]
    if not 20.0 <= width <= 2000.0:
        raise UsageError.of("front.width-mm", value=float(width))
    return float(width)


def _shrink_text(figure: Figure, scale: float) -> None:
    """Reduce text and lines to `scale`, and break long labels."""
    specs = [axes.get_subplotspec() for axes in figure.axes]
    columns = max((spec.get_gridspec().ncols for spec in specs if spec is not None), default=1)
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(scale * float(text.get_fontsize()))
        if text.get_rotation() == 0.0:
            text.set_text(fill(text.get_text(), MAX_LABEL_LETTERS // columns + 4))
    for line in figure.findobj(Line2D):
        assert isinstance(line, Line2D)
        line.set_linewidth(scale * line.get_linewidth())
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_tick_params(labelsize=_tick_size(axis))
    for place in (figure, *figure.axes):
        _fit_legend(place, MAX_LEGEND_SHARE * figure.get_figwidth() * figure.dpi)


def _fit_legend(place: Figure | Axes, room: float) -> None:
    """Replace a legend that is wider than `room` [pixels] by a legend with fewer columns."""
    legend = _find_legend(place)
    if legend is None or legend.get_window_extent().width <= room:
        return
    entries = zip(legend.legend_handles, legend.get_texts(), strict=True)
    handles, texts = zip(*((handle, text) for handle, text in entries if handle is not None), strict=True)
    words = [fill(text.get_text(), MAX_LABEL_LETTERS) for text in texts]
    position = {"loc": "outside upper left"} if isinstance(place, Figure) else LEGEND_ABOVE
    letters = min(float(text.get_fontsize()) for text in texts)
    for columns in (3, 2, 1):
        _set_legend(place, None)
        options = position | {"ncols": columns, "fontsize": letters, "frameon": legend.get_frame_on()}
        new = place.legend(handles, words, **options)
        if new.get_window_extent().width <= room:
            return


def _find_legend(place: Figure | Axes) -> Legend | None:
    """Return the legend of a figure or of axes; None without one."""
    if isinstance(place, Figure):
        return next(iter(place.legends), None)
    return place.get_legend()


def _set_legend(place: Figure | Axes, legend: Legend | None) -> None:
    """Replace the legend of a figure or of axes."""
    if isinstance(place, Figure):
        place.legends[:] = [] if legend is None else [legend]
    else:
        place.legend_ = legend


def _tick_size(axis: Axis) -> float:
    """Return the smallest size of the letters at an axis [pt]."""
    return min((float(label.get_fontsize()) for label in axis.get_ticklabels()), default=8.0)
