"""Build blocks from the tables of a vehicle file.

A block receives `vehicle`, `sensors` and the route if it has fields of these names. If its table lacks `rate_hz` or
`limit`, it receives the values of the file.
"""

import sys
from dataclasses import replace
from functools import partial
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.block_checks.motion import sensor_obstacle
from baqueano.blocks import PROGRAM, check_step, kinds, place_of, resolve, resolve_named
from baqueano.contracts import optional
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.time_limit import PREPARE_S, within
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import nearest
from baqueano.errors import FileError, UsageError, error_text, is_interruption, user_code_place
from baqueano.estimators.readings.velocity_readings import velocity_rows
from baqueano.messages.printable import baqueano_command
from baqueano.signals import ByName, is_sensor_name, sensor_slots
from baqueano.vehicle_file.head import Geometry, solid_inertia
from baqueano.vehicle_file.tables import (
    DERIVED_KEYS,
    KeyPath,
    ReadReport,
    argument_names,
    arguments,
    missing_keys,
    table_keys,
)
from baqueano.vehicle_file.units import NON_MOTION_CHANNELS
from baqueano.vehicles.rk4 import row_rate_hz

FINDING_COMMANDS = {"controller": ("tune", "--update"), "estimator": ("identify", "last", "--update")}

DEFAULT_KINDS = {
    "estimator": "augmented_ekf",
    "guide": "repeat",
    "controller": "pd_feedforward",
    "supervisor": "supervisor",
}
ROUTE_FIELDS = (
    "t_s",
    "eta",
    "nu",
    "closed",
    "route",
    "ends_in_motion",
)  # of a guide, set by route and mission


VEHICLE_MEMBERS = ("commands", "drivetrain", "init", "step", "advance", "gravity")  # of the protocol


class BuildContext(NamedTuple):
    """The values of other parts of the file that the table of a block can need."""

    folder: str | None  # the folder of "file.py:Class"
    rate_hz: float
    geometry: Geometry
    low_pass_hz: float | None = None  # of the IMU, from the setting of its chip; None if the file lacks it


def vehicle(report: ReadReport, table: Any, context: BuildContext) -> Any:
    """Return the block of [model], or None after a problem was added to `report`."""
    block_class = _named_class(report, ("model",), "vehicle", table, None, context)
    if block_class is None:
        return None
    keys = table_keys(block_class, DERIVED_KEYS)
    values = arguments(report, ("model",), keys, table)
    if "inertia_kg_m2" in keys and "inertia_kg_m2" not in table and "mass_kg" in values:
        inertia = solid_inertia(values["mass_kg"], context.geometry)
        if inertia is not None:
            values["inertia_kg_m2"] = inertia
    if (
        "friction" in keys
        and context.geometry.track_m is not None
        and isinstance(table.get("friction", {}), dict)
    ):
        values["friction"] = {"track_m": context.geometry.track_m, **values.get("friction", {})}
    has_solid_inertia = solid_inertia(1.0, context.geometry) is not None
    missing_names = [k for k in missing_keys(keys, values) if k not in table]
    if missing_names := [k for k in missing_names if not (k == "inertia_kg_m2" and has_solid_inertia)]:
        code = "vehicle.model-lacks-inertia" if "inertia_kg_m2" in missing_names else "vehicle.model-lacks"
        report.add_table_problem(("model",), code, keys=missing_names, model=block_class.__name__)
    if report.problems:
        return None
    block = construct(
        report, ("model",), block_class, values, context, commands=getattr(block_class, "commands", 3)
    )
    missing_members = [name for name in VEHICLE_MEMBERS if name not in dir(block)]
    if missing_members and block is not None:
        report.add_table_problem(
            ("model",), "vehicle.lacks-members", block=_block_name(block_class), names=missing_members
        )
    return block


def sensors(report: ReadReport, tables: object, context: BuildContext) -> Any:
    """Return the NamedTuple of the sensor blocks of [sensors.…], in the order of the file."""
    blocks: JsonObject = {}
    for name, table in (tables if isinstance(tables, dict) else {}).items():
        path = ("sensors", name)
        if not is_sensor_name(name):
            report.add_table_problem(path, "vehicle.sensor-name")
            continue
        if name in NON_MOTION_CHANNELS and isinstance(table, dict) and table.get("kind", name) == name:
            arguments(report, path, {}, table)  # a fit reads the channel of the run
            continue
        default = name if name in kinds("sensor") else None
        block_class = _named_class(report, path, "sensor", table, default, context)
        if block_class is not None:
            blocks[name] = _sensor(report, path, block_class, table, context)
            _check_own_sensor(report, path, blocks[name], table)
    if not isinstance(tables, dict):
        report.add_problem(("sensors",), "vehicle.sensors-not-table")
    return sensor_slots(tuple(blocks))(*blocks.values())


def sensors_without_noise(sensors: ByName[Tree]) -> list[str]:
    """Return the names of the sensors with a channel whose noise is missing in the file, or 0."""
    return [name for name, sensor in sensors._asdict().items() if _lacks_noise(sensor)]


