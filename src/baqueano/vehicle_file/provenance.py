"""Read the provenance of the values: [provenance."key"] and [parameter_cov].

    [provenance."model.friction.linear"]   run = "runs/0001-experiment.mcap", date = 2026-11-21,
                                           std = [0.02, 0.1, 0.0001], verdict = "USABLE"
    [provenance.model]                     a whole table: all its values without a separate provenance
    [parameter_cov]                        of the last fit: run, date, names = ["model.friction.linear[0]", …],
                                           std = […], correlation = [[1.0], [0.83, 1.0]], the lower triangle

    cov_ij = r_ij std_i std_j                                                                                       (1)

If no value of a model was measured by a fit that was not refused, the model is a guess.
"""

from collections.abc import Iterator
from datetime import date as Date
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.messages.language import mark as N_
from baqueano.vehicle_file.paths import is_table, key_exists, valid_paths
from baqueano.vehicle_file.tables import ReadReport, number_array, report_unknown_key

GUESS = Verdict.GUESS  # verdict on values that were not measured
UNMEASURED_VERDICTS = (GUESS, Verdict.REFUSED)
FORMER_KEYS = {"sd": "std"}  # former name of a key → its present name


class Provenance(NamedTuple):
    """The provenance of a value, or of all values of a table that lack a separate provenance."""

    run: str
    date: Date | None = None
    std: Any = None  # one number, or an array like the value; None: not known
    verdict: str = ""


def model_values(data: JsonObject, provenance: dict[str, Provenance]) -> list[TableRow]:
    """Return one flat dict per key of the model: key, value (a list is one value), measuring run and verdict."""
    rows: list[TableRow] = []
    for key, value in _flat_items("model", data.get("model", {})):
        origin = provenance.get(key, provenance.get("model", Provenance("")))
        rows.append(
            {"parameter": key, "value": str(value), N_("measured by"): origin.run, "verdict": origin.verdict}
        )
    return rows


def _flat_items(name: str, table: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(table, dict):
        yield name, table
        return
    for key, value in table.items():
        yield from _flat_items(f"{name}.{key}", value)


class ParameterCov(NamedTuple):
    """The covariance of the parameters of one fit."""

    names: tuple[str, ...]  # (p,) dotted keys, with entries such as "model.friction.linear[0]"
    cov: np.ndarray  # (p, p)
    run: str = ""
    date: Date | None = None


def read_history(
    report: ReadReport, data: JsonObject, folder: str | None = None
) -> tuple[dict[str, Provenance], ParameterCov | None]:
    """Return the tables [provenance] and [parameter_cov], checked; None instead of a missing covariance.
    `folder` is searched for a block of the user.
    """
    return _provenance(report, data, folder), _parameter_cov(report, data, folder)


def is_measured(provenance: dict[str, Provenance], prefix: str = "model.") -> bool:
    """Return True if the vehicle's value of a key that begins with `prefix` is from a fit that was not refused."""
    return any(k.startswith(prefix) and p.verdict not in UNMEASURED_VERDICTS for k, p in provenance.items())


def _with_present_keys(table: JsonObject) -> JsonObject:
    """Return a table whose keys have their present names; the files of older runs contain former names."""
    return {FORMER_KEYS.get(key, key): value for key, value in table.items()}


def _provenance(report: ReadReport, data: JsonObject, folder: str | None) -> dict[str, Provenance]:
    origins = {}
    for key, table in data.get("provenance", {}).items():
        path = ("provenance", key)
        if not key_exists(data, key, folder) and not is_table(data, key, folder):
            report_unknown_key(report, path, table, dict.fromkeys(valid_paths(data, folder), ""))
            continue
        if not isinstance(table, dict):
            report.add_problem(path, "vehicle.provenance-not-table")
            continue
        table = _with_present_keys(table)
        for name in table:
            if name not in Provenance._fields:
                report_unknown_key(report, (*path, name), table[name], dict.fromkeys(Provenance._fields, ""))
        origins[key] = Provenance(
            _text(report, path, table, "run"),
            _date(report, path, table),
            _std(report, path, table),
            _text(report, path, table, "verdict"),
        )
    return origins


def _text(report: ReadReport, path: tuple[str, ...], table: JsonObject, name: str) -> str:
    value = table.get(name, "")
    if not isinstance(value, str):
        report.add_problem((*path, name), "vehicle.not-text", value=repr(value))
        return ""
    return value


def _date(report: ReadReport, path: tuple[str, ...], table: JsonObject) -> Date | None:
    value = table.get("date")
    if value is not None and not isinstance(value, Date):
        report.add_problem((*path, "date"), "vehicle.not-date", value=repr(value))
        return None
    return value


def _std(report: ReadReport, path: tuple[str, ...], table: JsonObject) -> Any:
    value = table.get("std")
    if value is None:
        return None
    array = number_array(value if isinstance(value, list) else [value])
    if array is None or np.any(np.isinf(array)) or np.any(array < 0.0):  # nan: not known
        report.add_problem((*path, "std"), "vehicle.not-std", value=repr(value))
        return None
    return array if isinstance(value, list) else float(array[0])


def _parameter_cov(report: ReadReport, data: JsonObject, folder: str | None) -> ParameterCov | None:
    table, path = data.get("parameter_cov"), ("parameter_cov",)
    if table is None:
        return None
    if not isinstance(table, dict):
        report.add_problem(path, "vehicle.cov-not-table")
        return None
    table = _with_present_keys(table)
    expected_keys = ("run", "date", "names", "std", "correlation")
    for name in table:
        if name not in expected_keys:
            report_unknown_key(report, (*path, name), table[name], dict.fromkeys(expected_keys, ""))
    names = table.get("names", [])
    if not isinstance(names, list) or not all(
        isinstance(n, str) and key_exists(data, n, folder) for n in names
    ):
        report.add_problem((*path, "names"), "vehicle.cov-names")
        return None
    cov = _covariance(report, path, table, len(names))
    if cov is None:
        return None
    return ParameterCov(tuple(names), cov, _text(report, path, table, "run"), _date(report, path, table))


def _covariance(report: ReadReport, path: tuple[str, ...], table: JsonObject, size: int) -> np.ndarray | None:
    """Return cov (size, size) from std and correlation; None after a problem was added to `report`.  (1)"""
    std, correlation = number_array(table.get("std", [])), _triangle(table.get("correlation", []), size)
    is_valid_std = std is not None and std.shape == (size,) and bool(np.all(np.isfinite(std) & (std >= 0.0)))
    if std is None or correlation is None or not is_valid_std:
        report.add_table_problem(path, "vehicle.cov-size", expected=size)
        return None
    min_eigenvalue = float(np.linalg.eigvalsh(correlation)[0]) if size else 0.0
    if min_eigenvalue < -1e-6:
        report.add_problem((*path, "correlation"), "vehicle.correlation", eigenvalue=min_eigenvalue)
        return None
    return correlation * np.outer(std, std)


def _triangle(rows: object, size: int) -> np.ndarray | None:
    """Return a symmetric matrix from the rows of its lower triangle; None if it is not a correlation matrix."""
    arrays = [number_array(row) for row in rows] if isinstance(rows, list) else []
    if len(arrays) != size or any(a is None or a.shape != (i + 1,) for i, a in enumerate(arrays)):
        return None
    matrix = np.zeros((size, size))
    for i, row in enumerate(arrays):
        matrix[i, : i + 1] = matrix[: i + 1, i] = row
    return matrix if np.all(np.abs(matrix) <= 1.0) and np.all(np.diag(matrix) == 1.0) else None
