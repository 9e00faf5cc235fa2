"""Write the rows of a result for other programs: CSV, and LaTeX with booktabs.

LaTeX needs \\usepackage{booktabs}; numbers are in math mode. A parameter has as many digits as its error allows, any
other number has five. A LaTeX table with more columns than rows is transposed, so that it fits a page. A comparison
has the rows, titles and units of its printed table.
"""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.contracts.values import TableRow
from baqueano.errors import UsageError
from baqueano.parameter import parameters
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.contracts.result import PrintedTable, Result

PARAMETER_KEYS = {"name", "estimate", "std", "unit"}  # of the rows of a fit
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:[.,]\d+)?(?:e[-+]\d+)?(?![\w])")
AXIS_SYMBOLS = ("x", "y", r"\psi")
LATEX_SIGNS = {  # that pdflatex does not know as letters
    "−": "$-$", "°": r"$^\circ$", "√": r"$\surd$", "ψ": r"$\psi$", "η": r"$\eta$", "ν": r"$\nu$",
}  # fmt: skip


def csv_text(rows: list[TableRow], decimal: str = ".") -> str:
    """Return rows as CSV (RFC 4180); the cell of an unknown value is empty. Rows can have different keys.

    With the decimal sign "," columns are separated by ";", and the text begins with a byte order mark: a spreadsheet of
    a country with decimal commas then reads numbers and accents correctly.
    """
    buffer = io.StringIO()
    is_local = decimal == ","
    writer = csv.DictWriter(buffer, _keys(rows), delimiter=";" if is_local else ",", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        cells = {key: "" if _is_nan(value) else value for key, value in row.items()}
        numbers = {
            key: repr(value).replace(".", decimal) for key, value in cells.items() if type(value) is float
        }
        writer.writerow(cells | numbers)
    return "\ufeff" * is_local + buffer.getvalue()


def latex_text(rows: list[TableRow], caption: str = "", blocks: object = None) -> str:
    """Return rows as a LaTeX table; the parameters of a fit have the symbols of its `blocks`."""
    if rows and rows[0].keys() >= PARAMETER_KEYS:
        head = ["parameter", "estimate", "standard error", "unit"]
        body = [_parameter_cells(row, blocks) for row in rows]
        comments = [f"% {symbol(row['name'], blocks)}: {row['name']}" for row in rows]
        return _booktabs("lrrl", head, body, caption, comments)
    keys = [key for key in _keys(rows) if not all(_is_nan(row.get(key)) for row in rows)]
    cells = [keys, *([_cell(row.get(key)) for key in keys] for row in rows)]
    if len(keys) > len(rows):
        cells = [list(column) for column in zip(*cells, strict=True)]
        cells = [[_escape(row[0]), *row[1:]] for row in cells]
        return _booktabs("l" + "r" * len(rows), cells[0], cells[1:], caption)
    return _booktabs("r" * len(keys), [_escape(key) for key in keys], cells[1:], caption)


def printed_table_text(table: "PrintedTable", caption: str = "") -> str:
    """Return a printed table as a LaTeX table: label, unit, and a column for each of its heads."""
    heads = table.heads
    body: list[list[str]] = []
    for section in table.sections:
        if section["title"]:
            body.append([rf"\multicolumn{{{len(heads) + 2}}}{{l}}{{{_printed(section['title'])}}}"])
        indent = r"\quad " * bool(section["title"])
        for row in section["rows"]:
            cells = ["--" if cell == "-" else _printed(cell) for cell in row["cells"]]
            body.append([indent + _printed(row["label"]), _printed(row["unit"]), *cells])
    return _booktabs("ll" + "r" * len(heads), ["", "", *map(_escape, heads)], body, caption)


def _printed(text: str) -> str:
    """Return printed text in LaTeX, with its numbers in math mode."""

    def number(match: re.Match[str]) -> str:
        return _power(match[0]).replace(",", "{,}")

    return NUMBER.sub(number, _escape(text)).translate(str.maketrans(LATEX_SIGNS))


def _booktabs(
    columns: str, head: list[str], body: list[list[str]], caption: str, comments: Sequence[str] = ()
) -> str:
    lines = [
        r"\begin{table}",
        r"  \centering",
        *([rf"  \caption{{{_escape(caption)}}}"] if caption else []),
        rf"  \begin{{tabular}}{{{columns}}}",
        r"    \toprule",
        rf"    {' & '.join(head)} \\",
        r"    \midrule",
        *(rf"    {' & '.join(cells)} \\" for cells in body),
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    return "\n".join([*lines, *comments, ""])


def _parameter_cells(row: TableRow, blocks: object) -> list[str]:
    value, std = row["estimate"], row["std"]
    cells = (r"\multicolumn{2}{c}{not identifiable}",) if value is None else format_estimate(value, std)
    return [symbol(row["name"], blocks), *cells, _unit(row["unit"])]


def _keys(rows: list[TableRow]) -> list[str]:
    return list(dict.fromkeys(key for row in rows for key in row))


def _cell(value: object) -> str:
    """Return a value of a row in LaTeX: a number in math mode, any other value as text."""
    if _is_nan(value):
        return "--"
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return _power(f"{value:.5g}") if is_number else _escape(str(value))


def symbol(path: str, blocks: object = None) -> str:
    """Return the symbol of a parameter of the `blocks` in math mode, or its name in typewriter."""
    field, _, entry = path.partition("[")
    owner, _, name = field.rpartition(".")
    try:
        p = dict(parameters(value_at_path(blocks, owner)))[name]
    except (AttributeError, KeyError, TypeError):
        p = None
    if p is None or not p.symbol:
        return rf"\texttt{{{_escape(path)}}}"
    index = [int(i) for i in entry.rstrip("]").split(",")] if entry else []
    if not isinstance(p.symbol, str):
        return f"${p.symbol[index[0] if index else 0]}$"
    if p.axes and len(index) == 1:
        return _subscript(p.symbol, AXIS_SYMBOLS[index[0]])
    return _subscript(p.symbol, "".join(str(i + 1) for i in index)) if index else f"${p.symbol}$"


def _subscript(letter: str, index: str) -> str:
    """Return the symbol `letter` with `index` added to its subscript."""
    return f"${letter[:-1]},{index}}}$" if letter.endswith("}") else f"${letter}_{{{index}}}$"


def format_estimate(value: float, std: float | None) -> tuple[str, str]:
    """Return a value and its standard error, to two digits of the error."""
    if std is None or not np.isfinite(std) or std <= 0.0:
        return f"${value:.5g}$", "--"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    if digits > 6 or abs(value) >= 1e6:
        return _power(f"{value:.6g}"), _power(f"{std:.2g}")
    return f"${value:.{digits}f}$", f"${std:.{digits}f}$"


def table_suffix(path: Path, decimal: str = ".") -> str:
    """Return ".csv" or ".tex". Raise UsageError for another file extension or another decimal sign."""
    if path.suffix not in (".csv", ".tex"):
        raise UsageError.of("report.table-ending", f"--table {path.stem}.csv", value=path)
    if decimal not in (".", ","):
        raise UsageError.of("runs.decimal", value=decimal)
    return path.suffix


def save_table(
    rows: list[TableRow], path: str | Path, decimal: str = ".", caption: str = "", blocks: object = None
) -> Path:
    """Write rows as .csv or .tex, by the file extension, and return the path. The file is replaced only when it is
    complete. Raise UsageError for another file extension or another decimal sign.
    """
    path = Path(path)
    is_csv = table_suffix(path, decimal) == ".csv"
    return replace_file(path, csv_text(rows, decimal) if is_csv else latex_text(rows, caption, blocks))


def save_result(
    result: "Result", path: str | Path, decimal: str = ".", caption: str = "", blocks: object = None
) -> Path:
    """Write the table of a result as `save_table` does."""
    path = Path(path)
    if table_suffix(path, decimal) == ".tex" and (table := result.printed_table()) is not None:
        return replace_file(path, printed_table_text(table, caption))
    return save_table(result.rows(), path, decimal, caption, blocks)


def _is_nan(value: object) -> bool:
    return value is None or (isinstance(value, float) and not np.isfinite(value))


def _power(number: str) -> str:
    mantissa, _, exponent = number.partition("e")
    return rf"${mantissa} \cdot 10^{{{int(exponent)}}}$" if exponent else f"${number}$"


def _unit(text: str) -> str:
    superscripts = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
    return re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda m: f"$^{{{m.group().translate(superscripts)}}}$", _escape(text))


def _escape(text: str) -> str:
    return re.sub(r"([&%$#_{}])", r"\\\1", text).replace("^", r"\^{}").replace("~", r"\~{}")
