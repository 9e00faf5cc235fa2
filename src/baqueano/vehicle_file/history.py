"""Where the values come from: [provenance."key"] and [parameter_cov].

[provenance."model.friction.linear"]
run = "runs/0001-experiment.mcap"
date = 2026-11-21
sd = [0.02, 0.1, 0.0001]
verdict = "USABLE"

[provenance.model]                      # a whole table: all values of it that have none of their own
run = "baqueano new, from small"
verdict = "GUESS"

[parameter_cov]                         # of the last fit
run = "runs/0001-experiment.mcap"
date = 2026-11-21
names = ["model.friction.linear[0]", "model.actuator_matrix[0,0]"]
sd = [0.02, 0.001]
correlation = [[1.0], [0.83, 1.0]]      # lower triangle

cov_ij = r_ij sd_i sd_j                                                                               (1)
A model of whose values none has a provenance is a guess, too.
"""

from datetime import date as Date
from typing import Any, NamedTuple

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.vehicle_file.paths import exists, is_table, known_paths
from baqueano.vehicle_file.tables import Sheet, number_array, unknown

GUESS = Verdict.GUESS  # verdict on values that nobody measured
NOT_MEASURED = (GUESS, Verdict.REFUSED)
NOT_VALUES = ("provenance.", "parameter_cov.", "envelope.")  # keys that tell of others


class Provenance(NamedTuple):
    """Where a value comes from, or the values of a table that have none of their own."""

    run: str
    date: Date | None = None
    sd: Any = None  # one number, or an array like the value; None: not known
    verdict: str = ""


class ParameterCov(NamedTuple):
    """The covariance of the parameters of one fit."""

    names: tuple[str, ...]  # (p,) dotted keys, entries as "model.friction.linear[0]"
    cov: np.ndarray  # (p, p)
    run: str = ""
    date: Date | None = None


def read_history(
    sheet: Sheet, data: dict[str, Any], folder: str | None = None
) -> tuple[dict[str, Provenance], ParameterCov | None]:
    """Both tables, checked; `folder` is where a block of the user's own is looked for."""
    return _provenance(sheet, data, folder), _parameter_cov(sheet, data, folder)


def measured(provenance: dict[str, Provenance]) -> bool:
    """Return whether any value of the model was measured on the vehicle, by a fit that was not refused."""
    return any(k.startswith("model.") and p.verdict not in NOT_MEASURED for k, p in provenance.items())


def _provenance(sheet: Sheet, data: dict[str, Any], folder: str | None) -> dict[str, Provenance]:
    found = {}
    for key, table in data.get("provenance", {}).items():
        path = ("provenance", key)
        if not exists(data, key, folder) and not is_table(data, key, folder):
            unknown(sheet, path, table, dict.fromkeys(known_paths(data, folder), ""))
            continue
        if not isinstance(table, dict):
            sheet.wrong(path, "is not a table: it holds run, date, sd and verdict.")
            continue
        for name in table:
            if name not in Provenance._fields:
                unknown(sheet, (*path, name), table[name], dict.fromkeys(Provenance._fields, ""))
        found[key] = Provenance(
            _text(sheet, path, table, "run"),
            _date(sheet, path, table),
            _sd(sheet, path, table),
            _text(sheet, path, table, "verdict"),
        )
    return found


def _text(sheet: Sheet, path: tuple[str, ...], table: dict[str, Any], name: str) -> str:
    value = table.get(name, "")
    if not isinstance(value, str):
        sheet.wrong((*path, name), f"= {value!r}: expected text in quotes.")
        return ""
    return value


def _date(sheet: Sheet, path: tuple[str, ...], table: dict[str, Any]) -> Date | None:
    value = table.get("date")
    if value is not None and not isinstance(value, Date):
        sheet.wrong((*path, "date"), f"= {value!r}: expected a date without quotes, as 2026-11-21.")
        return None
    return value


def _sd(sheet: Sheet, path: tuple[str, ...], table: dict[str, Any]) -> Any:
    value = table.get("sd")
    if value is None:
        return None
    array = number_array(value if isinstance(value, list) else [value])
    if array is None or np.any(np.isinf(array)) or np.any(array < 0.0):  # nan: not known
        sheet.wrong(
            (*path, "sd"), f"= {value!r}: expected standard deviations, 0 or more; nan where not known."
        )
        return None
    return array if isinstance(value, list) else float(array[0])


