"""Build blocks from the tables of a vehicle file.

A block receives `vehicle`, `sensors` and the route if it has fields of these names. If its table lacks `rate_hz` or
`limit`, it receives the values of the file.
"""

from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.blocks import kinds, place_of, resolve, resolve_named
from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.diagnostics import nearest
from baqueano.errors import FileError, error_text, from_outside, in_users_file
from baqueano.signals import ByName, sensor_slots
from baqueano.vehicle_file.head import Geometry, solid_inertia
from baqueano.vehicle_file.tables import (
    DERIVED,
    KeyPath,
    Sheet,
    argument_names,
    arguments,
    keys_of,
    missing,
)

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

DEFAULT_KIND = {
    "estimator": "augmented_ekf",
    "guide": "repeat",
    "controller": "pd_feedforward",
    "supervisor": "supervisor",
}
ROUTE = ("t_s", "eta", "nu", "closed", "route")  # fields of a guide that the route fills


class Surroundings(NamedTuple):
    """The values of other parts of the file that the table of a block may need."""

    folder: str | None  # the folder of "file.py:Class"
    rate_hz: float
    geometry: Geometry
    low_pass_hz: float | None = None  # of the IMU, by the setting of its chip if the file has one


def vehicle(sheet: Sheet, table: Any, around: Surroundings) -> Any:
    """Return the block of [model], or None after a problem was noted in `sheet`."""
    kind = _kind(sheet, ("model",), "vehicle", table, None, around)
    if kind is None:
        return None
    keys = keys_of(kind, DERIVED)
    values = arguments(sheet, ("model",), keys, table)
    if "inertia_kg_m2" in keys and "inertia_kg_m2" not in table and "mass_kg" in values:
        inertia = solid_inertia(values["mass_kg"], around.geometry)
        if inertia is not None:
            values["inertia_kg_m2"] = inertia
    if (
        "friction" in keys
        and around.geometry.track_m is not None
        and isinstance(table.get("friction", {}), dict)
    ):
        values["friction"] = {"track_m": around.geometry.track_m, **values.get("friction", {})}
    known_inertia = solid_inertia(1.0, around.geometry) is not None
    lacking = [k for k in missing(keys, values) if k not in table]
    if lacking := [k for k in lacking if not (k == "inertia_kg_m2" and known_inertia)]:
        code = "vehicle.model-lacks-inertia" if "inertia_kg_m2" in lacking else "vehicle.model-lacks"
        sheet.wrong_table(("model",), code, keys=lacking, model=kind.__name__)
    if sheet.problems:
        return None
    return construct(sheet, ("model",), kind, values, around, commands=getattr(kind, "commands", 3))


def sensors(sheet: Sheet, tables: object, around: Surroundings) -> Any:
    """Return the NamedTuple of the sensor blocks of [sensors.…], in the order of the file."""
    blocks: JsonObject = {}
    for name, table in (tables if isinstance(tables, dict) else {}).items():
        path = ("sensors", name)
        if not name.isidentifier() or name.startswith("_"):
            sheet.wrong_table(path, "vehicle.sensor-name")
            continue
        default = name if name in kinds("sensor") else None
        kind = _kind(sheet, path, "sensor", table, default, around)
        if kind is not None:
            blocks[name] = _sensor(sheet, path, kind, table, around)
    if not isinstance(tables, dict):
        sheet.wrong(("sensors",), "vehicle.sensors-not-table")
    return sensor_slots(tuple(blocks))(*blocks.values())


def noiseless(sensors: ByName[Tree]) -> list[str]:
    """Return the names of the sensors with a channel whose noise is missing in the file, or 0."""
    return [name for name, sensor in sensors._asdict().items() if _lacks_noise(sensor)]


def with_usual_noise(sensors: ByName[Tree]) -> ByName[Tree]:
    """Return the sensors for a filter: a channel without noise has the usual noise of this kind of sensor.

    A simulation accepts an exact sensor; a filter would divide by 0.
    """
    lacking = {name: getattr(sensors, name) for name in noiseless(sensors)}
    return (
        sensors._replace(**{name: _usual(sensor) for name, sensor in lacking.items()}) if lacking else sensors
    )


def _lacks_noise(sensor: Tree) -> bool:
    if optional.of(sensor, "usual_std") is None:
        return False
    return not bool(np.all(np.diag(sensor.cov) > 0.0))


def _usual(sensor: Tree) -> Tree:
    positive = np.diag(sensor.cov) > 0.0
    Q = np.where(positive[:, None] & positive[None, :], sensor.cov, 0.0)
    usual = np.where(positive, 0.0, np.array(sensor.usual_std))
    return replace(sensor, measurement_noise_cov=Q + np.diag(usual**2))


