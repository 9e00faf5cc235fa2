"""One block on trial: calls are made twice from the same arguments, and everything is compared.

Pure: neither an argument nor the block itself changes. Deterministic: twice the same call, twice the same
numbers, bit for bit. What is wrong is kept as sentences, each once.
"""

import copy
import dataclasses
import traceback
import warnings
from typing import Any

import numpy as np

from baqueano.block_checks.source import doors, place
from baqueano.errors import from_outside, named

MOST = 12  # sentences: more is not read


class GaveUp(Exception):
    """The block raised or returned something unusable: the trial of this room ends."""


class Trial:
    """A block and what was found wrong with it."""

    def __init__(self, block: object, verbs: tuple[str, ...] = ("init", "step")) -> None:
        self.block = block
        self.kind = type(block)
        self.sentences: dict[str, None] = {}
        self._own = _frozen(_fields(block))
        self._asked: dict[tuple[str, str], int] = {}
        for sentence in doors(self.kind):
            self.sentences[sentence] = None
        if not _is_frozen_dataclass(self.kind):
            self.say(
                "can be changed after it is built: write @dataclass(frozen=True, slots=True, eq=False) "
                "above it, so "
                "that a replay meets the same block."
            )
        for verb in verbs:
            if not callable(getattr(block, verb, None)):
                self.say(f"has no {verb}().")

    def say(self, what: str, verb: str = "") -> None:
        """One sentence for the author, with the place it speaks of."""
        at = place(getattr(self.kind, verb, self.kind)) if verb else place(self.kind)
        name = f"{self.kind.__name__}.{verb}()" if verb else self.kind.__name__
        self.sentences[f"{at}: {name} {what}"] = None

    def ask(self, verb: str, when: str, *arguments: object) -> Any:
        """The result of a call, made twice. GaveUp if it raised."""
        before = _frozen(arguments)
        first = self._call(verb, when, arguments)
        if _frozen(arguments) != before:
            self.say(
                f"changes its arguments ({when}): make new arrays and NamedTuples, x._replace(…), never "
                "x[…] = …",
                verb,
            )
        if self._again(verb, when) and _frozen(first) != _frozen(
            self._call(verb, when, copy.deepcopy(arguments))
        ):
            self.say(
                f"gives two answers to the same question ({when}): it may depend on its arguments and the "
                "block's "
                f"parameters alone.",
                verb,
            )
        if _frozen(_fields(self.block)) != self._own:
            self.say(f"changes the block itself ({when}): what is remembered goes into the state.", verb)
            self._own = _frozen(_fields(self.block))
        return first

    def _again(self, verb: str, when: str) -> bool:
        """Whether to ask the same once more: the first times, and then now and then."""
        count = self._asked[verb, when] = self._asked.get((verb, when), 0) + 1
        return count <= 5 or count % 10 == 0

    def step(self, when: str, *arguments: object) -> tuple[Any, Any]:
        """(state, output) of a step."""
        result = self.ask("step", when, *arguments)
        named = type(result) is not tuple  # a Command alone is a tuple of two as well
        if not (isinstance(result, tuple) and len(result) == 2) or named:
            shown = f"{len(result)} values" if type(result) is tuple else f"{type(result).__name__} alone"
            self.say(f"returns {shown} ({when}): expected two, (state, output).", "step")
            raise GaveUp
        return result

    def expect(
        self, what: str, value: object, shape: tuple[int, ...], when: str, verb: str = "step"
    ) -> np.ndarray:
        """An array of a shape, finite; GaveUp if it is no such thing."""
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            self.say(f"gives {what} = {type(value).__name__}: expected numbers of shape {shape}.", verb)
            raise GaveUp from None
        if array.shape != shape:
            self.say(f"gives {what} with shape {array.shape}: expected {shape}.", verb)
            raise GaveUp
        if not np.all(np.isfinite(array)):
            self.say(f"gives {what} = {array.tolist()} ({when}): expected finite numbers.", verb)
            raise GaveUp
        return array

    def stamped(self, output: object, t_ns: int, of: str, when: str) -> None:
        """The output carries the time of what it answers."""
        found = getattr(output, "t_ns", None)
        if found is None or int(found) != t_ns:
            self.say(f"stamps its output with {found} instead of {of}.t_ns = {t_ns} ({when}).", "step")

    def wrapped(self, what: str, psi: float, when: str) -> None:
        """An angle that leaves a block lies within [−π, π]."""
        if abs(psi) > np.pi + 1e-9:
            self.say(
                f"gives {what} = {psi:.4g} rad ({when}): expected it wrapped to [-π, π], geometry.wrap.",
                "step",
            )

    def covariance(self, what: str, value: object, size: int, when: str, verb: str = "step") -> np.ndarray:
        """Symmetric, and no eigenvalue below 0."""
        P = self.expect(what, value, (size, size), when, verb)
        scale = np.max(np.abs(P), initial=0.0)
        if np.max(np.abs(P - P.T), initial=0.0) > 1e-9 * scale:
            self.say(f"gives a {what} that is not symmetric ({when}).", verb)
        elif np.linalg.eigvalsh(P)[0] < -1e-9 * scale:
            smallest = np.linalg.eigvalsh(P)[0]
            self.say(
                f"gives a {what} with the eigenvalue {smallest:.3g} ({when}): a covariance has none below "
                "0. The form "
                f"of Joseph keeps it so: (I - K H) P (I - K H)ᵀ + K Q Kᵀ.",
                verb,
            )
        return P

    def done(self) -> list[str]:
        """The sentences."""
        return list(self.sentences)[:MOST]

    def _call(self, verb: str, when: str, arguments: tuple[Any, ...]) -> Any:
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                return getattr(self.block, verb)(*arguments)
        except BaseException as error:
            if from_outside(error):
                raise
            raised = f"raises {named(error)}{_line(self.kind, error)} ({when})."
            self.say(raised, verb if hasattr(self.kind, verb) else "")
            raise GaveUp from error


def _line(kind: type, error: BaseException) -> str:
    """ " on line 12": the last line of the block's own file on the way to the error."""
    file = getattr(getattr(kind, "step", None), "__code__", None)
    frames = traceback.extract_tb(error.__traceback__)
    own = [f.lineno for f in frames if file is not None and f.filename == file.co_filename]
    return f" on line {own[-1]}" if own else ""


def _is_frozen_dataclass(kind: type) -> bool:
    return dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen  # pyright: ignore


def _fields(block: object) -> Any:
    """All that an object holds, in slots or in a dict."""
    names = [n for c in type(block).__mro__ for n in getattr(c, "__slots__", ()) if not n.startswith("__")]
    held = {n: getattr(block, n, None) for n in names}
    return held | dict(getattr(block, "__dict__", {}))


def _frozen(value: object) -> Any:
    """A copy that compares with ==, NaN equal to NaN, every bit counting."""
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
        return _frozen(value.item())
    if isinstance(value, dict):
        return ("dict", tuple((k, _frozen(v)) for k, v in value.items()))
    if isinstance(value, list | tuple):
        return (type(value).__name__, tuple(_frozen(v) for v in value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return (type(value).__name__, _frozen(_fields(value)))
    return value if isinstance(value, int | str | bytes | type(None)) else ("object", id(value))
