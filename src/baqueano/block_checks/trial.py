"""Check one block: repeat some of its calls with the same arguments, and compare the results.

Pure: the arguments and the block itself do not change. Deterministic: two equal calls give the same numbers, bit for
bit. Faults are stored as diagnostics, each once.
"""

import copy
import dataclasses
import traceback
import warnings
from typing import Any

import numpy as np

from baqueano.block_checks.source import doors, place
from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import error_text, from_outside

MOST = 12  # diagnostics that are reported at most
AT_START = note("when.start")
LACKING = ("check.no-method", "check.no-attribute", "check.no-commands", "check.no-drivetrain")


class GaveUp(Exception):
    """Raised to end the check: the block raised an exception or returned an unusable result."""


class Trial:
    """A block and the faults that were found in it."""

    def __init__(self, block: object, verbs: tuple[str, ...] = ("init", "step")) -> None:
        self.block = block
        self.kind = type(block)
        self.faults = dict.fromkeys(doors(self.kind))
        self._own = _freeze(_fields(block))
        self._calls_of: dict[tuple[str, Diagnostic], int] = {}
        if not _is_frozen_dataclass(self.kind):
            self.add_fault("check.not-frozen")
        for verb in verbs:
            if not callable(getattr(block, verb, None)):
                self.add_fault("check.no-method", name=verb)

    @property
    def lacking(self) -> bool:
        """Return True if the block is without a method or attribute that its check needs."""
        return any(fault_.code in LACKING for fault_ in self.faults)

    def add_fault(self, code: str, verb: str = "", **figures: Any) -> None:
        """Store a diagnostic for the author, with the place in the code."""
        at = place(getattr(self.kind, verb, self.kind)) if verb else place(self.kind)
        name = f"{self.kind.__name__}.{verb}()" if verb else self.kind.__name__
        self.faults[fault(code, subject=name, place=at, **figures)] = None

    def checked_call(self, verb: str, when: Diagnostic, *arguments: object) -> Any:
        """Return the result of a call. Repeat some calls, and store faults if results, arguments or the block change.
        Raise GaveUp if the block raises.
        """
        before = _freeze(arguments)
        first = self._call(verb, when, arguments)
        if _freeze(arguments) != before:
            self.add_fault("check.changes-arguments", verb, when=when)
        if self._repeats(verb, when) and _freeze(first) != _freeze(
            self._call(verb, when, copy.deepcopy(arguments))
        ):
            self.add_fault("check.two-answers", verb, when=when)
        if _freeze(_fields(self.block)) != self._own:
            self.add_fault("check.changes-itself", verb, when=when)
            self._own = _freeze(_fields(self.block))
        return first

    def _repeats(self, verb: str, when: Diagnostic) -> bool:
        """Return True if a call is to be repeated: the first five calls of a kind, then every tenth."""
        count = self._calls_of[verb, when] = self._calls_of.get((verb, when), 0) + 1
        return count <= 5 or count % 10 == 0

    def step(self, when: Diagnostic, *arguments: object) -> tuple[Any, Any]:
        """Return (state, output) of a step. Raise GaveUp for another result."""
        result = self.checked_call("step", when, *arguments)
        is_record = type(result) is not tuple  # a Command is also a tuple of two
        if not (isinstance(result, tuple) and len(result) == 2) or is_record:
            if type(result) is tuple:
                self.add_fault("check.values", "step", count=len(result), when=when)
            else:
                self.add_fault("check.one-value", "step", found=type(result).__name__, when=when)
            raise GaveUp
        return result

    def expect(
        self, quantity: str, value: object, shape: tuple[int, ...], when: Diagnostic, verb: str = "step"
    ) -> np.ndarray:
        """Return the value as a finite array of this shape. Raise GaveUp for another value."""
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            self.add_fault(
                "check.no-numbers", verb, what=quantity, found=type(value).__name__, shape=str(shape)
            )
            raise GaveUp from None
        if array.shape != shape:
            self.add_fault("check.shape", verb, what=quantity, found=str(array.shape), shape=str(shape))
            raise GaveUp
        if not np.all(np.isfinite(array)):
            self.add_fault("check.not-finite", verb, what=quantity, found=str(array.tolist()), when=when)
            raise GaveUp
        return array

    def check_stamp(self, output: object, t_ns: int, quantity: str, when: Diagnostic) -> None:
        """Check that the output has the timestamp of its input."""
        stamp = getattr(output, "t_ns", None)
        if stamp is None or int(stamp) != t_ns:
            self.add_fault("check.stamp", "step", found=stamp, of=quantity, t_ns=t_ns, when=when)

    def check_wrapped(self, quantity: str, psi: float, when: Diagnostic) -> None:
        """Check that an angle in an output is within [−π, π]."""
        if abs(psi) > np.pi + 1e-9:
            self.add_fault("check.not-wrapped", "step", what=quantity, psi_rad=psi, when=when)

    def covariance(
        self, quantity: str, value: object, size: int, when: Diagnostic, verb: str = "step"
    ) -> np.ndarray:
        """Return a covariance, and check that it is symmetric and without a negative eigenvalue."""
        P = self.expect(quantity, value, (size, size), when, verb)
        scale = np.max(np.abs(P), initial=0.0)
        if np.max(np.abs(P - P.T), initial=0.0) > 1e-9 * scale:
            self.add_fault("check.not-symmetric", verb, what=quantity, when=when)
        elif np.linalg.eigvalsh(P)[0] < -1e-9 * scale:
            self.add_fault(
                "check.eigenvalue", verb, what=quantity, smallest=np.linalg.eigvalsh(P)[0], when=when
            )
        return P

    def done(self) -> list[Diagnostic]:
        """Return the faults, at most MOST."""
        return list(self.faults)[:MOST]

    def _call(self, verb: str, when: Diagnostic, arguments: tuple[Any, ...]) -> Any:
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                return getattr(self.block, verb)(*arguments)
        except BaseException as error:
            if from_outside(error):
                raise
            line, at = _line(self.kind, error), verb if hasattr(self.kind, verb) else ""
            if line:
                self.add_fault("check.raises-on-line", at, error=error_text(error), line=line, when=when)
            else:
                self.add_fault("check.raises", at, error=error_text(error), when=when)
            raise GaveUp from error


def _line(kind: type, error: BaseException) -> int:
    """Return the last line number of the block's file in the traceback of the error; 0 without one."""
    file = getattr(getattr(kind, "step", None), "__code__", None)
    frames = traceback.extract_tb(error.__traceback__)
    own = [f.lineno for f in frames if file is not None and f.filename == file.co_filename]
    return own[-1] or 0 if own else 0


def _is_frozen_dataclass(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen  # pyright: ignore


def _fields(block: object) -> Any:
    """Return all attributes of an object, from its slots or its dict."""
    names = [n for c in type(block).__mro__ for n in getattr(c, "__slots__", ()) if not n.startswith("__")]
    values = {n: getattr(block, n, None) for n in names}
    return values | dict(getattr(block, "__dict__", {}))


def _freeze(value: object) -> Any:
    """Return a copy that compares with ==, bit for bit, with NaN equal to NaN."""
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
    if isinstance(value, dict):
        return ("dict", tuple((k, _freeze(v)) for k, v in value.items()))
    if isinstance(value, list | tuple):
        return (type(value).__name__, tuple(_freeze(v) for v in value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return (type(value).__name__, _freeze(_fields(value)))
    return value if isinstance(value, int | str | bytes | type(None)) else ("object", id(value))
