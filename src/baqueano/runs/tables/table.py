"""Read a CSV file, or JSON lines, as columns of text, and the numbers in these columns, without silent guesses.

The encoding is detected (lines.py), the separator if only one fits every line or if the first line is `sep=;`, and the
decimal comma if all numbers are unambiguous. Otherwise an error message contains the line that the map needs.
"""

import csv
import re
from array import array
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import FileError
from baqueano.messages.language import translate as _
from baqueano.runs.tables.cells import Cells, pack
from baqueano.runs.tables.json_lines import is_json_line, json_columns
from baqueano.runs.tables.lines import CELL_BYTES, Lines

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
MISSING_TEXTS = {"", "nan", "na", "n/a", "null", "none", "-"}
MAX_COLUMNS = 10_000
BLOCK_CELLS = 16_384  # cells that are text at the same time
MAX_SHOWN_NAMES = 30  # columns that a message names

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?inf", re.ASCII | re.IGNORECASE)
DIGIT_CELLS, INTEGER_CELLS = re.compile(rb"[-+.eE0-9\0]*"), re.compile(rb"[-+0-9\0]*")  # cells, joined by \0
_EXCHANGE = bytes.maketrans(b".,", b",.")
_BLANK = re.compile(rb"[^\S\0]|[\x80-\xff]")  # a blank, or a byte that can belong to a blank
_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?", re.ASCII)
_DECLARATION = re.compile(r'"?sep=([,;|\t])"?', re.IGNORECASE)  # the first line of a file for Excel
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)


MAX_INTEGER_TEXT_VALUE = 1e308  # about the largest integer that a double can represent


class LogTable(NamedTuple):
    """The columns of a file, as text or numbers."""

    label: str  # the file, for messages
    columns: JsonObject  # name → Cells, or an array (bags); None: several columns have that name
    lines: np.ndarray  # (rows,) line of the file, or number of the message
    decimal: str = "."
    cut: tuple[int, ...] = ()  # lines that were excluded
    kept_rows: np.ndarray | None = None  # (rows,) indices in the file; None: all rows are kept

    @property
    def row_indices(self) -> np.ndarray:
        """Return the index of each row in the file, without its blank lines and comments: (rows,)."""
        return np.arange(len(self.lines)) if self.kept_rows is None else self.kept_rows

    def text(self, column: str) -> Any:
        """Return the column as it was read. Raise FileError if no column or several columns have that name."""
        import difflib

        if column not in self.columns:
            close_names = difflib.get_close_matches(column, self.columns, n=3, cutoff=0.4)
            names = [
                *map(repr, [*self.columns][:MAX_SHOWN_NAMES]),
                *["…"] * (len(self.columns) > MAX_SHOWN_NAMES),
            ]
            code = "table.column-mistyped" if close_names else "table.no-column"
            cells = [self._first_cells(name) for name in close_names]
            raise FileError.of(
                code, file=self.label, column=column, match=map(repr, close_names), cells=cells, valid=names
            )
        if self.columns[column] is None:
            raise FileError.of("table.column-twice", file=self.label, column=column)
        return self.columns[column]

    def _first_cells(self, column: str) -> str:
        """Return the first cells of a column as text, for a message."""
        cells = self.columns[column]
        return _("several columns of that name") if cells is None else f"{', '.join(map(str, cells[:3]))}, …"

    def numbers(self, column: str) -> np.ndarray:
        """Return the numbers (rows,) of a column, float64; NaN if the cell is empty or one of MISSING_TEXTS."""
        cells = self.text(column)
        if isinstance(cells, np.ndarray):
            return cells.astype(np.float64)
        values = np.empty(len(cells))
        for rows, block in Cells.of(cells).blocks():
            block = block.translate(_EXCHANGE) if self.decimal == "," else block  # 1.234 is refused as 1,234
            try:
                if not DIGIT_CELLS.fullmatch(block):  # otherwise each cell is tested with _NUMBER
                    raise ValueError
                values[rows] = list(map(float, block.split(b"\0")))
            except ValueError:
                for i, cell in enumerate(block.decode().split("\0"), rows.start):
                    values[i] = self._cell_number(cell, column, i)
        return values

    def _cell_number(self, cell: str, column: str, row: int) -> float:
        """Return the number in a cell: NaN for one of MISSING_TEXTS, 1 for true, 0 for false.
        Raise FileError for any other text.
        """
        if _NUMBER.fullmatch(cell):
            return float(cell)
        lower_text = cell.lower()
        if lower_text in MISSING_TEXTS:
            return np.nan
        if lower_text in ("true", "false"):
            return float(lower_text == "true")
        raise FileError(self._number_error(column, row))

    def integers(self, column: str) -> np.ndarray | None:
        """Return the column as int64 (rows,), or None if a cell is not an integer.
        A float cannot represent nanoseconds since 1970 exactly.
        """
        cells = self.text(column)
        if isinstance(cells, np.ndarray):
            return cells.astype(np.int64) if cells.dtype.kind in "iu" else None
        values = np.empty(len(cells), dtype=np.int64)
        for rows, block in Cells.of(cells).blocks():
            if not INTEGER_CELLS.fullmatch(block):
                return None
            try:
                values[rows] = list(map(int, block.split(b"\0")))
            except (ValueError, OverflowError):  # "", "+-3", beyond 64 bits
                return None
        return values

    def has(self, column: str, value: str | float) -> np.ndarray:
        """Return a mask (rows,): True if the cell in the column equals `value`, a number or a string as in the file."""
        if isinstance(value, str):
            cells = self.text(column)
            return np.fromiter((cell == value for cell in cells), dtype=bool, count=len(cells))
        return np.asarray(
            self.numbers(column) == (float(value) if abs(value) < MAX_INTEGER_TEXT_VALUE else np.inf)
        )

    def rows_where(self, is_kept: np.ndarray) -> "LogTable":
        """Return the rows where `is_kept` is true."""
        return self if is_kept.all() else self.select(np.flatnonzero(is_kept))

    def select(self, rows: np.ndarray) -> "LogTable":
        """Return the rows with these indices, which must increase."""
        columns = {
            name: cells
            if cells is None
            else cells[rows]
            if isinstance(cells, np.ndarray)
            else cells.select(rows)
            for name, cells in self.columns.items()
        }
        return self._replace(columns=columns, lines=self.lines[rows], kept_rows=self.row_indices[rows])

    def _number_error(self, column: str, row: int) -> Diagnostic:
        cell = self.columns[column][row][:80]
        key = column if re.fullmatch(r"[\w-]+", column, re.ASCII) else f'"{column}"'
        code = "word" if re.search(r"[a-zA-Z°/%]", cell) else "not-number"
        code = "comma-of-number" if _COMMA.fullmatch(cell) else code
        return fault(
            f"table.{code}", file=self.label, line=self.lines[row], column=column, key=key, value=cell
        )


