"""Resolve dotted keys of the file: "model.friction.linear", or one entry of it, "model.friction.linear[0]"."""

import difflib
import re
from dataclasses import is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from baqueano.blocks import resolve_named
from baqueano.contracts.result import no_attribute
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import nearest
from baqueano.errors import FileError, NoAttribute, UsageError
from baqueano.vehicle_file.head import Geometry, Hardware, Simulation
from baqueano.vehicle_file.tables import DERIVED_KEYS, table_keys

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

MIN_SIMILARITY = 0.6  # least similarity of the last names of two keys
_ENTRY = re.compile(r"^(.*?)((?:\[\s*\d+(?:\s*,\s*\d+)*\s*\])*)$")


def split_key(path_text: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return (("model", "friction", "linear"), (0,)) for "model.friction.linear[0]"; [0,2] equals [0][2]."""
    match = _ENTRY.match(path_text.strip())
    assert match is not None
    return tuple(name.strip() for name in match[1].split(".")), tuple(
        int(i) for i in re.findall(r"\d+", match[2])
    )


def valid_paths(data: JsonObject, folder: Path | str | None = None) -> list[str]:
    """Return every key that the blocks of this file can have, including keys that are not written in the file.

    A block of the user is searched for in `folder`. If the block is missing, as on another computer, only its written
    keys are returned.
    """
    paths = [
        "rate_hz",
        *(f"command.{k}" for k in data.get("command", {})),
        *(f"geometry.{k}" for k in table_keys(Geometry)),
        *(f"robot.{k}" for k in table_keys(Hardware)),
        *(f"simulation.{k}" for k in table_keys(Simulation)),
    ]
    tables = {("model",): "vehicle"}
    tables |= {("sensors", name): "sensor" for name in data.get("sensors", {})}
    tables |= {(role,): role for role in ("estimator", "controller", "guide", "supervisor")}
    for path, role in tables.items():
        keys = _keys(data, path, role, folder)
        paths += [".".join((*path, *inner_path)) for inner_path in [("kind",), *keys]]
    return paths


def key_exists(data: JsonObject, path_text: str, folder: Path | str | None = None) -> bool:
    """Return True if the blocks of this file can have this key, or the key of this entry."""
    return ".".join(split_key(path_text)[0]) in valid_paths(data, folder)


def is_table(data: JsonObject, path_text: str, folder: Path | str | None = None) -> bool:
    """Return True for the name of a table that this file can have, such as "model" or "model.friction"."""
    return any(path.startswith(f"{path_text}.") for path in valid_paths(data, folder))


def current_value(vehicle_file: "VehicleFile", path_text: str) -> Any:
    """Return the value, or default, of a key in the block that was built. Raise UsageError for an unknown key."""
    path, entry = split_key(path_text)
    paths = valid_paths(vehicle_file.data, vehicle_file.folder)
    if ".".join(path) not in paths:
        raise no_such_key(vehicle_file.name, path_text, paths)
    value: Any = vehicle_file
    if path[0] == "model":
        value, path = vehicle_file.vehicle, path[1:]
    elif path[0] in ("estimator", "controller", "guide", "supervisor"):
        if path[0] == "guide" or path[1] in vehicle_file.data.get(path[0], {}):
            value, path = vehicle_file.data[path[0]], path[1:]
        else:
            value, path = getattr(vehicle_file, path[0])(), path[1:]
    if path[-1] == "kind":
        return vehicle_file.data.get(path_text.split(".")[0], {}).get("kind")
    for name in path:
        value = value[name] if isinstance(value, dict) else getattr(value, name)
    value = np.array(value, dtype=float) if isinstance(value, list) else value
    return value[entry] if entry else value


def no_such_key(name: str, path_text: str, keys: list[str]) -> UsageError:
    """Return the error for an unknown key, with the keys of its table. A suggested key must be similar in the last
    part of its name: so `mass_kg` is not suggested for `yaw_lag_s`, although both are in the model.
    """
    match = str(nearest(path_text, keys).figures.get("match", ""))
    last_parts = path_text.rpartition(".")[2], match.rpartition(".")[2]
    if difflib.SequenceMatcher(None, *last_parts).ratio() < MIN_SIMILARITY:
        match = ""
    table = f"{(match or path_text).rpartition('.')[0]}."
    hint = nearest(match, [key for key in keys if key.startswith(table)] or keys, cutoff=1.0)
    return UsageError.of("vehicle.unknown-key", file=name, value=path_text, suggestion=hint)


def raise_missing_attribute(vehicle_file: "VehicleFile", name: str) -> Any:
    """Raise the error for an attribute that a vehicle file lacks: it names a key that begins so."""
    if name.startswith("_") or name in type(vehicle_file).__slots__:  # of a copy that is incomplete
        raise AttributeError(name)
    if key := _attribute_key(vehicle_file, name):
        figures = {"file": vehicle_file.name, "value": name, "key": key}
        raise NoAttribute.of("vehicle.attribute-is-key", f'robot.value("{key}")', **figures)
    raise no_attribute(vehicle_file, name, vehicle_file.name)


def refuse_change(vehicle_file: "VehicleFile", name: str, value: object) -> NoReturn:
    """Raise the error for `robot.name = value`: a vehicle file is never changed, and a copy has other values."""
    key = _attribute_key(vehicle_file, name) or f"model.{name}"
    fix = f'robot = robot.with_values({{"{key}": {value!r}}})'
    raise NoAttribute.of("vehicle.no-change", fix, file=vehicle_file.name, value=name)


def _attribute_key(vehicle_file: "VehicleFile", name: str) -> str:
    """Return the first key whose last name begins with `name`, or the first value of the table `name`; else ""."""
    keys = [k for k in valid_paths(vehicle_file.data, vehicle_file.folder) if not k.endswith(".kind")]
    last_names = [key for key in keys if key.rpartition(".")[2].startswith(name)]
    return next(iter([*last_names, *(key for key in keys if key.startswith(f"{name}."))]), "")


def _keys(
    data: JsonObject, path: tuple[str, ...], role: str, folder: Path | str | None
) -> list[tuple[str, ...]]:
    """Return the paths of all keys of one block's table."""
    from baqueano.vehicle_file.build import DEFAULT_KINDS

    table: Any = data
    for name in path:
        table = table.get(name, {}) if isinstance(table, dict) else {}
    kind = table.get("kind", DEFAULT_KINDS.get(role, path[-1])) if isinstance(table, dict) else None
    try:
        return _block_keys(resolve_named(role, kind, folder)) if isinstance(kind, str) else []
    except FileError:
        return _leaf_paths(table)


def _block_keys(block_class: type) -> list[tuple[str, ...]]:
    keys: list[tuple[str, ...]] = []
    for name, key in table_keys(block_class, {*DERIVED_KEYS, "vehicle", "sensors"}).items():
        is_table = is_dataclass(key.type)
        keys += [(name, *inner_path) for inner_path in _block_keys(key.type)] if is_table else [(name,)]
    return keys


def _leaf_paths(table: JsonObject) -> list[tuple[str, ...]]:
    keys: list[tuple[str, ...]] = []
    for name, value in table.items():
        keys += (
            [(name, *inner_path) for inner_path in _leaf_paths(value)]
            if isinstance(value, dict)
            else [(name,)]
        )
    return keys