def with_usual_noise(sensors: ByName[Tree]) -> ByName[Tree]:
    """Return the sensors for a filter: a channel without noise has the usual noise of this kind of sensor.

    A simulation accepts an exact sensor; a filter would divide by 0.
    """
    missing_names = sensors_without_noise(sensors)
    return (
        sensors._replace(**{name: with_usual_std(getattr(sensors, name)) for name in missing_names})
        if missing_names
        else sensors
    )


def _lacks_noise(sensor: Tree) -> bool:
    if optional.attribute(sensor, "usual_std") is None:
        return False
    return not bool(np.all(np.diag(sensor.cov) > 0.0))


def with_usual_std(sensor: Tree) -> Tree:
    """Return a sensor whose channels without noise have the usual noise of its kind, if this is known."""
    if not _lacks_noise(sensor):
        return sensor
    is_positive = np.diag(sensor.cov) > 0.0
    Q = np.where(is_positive[:, None] & is_positive[None, :], sensor.cov, 0.0)
    added_std = np.where(is_positive, 0.0, np.array(sensor.usual_std))
    return replace(sensor, measurement_noise_cov=Q + np.diag(added_std**2))


def _sensor(report: ReadReport, path: KeyPath, block_class: type, table: Any, context: BuildContext) -> Any:
    keys = table_keys(block_class, DERIVED_KEYS)
    values = arguments(report, path, keys, table)
    if "track_m" in keys and "track_m" not in table and context.geometry.track_m is not None:
        values["track_m"] = context.geometry.track_m
    if "low_pass_hz" in keys and "low_pass_hz" not in table and context.low_pass_hz is not None:
        values["low_pass_hz"] = context.low_pass_hz
    missing_names = [k for k in missing_keys(keys, values) if k not in table]
    if missing_names:
        report.add_table_problem(path, "vehicle.table-lacks", keys=missing_names)
    if missing_names or report.problems:
        return None
    return construct(report, path, block_class, values, context)


def _check_own_sensor(report: ReadReport, path: KeyPath, block: Tree, table: JsonObject) -> None:
    """Add a problem if a sensor of the user's own fails where each drive would fail."""
    if block is None or type(block).__module__.startswith("baqueano."):
        return
    if (obstacle := sensor_obstacle(block)) is not None:
        is_in_cell = type(block).__module__ == PROGRAM
        fix = (
            f"bq.check({type(block).__name__})"
            if is_in_cell
            else baqueano_command("blocks", "check", table["kind"])
        )
        report.add_table_problem(path, "vehicle.sensor-breaks", fix, cause=obstacle)


class RoleTable(NamedTuple):
    """The content of a block's table: the class, the values of the file, the missing keys."""

    block_class: type
    values: JsonObject
    missing_names: list[str]


def role_table(
    report: ReadReport,
    name: str,
    table: Any,
    role_values: JsonObject,
    fallback: JsonObject,
    context: BuildContext,
    kind: str | type | None = None,
) -> RoleTable | None:
    """Return the content of the table of a role, or None after a problem was added to `report`.
    If `kind` replaces the kind of the table, keys that the new kind lacks are omitted. The gains of a controller belong
    to one kind, so another kind does not receive them, even under the same name.
    """
    path = (name,)
    own_kind = table.get("kind", DEFAULT_KINDS[name]) if isinstance(table, dict) else DEFAULT_KINDS[name]
    named_table = {**table, "kind": kind} if kind else table
    block_class = _named_class(
        report, path, name, named_table, DEFAULT_KINDS[name], context, is_typed=kind is not None
    )
    if block_class is None:
        return None
    keys = table_keys(block_class, {*DERIVED_KEYS, *role_values, *(ROUTE_FIELDS if name == "guide" else ())})
    if kind is not None and kind != own_kind:
        is_usable = name != "controller" or _has_kind(block_class, name, own_kind, context)
        table = {k: v for k, v in table.items() if k in keys and is_usable}
    values = arguments(report, path, keys, table)
    values |= {k: v for k, v in fallback.items() if k in keys and k not in values}
    if "use" in keys and "use" not in values and keys["use"].default == ("imu",):
        sensors = role_values["sensors"]
        names = tuple(n for n in sensors._fields if velocity_rows(getattr(sensors, n)))
        values["use"] = ("imu",) if "imu" in sensors._fields else names or sensors._fields
    missing_names = missing_keys(keys, values)
    values |= {k: v for k, v in role_values.items() if k in argument_names(block_class)}
    return RoleTable(block_class, values, [k for k in missing_names if k not in table])


def _has_kind(block_class: type, role: str, kind: str, context: BuildContext) -> bool:
    """Return True if a kind of the file names this class."""
    try:
        own_class = resolve_named(role, kind, context.folder)
    except (FileError, UsageError):
        return False
    return _origin(own_class) == _origin(block_class)


