"""Write and read a route as a CSV file that a user can read, edit and plot:

    # closed = true
    t_s,x_m,y_m,psi_rad,nu_x_m_s,nu_y_m_s,nu_psi_rad_s

Every double has all its digits, so that a route is the same after writing and reading. Semicolons and decimal commas of
a spreadsheet are also accepted. For a user or another program, it is easier to write poses over path length and speeds:

    s_m,x_m,y_m,psi_rad,v_m_s,wait_s          wait_s is optional

    t_k+1 = t_k + 2 Δs / (|v_k| + |v_k+1|) + wait_k,   ν_ψ = v dψ/ds                                      (1)

wait_s is the time that the vehicle waits at a row before it continues.
A turn on the spot (Δs = 0) lasts 1 s per radian.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.contracts.names import SHAPE_NAMES, STORED_ROUTES
from baqueano.diagnostics import Diagnostic, fault, nearest, note
from baqueano.errors import FileError, UsageError
from baqueano.guides.route import Route
from baqueano.messages.printable import baqueano_command
from baqueano.runs.tables.lines import Lines
from baqueano.runs.tables.table import LogTable, read_table

DISTANCE_COLUMNS, WAIT_COLUMN = ("s_m", "x_m", "y_m", "psi_rad", "v_m_s"), "wait_s"
SPOT_TURN_RAD_S = 1.0  # yaw rate of a turn on the spot
COLUMNS = ("t_s", "x_m", "y_m", "psi_rad", "nu_x_m_s", "nu_y_m_s", "nu_psi_rad_s")
# the same faults of a table, with advice for a file without a map
_CODES = {
    "table.utf-16": "route.encoding",
    "table.not-encoded": "route.encoding",
    "table.delimiter": "route.delimiter",
    "table.no-header": "route.no-header",
    "table.comma": "route.comma",
    "table.comma-of-number": "route.comma-of-number",
    "table.word": "route.cell",
    "table.not-number": "route.cell",
    "table.no-column": "route.no-column",
    "table.column-mistyped": "route.no-column",
    "table.uneven": "route.uneven",
    "table.commas-between-commas": "route.uneven",
}
_CLOSED_LINE = re.compile(r"^#\s*closed\s*=\s*(true|false)\b", re.IGNORECASE)


def write_route(route: Route, path: Path | str) -> Path:
    """Write a route as a CSV file that a user can read and edit; it replaces an older file.

    Parameters
    ----------
    route : Route
        Poses in the map [m, m, rad] and velocities in the body frame [m/s, m/s, rad/s] over time [s].
    path : path
        The file, which ends in .csv; it appears complete or not at all.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UsageError
        If the name of the file has another ending: it would replace a vehicle file or a run.

    Examples
    --------
    >>> print(write_route(bq.guides.shapes.circle(0.5, 0.2), "circle.csv").read_text().splitlines()[0])
    # closed = true
    """
    check_ending(path)
    rows = np.column_stack([route.t_s, route.eta, route.nu])
    lines = [f"# closed = {'true' if route.closed else 'false'}", ",".join(COLUMNS)]
    lines += [",".join(map(repr, row)) for row in rows.tolist()]
    return replace_file(Path(path), "\n".join(lines) + "\n")


def check_ending(path: Path | str) -> None:
    """Raise UsageError if the name of a route's file does not end in .csv."""
    if Path(path).suffix.lower() != ".csv":
        raise UsageError.of("route.ending", path=path)


@contextmanager
def column_advice(names: Sequence[str]) -> Iterator[None]:
    """Replace the advice to write a map in an error of a table, which must have the columns `names`."""
    try:
        yield
    except FileError as error:
        reason = error.diagnostic
        if reason.code not in _CODES:
            raise
        figures = {**reason.figures, "names": ",".join(names)}
        raise FileError(replace(reason, code=_CODES[reason.code], figures=figures)) from error


def stored_routes() -> list[str]:
    """Return the names of the routes in the folder `routes`."""
    return sorted(route_file.stem for route_file in STORED_ROUTES.glob("*.csv"))


def absent_route(name: str, path: Path, *teach_options: str) -> Diagnostic:
    """Return the fault of a route that does not exist, with the nearest name, or the command that stores the route."""
    names, figures = stored_routes(), {"value": name, "absent_path": path}
    suggestion = nearest(name, names)
    if "match" in suggestion.figures:
        return fault("route.absent-stored", suggestion=suggestion, **figures)
    shape_name = nearest(name, SHAPE_NAMES).figures.get("match")
    if shape_name is not None:
        fix = baqueano_command("route", "draw", str(shape_name), str(shape_name))
        return fault("route.absent-shape", fix, shape=str(shape_name), **figures)
    valid = suggestion if names else note("route.none-stored")
    return fault("route.absent", baqueano_command("teach", name, *teach_options), valid=valid, **figures)


