"""Lay out a table for a terminal: each column is as wide as its widest cell, in every language."""

from collections.abc import Sequence


def text_table(sides: str, *lines: Sequence[str]) -> list[str]:
    """Return the lines of a table, the head first, each given as its cells. `sides` contains "<" for each column of
    words and ">" for each column of numbers. Raise ValueError if a line has another number of cells.
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            f"{cell:{side}{width}}" for cell, side, width in zip(line, sides, widths, strict=True)
        ).rstrip()
        for line in lines
    ]
