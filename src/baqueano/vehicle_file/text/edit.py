"""Edit values in the text of a vehicle file; the rest of the text is unchanged.

So the difference of two files shows only the changes of the vehicle, such as wear. A file is written completely or not
at all.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from datetime import date
from math import floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.blocks import LOOP_ROLES, block_kind, check_role
from baqueano.contracts.values import JsonObject
from baqueano.errors import FileError, UsageError
from baqueano.vehicle_file.paths import current_value, no_such_key, split_key, valid_paths
from baqueano.vehicle_file.provenance import ParameterCov, Provenance
from baqueano.vehicle_file.text.dump import dump
from baqueano.vehicle_file.text.toml_text import read_text

if TYPE_CHECKING:
    from baqueano.vehicle_file.envelope import Envelope
    from baqueano.vehicle_file.file import VehicleFile

RANGE_DIGITS = 4  # digits of an end of the envelope
KIND_KEY = re.compile(rf"(model|sensors\.[^.]+|{'|'.join(LOOP_ROLES)})\.kind")
STD_DIGITS = 3  # digits of a standard deviation; a value is rounded to a thousandth of its standard deviation


def text_with_equipment(truth: "VehicleFile", vehicle_file: "VehicleFile") -> str:
    """Return the text of `truth` with the IMU filter of `vehicle_file`, and with the sensors that only it describes.
    A block of the user keeps its file."""
    setting = vehicle_file.data.get("robot", {}).get("imu_filter")
    values: JsonObject = {} if setting is None else {"robot.imu_filter": setting}
    for name in vehicle_file.sensors._fields:
        if name not in truth.sensors._fields:
            table = {"kind": name} | vehicle_file.data["sensors"][name]
            if ".py:" in table["kind"]:
                table["kind"] = str(Path(vehicle_file.folder or ".") / table["kind"])
            values |= {f"sensors.{name}.{key}": value for key, value in table.items()}
    return text_with_values(truth, values) if values else truth.text


def text_with_values(vehicle_file: "VehicleFile", values: JsonObject) -> str:
    """Return the text with other values, and with its comments if tomlkit is installed."""
    return _edit_text(vehicle_file, values, keep_comments=_has_tomlkit())


def edit_text(
    vehicle_file: "VehicleFile",
    values: JsonObject,
    provenance: Mapping[str, Any],
    parameter_cov: ParameterCov | None,
    envelope: "Envelope | None" = None,
) -> str:
    """Return the text of `vehicle_file` with other values, their provenance, and the covariance and envelope of a fit.
    Raise UsageError for an unknown key, or without tomlkit.
    """
    if not _has_tomlkit():
        raise UsageError.of("vehicle.no-tomlkit", "pip install tomlkit")
    for key in [k for k in values if KIND_KEY.fullmatch(k) and isinstance(values[k], type)]:
        check_role(key.split(".")[0].removesuffix("s"), values[key])
        values = {**values, key: block_kind(values[key])}
    origins = {key: p if isinstance(p, Provenance) else Provenance(**p) for key, p in provenance.items()}
    rounded_values = {k: _round(v, origins[k].std if k in origins else None) for k, v in values.items()}
    paths = valid_paths(_set_kinds(vehicle_file.data, values), vehicle_file.folder)
    for key in origins:
        if ".".join(split_key(key)[0]) not in paths:
            raise no_such_key(vehicle_file.name, key, paths)
    return _edit_text(
        vehicle_file,
        rounded_values,
        keep_comments=True,
        origins=origins,
        parameter_cov=parameter_cov,
        envelope=envelope,
    )


def write_file_text(vehicle_file: "VehicleFile", path: str | Path | None = None) -> Path:
    """Write the text to a new file, which then replaces the old file; return the path.
    After an interruption the old file is unchanged. Raise FileError if another program changed the old file, or if the
    new file cannot be written. Raise UsageError for a file of the garage without `path`.
    """
    target = Path(path).expanduser() if path is not None else vehicle_file.path
    if target is None:
        raise UsageError.of("vehicle.of-garage", name=vehicle_file.name)
    target = target.resolve()  # a link stays a link
    if (
        target == vehicle_file.path
        and vehicle_file.on_disk is not None
        and target.exists()
        and read_text(target) != vehicle_file.on_disk
    ):
        raise FileError.of("vehicle.changed-since", file=target.name)
    try:
        target.parent.stat()  # a folder that does not exist is reported and not made
        replace_file(target, vehicle_file.text)
    except OSError as error:
        raise FileError.of("vehicle.not-written", path=target, error=error.strerror or error) from error
    return target


def _has_tomlkit() -> bool:
    try:
        import tomlkit  # noqa: F401
    except ImportError:
        return False
    return True


def _edit_text(
    vehicle_file: "VehicleFile",
    values: Mapping[str, object],
    keep_comments: bool,
    origins: Mapping[str, Provenance] | None = None,
    parameter_cov: ParameterCov | None = None,
    envelope: "Envelope | None" = None,
) -> str:
    """Return the text with the new values: edited by tomlkit with its comments, or written again without comments.
    Raise UsageError for an unknown key.
    """
    paths = valid_paths(_set_kinds(vehicle_file.data, values), vehicle_file.folder)
    if keep_comments:
        import tomlkit

        document: Any = tomlkit.parse(vehicle_file.text)
    else:
        document = tomllib.loads(vehicle_file.text)
    new_values: dict[tuple[str, ...], Any] = {}
    for dotted_key, value in values.items():
        path, entry = split_key(dotted_key)
        if ".".join(path) not in paths:
            raise no_such_key(vehicle_file.name, dotted_key, paths)
        new_values[path] = (
            _replace_entry(vehicle_file, path, new_values.get(path), entry, value) if entry else value
        )
    for path, value in new_values.items():
        _set_value(document, path, value)
        _delete_origin(document, ".".join(path))
    _drop_unknown(document, [split_key(key)[0] for key in values], paths)
    for dotted_key, origin in (origins or {}).items():
        _set_value(document, ("provenance", dotted_key), _origin_table(origin))
    if parameter_cov is not None:
        _set_value(document, ("parameter_cov",), _cov_table(parameter_cov))
    if envelope is not None:
        low, high = (_digits(side, RANGE_DIGITS) for side in (envelope.low, envelope.high))
        table = envelope._replace(names=list(envelope.names), low=low, high=high)._asdict()
        _set_value(document, ("envelope",), _plain_value(table))
    return dump(document)


def _set_kinds(data: JsonObject, values: Mapping[str, object]) -> JsonObject:
    """Return the tables in which roles and sensors have the kinds that `values` contain; a new sensor has a table."""
    data = {**data, "sensors": {**data.get("sensors", {})}}
    for key in filter(KIND_KEY.fullmatch, values):
        *group, name, _kind = key.split(".")
        tables = data["sensors"] if group else data
        tables[name] = {**tables.get(name, {}), "kind": values[key]}
    return data


def _drop_unknown(document: Any, changed_paths: Iterable[tuple[str, ...]], paths: list[str]) -> None:
    """Delete the keys that the block of a new kind does not have, and their provenance."""
    for path in changed_paths:
        if KIND_KEY.fullmatch(".".join(path)):
            table = document
            for name in path[:-1]:
                table = table[name]
            _drop_unknown_keys(document, table, ".".join(path[:-1]), paths)


def _drop_unknown_keys(document: Any, table: Any, name: str, paths: list[str]) -> None:
    for key in [*table]:
        dotted_key = f"{name}.{key}"
        if any(path.startswith(f"{dotted_key}.") for path in paths):
            _drop_unknown_keys(document, table[key], dotted_key, paths)
        elif dotted_key not in paths:
            del table[key]
            _delete_origin(document, dotted_key)


def _replace_entry(
    vehicle_file: "VehicleFile",
    path: tuple[str, ...],
    array_value: object,
    entry: tuple[int, ...],
    value: object,
) -> np.ndarray:
    """Return the whole array of a key with one entry replaced. Raise UsageError if the array lacks this entry."""
    array = np.array(
        current_value(vehicle_file, ".".join(path)) if array_value is None else array_value, dtype=float
    )
    if len(entry) != array.ndim or any(i >= n for i, n in zip(entry, array.shape, strict=True)):
        raise UsageError.of(
            "vehicle.no-entry", key=".".join(path), shape=str(array.shape), entry=str(list(entry))
        )
    array[entry] = value
    return array


def _set_value(document: Any, path: tuple[str, ...], value: Any) -> None:
    """Set one key, and create missing tables."""
    table = document
    for part in path[:-1]:
        if part not in table:
            table[part] = {}
        table = table[part]
    value = _plain_value(value)
    old_value = table.get(path[-1])
    if isinstance(old_value, list) and isinstance(value, list) and _have_same_shape(old_value, value):
        _put_entries(old_value, value)  # line breaks and comments of the rows stay
    elif isinstance(old_value, dict) and isinstance(value, dict):
        for name in [n for n in old_value if n not in value]:
            del old_value[name]
        for name, subtable in value.items():
            old_value[name] = subtable
    elif _plain_value(old_value) != value or old_value is None:
        table[path[-1]] = value


def _put_entries(old_rows: list[Any], new_rows: list[Any]) -> None:
    for i, value in enumerate(new_rows):
        if isinstance(value, list):
            _put_entries(old_rows[i], value)
        elif old_rows[i] != value:
            old_rows[i] = value


def _delete_origin(document: Any, dotted_key: str) -> None:
    """Delete the provenance of a value that is replaced."""
    origins = document.get("provenance", {})
    for key in [k for k in origins if ".".join(split_key(k)[0]) == dotted_key]:
        del origins[key]
    if "provenance" in document and not origins:
        del document["provenance"]


def _have_same_shape(old_value: Any, new_value: Any) -> bool:
    if isinstance(old_value, list) != isinstance(new_value, list):
        return False
    return not isinstance(new_value, list) or (
        len(old_value) == len(new_value)
        and all(_have_same_shape(a, b) for a, b in zip(old_value, new_value, strict=True))
    )


def _plain_value(value: object) -> Any:
    """Return a value as Python numbers and lists, as TOML requires."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {k: _plain_value(v) for k, v in value.items()}
    return [_plain_value(v) for v in value] if isinstance(value, list | tuple) else value


