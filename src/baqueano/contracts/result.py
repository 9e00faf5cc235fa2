"""The face of every result: a short print, a card in a notebook, a figure, and a data frame.

A class that derives from `Result` has `table()`, the whole for people, and `rows()`, flat dicts for machines. What
draws stands in `report`, above all results, and is loaded by its name when somebody asks for it.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from baqueano.diagnostics import fault, note
from baqueano.errors import UsageError
from baqueano.language import marked as N_
from baqueano.messages import text
from baqueano.printable import in_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from baqueano.contracts.values import TableRow

LINES, LETTERS = 12, 110  # of a short print


class Tabular(Protocol):
    """Anything with rows and a table: a Result, or a NamedTuple, which takes the methods of one."""

    def rows(self) -> list["TableRow"]:
        """Return flat dicts, one for each row."""
        ...

    def table(self) -> str:
        """Return the whole, for people."""
        ...


class Result:
    """A result as a person sees it. `print(result)` gives at most LINES lines, `result.table()` all of it.

    Examples
    --------
    >>> run: Result = bq.simulate(bq.load("small"), np.zeros((10, 3)))
    >>> run.rows()[0]["topic"]
    'command applied'
    """

    __slots__ = ()

    def rows(self) -> list["TableRow"]:
        """Flat dicts, one for each row."""
        raise NotImplementedError

    def table(self) -> str:
        """The whole, for people."""
        raise NotImplementedError

    def __repr__(self) -> str:
        lines = self.table().splitlines()
        return shortened([], lines, []) if len(lines) > LINES else in_lines(map(_cut, lines))

    def _repr_html_(self: Tabular) -> str:
        """Return the card that a notebook shows."""
        return import_module("baqueano.report.card").html_of(self)

    def plot(
        self: Tabular,
        kind: str = "",
        *,
        ax: "Axes | None" = None,
        figure: "Figure | SubFigure | None" = None,
        width: str | float | None = None,
    ) -> "Figure":
        """Draw the result and return the figure, to be styled or written: `plot(width="column").savefig("run.pdf")`.

        `kind` is another of its drawings than the first, `ax` or `figure` takes the drawing, `width` is "column",
        "page" or a number of millimetres. UsageError for another kind, which names those there are, or without
        matplotlib.
        """
        return import_module("baqueano.report.plots").plot(self, kind, ax or figure, width)

    def to_pandas(self: Tabular) -> Any:
        """Return the rows as a pandas DataFrame. UsageError, with what to type, where pandas is not installed."""
        return pandas().DataFrame(self.rows())


def shortened(head: Sequence[str], rows: Sequence[str], tail: Sequence[str], lines: int = LINES) -> str:
    """Return `head`, as many `rows` as there is room for, how many more there are, and `tail`.

    >>> print(shortened(["gains"], ["a 1", "b 2", "c 3", "d 4"], ["USABLE"], lines=4))
    gains
    a 1
    3 more lines: .table()
    USABLE
    """
    room = max(1, lines - len(head) - len(tail))
    if len(rows) > room:
        rows = [*rows[: room - 1], text(note("front.more", lines=len(rows) - room + 1))]
    return in_lines(map(_cut, [*head, *rows, *tail]))


def _cut(line: str) -> str:
    return line if len(line) <= LETTERS else f"{line[: LETTERS - 2]} …"


def pandas() -> Any:
    """The library of data frames. UsageError where it is missing."""
    try:
        import pandas  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UsageError(
            fault("front.missing", "pip install pandas", package="pandas", what=N_("a data frame"))
        ) from error
    return pandas
