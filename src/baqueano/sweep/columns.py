"""The columns of the tables of a sweep: short names of the combinations, cells, and lines of text."""

import re
from collections.abc import Sequence

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import LINE_LETTERS
from baqueano.sweep.figures import ALL_FIGURES

FILE_CLASS = re.compile(r"(?P<file>[^ ]*[/\\.][^ :]*):(?P<name>\w+)")
MAX_LABEL_LETTERS = 32  # characters of a label


def ratio_cell(row: TableRow, name: str, reference: str) -> str:
    """Return the ratio of the result `name` to that of `reference`, with its interval; `row` is of `combinations`."""
    if row["combination"] == reference or not np.isfinite(row[f"{name}_ratio"]):
        return "1" if row["combination"] == reference else "-"
    if not np.isfinite(row[f"{name}_low"]):
        return f"{number(row[f'{name}_ratio']):.2f} [-]"
    return _(
        "{ratio:.2f} [{low:.2f}, {high:.2f}]",
        **{end: row[f"{name}_{end}"] for end in ("ratio", "low", "high")},
    )


def short_labels(labels: Sequence[str]) -> dict[str, str]:
    """Return a short name of each label: with the class alone instead of file.py:Class, if this name is unique.

    Otherwise the file with its folder replaces the class, such as ana/my_controller, or the whole path.
    """
    for shorten_name in (
        lambda match: match["name"],
        lambda match: "/".join(re.split(r"[/\\]", match["file"])[-2:]).removesuffix(".py"),
        lambda match: match["file"].removesuffix(".py"),
    ):
        names = {label: FILE_CLASS.sub(shorten_name, label) for label in labels}
        if len(set(names.values())) == len(names):
            return names
    return dict(zip(labels, labels, strict=True))


def median_columns(
    rows: Sequence[TableRow], blocks: Sequence[Sequence[str]], main: str, reference: str
) -> list[list[list[str]]]:
    """Return the columns of each block of names: heading, unit, and a cell for each of the `rows`.

    The first block also has the ratio of the result `main`, and the count of stopped drives if there are any.
    """
    tables = [[_figure_column(name, rows) for name in block] for block in blocks if block]
    if tables and len(rows) > 1:
        tables[0].insert(1, [_("ratio"), "", *(ratio_cell(row, main, reference) for row in rows)])
    if tables and any(row["stopped"] for row in rows):
        tables[0].insert(0, [_("stopped"), _("drives"), *(str(row["stopped"]) for row in rows)])
    return tables


def _figure_column(name: str, rows: Sequence[TableRow]) -> list[str]:
    """Return the cells of a column: heading, unit, and the value of each row."""
    figure = ALL_FIGURES[name]
    values = (row[name] * figure.scale for row in rows)
    return [_(figure.heading), figure.unit, *map(number_cell, values)]


def number_cell(value: float) -> str:
    """Return a number with three digits, or - for NaN."""
    return f"{number(value):.3g}" if np.isfinite(value) else "-"


def table_lines(labels: Sequence[str], columns: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the lines of as many tables as the columns need, each at most LINE_LETTERS wide. A label of more than
    MAX_LABEL_LETTERS has its own line, above its values.
    """
    width = min(max(map(len, labels)), MAX_LABEL_LETTERS)
    column_widths = [max(map(len, column)) + 2 for column in columns]
    tables: list[list[list[str]]] = []
    left = 0
    for column, letters in zip(columns, column_widths, strict=True):
        if letters > left:
            tables.append([])
            left = LINE_LETTERS - width
        tables[-1].append([f"{cell:>{letters}}" for cell in column])
        left -= letters
    blocks_of_lines = []
    for table in tables:
        heads, units, *values = ("".join(cells) for cells in zip(*table, strict=True))
        lines = [f"{'':{width}}{words}" for words in (heads, units.rstrip()) if words]
        for label, words in zip(labels, values, strict=True):
            lines += [f"{label:{width}}{words}"] if len(label) <= width else [label, f"{'':{width}}{words}"]
        blocks_of_lines.append(lines)
    return blocks_of_lines
