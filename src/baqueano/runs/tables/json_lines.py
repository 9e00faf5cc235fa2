"""Read a log of JSON lines as columns: one object per line, as written by telemetry, MQTT and message brokers.

    {"t": 0.02, "cmd": {"v": 0.3}, "enc": [10, 12]}  →  t, cmd.v, enc.0, enc.1 = 0.02, 0.3, 10, 12        (1)

A cell is empty in each line that lacks its column, so a topic can have its own lines.
"""

import json
from array import array
from collections.abc import Iterator

from baqueano.contracts.values import JsonObject, Value
from baqueano.diagnostics import fault
from baqueano.errors import FileError
from baqueano.runs.tables.cells import pack
from baqueano.runs.tables.lines import CELL_BYTES, Lines

BLOCK_LINES = 1024


def is_json_line(line: str) -> bool:
    """Return True if a line begins as an object of JSON, and not as a cell of a table.

    >>> is_json_line('{"t": 0.02}'), is_json_line("{t},{v}")
    (True, False)
    """
    return line.lstrip().startswith(('{"', "{ ", "{}"))


def json_columns(
    lines: Lines, rows: Iterator[tuple[int, str]], max_columns: int
) -> tuple[dict[str, bytearray], "array[int]", tuple[int, ...]]:
    """Return the cells of each column, the line number of each row, and the number of an incomplete last line.
    Raise FileError for a line that is not an object, and for too many columns.
    """
    columns: dict[str, bytearray] = {}
    line_numbers, problem, texts = array("q"), None, 0
    for line_number, line in rows:
        if problem is not None:
            raise FileError(problem)
        try:
            cells = dict(_cells("", json.loads(line)))
        except (ValueError, RecursionError) as error:
            problem = fault("table.not-json", file=lines.label, line=line_number, error=str(error))
            continue
        for name in cells:
            columns.setdefault(name, bytearray(len(line_numbers)))  # empty cells before its first line
        if len(columns) > max_columns:
            raise FileError.of("table.columns", file=lines.label, count=len(columns), maximum=max_columns)
        for name, column in columns.items():
            column += pack([cells.get(name, "")])
        line_numbers.append(line_number)
        texts += 1
        if texts == BLOCK_LINES:
            lines.reserve_memory(CELL_BYTES * len(columns) * texts)
            texts = 0
    if problem is not None and not line_numbers:
        raise FileError(problem)
    return columns, line_numbers, () if problem is None else (lines.number,)


def _cells(name: str, value: Value) -> Iterator[tuple[str, str]]:
    """Yield name and text of each number, text or boolean in a value.  (1)"""
    if isinstance(value, dict | list):
        members: JsonObject = value if isinstance(value, dict) else {str(k): x for k, x in enumerate(value)}
        for key, member in members.items():
            yield from _cells(f"{name}.{key}" if name else key, member)
    elif not name:
        raise ValueError(repr(value))
    else:
        text = value if isinstance(value, str) else "" if value is None else json.dumps(value)
        yield name, text.replace("\0", " ").strip()
