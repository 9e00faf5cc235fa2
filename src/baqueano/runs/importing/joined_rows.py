"""Join rows with the same time that contain different columns, as written by a logger of several topics.

    t, a, b:   (1.00, 0.3, ·), (1.00, ·, 7)  →  (1.00, 0.3, 7)                                            (1)

Rows with one time are joined only if no column has two different values at that time, in the whole file. Otherwise the
rows contradict each other, and timing.py reports them.
"""

from collections.abc import Collection

import numpy as np

from baqueano.contracts.values import Value
from baqueano.diagnostics import note
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.maps.columns import FileSpec
from baqueano.runs.tables.cells import Cells
from baqueano.runs.tables.table import MISSING_TEXTS, LogTable


def joined_rows(
    table: LogTable, t_ns: np.ndarray, spec: FileSpec, columns: Collection[str], findings: list[ImportFinding]
) -> tuple[LogTable, np.ndarray]:
    """Return the rows and their times (rows,) [ns] after (1), and add a finding; the same rows if it does not apply."""
    repeated_rows = np.flatnonzero(np.diff(t_ns) == 0)
    if not len(repeated_rows) or spec.repeats is not None:
        return table, t_ns
    rows = np.union1d(repeated_rows, repeated_rows + 1)
    groups = np.cumsum(np.diff(t_ns[rows], prepend=t_ns[rows[0]]) != 0)
    first_rows = rows[np.flatnonzero(np.diff(groups, prepend=-1))]
    times = {spec.time, spec.time_rest and spec.time_rest[0]}
    names = sorted(name for name in {*columns} - times if table.columns[name] is not None)
    group_rows, changed_cells, joined_columns = table.select(rows), 0, {}
    for name in names:
        values = _common_values(group_rows.columns[name], groups)
        if values is None:
            return table, t_ns
        joined_columns[name], count = _with_values(table.columns[name], first_rows, values)
        changed_cells += count
    if not changed_cells:  # equal rows
        return table, t_ns
    figures = {
        "table": table.label, "count": len(rows), "times": len(first_rows), "line": table.lines[first_rows[0]],
    }  # fmt: skip
    findings.append(
        ImportFinding(
            "joined rows", "info", note("recording.joined", **figures), t_ns=int(t_ns[first_rows[0]])
        )
    )
    is_first = np.append(True, np.diff(t_ns) != 0)
    joined_table = table._replace(columns=table.columns | joined_columns)
    return joined_table.rows_where(is_first), t_ns[is_first]


def is_slower_topic(rows: np.ndarray) -> bool:
    """Return True if these rows of a file belong to a slower topic: at most every second row, and evenly.

    >>> is_slower_topic(np.array([0, 5, 10, 14])), is_slower_topic(np.array([0, 1, 2, 40]))
    (True, False)
    """
    steps = np.diff(rows)
    return bool(len(steps) and np.median(steps) >= 2 and steps.max() <= 2 * np.median(steps))


def _is_missing(cell: Value) -> bool:
    """Return True for an empty cell, one of MISSING_TEXTS, or NaN."""
    return cell.lower() in MISSING_TEXTS if isinstance(cell, str) else cell is None or cell != cell


def _common_values(cells: Value, groups: np.ndarray) -> list[Value] | None:
    """Return the value of each group of rows, None without one; None if a group has two different values."""
    values: list[Value] = [None] * (int(groups[-1]) + 1)
    for cell, group in zip(cells, groups.tolist(), strict=True):
        if _is_missing(cell):
            continue
        if values[group] is not None and values[group] != cell:
            return None
        values[group] = cell
    return values


def _with_values(cells: Value, first_rows: np.ndarray, values: list[Value]) -> tuple[Value, int]:
    """Return the column with the value of its group in the first row of each group, and the number of changed cells."""
    changes = {
        row: value
        for row, value in zip(first_rows.tolist(), values, strict=True)
        if value is not None and _is_missing(cells[row])
    }
    if not changes:
        return cells, 0
    if isinstance(cells, np.ndarray):
        cells = cells.copy()
        cells[list(changes)] = list(changes.values())
        return cells, len(changes)
    return Cells.of(changes.get(row, cell) for row, cell in enumerate(cells)), len(changes)
