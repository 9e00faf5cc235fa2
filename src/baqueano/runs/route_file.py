"""A route as a CSV file that a person can read, edit and draw:

    # closed = true
    t_s,x_m,y_m,psi_rad,nu_x_m_s,nu_y_m_s,nu_psi_rad_s

Every double has all its digits, so that a route written and read back is the same. Semicolons and decimal
commas of a spreadsheet are read as well.
"""

import os
import re
from pathlib import Path

import numpy as np

from baqueano.diagnostics import fault
from baqueano.errors import FileError
from baqueano.guides.route import Route
from baqueano.runs.tables.lines import Lines
from baqueano.runs.tables.table import read_table

COLUMNS = ("t_s", "x_m", "y_m", "psi_rad", "nu_x_m_s", "nu_y_m_s", "nu_psi_rad_s")
_CLOSED = re.compile(r"^#\s*closed\s*=\s*(true|false)\b", re.IGNORECASE)


def write_route(route: Route, path: Path | str) -> Path:
    """Write a route as a CSV file that a person can read and edit, in place of an older one.

    Parameters
    ----------
    route : Route
        Poses in the map [m, m, rad] and velocities in the body frame [m/s, m/s, rad/s] over time [s].
    path : path
        The file; it appears whole.

    Returns
    -------
    Path
        The file.

    Examples
    --------
    >>> print(write_route(bq.guides.shapes.circle(0.5, 0.2), "circle.csv").read_text().splitlines()[0])
    # closed = true
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = np.column_stack([route.t_s, route.eta, route.nu])
    lines = [f"# closed = {'true' if route.closed else 'false'}", ",".join(COLUMNS)]
    lines += [",".join(map(repr, row)) for row in rows.tolist()]
    part = path.with_name(path.name + ".part")
    part.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    os.replace(part, path)
    return path


def read_route(path: Path | str) -> Route:
    """Return the route in a CSV file.

    Parameters
    ----------
    path : path
        A file as `write_route` makes it; semicolons and decimal commas are read as well.

    Returns
    -------
    Route
        Equal to the route that was written.

    Raises
    ------
    FileError
        Where a column is missing, a number cannot be read, or time does not increase.

    Examples
    --------
    >>> read_route(write_route(bq.guides.shapes.circle(0.5, 0.2), "circle.csv"))
    Route(1441 poses, 15.7 s, 3.14 m, closed)
    """
    path = Path(path)
    table = read_table(path, {})
    t_s, *rest = (table.numbers(column) for column in COLUMNS)
    values = np.column_stack(rest)
    wrong = ~np.isfinite(np.column_stack([t_s, values])).all(axis=1)
    if wrong.any():
        raise FileError(fault("route.not-number", path=path, line=table.lines[np.argmax(wrong)]))
    if len(t_s) < 2:
        raise FileError(fault("route.too-short", path=path, count=len(t_s)))
    late = np.diff(t_s) <= 0.0
    if late.any() or t_s[0] != 0.0:
        line = table.lines[np.argmax(late) + 1] if late.any() else table.lines[0]
        raise FileError(
            fault("route.times", path=path, line=line, found=t_s[np.argmax(late) + int(late.any())])
        )
    return Route(t_s, values[:, :3], values[:, 3:], _closed(path))


def _closed(path: Path) -> bool:
    for line in Lines(path, None, str(path)):
        match = _CLOSED.match(line)
        if match:
            return match[1].lower() == "true"
    raise FileError(fault("route.closed-unsaid", path=path))