def read_table(path: Path, options: JsonObject, label: str = "") -> LogTable:
    """Read a CSV file, or JSON lines. `options`: delimiter, decimal, encoding, header, comment of a [files.NAME] table.
    Raise FileError for a file without data, or if its separator, its decimal mark or its columns are not clear.
    """
    label = label or str(path)
    lines = Lines(path, options.get("encoding"), label)
    data_lines = _data_lines(lines, options.get("comment", "#"))
    start = [line for _, line in zip(range(200), data_lines, strict=False)]
    if start and is_json_line(start[0][1]):
        data, numbers, excluded_lines = json_columns(lines, chain(start, data_lines), MAX_COLUMNS)
        cells_by_name = {name: Cells(bytes(cells)) for name, cells in data.items()}
        return LogTable(label, cells_by_name, np.array(numbers, dtype=np.int64), ".", excluded_lines)
    declaration = _DECLARATION.fullmatch(start[0][1].rstrip("\r")) if start else None
    if declaration:
        start = start[1:]
    if not start:
        raise FileError.of("table.no-data", file=label)
    delimiter = options.get("delimiter") or (
        declaration[1] if declaration else _separator([line for _, line in start], label)
    )
    rows = _rows(label, chain(start, data_lines), delimiter)
    line_number, first = next(rows)
    names = _header([cell.strip() for cell in first], options, label)
    if not options.get("header", True):
        rows = chain([(line_number, first)], rows)
    data, line_numbers, excluded_lines = _columns(lines, rows, len(names), delimiter)
    columns: JsonObject = {}
    for name, cells in zip(names, data, strict=True):
        columns[name] = None if name in columns else Cells(bytes(cells))
        cells.clear()
    decimal = options.get("decimal") or _decimal(columns, delimiter, label)
    return LogTable(label, columns, np.array(line_numbers, dtype=np.int64), decimal, excluded_lines)


def _data_lines(lines: Lines, comment: str) -> Iterator[tuple[int, str]]:
    """Yield the lines with data and their numbers, without empty lines and comments."""
    for line in lines:
        if line.strip() and not (comment and line.lstrip().startswith(comment)):
            yield lines.number, line


