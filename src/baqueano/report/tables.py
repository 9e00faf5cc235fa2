"""Write the table of a result for other programs: CSV, and LaTeX with booktabs.

LaTeX needs \\usepackage{booktabs}; numbers are in math mode with as many digits as their error allows.
"""

import csv
import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.parameter import parameters
from baqueano.symbolic import value_at_path

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow

AXIS_SYMBOLS = ("x", "y", r"\psi")


def csv_text(rows: list["TableRow"]) -> str:
    """Return rows as CSV (RFC 4180); the cell of an unknown value is empty."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: "" if _is_nan(value) else value for key, value in row.items()})
    return buffer.getvalue()


def latex_text(rows: list["TableRow"], caption: str = "", blocks: object = None) -> str:
    """Return the parameters of a fit (`Fit.rows()`) as a LaTeX table, with the symbols of its `blocks`."""
    lines = [
        r"\begin{table}",
        r"  \centering",
        *([rf"  \caption{{{_escape(caption)}}}"] if caption else []),
        r"  \begin{tabular}{lrrl}",
        r"    \toprule",
        r"    parameter & estimate & standard error & unit \\",
        r"    \midrule",
    ]
    for row in rows:
        value, std = row["estimate"], row["std"]
        cells = (r"\multicolumn{2}{c}{not identifiable}",) if value is None else with_error(value, std)
        lines.append(f"    {symbol(row['name'], blocks)} & {' & '.join(cells)} & {_unit(row['unit'])} \\\\")
    comments = [f"% {symbol(row['name'], blocks)}: {row['name']}" for row in rows]
    return "\n".join([*lines, r"    \bottomrule", r"  \end{tabular}", r"\end{table}", *comments, ""])


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
        return _under(p.symbol, AXIS_SYMBOLS[index[0]])
    return _under(p.symbol, "".join(str(i + 1) for i in index)) if index else f"${p.symbol}$"


def _under(letter: str, index: str) -> str:
    """Return the symbol `letter` with `index` added to its subscript."""
    return f"${letter[:-1]},{index}}}$" if letter.endswith("}") else f"${letter}_{{{index}}}$"


def with_error(value: float, std: float | None) -> tuple[str, str]:
    """Return a value and its standard error, to two digits of the error."""
    if std is None or not np.isfinite(std) or std <= 0.0:
        return f"${value:.5g}$", "--"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    if digits > 6 or abs(value) >= 1e6:
        return _power(f"{value:.6g}"), _power(f"{std:.2g}")
    return f"${value:.{digits}f}$", f"${std:.{digits}f}$"


def suffix_of(path: Path) -> str:
    """Return ".csv" or ".tex". Raise UsageError for another file extension."""
    if path.suffix not in (".csv", ".tex"):
        raise UsageError(fault("report.table-ending", f"--table {path.stem}.csv", value=path))
    return path.suffix


def save_table(rows: list["TableRow"], path: str | Path, caption: str = "", blocks: object = None) -> Path:
    """Write rows as .csv or .tex, by the file extension, and return the path. The file is replaced only when it is
    complete. Raise UsageError for another file extension.
    """
    path = Path(path)
    text = csv_text(rows) if suffix_of(path) == ".csv" else latex_text(rows, caption, blocks)
    return replace_file(path, text)


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
