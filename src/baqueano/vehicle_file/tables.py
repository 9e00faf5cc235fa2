"""Convert tables of the file to keyword arguments of a block, with a diagnostic for everything that does not fit.

The keys of a table are the fields of the block's class. Their allowed values are defined with each field
(parameter.py), so a second list of keys does not exist. For a missing key the default of the class is used.
"""

import dataclasses
import inspect
import typing
from dataclasses import dataclass, field
from functools import cache, reduce
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, fault, nearest, note
from baqueano.errors import FileError
from baqueano.estimators.covariance import covariance
from baqueano.vehicle_file.text.toml_text import key_line
from baqueano.vehicle_file.units import wrong_unit

if typing.TYPE_CHECKING:
    from baqueano.parameter import Parameter

DERIVED_KEYS = {
    "delay_slots",
    "tick_rate_hz",
    "has_lag",
    "has_servo_lag",
    "has_back_emf",
    "has_low_pass",
    "servos",
    "commands",
}  # fields that the loader computes
NO_DEFAULT = dataclasses.MISSING
KeyPath = tuple[str, ...]


@dataclass
class ReadReport:
    """The problems and remarks that were found while a file is read."""

    name: str  # of the file, for the reader
    text: str
    problems: list[Diagnostic] = field(default_factory=list)
    notes: list[Diagnostic] = field(default_factory=list)

    def location(self, path: KeyPath) -> Diagnostic:
        """Return file, line and key: "small.toml line 12, [model] mass_kg"."""
        *table, key = path
        return self._text_location(path, f"[{'.'.join(table)}] {key}" if table else key)

    def _text_location(self, path: KeyPath, key: str) -> Diagnostic:
        line = key_line(self.text, path)
        if line is None:
            return note("vehicle.place", file=self.name, key=key)
        return note("vehicle.line", file=self.name, line=line, key=key)

    def add_problem(self, path: KeyPath, code: str, fix: str = "", **figures: Any) -> None:
        """Add a problem of a key."""
        self.problems.append(fault(code, fix, place=self.location(path), **figures))

    def add_table_problem(self, path: KeyPath, code: str, fix: str = "", **figures: Any) -> None:
        """Add a problem of a whole table, with the command to type next if there is one."""
        place = self._text_location(path, f"[{'.'.join(path)}]")
        self.problems.append(fault(code, fix, place=place, **figures))

    def add_notice(self, path: KeyPath, code: str, **figures: Any) -> None:
        """Add a remark about a key, which does not prevent the use of the file."""
        self.notes.append(note(code, Severity.WARNING, place=self.location(path), **figures))

    def raise_problems(self) -> None:
        """Raise FileError with all problems; do nothing without problems."""
        problems, self.problems = self.problems, []
        if problems:
            join = lambda rest, first: fault("vehicle.problems", first=first, rest=rest)  # noqa: E731
            raise FileError(reduce(join, reversed(problems)))


class Key(NamedTuple):
    """A key that a table can have."""

    name: str
    parameter: "Parameter | None"
    type: Any
    default: Any  # NO_DEFAULT if the block cannot be built without it


def table_keys(block_class: type, hidden_names: typing.Collection[str] = ()) -> dict[str, Key]:
    """Return the keys of a block's table, in the order of its fields."""
    if not dataclasses.is_dataclass(block_class):
        return _plain_class_keys(block_class, hidden_names)
    hints = _type_hints(block_class)
    keys = {}
    for f in dataclasses.fields(block_class):
        if f.init and f.name not in hidden_names:
            default = f.default if f.default_factory is NO_DEFAULT else f.default_factory()  # pyright: ignore
            keys[f.name] = Key(f.name, f.metadata.get("parameter"), hints.get(f.name, Any), default)
    return keys


def _plain_class_keys(block_class: type, hidden_names: typing.Collection[str]) -> dict[str, Key]:
    keys = {}
    for p in inspect.signature(block_class).parameters.values():
        if p.name not in hidden_names and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY):
            default = NO_DEFAULT if p.default is p.empty else p.default
            keys[p.name] = Key(p.name, None, Any, default)
    return keys


@cache
def _type_hints(block_class: type) -> JsonObject:
    try:
        return typing.get_type_hints(block_class)
    except NameError:  # a name that is defined only for a type checker
        return {}