def _rows(label: str, texts: Iterator[tuple[int, str]], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the last line of each row, and the cells of the row."""
    line_number = first_line = row_lines = 0
    is_at_end = False

    def each() -> Iterator[str]:
        nonlocal line_number, first_line, row_lines, is_at_end
        for line_number, line in texts:
            row_lines += 1
            first_line = line_number if row_lines == 1 else first_line
            yield line if delimiter == " " else line.rstrip(" ")
        is_at_end = True

    try:
        for row in csv.reader(each(), delimiter=delimiter, strict=True):  # an open quote is an error
            yield line_number, row
            row_lines = 0
    except csv.Error as error:
        if is_at_end and row_lines == 1:
            yield line_number, []  # the last line is cut inside a quoted cell
            return
        is_too_long = "field limit" in str(error)
        code = "table.long-cell" if is_too_long else "table.not-csv"
        raise FileError.of(
            code, file=label, line=first_line, maximum=csv.field_size_limit(), error=str(error)
        ) from error


def _columns(
    lines: Lines, rows: Iterator[tuple[int, list[str]]], width: int, delimiter: str
) -> tuple[list[bytearray], "array[int]", tuple[int, ...]]:
    """Return the cells of each column, the line number of each row, and the numbers of the excluded lines.
    Raise FileError for rows of another width; only an incomplete last row is excluded.
    """
    columns, line_numbers, block = [bytearray() for _ in range(width)], array("q"), []
    uneven_count, first_uneven, line_number, stored_lines = 0, (0, 0), 0, 0
    for line_number, row in rows:
        if len(row) == width + 1 and not row[-1].strip():
            row.pop()  # a separator ends each row, but not the header
        if len(row) != width:
            first_uneven = first_uneven if uneven_count else (line_number, len(row))
            uneven_count += 1
            continue
        line_numbers.append(line_number)
        block.append(row)
        if len(block) * width >= BLOCK_CELLS or lines.reserved_bytes >= stored_lines + 16 * BLOCK_CELLS:
            _append(lines, block, columns)
            stored_lines = lines.reserved_bytes
    _append(lines, block, columns)
    if uneven_count == 1 and first_uneven[0] == line_number and first_uneven[1] < width:
        return columns, line_numbers, (line_number,)
    if uneven_count:
        code = (
            "table.commas-between-commas" if delimiter == "," and first_uneven[1] > width else "table.uneven"
        )
        line, problem = first_uneven
        raise FileError.of(
            code, file=lines.label, line=line, value=problem, expected=width, count=uneven_count
        )
    return columns, line_numbers, ()


def _append(lines: Lines, block: list[list[str]], columns: list[bytearray]) -> None:
    """Move the rows of a block to the columns."""
    lines.reserve_memory(CELL_BYTES * len(columns) * len(block))
    for column, cells in zip(columns, zip(*block, strict=True), strict=False):
        data = pack(cells)
        column += pack([cell.strip() for cell in cells]) if _BLANK.search(data) else data
    block.clear()


def _separator(lines: list[str], label: str) -> str:
    good_separators, candidates = [], [s for s in SEPARATORS if s in lines[0]]
    for separator in SEPARATORS:
        try:
            counts = {len(row) for row in csv.reader(lines, delimiter=separator)}
        except csv.Error:
            continue  # reading reports its line later
        if counts == {max(counts)} and max(counts) > 1:
            good_separators.append(separator)
    if len(good_separators) == 1:
        return good_separators[0]
    if not good_separators:
        if len(candidates) == 1:
            return candidates[0]  # each uneven line is reported later
        if not candidates:
            return ","  # a single column
    names = " or ".join(SEPARATORS[s] for s in good_separators or candidates)
    delimiter = (good_separators or candidates)[0].replace("\t", "\\t")
    raise FileError.of("table.delimiter", file=label, delimiters=names, expected=delimiter)


def _header(first: list[str], options: JsonObject, label: str) -> list[str]:
    if len(first) > MAX_COLUMNS:
        raise FileError.of("table.columns", file=label, count=len(first), maximum=MAX_COLUMNS)
    numeric = all(_NUMBER.fullmatch(cell) or _COMMA.fullmatch(cell) for cell in first)
    if not options.get("header", True):
        return [str(i + 1) for i in range(len(first))]
    if numeric:
        raise FileError.of("table.no-header", file=label, value=first[:3])
    return first


def _decimal(columns: JsonObject, delimiter: str, label: str) -> str:
    if delimiter == ",":
        return "."
    comma = cell_with_both = ""  # the first number of each kind
    points, is_thousands_mark = False, True
    for cell in chain.from_iterable(column for column in columns.values() if column):
        if "," in cell:
            if _COMMA.fullmatch(cell):
                comma, is_thousands_mark = (
                    comma or cell,
                    is_thousands_mark and bool(_THOUSANDS.fullmatch(cell)),
                )
            elif "." in cell and _NUMBER.fullmatch(cell.replace(".", "").replace(",", ".")):
                cell_with_both = cell_with_both or cell
        elif not points and "." in cell:
            points = bool(_NUMBER.fullmatch(cell))
    if not comma and not cell_with_both:
        return "."
    if points or cell_with_both:
        raise FileError.of("table.two-decimals", file=label, value=cell_with_both or comma)
    if is_thousands_mark:
        raise FileError.of(
            "table.comma",
            file=label,
            value=comma,
            integer_reading=comma.replace(",", ""),
            decimal_reading=comma.replace(",", "."),
        )
    return ","
