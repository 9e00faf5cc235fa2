"""Tables of the file → keyword arguments of a block, with a sentence for everything that does not fit.

The keys of a table are the fields of the block's class, and what is allowed stands beside each field
(parameter.py): there is no second list of keys. What the file does not say is the class's own default.
"""

import dataclasses
import inspect
import typing
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from baqueano.blocks import closest
from baqueano.errors import FileError
from baqueano.vehicle_file.text.toml_text import line_of
from baqueano.vehicle_file.units import wrong_unit

if typing.TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.parameter import Parameter

DERIVED = {"delay_slots", "has_lag", "has_low_pass", "servos", "commands"}  # fields that the loader works out
NO_DEFAULT = dataclasses.MISSING
KeyPath = tuple[str, ...]


@dataclass
class Sheet:
    """The file as far as it is read: what was found wrong so far, and what is worth saying."""

    name: str  # of the file, for the reader
    text: str
    problems: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def place(self, path: KeyPath) -> str:
        """ "small.toml line 12, [model] mass_kg"."""
        line = line_of(self.text, path)
        at = f"{self.name} line {line}," if line else f"{self.name},"
        *table, key = path
        return f"{at} [{'.'.join(table)}] {key}" if table else f"{at} {key}"

    def wrong(self, path: KeyPath, what: str) -> None:
        """One sentence more to be told of a key."""
        self.problems.append(f"{self.place(path)} {what}")

    def wrong_table(self, path: KeyPath, what: str) -> None:
        """One sentence more to be told of a whole table."""
        line = line_of(self.text, path)
        self.problems.append(f"{self.name}{f' line {line}' if line else ''}, [{'.'.join(path)}] {what}")

    def finish(self) -> None:
        """Raises if anything was wrong."""
        if self.problems:
            problems, self.problems = self.problems, []
            raise FileError("\n".join(problems))


class Key(NamedTuple):
    """What a table may hold."""

    name: str
    parameter: "Parameter | None"
    type: Any
    default: Any  # NO_DEFAULT if the block cannot be built without it


def keys_of(kind: type, hidden: typing.Collection[str] = ()) -> dict[str, Key]:
    """The keys of a block's table, in the order of its fields."""
    if not dataclasses.is_dataclass(kind):
        return _keys_of_plain_class(kind, hidden)
    hints = _hints(kind)
    keys = {}
    for f in dataclasses.fields(kind):
        if f.init and f.name not in hidden:
            default = f.default if f.default_factory is NO_DEFAULT else f.default_factory()  # pyright: ignore
            keys[f.name] = Key(f.name, f.metadata.get("parameter"), hints.get(f.name, Any), default)
    return keys


def _keys_of_plain_class(kind: type, hidden: typing.Collection[str]) -> dict[str, Key]:
    keys = {}
    for p in inspect.signature(kind).parameters.values():
        if p.name not in hidden and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY):
            default = NO_DEFAULT if p.default is p.empty else p.default
            keys[p.name] = Key(p.name, None, Any, default)
    return keys


def _hints(kind: type) -> "JsonObject":
    try:
        return typing.get_type_hints(kind)
    except NameError:  # a name that only a type checker knows
        return {}


def asks_for(kind: type) -> set[str]:
    """The names of all arguments that a class takes."""
    if dataclasses.is_dataclass(kind):
        return {f.name for f in dataclasses.fields(kind) if f.init}
    return set(inspect.signature(kind).parameters)


def arguments(
    sheet: Sheet, path: KeyPath, keys: dict[str, Key], table: object, also: typing.Collection[str] = ("kind",)
) -> "JsonObject":
    """Keyword arguments from a table; what does not fit is noted in `sheet` and left out."""
    if not isinstance(table, dict):
        sheet.wrong(
            path, f"= {_shown(table)}: expected a table. Write [{'.'.join(path)}] on a line of its own."
        )
        return {}
    values = {}
    for name, value in table.items():
        if name in keys:
            found = _converted(sheet, (*path, name), keys[name], value)
            if found is not None:
                values[name] = found
        elif name not in also:
            unknown(sheet, (*path, name), value, {k: _unit(key) for k, key in keys.items()}, also)
    return values


def unknown(
    sheet: Sheet, path: KeyPath, value: object, known: dict[str, str], also: typing.Collection[str] = ()
) -> None:
    """Notes a key that nobody reads, with what was probably meant."""
    name = path[-1]
    if name in DERIVED:
        sheet.wrong(path, "is worked out by itself from the other keys. Delete the line.")
        return
    names = [*known, *also]
    other = wrong_unit(name, value, known)
    hint = other or closest(name, names) or f" The keys here are {', '.join(names)}."
    what = "a key of this table" if len(path) > 1 else "a key or table of a vehicle file"
    sheet.wrong(path, f"is not {what}.{hint}")


def missing(keys: dict[str, Key], values: "JsonObject") -> list[str]:
    """Keys without which the block cannot be built."""
    return [name for name, key in keys.items() if key.default is NO_DEFAULT and name not in values]


def _unit(key: Key) -> str:
    return key.parameter.unit if key.parameter else ""


def _converted(sheet: Sheet, path: KeyPath, key: Key, value: object) -> Any:
    """The value as the block wants it; None after a complaint."""
    if dataclasses.is_dataclass(key.type) and isinstance(key.type, type):
        return _nested(sheet, path, key.type, value)
    if key.parameter is not None:
        return _number(sheet, path, key, value)
    kind = key.type if key.type is not Any else type(key.default) if key.default is not NO_DEFAULT else Any
    return _plain(sheet, path, kind, value)


