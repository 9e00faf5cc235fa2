"""Define the presentation of every result: a short print, a summary in a notebook, a figure, and a data frame.

A class that derives from `Result` has `table()`, the complete result as text, and `rows()`, flat dicts for programs.
The code that draws is in `report`, a layer above all results, which the package baqueano registers.
"""

import re
import textwrap
from collections.abc import Iterable, Sequence
from itertools import accumulate, chain
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from baqueano.contracts.calls import checked_call
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict, nearest, note
from baqueano.errors import NoAttribute, UsageError
from baqueano.messages import text, unbroken
from baqueano.messages.language import mark as N_, translate
from baqueano.messages.printable import join_rows
from baqueano.on_demand import registered_function

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


MAX_LINES, MAX_LETTERS = 12, 110  # lines, and characters of a line, of a short print
MIN_ROWS = 5  # least number of rows in a short print with long sentences
MIN_PREFIX = 3  # letters of a short name, such as cov of covariance
MAX_SENTENCE = 80  # characters of a line of sentences below a table


class PrintedTable(NamedTuple):
    """A printed table as data: a head for each column, and sections [{title, rows: [{label, unit, cells}]}]."""

    heads: tuple[str, ...]
    sections: list[JsonObject]


class Tabular(Protocol):
    """Protocol of an object with rows and a table: a Result, or a NamedTuple that uses the methods of Result."""

    def rows(self) -> list[TableRow]:
        """Return flat dicts, one for each row."""
        ...

    def table(self) -> str:
        """Return the complete result as text."""
        ...


