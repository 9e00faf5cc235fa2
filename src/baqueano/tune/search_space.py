"""The gains that a search varies: names, units and bounds, from the metadata of the controller's fields.

Each entry of an array is one gain: "e_max[0]". If a class lacks this metadata, each number that it receives is a gain
without unit, which keeps its sign. Bounds of the field are hard. A field without an upper bound has a
soft bound: the gain that requests the full command for the smallest error, or DEFAULT_SPREAD times its present value.
If a gain ends on a soft bound, the search is repeated with a wider bound.
"""

import inspect
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.blocks import kinds, resolve
from baqueano.contracts import optional
from baqueano.contracts.blocks import Controller, OwnBlock
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import nearest
from baqueano.errors import BaqueanoError, UsageError
from baqueano.parameter import Parameter, parameters
from baqueano.symbolic import value_at_path, with_value
from baqueano.tune.search import gains as gains_at

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

PAPER_GAINS = ("alpha", "beta", "gamma")
# smallest error for which the full command can be requested
MIN_GAIN_SCALES = {"m": 0.005, "rad": 0.01, "rad/s": 0.05, "m/s": 0.02}
FILLED_ARGUMENTS = {"vehicle", "sensors", "rate_hz", "limit"}  # the vehicle file fills them
DEFAULT_SPREAD = 20.0  # factor in both directions for a quantity that is not a gain, without bounds
WIDENING_FACTOR = 4.0  # factor on a soft bound, before a search is repeated


class SearchSpace(NamedTuple):
    """The gains that a search varies, with their bounds."""

    names: tuple[str, ...]  # "k_x", "e_max[0]"
    units: tuple[str, ...]
    low: np.ndarray  # (p,)
    high: np.ndarray  # (p,)
    hard_low: np.ndarray  # (p,) hard bounds, which a search never exceeds
    hard_high: np.ndarray
    file_gains: np.ndarray  # (p,) values in the file, NaN for a gain that it lacks
    block: Controller  # the controller with allowed values of the gains

    @property
    def initial_gains(self) -> JsonObject:
        """Return an allowed value of each gain, by name."""
        return {name: float(np.asarray(value_at_path(self.block, name))) for name in self.names}

    @property
    def middle(self) -> np.ndarray:
        """Return the middle of the range of each gain, in the coordinates of the search: (p,)."""
        return gains_at(np.full(len(self.low), 0.5), self.low, self.high)

    def widen(self, ends: np.ndarray) -> "SearchSpace":
        """Return the space with a wider soft bound for each entry of `ends` (p,) that is −1 (lower bound) or +1 (upper
        bound). Hard bounds are not exceeded.
        """
        high = np.where(ends > 0, np.minimum(WIDENING_FACTOR * self.high, self.hard_high), self.high)
        low = np.where(ends < 0, np.maximum(self.low / WIDENING_FACTOR, self.hard_low), self.low)
        return self._replace(low=low, high=high)

    def with_gains(self, gains: np.ndarray) -> Controller:
        """Return the controller with the gains (p,), in the order of `names`."""
        return with_gains(self.block, self.names, gains)


def with_gains(block: Controller, names: Iterable[str], gains: Iterable[float]) -> Controller:
    """Return a copy of the controller with these `gains` in the fields `names`."""
    for name, value in zip(names, gains, strict=True):
        block = with_value(block, name, float(value))
    return block


def file_values(block: Controller, names: Iterable[str], controller: OwnBlock | None = None) -> JsonObject:
    """Return the keys of a vehicle file and their values for the gains of a block; with `controller`, also the kind
    of the controller.

    Raise UsageError for a class that is not defined in a file.
    """
    fields = dict.fromkeys(name.partition("[")[0] for name in names)
    values: JsonObject = {f"controller.{field}": getattr(block, field) for field in fields}
    return values if controller is None else {"controller.kind": _controller_kind(controller)} | values


def _controller_kind(controller: OwnBlock) -> str:
    """Return the short name of a controller of this package, or "file.py:Class".

    Raise UsageError for a class without a file.
    """
    if isinstance(controller, str):
        return controller
    controller_class = controller if isinstance(controller, type) else type(controller)
    names = [name for name in kinds("controller") if resolve("controller", name) is controller_class]
    if names:
        return names[0]
    path = getattr(sys.modules.get(controller_class.__module__), "__file__", None)
    if path is None:
        raise UsageError.of("tune.of-a-cell", controller=controller_class.__name__)
    return f"{path}:{controller_class.__qualname__}"