def _origin(block_class: type) -> tuple[str, str]:
    """Return the file and the name of a class; a notebook cell that is executed again makes another class of both."""
    module = block_class.__module__
    return getattr(sys.modules.get(module), "__file__", None) or module, block_class.__qualname__


def missing_values(
    file: str, path: Path | None, role: str, keys: list[str], kind: OwnBlock | None, own_kind: str | None
) -> FileError:
    """Return the error of a block without its values; a class from Python can also be given as an object.

    The gains of a controller other than `own_kind`, that of the file, need a file of their own: in this file they would
    replace those of its controller.
    """
    if isinstance(kind, type) and not kind.__module__.startswith("baqueano."):
        call = f"{role}={kind.__name__}({', '.join(f'{key}=1.0' for key in keys)})"
        return FileError.of(
            "block.lacks-arguments", call, file=file, role=role, keys=keys, block=kind.__name__
        )
    words = FINDING_COMMANDS.get(role, ())
    code, gains_file = "vehicle.lacks-estimates", Path()
    if role == "controller" and isinstance(kind, str):
        words = "tune", "--controller", kind, "--update"
        if own_kind not in (None, kind):
            code, gains_file = "vehicle.lacks-gains-of", Path(f"{kind.rpartition(':')[2].lower()}.toml")
            words = "tune", "--controller", kind, "--out", gains_file
    if not words:
        return FileError.of("vehicle.lacks", file=file, role=role, keys=keys)
    folder = Path.cwd()
    is_default = path is None or path == folder / "vehicle.toml"
    shown_path = path.relative_to(folder) if path and path.is_relative_to(folder) else path
    advice = baqueano_command(*words, *(() if is_default else ("--vehicle", shown_path)))
    figures = {"kind": kind, "own_kind": own_kind, "gains_file": gains_file} if gains_file.suffix else {}
    return FileError.of(code, advice, file=file, role=role, keys=keys, **figures)


def construct(
    report: ReadReport,
    path: KeyPath,
    block_class: type,
    values: JsonObject,
    context: BuildContext,
    commands: int | None = None,
) -> Any:
    """Return an object of the class. If its constructor raises, add a problem of the table and return None."""
    names = argument_names(block_class)
    values = dict(values)
    for name, key in table_keys(block_class).items():
        if isinstance(values.get(name), dict):
            values[name] = construct(report, (*path, name), key.type, values[name], context, commands)
            if values[name] is None:
                return None
        elif name == "drivetrain" and name not in values and commands is not None:
            values[name] = construct(report, (*path, name), key.type, {}, context, commands)
    if "commands" in names and commands is not None:
        values["commands"] = commands
    if "delay_slots" in names and "delay_s" in names:
        values["delay_slots"] = ceil(values.get("delay_s", 0.0) * row_rate_hz(context.rate_hz) - 1e-9)
    if "tick_rate_hz" in names:
        values["tick_rate_hz"] = context.rate_hz
    try:
        return within(PREPARE_S, partial(block_class, **values))
    except (ValueError, TypeError) as error:
        report.add_table_problem(path, "vehicle.refused", block=_block_name(block_class), error=str(error))
    except BaseException as error:
        if is_interruption(error):
            raise
        code_place = user_code_place(error)
        block_name = f"{block_class.__name__} ({code_place})" if code_place else _block_name(block_class)
        report.add_table_problem(path, "vehicle.not-built", block=block_name, error=error_text(error))
    return None


def _block_name(block_class: type) -> str:
    if block_class.__module__.startswith("baqueano."):
        return block_class.__name__
    place = place_of(block_class)
    return f"{block_class.__name__} ({place})" if place else block_class.__name__


def _named_class(
    report: ReadReport, path: KeyPath, role: str, table: object, default: str | None, context: BuildContext,
    is_typed: bool = False,
) -> type | None:  # fmt: skip
    """Return the class that a table names, or None after a problem. `is_typed`: the user typed the name."""
    if not isinstance(table, dict):
        report.add_problem(path, "vehicle.block-not-table", table=".".join(path))
        return None
    name = table.get("kind", default)
    if name is None:
        close_keys = [k for k in table if "match" in nearest(k, ["kind"]).figures]
        code = "vehicle.kind-mistyped" if close_keys else "vehicle.no-kind"
        report.add_table_problem(path, code, valid=kinds(role), value=close_keys[:1])
        return None
    if isinstance(name, type):
        return name
    if not isinstance(name, str):
        report.add_problem((*path, "kind"), "vehicle.kind-not-text", value=repr(name), valid=kinds(role))
        return None
    resolve_kind = resolve if is_typed else resolve_named
    try:
        block_class = resolve_kind(role, name, context.folder)
        check_step(
            role, block_class, lambda owner: f'{owner}="{name}"' if is_typed else f'[{owner}] kind = "{name}"'
        )
        return block_class
    except (FileError, UsageError) as error:
        if is_typed:  # the name is not in the file
            raise
        report.add_problem((*path, "kind"), "vehicle.kind", kind=name, cause=error.diagnostic)
        return None
