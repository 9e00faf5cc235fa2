"""Check one block: repeat some of its calls with the same arguments, and compare the results.

Pure: the arguments and the block itself do not change. Deterministic: two equal calls give the same results, bit for
bit. Faults are stored as diagnostics, each of them once.
"""

import copy
import dataclasses
import io
import traceback
import warnings
from collections import deque
from collections.abc import Coroutine, Generator
from contextlib import redirect_stdout, suppress
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np

from baqueano.block_checks.source import method_place, outside_accesses
from baqueano.contracts.blocks import STEP_INPUTS
from baqueano.contracts.time_limit import HANG_S, within
from baqueano.contracts.values import array_text
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import GENERATED_CODE, error_text, is_interruption

MAX_REPORTED = 12  # diagnostics that are reported at most
START_NOTE = note("when.start")
INCOMPLETE_CODES = ("check.no-method", "check.no-attribute", "check.no-commands", "check.no-drivetrain")


class CheckAborted(Exception):
    """Exception that ends the check, because the block raised an exception or returned an unusable result."""


class Trial:
    """A block and the faults that were found in it."""

    def __init__(self, block: object, method_names: tuple[str, ...] = ("init", "step")) -> None:
        self.block = block
        self.block_class = type(block)
        self.faults = dict.fromkeys(outside_accesses(self.block_class))
        self._fault_keys: set[tuple[str, ...]] = set()
        self._frozen_fields = _freeze(_fields(block))
        self._calls_of: dict[tuple[str, Diagnostic], int] = {}
        if not _is_frozen_dataclass(self.block_class):
            self.add_fault("check.not-frozen", severity=Severity.WARNING)
        for method_name in method_names:
            if not callable(getattr(block, method_name, None)):
                self.add_fault("check.no-method", name=method_name)

    @property
    def is_incomplete(self) -> bool:
        """Return True if the block lacks a method or an attribute that the check needs."""
        return any(fault_.code in INCOMPLETE_CODES for fault_ in self.faults)

    @property
    def is_deterministic(self) -> bool:
        """Return False if two equal calls gave different results: then no other comparison of results is valid."""
        return all(fault_.code != "check.not-deterministic" for fault_ in self.faults)

    def add_fault(
        self, code: str, method_name: str = "", severity: Severity = Severity.ERROR, **figures: Any
    ) -> None:
        """Store a diagnostic for the author, with its place in the code; the same fault at a later tick only once."""
        key = code, method_name, *(str(figures.get(name, "")) for name in ("field", "signal", "name"))
        if key in self._fault_keys:
            return
        self._fault_keys.add(key)
        place_text = method_place(self.block_class, method_name)
        name = f"{self.block_class.__name__}.{method_name}()" if method_name else self.block_class.__name__
        self.faults[note(code, severity, subject=name, place=place_text, **figures)] = None

    def checked_call(self, method_name: str, context: Diagnostic, *arguments: object) -> Any:
        """Return the result of a call. Store a fault if it changes its arguments. Repeat some calls, and store faults
        if their results differ or the block changed.

        Raise CheckAborted if the block raises an exception.
        """
        frozen_arguments = _freeze(arguments)
        first = self._call(method_name, context, arguments)
        if _freeze(arguments) != frozen_arguments:
            self.add_fault("check.changes-arguments", method_name, situation=context)
        if not self._is_call_repeated(method_name, context):
            return first
        if _freeze(first) != _freeze(self._call(method_name, context, copy.deepcopy(arguments))):
            self.add_fault("check.not-deterministic", method_name, situation=context)
        if (frozen_fields := _freeze(_fields(self.block))) != self._frozen_fields:
            self.add_fault("check.block-changed", method_name, situation=context)
            self._frozen_fields = frozen_fields
        return first

    def _is_call_repeated(self, method_name: str, context: Diagnostic) -> bool:
        """Return True if a call is to be repeated: the first five calls of a kind, then every tenth."""
        count = self._calls_of[method_name, context] = self._calls_of.get((method_name, context), 0) + 1
        return count <= 5 or count % 10 == 0

    def step(self, context: Diagnostic, *arguments: object) -> tuple[Any, Any]:
        """Return (state, output) of a step. Raise CheckAborted for another result."""
        result = self.checked_call("step", context, *arguments)
        is_record = type(result) is not tuple  # a Command is also a tuple of two
        if not (isinstance(result, tuple) and len(result) == 2) or is_record:
            if type(result) is tuple:
                self.add_fault("check.values", "step", count=len(result), situation=context)
            elif result is None:
                self.add_fault("check.no-return", "step", situation=context)
            else:
                self.add_fault("check.two-values", "step", value=type(result).__name__, situation=context)
            raise CheckAborted
        return result

    def expect_record(self, value: object, kind: type, expected: str) -> None:
        """Raise CheckAborted if an output of a step is not of a class; `expected` is the correct result."""
        if not isinstance(value, kind):
            value_class = type(value).__name__
            self.add_fault("check.returns", "step", value=value_class, expected=expected)
            role = {"Estimate": "estimator", "Reference": "guide", "Command": "controller"}.get(
                value_class, ""
            )
            if role:
                self.add_fault("check.returns-of", "step", role=role, expected=", ".join(STEP_INPUTS[role]))
            raise CheckAborted

    def expect(
        self,
        quantity: str,
        value: object,
        shape: tuple[int, ...],
        context: Diagnostic,
        method_name: str = "step",
    ) -> np.ndarray:
        """Return the value as a finite array of this shape. Raise CheckAborted for another value."""
        try:
            array = np.asarray(value)
            shown_value = array_text(array) if array.dtype.kind == "c" else type(value).__name__
            is_number = value is not None and array.dtype.kind in "biufO"
            array = array.astype(float) if is_number else None
        except (TypeError, ValueError, OverflowError):
            array, shown_value = None, type(value).__name__
        if array is None:
            self.add_fault(
                "check.no-numbers", method_name, field=quantity, value=shown_value, shape=str(shape)
            )
            raise CheckAborted
        if array.shape != shape:
            self.add_fault(
                "check.shape", method_name, field=quantity, value=str(array.shape), shape=str(shape)
            )
            raise CheckAborted
        if not np.all(np.isfinite(array)):
            self.add_fault(
                "check.not-finite", method_name, field=quantity, value=array_text(array), situation=context
            )
            raise CheckAborted
        return array

    def check_stamp(self, output: object, t_ns: int, quantity: str, context: Diagnostic) -> None:
        """Check that the output has the timestamp of its input."""
        stamp = np.asarray(getattr(output, "t_ns", None))
        is_number = not stamp.shape and stamp.dtype.kind in "iuf"
        if not is_number or stamp != t_ns:
            shown_stamp = stamp.item() if is_number else str(stamp.tolist())
            figures = {"value": shown_stamp, "signal": quantity, "t_ns": t_ns, "situation": context}
            self.add_fault("check.stamp", "step", **figures)

    def check_wrapped(self, quantity: str, psi: float, context: Diagnostic) -> None:
        """Check that an angle in an output is within [−π, π]."""
        if abs(psi) > np.pi + 1e-9:
            self.add_fault("check.not-wrapped", "step", field=quantity, psi_rad=psi, situation=context)

    def expect_covariance(
        self, quantity: str, value: object, size: int, context: Diagnostic, method_name: str = "step"
    ) -> np.ndarray:
        """Return a covariance (size, size), and check that it is symmetric and without a negative eigenvalue."""
        P = self.expect(quantity, value, (size, size), context, method_name)
        scale = np.max(np.abs(P), initial=0.0)
        if np.max(np.abs(P - P.T), initial=0.0) > 1e-9 * scale:
            self.add_fault("check.not-symmetric", method_name, field=quantity, situation=context)
        elif np.linalg.eigvalsh(P)[0] < -1e-9 * scale:
            self.add_fault(
                "check.eigenvalue",
                method_name,
                field=quantity,
                smallest=np.linalg.eigvalsh(P)[0],
                situation=context,
            )
        return P

    def reported_faults(self) -> list[Diagnostic]:
        """Return the faults, at most MAX_REPORTED."""
        return list(self.faults)[:MAX_REPORTED]

    def _call(self, method_name: str, context: Diagnostic, arguments: tuple[Any, ...]) -> Any:
        if self.is_incomplete and not callable(getattr(self.block, method_name, None)):
            raise CheckAborted  # the fault is stored
        try:  # what the block prints is dropped: a fault names the line
            with warnings.catch_warnings(), np.errstate(all="ignore"), redirect_stdout(io.StringIO()):
                warnings.simplefilter("ignore")
                result = within(HANG_S, getattr(self.block, method_name), *arguments)
        except BaseException as error:
            if is_interruption(error):
                raise
            line = _line(self.block_class, error)
            named_method = method_name if hasattr(self.block_class, method_name) else ""
            figures = {"error": error_text(error), "situation": context}
            if line and isinstance(error, dataclasses.FrozenInstanceError):
                self.add_fault("check.assigns-field", named_method, line=line, **figures)
            elif line:
                self.add_fault("check.raises-on-line", named_method, line=line, **figures)
            else:
                self.add_fault("check.raises", named_method, **figures)
            raise CheckAborted from error
        if isinstance(result, Coroutine | Generator):
            result.close()
            self.add_fault("check.no-function", method_name, value=type(result).__name__)
            raise CheckAborted
        return result