def _parameter_cov(sheet: Sheet, data: dict[str, Any], folder: str | None) -> ParameterCov | None:
    table, path = data.get("parameter_cov"), ("parameter_cov",)
    if table is None:
        return None
    if not isinstance(table, dict):
        sheet.wrong(path, "is not a table: it holds run, date, names, sd and correlation.")
        return None
    expected = ("run", "date", "names", "sd", "correlation")
    for name in table:
        if name not in expected:
            unknown(sheet, (*path, name), table[name], dict.fromkeys(expected, ""))
    names = table.get("names", [])
    if not isinstance(names, list) or not all(isinstance(n, str) and exists(data, n, folder) for n in names):
        sheet.wrong(
            (*path, "names"),
            "names a parameter that is not in the file. Delete the table: the next fit writes it.",
        )
        return None
    cov = _covariance(sheet, path, table, len(names))
    if cov is None:
        return None
    return ParameterCov(tuple(names), cov, _text(sheet, path, table, "run"), _date(sheet, path, table))


def _covariance(sheet: Sheet, path: tuple[str, ...], table: dict[str, Any], size: int) -> np.ndarray | None:
    """cov (size, size) from sd and correlation.  (1)"""
    sd, correlation = number_array(table.get("sd", [])), _triangle(table.get("correlation", []), size)
    fits = sd is not None and sd.shape == (size,) and bool(np.all(np.isfinite(sd) & (sd >= 0.0)))
    if sd is None or correlation is None or not fits:
        sheet.wrong_table(
            path,
            f"has {size} names: expected as many sd, 0 or more, and a correlation of rows of 1, 2, … {size} "
            f"numbers from -1 to 1. Delete the table: the next fit writes it.",
        )
        return None
    smallest = float(np.linalg.eigvalsh(correlation)[0]) if size else 0.0
    if smallest < -1e-6:
        sheet.wrong(
            (*path, "correlation"),
            f"has the eigenvalue {smallest:.3g}: no parameters are correlated like this.",
        )
        return None
    return correlation * np.outer(sd, sd)


def _triangle(rows: Any, size: int) -> np.ndarray | None:
    """A symmetric matrix from the rows of its lower triangle."""
    arrays = [number_array(row) for row in rows] if isinstance(rows, list) else []
    if len(arrays) != size or any(a is None or a.shape != (i + 1,) for i, a in enumerate(arrays)):
        return None
    full = np.zeros((size, size))
    for i, row in enumerate(arrays):
        full[i, : i + 1] = full[: i + 1, i] = row
    return full if np.all(np.abs(full) <= 1.0) and np.all(np.diag(full) == 1.0) else None


def changes(before: Any, after: Any) -> list[dict[str, Any]]:
    """What differs between two vehicle files, key by key: the history of wear. `sds` is how many standard
    deviations (both together) lie between the values; None where it is not known."""
    old, new = _leaves(before.data), _leaves(after.data)
    rows = []
    for key in [*old, *(k for k in new if k not in old)]:
        a, b = old.get(key), new.get(key)
        if a == b or key.startswith(NOT_VALUES):
            continue
        sd = [f.provenance[key].sd if key in f.provenance else None for f in (before, after)]
        rows.append({"key": key, "before": a, "after": b, "sds": _distance(a, b, sd)})
    return rows


def _leaves(table: dict[str, Any], path: str = "") -> dict[str, Any]:
    found = {}
    for name, value in table.items():
        key = f"{path}{name}"
        found |= _leaves(value, f"{key}.") if isinstance(value, dict) else {key: value}
    return found


def _distance(a: Any, b: Any, sd: list[Any]) -> float | None:
    known = [np.asarray(s, dtype=float) for s in sd if s is not None]
    try:
        d = np.abs(np.asarray(b, dtype=float) - np.asarray(a, dtype=float))
        spread = (
            np.sqrt(np.sum([s**2 for s in np.broadcast_arrays(*known)], axis=0)) if known else np.zeros(())
        )
    except (TypeError, ValueError):
        return None
    ratio = (
        d[np.broadcast_to(spread, d.shape) > 0.0]
        / np.broadcast_to(spread, d.shape)[np.broadcast_to(spread, d.shape) > 0.0]
    )
    return float(np.max(ratio)) if ratio.size else None
