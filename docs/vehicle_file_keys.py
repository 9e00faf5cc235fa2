"""Write the keys of a vehicle file as the page vehicle-file.md, from the metadata that the loader checks.

Texts are translated by the catalogue, so the page exists in each language; numbers keep the notation of TOML.
"""

import json
from dataclasses import is_dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.blocks import BLOCK_TARGETS, resolve
from baqueano.messages import text
from baqueano.messages.language import N_, shown_unit, translate as _
from baqueano.parameter import INF
from baqueano.vehicle_file.build import ROUTE_FIELDS
from baqueano.vehicle_file.head import Channels, Geometry, Hardware, Simulation, TopLevelKeys
from baqueano.vehicle_file.provenance import Provenance
from baqueano.vehicle_file.tables import DERIVED_KEYS, NO_DEFAULT, Key, allowed_range, table_keys

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow

ROLE_TABLES = {
    "vehicle": "model",
    "sensor": "sensors.NAME",
    "estimator": "estimator",
    "guide": "guide",
    "controller": "controller",
    "supervisor": "supervisor",
}
PLAIN_MEANINGS = {  # keys without a unit: what they mean
    "format": N_("version of this layout, 1"),
    "name": N_("name of the vehicle"),
    "about": N_("description of the vehicle, in one line"),
    "names": N_(
        "names of the entries of the command u, of the parameters of the fit, or of the quantities of an "
        "envelope"
    ),
    "unit": N_("unit of the command; a real robot takes duty, -1 to 1"),
    "kind": N_('the block: a short name, or `"file.py:Class"` for your own'),
    "mixing": N_('`"none"`, or `"two_wheels"`: `left = u_x - u_psi`, `right = u_x + u_psi`'),
    "battery": N_(
        '`"steady"`: `battery_v`; `"logged"`: in a fit, the voltage in the channel `battery` of the run'
    ),
    "measurement_model": N_('`"physical"`, or `"paper"`: h as the paper prints it'),
    "measures_offset": N_(
        "a reading gives the position of the reader itself; `false`: the position of the tag"
    ),
    "mode": N_('`"default"`, or `"paper"`: the filter as the paper prints it'),
    "use": N_(
        'sensors that correct the estimate, or single channels of them: `"imu[2]"`; the others are only '
        "recorded"
    ),
    "speed_from": N_('accelerometers that may correct the speed: `"imu[1]"`'),
    "watch": N_("the sensor that must always give data"),
    "truth": N_(
        "the vehicle of the simulation: a name of the garage, or a file in the same folder; if missing, "
        "this vehicle"
    ),
    "port": N_('`"auto"`, or the serial line of the Uno: `"/dev/serial/by-id/..."`'),
    "imu_axes": N_(
        'axes of the chip that point forward, left and up: `["-y", "x", "z"]` if it is turned to the left, '
        '`["x", "-y", "-z"]` if it is upside down'
    ),
    "rate_hz": N_("commands per second"),
    "laps": N_("number of laps; 0 means without end"),
    "waves": N_("waves of the radius in a lap"),
    "run": N_("the run from which the value was estimated"),
    "date": N_("the day on which the value was estimated"),
    "std": N_("standard deviation; `nan` if unknown"),
    "verdict": N_("USABLE, WARN or REFUSED; GUESS if it was not measured"),
    "low": N_("smallest value of each name in the data of the last fit"),
    "high": N_("largest value of each name in the data of the last fit"),
    "correlation": N_("of the parameters of the last fit, lower triangle"),
}
FILE_DEFAULTS = {  # keys whose default is elsewhere in the file
    ("model", "inertia_kg_m2"): N_("½ m R², from radius_m"),
    ("sensors.NAME", "track_m"): N_("the value in [geometry]"),
    ("model.friction", "track_m"): N_("the value in [geometry], else 0"),
    ("estimator", "rate_hz"): N_("the rate of the file"),
    ("controller", "limit"): N_("the limit in [command]"),
    ("controller", "rate_hz"): N_("the rate of the file"),
    ("supervisor", "limit"): N_("the limit in [command]"),
}
FILE_FIELDS = {"vehicle", "sensors"}
INTRODUCTION = N_(
    "A key that is not required may be missing. Its default is written here as in the file, with a decimal "
    "point."
)