def read_route(path: Path | str) -> Route:
    """Read the route in a CSV file.

    Parameters
    ----------
    path : path
        A file from `write_route`, or poses over path length; semicolons and decimal commas are also accepted.

    Returns
    -------
    Route
        Equal to the route that was written.

    Raises
    ------
    FileError
        If the route does not exist, a column is missing, a number cannot be read, or time does not increase.

    Examples
    --------
    >>> read_route(write_route(bq.guides.shapes.circle(0.5, 0.2), "circle.csv"))
    Route(1441 poses, 15.7 s, 3.14 m, closed)
    """
    path = Path(path)
    stored_path = STORED_ROUTES / f"{path}.csv"
    is_name = path.name == str(path) and not path.exists() and (stored_path.is_file() or not path.suffix)
    if is_name and not stored_path.is_file():
        raise FileError(absent_route(str(path), stored_path))
    with column_advice(COLUMNS):
        return _read_route(stored_path if is_name else path)


def _read_route(path: Path) -> Route:
    table = read_table(path, {})
    if set(DISTANCE_COLUMNS) <= set(table.columns) and COLUMNS[0] not in table.columns:
        return _distance_route(table, path)
    t_s, *columns = (table.numbers(column) for column in COLUMNS)
    values = np.column_stack(columns)
    is_not_finite = ~np.isfinite(np.column_stack([t_s, values])).all(axis=1)
    if is_not_finite.any():
        raise FileError.of("route.not-number", path=path, line=table.lines[np.argmax(is_not_finite)])
    if len(t_s) < 2:
        raise FileError.of("route.too-short", path=path, count=len(t_s))
    is_not_later = np.diff(t_s) <= 0.0
    if is_not_later.any() or t_s[0] != 0.0:
        line = table.lines[np.argmax(is_not_later) + 1] if is_not_later.any() else table.lines[0]
        raise FileError.of(
            "route.times", path=path, line=line, value=t_s[np.argmax(is_not_later) + int(is_not_later.any())]
        )
    return Route(t_s, values[:, :3], values[:, 3:], _is_closed(path))


def _distance_route(table: LogTable, path: Path) -> Route:
    """Return the route from poses over path length. Raise FileError for fewer than two poses, or a wrong value.  (1)"""
    values = np.column_stack([table.numbers(column) for column in DISTANCE_COLUMNS])
    wait_s = table.numbers(WAIT_COLUMN) if WAIT_COLUMN in table.columns else np.zeros(len(values))
    is_not_finite = ~np.isfinite(np.column_stack([values, wait_s])).all(axis=1)
    if is_not_finite.any():
        raise FileError.of("route.not-number", path=path, line=table.lines[np.argmax(is_not_finite)])
    if len(values) < 2:
        raise FileError.of("route.too-short", path=path, count=len(values))
    s, v, psi = values[:, 0], values[:, 4], np.unwrap(values[:, 3])
    ds, dpsi, pace = np.diff(s), np.diff(psi), 0.5 * (np.abs(v[1:]) + np.abs(v[:-1]))
    is_not_finite = (ds < 0.0) | ((ds > 0.0) & (pace <= 0.0)) | (wait_s[:-1] < 0.0)
    if is_not_finite.any():
        k = int(np.argmax(is_not_finite))
        raise FileError.of("route.way", path=path, line=table.lines[k + 1], ds_m=ds[k], v_m_s=pace[k])
    moves = ds > 0.0
    dt_s = np.where(moves, ds / np.where(moves, pace, 1.0), np.abs(dpsi) / SPOT_TURN_RAD_S)
    turn = np.where(moves, dpsi / np.where(moves, ds, 1.0) * pace, np.sign(dpsi) * SPOT_TURN_RAD_S)
    turn = np.interp(np.arange(len(s)), np.arange(len(s) - 1) + 0.5, turn)
    eta, nu = np.column_stack([values[:, 1:3], psi]), np.column_stack([v, 0.0 * v, turn])
    t_s = np.append(0.0, np.cumsum(dt_s + wait_s[:-1]))
    waiting_rows = np.flatnonzero(wait_s[:-1] > 0.0)
    nu[waiting_rows] = 0.0
    leaves = t_s[waiting_rows] + wait_s[waiting_rows]
    t_s, eta, nu = (
        np.insert(rows, waiting_rows + 1, inserted_rows, axis=0)
        for rows, inserted_rows in ((t_s, leaves), (eta, eta[waiting_rows]), (nu, nu[waiting_rows]))
    )
    is_kept = np.append(True, np.diff(t_s) > 0.0)  # of two equal poses one is kept
    if np.count_nonzero(is_kept) < 2:
        raise FileError.of("route.too-short", path=path, count=1)
    return Route(t_s[is_kept], eta[is_kept], nu[is_kept], _is_closed(path))


def _is_closed(path: Path) -> bool:
    for line in Lines(path, None, str(path)):
        match = _CLOSED_LINE.match(line)
        if match:
            return match[1].lower() == "true"
    raise FileError.of("route.closed-missing", path=path)
