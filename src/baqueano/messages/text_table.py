"""Lay out a table for a terminal: each column is as wide as its widest cell, in every language."""

import re
from collections.abc import Sequence
from textwrap import wrap

from baqueano.messages import unbroken

LINE_LETTERS = 80  # characters of a line
MIN_LAST_LETTERS = 24  # of a cell that is wrapped, and of the place in which it is wrapped
INDENT = 4  # of words that are written below their line
CODE = re.compile(r"\w+ = \S+|\bbaqueano( [-\w./:\"'=]+)+")  # to type as it is printed, so in one line
NO_BREAK = "\N{NO-BREAK SPACE}"


def text_table(sides: str, *lines: Sequence[str]) -> list[str]:
    """Return the lines of a table, the head first, each given as its cells. `sides` contains "<" for each column of
    words and ">" for each column of numbers. Words of the last column beyond LINE_LETTERS are wrapped, and so are
    headings without a number in a table that is wider. Raise ValueError if a line has another number of cells.
    """
    if sum(max(map(len, column)) + 2 for column in zip(*lines, strict=True)) > LINE_LETTERS + 2:
        lines = *_heads(sides, lines), *lines[1:]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    start = sum(widths[:-1]) + 2 * (len(widths) - 1)
    indent = start if start <= LINE_LETTERS - MIN_LAST_LETTERS else INDENT
    wrapped_lines: list[str] = []
    for line in lines:
        cells = [f"{cell:{side}{width}}" for cell, side, width in zip(line, sides, widths, strict=True)]
        row_text = "  ".join(cells).rstrip()
        if sides[-1:] == ">" or len(row_text) <= LINE_LETTERS or len(line[-1]) <= MIN_LAST_LETTERS:
            wrapped_lines.append(row_text)
            continue
        words = _wrapped(line[-1], LINE_LETTERS - indent)
        first_cells = "  ".join(cells[:-1])
        wrapped_lines += [f"{first_cells}  {words.pop(0)}"] if indent == start else [first_cells.rstrip()]
        wrapped_lines += [f"{'':{indent}}{part}" for part in words]
    return wrapped_lines


def _heads(sides: str, lines: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the first line of a table as several lines, in which no heading of numbers is wider than necessary."""
    columns = []
    for side, head, *cells in zip(sides, *lines, strict=True):
        is_heading = side == ">" and not any(map(str.isdigit, head))
        width = max(map(len, [*cells, *head.split(), " "]))
        columns.append((wrap(head, width) or [""]) if is_heading else [head])
    height = max(map(len, columns))
    return [
        list(row) for row in zip(*([""] * (height - len(column)) + column for column in columns), strict=True)
    ]


def with_remark(line: str, remark: str) -> list[str]:
    """Return a line of the table with its remark, which is below the line if both are wider than LINE_LETTERS."""
    full_line = f"{line}  ({remark})" if remark else line
    return [full_line] if len(full_line) <= LINE_LETTERS or not remark else [line, f"{'':{INDENT}}({remark})"]


def _wrapped(words: str, letters: int) -> list[str]:
    """Return the lines of a text, in which a key with its value, a quantity and a command are not divided."""
    whole_commands = CODE.sub(lambda match: match[0].replace(" ", NO_BREAK), words)
    lines = wrap(unbroken(whole_commands), letters, break_long_words=False, break_on_hyphens=False) or [""]
    return [line.replace(NO_BREAK, " ") for line in lines]
