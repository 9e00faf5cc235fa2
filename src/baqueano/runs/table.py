"""A CSV file as columns of text, and numbers out of them, with nothing guessed silently.

Read without being told: UTF-8 with or without BOM, UTF-16 with BOM, gzip; the separator when one alone fits
every line; the decimal comma when no number can be read in two ways. Else the message says which line the map
needs.
"""

import csv
import gzip
import io
import re
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import FileError

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
MISSING = {"", "nan", "na", "n/a", "null", "none", "-"}
LARGEST = 2 * 2**30  # bytes of one unpacked file

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?inf", re.ASCII | re.IGNORECASE)
_DIGITS, _WHOLE = re.compile(r"[-+.eE0-9\0]*"), re.compile(r"[-+0-9\0]*")  # a whole column, joined by \0
_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+", re.ASCII)


class Table(NamedTuple):
    """The columns of a file."""

    label: str  # the file, for messages
    columns: dict[str, Any]  # name → list of str, or an array (bags)
    lines: np.ndarray  # (rows,) line of the file, or number of the message
    decimal: str = "."
    notes: tuple[str, ...] = ()

    def text(self, column: str) -> Any:
        """The column as it was read. FileError if there is none of that name, or several."""
        import difflib

        if column not in self.columns:
            near = difflib.get_close_matches(column, self.columns, n=3, cutoff=0.4)
            held = " and ".join(self._first_cells(name) for name in near)
            hint = f"Did you mean {' or '.join(map(repr, near))}? In it is {held}." if near else ""
            raise FileError(
                f"{self.label} has no column {column!r}. {hint}{' ' if hint else ''}It has: "
                f"{', '.join(map(repr, self.columns))}. Write one of these in the map, or give another file."
            )
        if self.columns[column] is None:
            raise FileError(f"{self.label} has several columns named {column!r}; give each its own name.")
        return self.columns[column]

    def _first_cells(self, column: str) -> str:
        """What is in it, for a message."""
        cells = self.columns[column]
        return "several of that name" if cells is None else f"{', '.join(map(str, cells[:3]))}, …"

    def numbers(self, column: str) -> np.ndarray:
        """(rows,) float64; NaN where the cell is empty or says so."""
        cells = self.text(column)
        if isinstance(cells, np.ndarray):
            return cells.astype(np.float64)
        if self.decimal == ",":
            cells = [cell.replace(",", ".") for cell in cells]
        if _DIGITS.fullmatch("\0".join(cells)):  # then float() takes what _NUMBER does, at once
            with suppress(ValueError):
                return np.array(list(map(float, cells)))
        values = np.empty(len(cells))
        for i, cell in enumerate(cells):
            if _NUMBER.fullmatch(cell):
                values[i] = float(cell)
            elif cell.lower() in MISSING:
                values[i] = np.nan
            elif cell.lower() in ("true", "false"):
                values[i] = float(cell.lower() == "true")
            else:
                raise FileError(self._not_a_number(column, i))
        return values

    def integers(self, column: str) -> np.ndarray | None:
        """(rows,) int64 where every cell is a whole number: nanoseconds since 1970 do not fit a float."""
        cells = self.text(column)
        if isinstance(cells, np.ndarray):
            return cells.astype(np.int64) if cells.dtype.kind in "iu" else None
        if not _WHOLE.fullmatch("\0".join(cells)):
            return None
        try:
            return np.array(list(map(int, cells)), dtype=np.int64)
        except (ValueError, OverflowError):  # "", "+-3", beyond 64 bits
            return None

    def has(self, column: str, value: str | float) -> np.ndarray:
        """(rows,) where a column has that value: a word as it is written, or a number."""
        if isinstance(value, str):
            return np.array([cell == value for cell in self.text(column)], dtype=bool)
        return np.asarray(self.numbers(column) == value)

    def only(self, keep: np.ndarray) -> "Table":
        """The rows where `keep` is true."""
        return self if keep.all() else self.at(np.flatnonzero(keep))

    def at(self, rows: np.ndarray) -> "Table":
        """The rows of these indices."""
        at = rows.tolist()
        columns = {
            name: cells
            if cells is None
            else cells[at]
            if isinstance(cells, np.ndarray)
            else [cells[i] for i in at]
            for name, cells in self.columns.items()
        }
        return self._replace(columns=columns, lines=self.lines[rows])

    def _not_a_number(self, column: str, row: int) -> str:
        cell = self.columns[column][row]
        where = f"{self.label} line {self.lines[row]}, column {column!r}: {cell!r} is not a number."
        if _COMMA.fullmatch(cell):
            return f'{where} If the comma is a decimal one, write in its [files.…] table: decimal = ","'
        key = column if re.fullmatch(r"[\w-]+", column, re.ASCII) else f'"{column}"'
        leave = f'or leave the row out with where = {{ {key} = {{ not = "{cell}" }} }}.'
        if re.search(r"[a-zA-Z°/%]", cell):
            return f"{where} Take units and words out of the cells, {leave}"
        return f"{where} Correct the cell, {leave}"