def rows() -> list["TableRow"]:
    """Return a row for each key, in the current language: table, kind, key, unit, shape, range, default, meaning."""
    all_rows = _rows("", "", TopLevelKeys) + _rows("command", "", Channels) + _rows("geometry", "", Geometry)
    all_rows += _rows("robot", "", Hardware) + _rows("simulation", "", Simulation)
    for role, kinds in BLOCK_TARGETS.items():
        for kind in kinds:
            all_rows += _rows(ROLE_TABLES[role], kind, resolve(role, kind))
    for name in Provenance._fields:
        all_rows.append(_row('provenance."KEY"', "", Key(name, None, Any, None)))
    for name in ("run", "date", "names", "std", "correlation"):
        all_rows.append(_row("parameter_cov", "", Key(name, None, Any, None)))
    for name in ("run", "names", "low", "high"):
        all_rows.append(_row("envelope", "", Key(name, None, Any, None)))
    return [row for i, row in enumerate(all_rows) if row not in all_rows[:i]]


def reference_table() -> str:
    """Return the rows as Markdown in the current language, one table for each table of the file."""
    lines = [f"# {_('Keys of a vehicle file')}", "", _(INTRODUCTION)]
    for title, group in groupby(rows(), _title):
        lines += ["", f"## {title}", "", *_markdown(list(group))]
    return "\n".join(lines) + "\n"


def _title(row: "TableRow") -> str:
    if not row["table"]:
        return _("Above the first table")
    kind = f' kind = "{row["kind"]}"' if row["kind"] else ""
    return f"`[{row['table']}]{kind}`"


def _markdown(table_rows: list["TableRow"]) -> list[str]:
    """Return the lines of one table in Markdown, without its empty columns."""
    heads = {"key": _("key"), "meaning": _("meaning"), "unit": _("unit"), "shape": _("shape"), "range": _("range"),
             "default": _("default")}  # fmt: skip
    columns = [name for name in heads if any(row[name] for row in table_rows)]
    lines = [f"| {' | '.join(heads[name] for name in columns)} |", "|---" * len(columns) + "|"]
    for row in table_rows:
        cells = [f"`{row['key']}`", *(row[name].replace("|", "\\|") for name in columns[1:])]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _rows(table: str, kind: str, block: type) -> list["TableRow"]:
    own_rows, nested_rows = [], []
    if kind and "." not in table.replace("sensors.NAME", ""):
        own_rows.append(_row(table, kind, Key("kind", None, str, NO_DEFAULT)))
    for name, key in table_keys(
        block, {*DERIVED_KEYS, *FILE_FIELDS, *(ROUTE_FIELDS if table == "guide" else ())}
    ).items():
        if isinstance(key.type, type) and is_dataclass(key.type):
            nested_rows += _rows(f"{table}.{name}", "", key.type)
        else:
            own_rows.append(_row(table, kind, key))
    return own_rows + nested_rows


def _row(table: str, kind: str, key: Key) -> "JsonObject":
    p = key.parameter
    file_default = FILE_DEFAULTS.get((table, key.name))
    return {
        "table": table,
        "kind": kind,
        "key": key.name,
        "unit": shown_unit(p.unit) if p else "",
        "shape": "" if p is None or p.shape == () else str(p.shape) if p.shape else _("list"),
        "range": _range(key),
        "default": _(file_default) if file_default else _default(key),
        "meaning": _(p.meaning if p else PLAIN_MEANINGS.get(key.name, "")),
    }


def _range(key: Key) -> str:
    p = key.parameter
    if p is None:
        return ""
    if key.name.endswith("_cov"):
        return _("symmetric, no eigenvalue below 0")
    return _("any") if p.low == -INF and p.high == INF else text(allowed_range(p))


def _default(key: Key) -> str:
    """Return the default of a key in the notation of the file; "" for None, "required" for a key without a default."""
    if key.default is NO_DEFAULT:
        return _("required")
    if key.default is None:
        return ""
    if isinstance(key.default, float | np.ndarray):
        return f"`{np.asarray(key.default).tolist()}`"
    return f"`{json.dumps(key.default)}`"