def _nested(sheet: Sheet, path: KeyPath, kind: type, value: object) -> Any:
    """The arguments of a block within the block: a dict, built later."""
    return arguments(sheet, path, keys_of(kind, DERIVED), value, also=())


def _number(sheet: Sheet, path: KeyPath, key: Key, value: object) -> Any:
    p = key.parameter
    assert p is not None
    if p.shape == ():
        if isinstance(value, bool) or not isinstance(value, int | float):
            quotes = " Take the quotes away." if isinstance(value, str) else ""
            sheet.wrong(path, f"= {_shown(value)}: expected one number [{p.unit}], {p.meaning}.{quotes}")
            return None
        array = np.array(_float(value))
    else:
        value = [value] if p.shape is None and isinstance(value, int | float) else value
        array = number_array(value)
        if array is None:
            sheet.wrong(path, f"= {_shown(value)}: expected {_words(p.shape)} [{p.unit}], {p.meaning}.")
            return None
        if p.shape is not None and array.shape != p.shape:
            commas = " Decimal commas? Write points." if array.size == 2 * int(np.prod(p.shape)) else ""
            sheet.wrong(
                path,
                f"has {_words(array.shape)}: expected {_words(p.shape)} [{p.unit}], {p.meaning}.{commas}",
            )
            return None
    if not _in_range(sheet, path, key, array):
        return None
    if key.name.endswith("_cov") and array.ndim == 2 and not _covariance(sheet, path, array):
        return None
    return float(array) if p.shape == () else array


def _in_range(sheet: Sheet, path: KeyPath, key: Key, array: np.ndarray) -> bool:
    p = key.parameter
    assert p is not None
    endless = _may_be_infinite(key)
    bad = ~np.isfinite(array) & ~(np.isposinf(array) & endless)
    if np.any(bad):
        sheet.wrong(path, f"= {listed(array)}: expected finite numbers [{p.unit}], {p.meaning}.")
        return False
    outside = (array < p.low) | (array > p.high)
    if np.any(outside):
        sheet.wrong(path, f"= {listed(array)}: expected {range_words(p)} [{p.unit}], {p.meaning}.")
        return False
    return True


def _may_be_infinite(key: Key) -> bool:
    """A limit that is infinite by default may be infinite in the file; so may the gate of a filter."""
    if key.name == "gate_sigma":
        return True
    return isinstance(key.default, float | np.ndarray) and bool(np.any(np.isposinf(key.default)))


def _covariance(sheet: Sheet, path: KeyPath, matrix: np.ndarray) -> bool:
    from baqueano.estimators.covariance import covariance

    try:
        covariance(matrix, matrix.shape[0], path[-1])
    except ValueError as error:
        sheet.wrong(path, str(error).removeprefix(path[-1]).strip())
        return False
    return True


def _plain(sheet: Sheet, path: KeyPath, kind: object, value: object) -> Any:
    """A field without unit: text, flag, count, list of names."""
    origin = typing.get_origin(kind) or kind
    if kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if origin in (str, bool, int) and type(value) is not origin:
        words = {str: 'text in quotes, "…"', bool: "true or false", int: "a whole number"}[origin]
        sheet.wrong(path, f"= {_shown(value)}: expected {words}.")
        return None
    if origin is float or (isinstance(value, float | int) and not isinstance(value, bool) and origin is Any):
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(_float(value)):
            sheet.wrong(path, f"= {_shown(value)}: expected one finite number.")
            return None
        return _float(value) if origin is float or isinstance(value, float) else value
    if origin is tuple:
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            sheet.wrong(path, f'= {_shown(value)}: expected a list of names, ["…", "…"].')
            return None
        return tuple(value)
    array = number_array(value) if isinstance(value, list) else None
    if origin is np.ndarray and (array is None or not np.all(np.isfinite(array))):
        sheet.wrong(path, f"= {_shown(value)}: expected a list of finite numbers.")
        return None
    return value if array is None else array


def number_array(value: Any) -> np.ndarray | None:
    """Nested lists of numbers, all rows alike, as an array of floats; None for anything else."""
    flat = [value]
    while any(isinstance(v, list) for v in flat):
        if not all(isinstance(v, list) for v in flat):
            return None
        flat = [x for v in flat for x in v]
    if not isinstance(value, list) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in flat
    ):
        return None
    try:
        return np.array(value, dtype=float)
    except (ValueError, OverflowError):
        return None


def _float(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def listed(array: np.ndarray) -> str:
    """Numbers as they would stand in the file."""
    if array.ndim == 0:
        return f"{float(array):.6g}"
    return "[" + ", ".join(listed(row) for row in array) + "]"


def _words(shape: tuple[int, ...] | None) -> str:
    if shape is None:
        return "a list of numbers"
    if shape == ():
        return "one number"
    return f"{shape[0]} numbers" if len(shape) == 1 else f"{shape[0]} rows of {shape[1]} numbers"


def range_words(p: "Parameter") -> str:
    """The allowed values of a parameter."""
    if p.high == float("inf"):
        return f"at least {p.low:g}"
    return f"at most {p.high:g}" if p.low == -float("inf") else f"{p.low:g} to {p.high:g}"


def _shown(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."