def _sensor(sheet: Sheet, path: KeyPath, kind: type, table: Any, around: Surroundings) -> Any:
    keys = keys_of(kind, DERIVED)
    values = arguments(sheet, path, keys, table)
    if "track_m" in keys and "track_m" not in table and around.geometry.track_m is not None:
        values["track_m"] = around.geometry.track_m
    if "low_pass_hz" in keys and "low_pass_hz" not in table and around.low_pass_hz is not None:
        values["low_pass_hz"] = around.low_pass_hz
    lacking = [k for k in missing(keys, values) if k not in table]
    if lacking:
        sheet.wrong_table(path, "vehicle.table-lacks", keys=lacking)
    if lacking or sheet.problems:
        return None
    return construct(sheet, path, kind, values, around)


class BlockRoom(NamedTuple):
    """The content of a block's table: the class, the values of the file, the missing keys."""

    kind: type
    values: "JsonObject"
    lacking: list[str]


def room(
    sheet: Sheet,
    name: str,
    table: Any,
    given: "JsonObject",
    fallback: "JsonObject",
    around: Surroundings,
    kind: str | type | None = None,
) -> BlockRoom | None:
    """Return the content of a room's table; None after a problem. If `kind` replaces the kind of the table, keys that
    the new kind lacks are omitted.
    """
    path = (name,)
    own = table.get("kind", DEFAULT_KIND[name]) if isinstance(table, dict) else DEFAULT_KIND[name]
    sheet_table = {**table, "kind": kind} if kind else table
    block = _kind(sheet, path, name, sheet_table, DEFAULT_KIND[name], around, typed=kind is not None)
    if block is None:
        return None
    keys = keys_of(block, {*DERIVED, *given, *(ROUTE if name == "guide" else ())})
    if kind is not None and kind != own:
        table = {k: v for k, v in table.items() if k in keys}
    values = arguments(sheet, path, keys, table)
    values |= {k: v for k, v in fallback.items() if k in keys and k not in values}
    lacking = missing(keys, values)
    values |= {k: v for k, v in given.items() if k in argument_names(block)}
    return BlockRoom(block, values, [k for k in lacking if k not in table])


def construct(
    sheet: Sheet,
    path: KeyPath,
    kind: type,
    values: "JsonObject",
    around: Surroundings,
    commands: int | None = None,
) -> Any:
    """Return an object of the class; if it raises, note this as a problem of the table and return None."""
    names = argument_names(kind)
    values = dict(values)
    for name, key in keys_of(kind).items():
        if isinstance(values.get(name), dict):
            values[name] = construct(sheet, (*path, name), key.type, values[name], around, commands)
            if values[name] is None:
                return None
        elif name == "drivetrain" and name not in values and commands is not None:
            values[name] = construct(sheet, (*path, name), key.type, {}, around, commands)
    if "commands" in names and commands is not None:
        values["commands"] = commands
    if "delay_slots" in names and "delay_s" in names:
        values["delay_slots"] = ceil(values.get("delay_s", 0.0) * around.rate_hz - 1e-9)
    try:
        return kind(**values)
    except (ValueError, TypeError) as error:
        sheet.wrong_table(path, "vehicle.refused", block=_block_name(kind), error=str(error))
    except BaseException as error:
        if from_outside(error):
            raise
        place = in_users_file(error)
        block_name = f"{kind.__name__} ({place})" if place else _block_name(kind)
        sheet.wrong_table(path, "vehicle.not-built", block=block_name, error=error_text(error))
    return None


def _block_name(kind: type) -> str:
    return kind.__name__ if kind.__module__.startswith("baqueano.") else f"{kind.__name__} ({place_of(kind)})"


def _kind(
    sheet: Sheet, path: KeyPath, room: str, table: object, default: str | None, around: Surroundings,
    typed: bool = False,
) -> type | None:  # fmt: skip
    """Return the class that a table names, or None after a problem; `typed` is True if the user typed the name."""
    if not isinstance(table, dict):
        sheet.wrong(path, "vehicle.block-not-table", table=".".join(path))
        return None
    name = table.get("kind", default)
    if name is None:
        near = [k for k in table if "meant" in nearest(k, ["kind"]).figures]
        code = "vehicle.kind-mistyped" if near else "vehicle.no-kind"
        sheet.wrong_table(path, code, known=kinds(room), found=near[:1])
        return None
    if isinstance(name, type):
        return name
    if not isinstance(name, str):
        sheet.wrong((*path, "kind"), "vehicle.kind-not-text", found=repr(name), known=kinds(room))
        return None
    kind_of = resolve if typed else resolve_named
    try:
        return kind_of(room, name, around.folder)
    except FileError as error:
        sheet.wrong((*path, "kind"), "vehicle.kind", kind=name, cause=error.diagnostic)
        return None