class Result:
    """A result as the user sees it: `print(result)` prints at most MAX_LINES lines, `result.table()` returns all lines.

    Examples
    --------
    >>> run: Result = bq.simulate(bq.load("small"), np.zeros((10, 3)))
    >>> run.rows()[0]["topic"]
    'command applied'
    """

    __slots__ = ()

    def rows(self) -> list[TableRow]:
        """Return flat dicts, one for each row."""
        raise NotImplementedError

    def table(self) -> str:
        """Return the complete result as text."""
        raise NotImplementedError

    def printed_table(self) -> PrintedTable | None:
        """Return the printed table as data, for LaTeX; None if LaTeX shows the rows."""
        return None

    def __repr__(self) -> str:
        lines = self.table().splitlines()
        words = tuple(translate(verdict) for verdict in Verdict)
        start = next((i for i, line in enumerate(lines) if i and line.startswith(words)), len(lines))
        return shorten([], [line for line in lines[:start] if line or start == len(lines)], lines[start:])

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise NoAttribute with the attributes of the result. Also called for a property that fails."""
            if name.startswith("_") or name in dir(type(self)):
                return object.__getattribute__(self, name)
            raise no_attribute(self, name, type(self).__name__)

    def _repr_html_(self: Tabular) -> str:
        """Return the HTML summary that a notebook shows."""
        return registered_function("card_html")(self)

    @checked_call('result.plot("path", width="column")')
    def plot(
        self: Tabular,
        kind: str = "",
        *,
        ax: "Axes | None" = None,
        figure: "Figure | SubFigure | None" = None,
        width: str | float | None = None,
    ) -> "Figure":
        """Draw the result and return the figure: `plot(width="column").savefig("run.pdf")`.

        `kind` chooses another drawing of the result, `ax` or `figure` receives the drawing, `width` is "column", "page"
        or a number [mm]. Raise UsageError if matplotlib is not installed, or for an unknown kind, with a list of the
        known kinds.
        """
        return registered_function("plot")(self, kind, ax or figure, width)

    @checked_call('result.save_table("table.csv")')
    def save_table(self, path: "str | Path", decimal: str = ".") -> "Path":
        """Write the rows as a table, .csv or .tex, and return the path.

        `decimal=","` writes a .csv file for a spreadsheet with decimal commas. Raise UsageError for another file
        extension.
        """
        return registered_function("save_result")(self, path, decimal)

    def to_pandas(self: Tabular) -> Any:
        """Return the rows as a pandas DataFrame. Raise UsageError with the command to type if pandas is missing."""
        return pandas().DataFrame(self.rows())


def no_attribute(owner: object, name: str, label: str) -> NoAttribute:
    """Return the error for a missing attribute of `owner`, whose name is `label`: it lists methods, then values."""
    if name == "save" and "updated_file" in dir(owner):
        return NoAttribute.of("front.save-file", 'result.updated_file().save("vehicle.toml")', owner=label)
    names = [attribute for attribute in dir(owner) if not attribute.startswith("_")]
    names.sort(key=lambda attribute: not callable(getattr(type(owner), attribute, None)))
    short_name = next((n for n in names if len(n) >= MIN_PREFIX and name.startswith(n)), name)
    return NoAttribute.of(
        "front.no-attribute", owner=label, value=name, suggestion=nearest(short_name, names)
    )


def shorten(
    head: Sequence[str], rows: Sequence[str], tail: Sequence[str], line_count: int = MAX_LINES
) -> str:
    """Return a text of at most `line_count` lines: `head`, `rows`, how many more lines exist, and `tail`.

    Long lines are wrapped, never cut. The first row, and the first line of `tail`, are always part of the text.

    >>> print(shorten(["gains"], ["a 1", "b 2", "c 3", "d 4"], ["USABLE"], line_count=4))
    gains
    a 1
    more lines (3): .table()
    USABLE
    """
    first, middle, last = ([_parts(line) for line in lines] for lines in (head, rows, tail))
    free_count = line_count - _count(first)
    if free_count >= _count([*middle, *last]):
        return join_rows(chain(*first, *middle, *last))
    least_count = _count(middle[: min(MIN_ROWS, max(1, free_count - len(last[:1]) - 1))])
    tail_count = _fitting(last, free_count - 1 - min(least_count, free_count - 1), minimum=1)
    row_count = _fitting(middle, free_count - 1 - _count(last[:tail_count]), minimum=1)
    omission_note = text(note("front.more", lines=len(middle) - row_count + len(last[tail_count:])))
    return join_rows(chain(*first, *middle[:row_count], [omission_note], *last[:tail_count]))


def _count(lines: Sequence[Sequence[str]]) -> int:
    return sum(map(len, lines))


def _fitting(lines: Sequence[Sequence[str]], free_count: int, minimum: int) -> int:
    """Return the number of wrapped lines that fit into `free_count` lines, at least `minimum` if they exist."""
    ends = accumulate(map(len, lines))
    return max(sum(end <= free_count for end in ends), min(minimum, len(lines)))


def wrap_sentences(lines: Iterable[str], width: int = MAX_SENTENCE) -> list[str]:
    """Return sentences in lines of at most `width` letters. A command stays in one line, so that it can be copied.

    >>> wrap_sentences(["- the floor disturbs the vehicle. Type: baqueano identify last"], 30)
    ['- the floor disturbs the', '  vehicle. Type:', '  baqueano identify last']
    """
    unsplit_lines = [
        re.sub(r"baqueano [a-z].*", lambda command: command[0].replace(" ", "\0"), line) for line in lines
    ]
    return [
        part.replace("\0", " ").replace("\u00a0", " ")
        for line in unsplit_lines
        for part in textwrap.wrap(
            unbroken(line), width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
    ]


def _parts(line: str) -> list[str]:
    """Return a line in parts: a sentence has at most MAX_SENTENCE letters, a row of a table MAX_LETTERS."""
    is_row = "  " in line.strip()
    return wrap_sentences([line]) if len(line) > (MAX_LETTERS if is_row else MAX_SENTENCE) else [line]


def pandas() -> Any:
    """Return the module pandas. Raise UsageError if it is not installed."""
    try:
        import pandas  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UsageError.of(
            "front.missing", "pip install pandas", package="pandas", feature=N_("a data frame")
        ) from error
    return pandas