def _line(block_class: type, error: BaseException) -> int:
    """Return the last line number of the block's module in the traceback of the error; 0 without one.

    The methods that a dataclass generates have lines too, but not in a file.
    """
    lines = [
        n
        for f, n in traceback.walk_tb(error.__traceback__)
        if f.f_globals.get("__name__") == block_class.__module__ and f.f_code.co_filename != GENERATED_CODE
    ]
    return lines[-1] if lines else 0


def _is_frozen_dataclass(block_class: type) -> bool:
    return dataclasses.is_dataclass(block_class) and block_class.__dataclass_params__.frozen  # pyright: ignore


def _fields(block: object) -> Any:
    """Return all attributes of an object, from its slots or its dict. A cached property is computed before."""
    names = [n for c in type(block).__mro__ for n in getattr(c, "__slots__", ()) if not n.startswith("__")]
    for name, value in [pair for c in type(block).__mro__ for pair in vars(c).items()]:
        if isinstance(value, cached_property):
            with suppress(Exception):  # a call of the block reports it
                getattr(block, name)
    values = {n: getattr(block, n, None) for n in names}
    return values | dict(getattr(block, "__dict__", {}))


def _freeze(value: object, outer_ids: tuple[int, ...] = ()) -> Any:
    """Return a copy that == compares bit for bit; NaN is equal to NaN. `outer_ids` are the ids of the containers."""
    if isinstance(value, np.ndarray):
        return (
            "array",
            value.shape,
            value.dtype.str,
            value.tobytes() if value.dtype != object else repr(value),
        )
    if isinstance(value, float | np.floating):
        return ("float", np.float64(value).tobytes())
    if isinstance(value, np.generic):
        return _freeze(value.item())
    if id(value) in outer_ids:
        return ("cycle", outer_ids.index(id(value)))
    outer_ids = (*outer_ids, id(value))
    if isinstance(value, dict):
        return ("dict", tuple((k, _freeze(v, outer_ids)) for k, v in value.items()))
    if isinstance(value, list | tuple | deque):
        return (type(value).__name__, tuple(_freeze(v, outer_ids) for v in value))
    if isinstance(value, set | frozenset):
        return (type(value).__name__, frozenset(_freeze(v, outer_ids) for v in value))
    if isinstance(value, int | str | bytes | type(None)):
        return value
    is_plain = (
        not isinstance(value, type | ModuleType)
        and not callable(value)
        and type(value).__reduce__ is object.__reduce__
    )
    return (type(value).__name__, _freeze(_fields(value), outer_ids)) if is_plain else ("object", id(value))
