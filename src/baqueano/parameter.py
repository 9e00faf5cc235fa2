"""A field of a block that is a parameter: its unit, its bounds, one line of meaning and its physics stand beside it.

The vehicle file, the bounds of a fit, what a fit frees, its advice and the labels of a report are all read from here,
so that a vehicle of your own is served as ours are. `role` says what a default fit does with a parameter:

    fitted   frees it                                   term    frees it where it is not neutral
    gain     frees it; what commands do                 known   leaves it: somebody measured it
    offset   frees it; it acts without a command        scale   leaves it; of a sensor, known by its data sheet
                                                        noise   leaves it; it moves nothing
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import Invalid

INF = float("inf")
ROLES = ("fitted", "gain", "offset", "term", "known", "scale", "noise")
Words = str | tuple[str, ...]  # for all entries, or one for each index of the first axis


class Parameter(NamedTuple):
    """The properties of a field that do not depend on its value."""

    unit: str  # SI, "1" for none; one for all entries, or one per entry separated by ", "
    low: float  # smallest allowed value of any entry
    high: float  # largest allowed value
    meaning: str  # one line
    shape: tuple[int, ...] | None  # of the array; () for a number; None where it depends on the vehicle
    role: str = "fitted"
    neutral: float | None = None  # value at which it is not there; None: it always is
    term: Words = ""  # the name of what `choose` may add; entries and fields of one name are one term
    start: tuple[float, ...] = ()  # where a search begins; from the file's value on, without neutral
    shown_by: Words = ""  # the motion that shows it
    measured_by: str = ""  # how a person measures it
    symbol: Words = ""  # its letter, in LaTeX
    std: str = ""  # the field that says how well it is known; a filter may take it into its state
    walk: str = ""  # the field of its random walk in 1 s: a bias; "": a constant
    slip: str = ""  # the field of the deviation by which it comes and goes; "": it does not
    fade: str = ""  # the field of the time over which that fades

    @property
    def axes(self) -> bool:
        """Return True where its first index is an axis of the body: forward, sideways, turning."""
        return self.shape is not None and self.shape[:1] == (3,) and self.unit.count(", ") == 2


def parameter(
    unit: str,
    meaning: str,
    *,
    low: float = -INF,
    high: float = INF,
    default: object = dataclasses.MISSING,
    shape: tuple[int, ...] | None = (),
    role: str = "fitted",
    **physics: Tree,
) -> Any:
    """A dataclass field that carries a `Parameter`; `physics` are its other fields. Array defaults are given as lists
    or tuples. A term is neutral at 0 if `neutral` is not given."""
    if role not in ROLES:
        raise Invalid(fault("field.role", found=repr(role), known=ROLES))
    if role == "term":
        physics = {"neutral": 0.0} | physics
    metadata = {"parameter": Parameter(unit, low, high, meaning, shape, role, **physics)}
    if isinstance(default, list | tuple):
        values = default
        return dataclasses.field(default_factory=lambda: np.array(values, dtype=float), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def parameters(block: Tree) -> Iterator[tuple[str, Parameter]]:
    """(field name, Parameter) of a block or of its class, in the order of the fields."""
    for field in dataclasses.fields(block):
        if "parameter" in field.metadata:
            yield field.name, field.metadata["parameter"]


def all_parameters(block: Tree, path: str) -> Iterator[tuple[str, Parameter]]:
    """(path, Parameter) of a block, at `path`, those of the blocks within it first; not what is None.
    A field with a block may give its parameters other roles: metadata={"roles": {name: role}}."""
    if not dataclasses.is_dataclass(block):
        return
    for field in dataclasses.fields(block):
        roles = field.metadata.get("roles", {})
        for inner, p in all_parameters(getattr(block, field.name), f"{path}.{field.name}"):
            yield inner, p._replace(role=roles.get(inner.rpartition(".")[2], p.role))
    for name, p in parameters(block):
        if getattr(block, name) is not None:
            yield f"{path}.{name}", p