def argument_names(block_class: type) -> set[str]:
    """Return the names of all arguments that a class accepts."""
    if dataclasses.is_dataclass(block_class):
        return {f.name for f in dataclasses.fields(block_class) if f.init}
    return set(inspect.signature(block_class).parameters)


def arguments(
    report: ReadReport,
    path: KeyPath,
    keys: dict[str, Key],
    table: object,
    other_keys: typing.Collection[str] = ("kind",),
) -> JsonObject:
    """Return keyword arguments from a table. A value that does not fit is omitted, and added to `report`."""
    if not isinstance(table, dict):
        report.add_problem(path, "vehicle.not-table", value=_short_text(table), table=".".join(path))
        return {}
    values = {}
    for name, value in table.items():
        if name in keys:
            result = _convert(report, (*path, name), keys[name], value)
            if result is not None:
                values[name] = result
        elif name not in other_keys:
            report_unknown_key(
                report, (*path, name), value, {k: _unit(key) for k, key in keys.items()}, other_keys
            )
    return values


def report_unknown_key(
    report: ReadReport,
    path: KeyPath,
    value: object,
    unit_by_key: dict[str, str],
    other_keys: typing.Collection[str] = (),
) -> None:
    """Add a problem for an unknown key, with a suggestion."""
    name = path[-1]
    if name in DERIVED_KEYS:
        report.add_problem(path, "vehicle.derived-key")
        return
    names = [*unit_by_key, *other_keys]
    near_unit = wrong_unit(name, value, unit_by_key)
    code = "vehicle.key-unknown" if len(path) > 1 else "vehicle.table-unknown"
    report.add_problem(path, code, value=name, suggestion=near_unit or nearest(name, names))


def missing_keys(keys: dict[str, Key], values: JsonObject) -> list[str]:
    """Return the missing keys without a default; without them the block cannot be built."""
    return [name for name, key in keys.items() if key.default is NO_DEFAULT and name not in values]


def _unit(key: Key) -> str:
    return key.parameter.unit if key.parameter else ""


def _convert(report: ReadReport, path: KeyPath, key: Key, value: object) -> Any:
    """Return the value in the type that the block requires; None after a problem was added."""
    if dataclasses.is_dataclass(key.type) and isinstance(key.type, type):
        return _nested_table(report, path, key.type, value)
    if key.parameter is not None:
        return _read_number(report, path, key, value)
    value_type = (
        key.type if key.type is not Any else type(key.default) if key.default is not NO_DEFAULT else Any
    )
    return _read_plain_value(report, path, value_type, value)


def _nested_table(report: ReadReport, path: KeyPath, block_class: type, value: object) -> Any:
    """Return the arguments of a block inside a block as a dict; the inner block is built later."""
    return arguments(report, path, table_keys(block_class, DERIVED_KEYS), value, other_keys=())


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_number(report: ReadReport, path: KeyPath, key: Key, value: object) -> Any:
    p = key.parameter
    assert p is not None
    if p.shape == ():
        if isinstance(value, bool) or not isinstance(value, int | float):
            is_quoted = isinstance(value, str) and _is_number(value)
            code = "vehicle.number-in-quotes" if is_quoted else "vehicle.not-number"
            report.add_problem(path, code, value=_short_text(value), unit_name=p.unit, meaning=p.meaning)
            return None
        number = _float_or_nan(value)
        if np.isfinite(number) and p.low <= number <= p.high:
            return number
        array = np.array(number)
    else:
        value = [value] if p.shape is None and isinstance(value, int | float) else value
        array = number_array(value)
        if array is None:
            report.add_problem(
                path,
                "vehicle.not-numbers",
                value=_short_text(value),
                size=_size(p.shape),
                unit_name=p.unit,
                meaning=p.meaning,
            )
            return None
        if p.shape is not None and array.shape != p.shape:
            commas = array.size == 2 * int(np.prod(p.shape))
            report.add_problem(
                path, "vehicle.size-with-commas" if commas else "vehicle.size", value=_size(array.shape),
                size=_size(p.shape), unit_name=p.unit, meaning=p.meaning,
            )  # fmt: skip
            return None
    if not _is_in_range(report, path, key, array):
        return None
    if key.name.endswith("_cov") and array.ndim == 2 and not _is_covariance(report, path, array):
        return None
    return float(array) if p.shape == () else array


