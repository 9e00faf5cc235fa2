"""Load matplotlib and jinja2, the two libraries for a report, when a report is written."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, ParamSpec, TypeAlias, TypeVar

import numpy as np

from baqueano.errors import UsageError
from baqueano.messages.language import current_language, mark as N_
from baqueano.report.style import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure, SubFigure

    Target: TypeAlias = Axes | Figure | SubFigure | None

INSTALL_COMMAND = "pip install matplotlib jinja2"

_TARGET: "ContextVar[Target]" = ContextVar("target", default=None)  # an axes or a figure of the user's
P = ParamSpec("P")
Drawn = TypeVar("Drawn")


@contextmanager
def draw_onto(target: "Target") -> Iterator[None]:
    """Draw on the user's axes, figure or subfigure, in their style. Without them, draw on a new figure."""
    token = _TARGET.set(target)
    try:
        yield
    finally:
        _TARGET.reset(token)


def with_style(draw: Callable[P, Drawn]) -> Callable[P, Drawn]:
    """Return `draw` with the style of this package, which does not apply to the user's own figures."""

    @wraps(draw)
    def wrapper(*args: P.args, **options: P.kwargs) -> Drawn:
        if _TARGET.get() is not None:
            return draw(*args, **options)
        with matplotlib().rc_context(STYLE):
            return draw(*args, **options)

    return wrapper


def panels(
    rows: int, columns: int, size_in: tuple[float, float], sharex: bool = False
) -> tuple["Figure", np.ndarray]:
    """Return a figure of `size_in` [in] and its axes (rows, columns), or the axes that `draw_onto` set.

    Raise UsageError if matplotlib is missing, or if axes are given for a drawing of several panels.
    """
    matplotlib()
    from matplotlib.axes import Axes

    from baqueano.report.canvas import Canvas

    target = _TARGET.get()
    if isinstance(target, Axes):
        if rows * columns > 1:
            raise UsageError.of("front.several-panels", panels=rows * columns)
        return target.figure, np.array([[target]])  # pyright: ignore[reportReturnType]
    figure = Canvas(figsize=size_in) if target is None else target
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex)
    _use_decimal_comma(axes)
    return figure, axes  # pyright: ignore[reportReturnType]


def _use_decimal_comma(axes: np.ndarray) -> None:
    """Format the numbers at the axes with the decimal comma of the current language."""
    if current_language() == "en":
        return
    from baqueano.report.canvas import CommaFormatter

    for axis in (axis for axes_pair in axes.flat for axis in (axes_pair.xaxis, axes_pair.yaxis)):
        axis.set_major_formatter(CommaFormatter())


def set_log_scale(axis: "Axis") -> None:
    """Make an axis logarithmic, with decimal numbers."""
    from baqueano.report.canvas import DecimalLogFormatter

    (axis.axes.set_xscale if axis is axis.axes.xaxis else axis.axes.set_yscale)("log")
    axis.set_major_formatter(DecimalLogFormatter())
    axis.set_minor_formatter(DecimalLogFormatter(labelOnlyBase=False, minor_thresholds=(1.0, 0.4)))


def panel(size_in: tuple[float, float]) -> tuple["Figure", "Axes"]:
    """Return a figure with a single axes, as `panels` does."""
    figure, axes = panels(1, 1, size_in)
    return figure, axes[0, 0]


def matplotlib() -> ModuleType:
    """Return the module matplotlib. If it is missing, raise UsageError with the command to install it."""
    return _library("matplotlib", N_("a figure"))


def jinja2() -> ModuleType:
    """Return the module jinja2. If it is missing, raise UsageError with the command to install it."""
    return _library("jinja2", N_("a report"))


def _library(name: str, purpose: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise UsageError.of("front.missing", INSTALL_COMMAND, package=name, feature=purpose) from error