def read_table(path: Path, options: dict[str, Any], label: str = "") -> Table:
    """A CSV file. `options`: delimiter, decimal, encoding, header, comment of a [files.NAME] table."""
    label = label or str(path)
    text = _decoded(_bytes(path, label), options.get("encoding"), label)
    comment = options.get("comment", "#")
    lines = [
        (number, line)
        for number, line in enumerate(re.split("\r\n|\r|\n", text), 1)
        if line.strip() and not (comment and line.lstrip().startswith(comment))
    ]
    if not lines:
        raise FileError(f"{label} has no line with data in it. Is it the right file?")
    delimiter = options.get("delimiter") or _separator([line for _, line in lines[:200]], label)
    cells = list(csv.reader([line for _, line in lines], delimiter=delimiter))
    if re.search(r"[^\S\r\n]", text):
        cells = [[cell.strip() for cell in row] for row in cells]
    numbers = [number for number, _ in lines]
    names = _header(cells, options, label)
    if options.get("header", True):
        cells, numbers = cells[1:], numbers[1:]
    notes = _make_even(cells, numbers, len(names), delimiter, label)
    columns: dict[str, Any] = {}
    for name, column in zip(names, zip(*cells, strict=True) if cells else [()] * len(names), strict=True):
        columns[name] = None if name in columns else list(column)
    decimal = options.get("decimal") or _decimal(columns, delimiter, label)
    return Table(label, columns, np.array(numbers, dtype=np.int64), decimal, notes)