def search_space(
    vehicle_file: "VehicleFile", gains: Sequence[str] | None = None,
    bounds: dict[str, tuple[float, float]] | None = None, controller: OwnBlock | None = None,
) -> SearchSpace:  # fmt: skip
    """Return the gains, their bounds and values in the file; `controller` replaces the controller of the file.
    Raise UsageError for an unknown gain, wrong bounds, or a controller without gains or without a compiled step.
    """
    bounds = bounds or {}
    block, complete_gains = _find_controller(vehicle_file, gains, controller)
    if optional.attribute(block, "is_interpreted"):
        raise UsageError.of("tune.as-written", controller=type(block).__name__)
    entries = _entries(block)
    names = _gain_names(type(block).__name__, entries, gains, bounds)
    bounds = {e: bounds[name] for name in bounds for e in _entry_names(name, entries)}
    limit = vehicle_file.command.limit
    full_command = float(np.max(limit[np.isfinite(limit)], initial=0.0)) or 1.0
    file_gains = np.array(
        [float(np.asarray(value_at_path(block, n))) if complete_gains else float("nan") for n in names]
    )
    gain_bounds = [
        _bounds(entries[n], full_command, file_gain, bounds.get(n))
        for n, file_gain in zip(names, file_gains, strict=True)
    ]
    low, high, hard_low, hard_high = np.array(gain_bounds, dtype=float).T
    for name, l, h in zip(names, low, high, strict=True):
        if not (np.isfinite(l) and np.isfinite(h) and l < h):
            raise UsageError.of("tune.bounds", name=name, low=l, high=h)
    initial_gains = np.where(np.isfinite(file_gains), file_gains, 0.5 * (low + high))
    units = tuple(entries[name].unit for name in names)
    block = with_gains(block, names, initial_gains)
    return SearchSpace(names, units, low, high, hard_low, hard_high, file_gains, block)


def _gain_names(
    kind: str, entries: dict[str, Parameter], gains: Sequence[str] | None, bounds: Iterable[str]
) -> tuple[str, ...]:
    """Return the names of the gains to search: those of `gains`, or all. Raise UsageError for an unknown name in
    `gains` or `bounds`, or without a gain.
    """
    fields, selection = {name.partition("[")[0] for name in entries}, entries if gains is None else gains
    for name in [*selection, *bounds]:
        if name not in entries and name not in fields:
            figures = {"kind": kind, "value": name, "suggestion": nearest(name, entries)}
            raise UsageError.of("tune.no-such-gain", **figures)
    if names := tuple(dict.fromkeys(e for name in selection for e in _entry_names(name, entries))):
        return names
    raise UsageError.of("tune.no-gains", kind=kind)


def _find_controller(
    vehicle_file: "VehicleFile", gains: Sequence[str] | None, controller: OwnBlock | None
) -> tuple[Controller, bool]:
    """Return the controller, and True if the file contains its gains; False if the search must find all gains."""
    try:
        return vehicle_file.controller(controller), True
    except BaqueanoError:
        placeholders: JsonObject = dict.fromkeys(PAPER_GAINS if gains is None else tuple(gains), 1.0)
        return vehicle_file.controller(controller, **placeholders), False


def _entries(block: Any) -> dict[str, Parameter]:
    """Return a parameter for each finite number in the fields of a block, by name: "k_x", "e_max[0]"."""
    parameters_by_name = {}
    described_gains = {name: p for name, p in parameters(block) if p.shape is not None}
    for name, p in (described_gains or _plain_gains(block)).items():
        units = p.unit.split(", ")
        values = np.asarray(getattr(block, name), dtype=float)
        for k, index in enumerate(np.ndindex(p.shape or ())):
            if np.isfinite(values[index]):
                unit = units[k] if len(units) == values.size else p.unit
                mark = f"[{','.join(map(str, index))}]" if index else ""
                parameters_by_name[name + mark] = p._replace(unit=unit, shape=())
    return parameters_by_name


def _plain_gains(block: Any) -> dict[str, Parameter]:
    """Return a parameter without unit and bounds for each number that a class of the user receives, by name."""
    values = {name: getattr(block, name, None) for name in inspect.signature(type(block)).parameters}
    return {
        name: Parameter("", -np.inf, np.inf, name, np.shape(value))
        for name, value in values.items()
        if name not in FILLED_ARGUMENTS
        and isinstance(value, int | float | np.ndarray)
        and not isinstance(value, bool)
    }


def _entry_names(name: str, entries: dict[str, Parameter]) -> list[str]:
    """Return the names of the entries of a field: one for a number, or all entries of an array."""
    return [name] if name in entries else [e for e in entries if e.partition("[")[0] == name]


def _bounds(
    p: Parameter, full_command: float, file_gain: float, bounds: tuple[float, float] | None
) -> tuple[float, float, float, float]:
    """Return the first bounds (low, high) and the hard bounds (low, high): from `bounds`, else from the field."""
    if bounds is not None:
        return *bounds, *bounds
    if not p.unit and file_gain < 0.0:  # its sign is kept
        low, high = DEFAULT_SPREAD * file_gain, file_gain / DEFAULT_SPREAD
        return low, high, low, high
    low, high = p.low if np.isfinite(p.low) else 0.0, p.high
    if np.isfinite(high):
        return low, high, low, high
    if " per " not in p.unit and file_gain > 0.0:  # for example a length, which is not a gain
        return max(low, file_gain / DEFAULT_SPREAD), DEFAULT_SPREAD * file_gain, low, high
    return low, full_command / MIN_GAIN_SCALES.get(p.unit.rpartition(" per ")[2], 0.01), low, high