def _is_in_range(report: ReadReport, path: KeyPath, key: Key, array: np.ndarray) -> bool:
    p = key.parameter
    assert p is not None
    may_be_infinite = _may_be_infinite(key)
    is_not_finite = ~np.isfinite(array) & ~(np.isposinf(array) & may_be_infinite)
    if np.any(is_not_finite):
        report.add_problem(
            path, "vehicle.not-finite", value=format_array(array), unit_name=p.unit, meaning=p.meaning
        )
        return False
    is_outside = (array < p.low) | (array > p.high)
    if np.any(is_outside):
        report.add_problem(
            path,
            "vehicle.out-of-range",
            value=format_array(array),
            expected=allowed_range(p),
            unit_name=p.unit,
            meaning=p.meaning,
        )
        return False
    return True


def _may_be_infinite(key: Key) -> bool:
    """Return True for a limit that is infinite by default, and for the gate of a filter."""
    if key.name == "gate_sigma":
        return True
    return isinstance(key.default, float | np.ndarray) and bool(np.any(np.isposinf(key.default)))


def _is_covariance(report: ReadReport, path: KeyPath, matrix: np.ndarray) -> bool:
    try:
        covariance(matrix, matrix.shape[0], path[-1])
    except ValueError as error:
        report.add_problem(path, "vehicle.not-covariance", error=str(error))
        return False
    return True


def _read_plain_value(report: ReadReport, path: KeyPath, value_type: object, value: object) -> Any:
    """Return the value of a field without unit: text, flag, count, list of names; None after a problem was added."""
    origin = typing.get_origin(value_type) or value_type
    if value_type is int and isinstance(value, float) and value.is_integer():
        return int(value)
    if origin in (str, bool, int) and type(value) is not origin:
        code = {str: "vehicle.not-text", bool: "vehicle.not-flag", int: "vehicle.not-whole"}[origin]
        report.add_problem(path, code, value=_short_text(value))
        return None
    if origin is float or (isinstance(value, float | int) and not isinstance(value, bool) and origin is Any):
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not np.isfinite(_float_or_nan(value))
        ):
            report.add_problem(path, "vehicle.not-one-finite", value=_short_text(value))
            return None
        return _float_or_nan(value) if origin is float or isinstance(value, float) else value
    if origin is tuple:
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            report.add_problem(path, "vehicle.not-names", value=_short_text(value))
            return None
        return tuple(value)
    array = number_array(value) if isinstance(value, list) else None
    if origin is np.ndarray and (array is None or not np.all(np.isfinite(array))):
        report.add_problem(path, "vehicle.not-list", value=_short_text(value))
        return None
    return value if array is None else array


def number_array(value: Any) -> np.ndarray | None:
    """Return nested lists of numbers with rows of equal length as an array of floats; None for any other value."""
    entries = [value]
    while any(isinstance(v, list) for v in entries):
        if not all(isinstance(v, list) for v in entries):
            return None
        entries = [x for v in entries for x in v]
    if not isinstance(value, list) or not all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in entries
    ):
        return None
    try:
        return np.array(value, dtype=float)
    except (ValueError, OverflowError):
        return None


def _float_or_nan(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def format_array(array: np.ndarray) -> str:
    """Return an array as text in the notation of the file."""
    if array.ndim == 0:
        return f"{float(array):.6g}"
    return "[" + ", ".join(format_array(row) for row in array) + "]"


def _size(shape: tuple[int, ...] | None) -> Diagnostic:
    if not shape:
        return note("vehicle.one-number" if shape == () else "vehicle.any-numbers")
    if len(shape) == 1:
        return note("vehicle.numbers", count=shape[0])
    return note("vehicle.rows", rows=shape[0], columns=shape[1])


def allowed_range(p: "Parameter") -> Diagnostic:
    """Return a message with the allowed range of a parameter."""
    if p.high == float("inf"):
        return note("vehicle.at-least", low=p.low)
    if p.low == -float("inf"):
        return note("vehicle.at-most", high=p.high)
    return note("vehicle.between", low=p.low, high=p.high)


def _short_text(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