def _bytes(path: Path, label: str) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"{label} cannot be read: {error.strerror or error}. Is the path right?") from error
    if data[:2] == b"\x1f\x8b":
        try:
            with gzip.open(io.BytesIO(data)) as stream:
                data = stream.read(LARGEST + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise FileError(f"{label} is a damaged or cut gzip file ({error}). Copy it again.") from error
        if len(data) > LARGEST:
            raise FileError(f"{label} unpacks to more than 2 GiB. Cut it into pieces first.")
    if not data:
        raise FileError(f"{label} is empty (0 bytes). Is it the right file?")
    return data


def _decoded(data: bytes, encoding: str | None, label: str) -> str:
    if encoding is None:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            encoding = "utf-16"
        elif b"\0" in data[:2000]:
            low = data[1:2000:2].count(0) > data[0:2000:2].count(0)
            if data[:2000].count(0) < 200 and len(data) > 1000:
                raise FileError(
                    f"{label} is not a text file: it has zero bytes. Only CSV and ROS bags are imported."
                )
            raise FileError(
                f"{label} looks like UTF-16 without a mark that says so. Write in its [files.…] table: "
                f'encoding = "{"utf-16-le" if low else "utf-16-be"}"'
            )
        else:
            encoding = "utf-8-sig"
    try:
        return data.decode(encoding)
    except LookupError:
        raise FileError(
            f'{label}: encoding = "{encoding}" is not known. Known are utf-8, utf-16, cp1252, …'
        ) from None
    except UnicodeDecodeError as error:
        raise FileError(
            f"{label}: byte {error.start} is not {encoding}. If the file was saved by Excel, write in its "
            "[files.…] "
            'table: encoding = "cp1252"'
        ) from None


def _separator(lines: list[str], label: str) -> str:
    fits, present = [], [s for s in SEPARATORS if s in lines[0]]
    for separator in SEPARATORS:
        counts = {len(row) for row in csv.reader(lines, delimiter=separator)}
        if counts == {max(counts)} and max(counts) > 1:
            fits.append(separator)
    if len(fits) == 1:
        return fits[0]
    if not fits:
        if len(present) == 1:
            return present[0]  # uneven lines are told one by one
        if not present:
            return ","  # a single column
    names = " or ".join(SEPARATORS[s] for s in fits or present)
    wanted = (fits or present)[0].replace("\t", "\\t")
    raise FileError(
        f"{label} can be read with {names} between its columns. Write in its [files.…] table which it is, "
        "for "
        f'example: delimiter = "{wanted}"'
    )


def _header(cells: list[list[str]], options: dict[str, Any], label: str) -> list[str]:
    first = cells[0]
    numeric = all(_NUMBER.fullmatch(cell) or _COMMA.fullmatch(cell) for cell in first)
    if not options.get("header", True):
        return [str(i + 1) for i in range(len(first))]
    if numeric:
        raise FileError(
            f"{label}: the first line has no names, only numbers ({', '.join(first[:3])} …). Write in its "
            "[files.…] "
            'table: header = false, and call the columns "1", "2", "3" …'
        )
    return first


def _make_even(
    cells: list[list[str]], numbers: list[int], width: int, delimiter: str, label: str
) -> tuple[str, ...]:
    """Refuses rows of another width; a last one that was cut is left out, and told."""
    uneven = [i for i, row in enumerate(cells) if len(row) != width]
    if uneven == [len(cells) - 1] and len(cells[-1]) < width:
        cells.pop()
        return (f"line {numbers.pop()} is cut and was left out",)
    if uneven:
        i = uneven[0]
        hint = (
            " Perhaps decimal commas between commas: save it with semicolons."
            if delimiter == "," and len(cells[i]) > width
            else ""
        )
        raise FileError(
            f"{label} line {numbers[i]} has {len(cells[i])} cells, the header has {width} ({len(uneven)} "
            "such lines)."
            f"{hint} Correct the file, or give its delimiter in the [files.…] table."
        )
    return ()


def _decimal(columns: dict[str, Any], delimiter: str, label: str) -> str:
    if delimiter == ",":
        return "."
    cells = [cell for column in columns.values() if column for cell in column if "," in cell]
    if not cells:
        return "."
    commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    points = any(_NUMBER.fullmatch(c) and "." in c for column in columns.values() if column for c in column)
    mixed = [
        cell for cell in cells if "." in cell and _NUMBER.fullmatch(cell.replace(".", "").replace(",", "."))
    ]
    if not commas and not mixed:
        return "."
    if points or mixed:
        raise FileError(
            f"{label} has numbers with a decimal point and numbers with a comma "
            f"({(mixed or commas)[0]!r}). Save it "
            "with one kind, without separators of thousands."
        )
    if all(_THOUSANDS.fullmatch(cell) for cell in commas):
        whole = commas[0].replace(",", "")
        raise FileError(
            f"{label}: {commas[0]!r} may be {whole} or {commas[0].replace(',', '.')}. If the comma is a "
            "decimal one, "
            'write in its [files.…] table: decimal = ","'
        )
    return ","