def _origin_table(origin: Provenance) -> JsonObject:
    table: JsonObject = {"run": origin.run, "date": origin.date or date.today()}
    if origin.std is not None:
        table["std"] = _plain_value(_digits(np.asarray(origin.std, dtype=float), STD_DIGITS))
    return table | ({"verdict": origin.verdict} if origin.verdict else {})


def _cov_table(p: ParameterCov) -> JsonObject:
    std = np.sqrt(np.diag(p.cov))
    r = p.cov / np.where(std > 0.0, std, 1.0)[:, None] / np.where(std > 0.0, std, 1.0)[None, :]
    r = np.clip(np.round(r, 8), -1.0, 1.0)
    rows = [[*map(float, r[i, :i]), 1.0] for i in range(len(std))]
    std_list = [float(f"{s:.10g}") for s in std]
    return {
        "run": p.run,
        "date": p.date or date.today(),
        "names": list(p.names),
        "std": std_list,
        "correlation": rows,
    }


def _round(value: Any, std: Any) -> Any:
    """Return values rounded to about a thousandth of their standard deviation, unchanged if this is unknown."""
    if std is None or isinstance(value, str | bool):
        return value
    array = np.asarray(value, dtype=float)
    std = np.broadcast_to(np.asarray(std, dtype=float), np.shape(value))
    rounded_values = [
        round(float(v), STD_DIGITS - floor(log10(s))) if isfinite(s) and s > 0.0 else float(v)
        for v, s in zip(array.ravel(), std.ravel(), strict=True)
    ]
    return np.array(rounded_values).reshape(array.shape)


def _digits(array: np.ndarray, digits: int) -> np.ndarray:
    return np.array([float(f"{v:.{digits}g}") for v in array.ravel()]).reshape(array.shape)
