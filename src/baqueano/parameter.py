"""Define a field of a block that is a parameter, with unit, bounds, meaning and physical properties.

The vehicle file, the bounds of a fit, its free parameters, its advice and the labels of a report all use this data. So
your own vehicle works like a vehicle of the package. `role` states whether a default fit estimates a parameter or keeps
its value:

    free     estimates                                   term    estimates if the value is not neutral
    gain     estimates: the effect of a command          fixed   keeps: measured separately
    offset   estimates: it acts without a command        scale   keeps: of a sensor, from its data sheet
    mount    estimates if a motion is known to be 0      noise   keeps: it does not act on the motion
    rolling  a term that is also estimated if no command pushes the vehicle sideways
    reverse  a term for drives backward, except in IMU-only fits
    tyre     a term that is also estimated from commands and IMU only: it affects the speed that turns show
"""

import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid
from baqueano.messages import list_item

__all__ = ["Parameter", "document", "parameter", "parameters"]

INF = float("inf")
Kind = TypeVar("Kind", bound=type)
SHOWN_BOUND = 1e3  # a larger bound only excludes absurd values, and is not shown to the reader
SECTION_HEAD = re.compile(r"^(\w[\w ]*)\n-+$", re.M)  # of a docstring, as numpydoc has them
SECTION_ENTRY = re.compile(r"^(\w+)\b.*(?:\n(?: .*|(?=\n)))*", re.M)
ROLES = ("free", "gain", "offset", "term", "rolling", "reverse", "tyre", "mount", "fixed", "scale", "noise")
TERM_ROLES = ("term", "rolling", "reverse", "tyre")
Words = str | tuple[str, ...]  # for all entries, or one for each index of the first axis


class Parameter(NamedTuple):
    """The properties of a field that do not depend on its value.

    Attributes
    ----------
    unit : str
        SI unit, "1" for none; one unit for all entries, or one per entry separated by ", ".
    low, high : float
        Smallest and largest allowed value of each entry [unit of the field].
    meaning : str
        Meaning of the parameter, in one line.
    shape : tuple of int or None
        Shape of the array; () for a number; None if it depends on the vehicle.
    role : str
        One of ROLES: its use in a default fit.
    neutral : float or None
        Value at which the effect vanishes [unit of the field]; None if no value does this.
    term : str or tuple of str
        Name of the term that `choose` can add; entries and fields with the same name belong to one term.
    start : tuple of float
        Values from which a search begins [unit of the field].
    requires : str
        Field of the same block without which it has no effect; `choose` tries it after the term of that field.
    shown_by : str or tuple of str
        The motion that makes it identifiable.
    measured_by : str
        Method by which a user measures it.
    symbol : str or tuple of str
        Symbol of the parameter, in LaTeX.
    label : str or tuple of str
        Short name for the reader; for a matrix, the name of the diagonal entries. If "", `meaning` is used.
    std : str
        Field with the standard deviation; a filter can include the parameter in its state.
    walk : str
        For a bias, the field with the random walk in 1 s; "" for a constant.
    slip : str
        Field with the standard deviation of the slow variation of a scale; "" for a constant.
    fade : str
        Field with the time constant of that variation.
    sign_speed : str
        For dry friction, the field with the speed over which it changes its sign.

    Examples
    --------
    >>> dict(parameters(bq.vehicles.Planar))["mass_kg"].unit
    'kg'
    """

    unit: str
    low: float
    high: float
    meaning: str
    shape: tuple[int, ...] | None
    role: str = "free"
    neutral: float | None = None
    term: Words = ""
    start: tuple[float, ...] = ()
    requires: str = ""
    shown_by: Words = ""
    measured_by: str = ""
    symbol: Words = ""
    label: Words = ""
    std: str = ""
    walk: str = ""
    slip: str = ""
    fade: str = ""
    sign_speed: str = ""

    @property
    def axes(self) -> bool:
        """Return True if the first index is an axis of the body: forward, sideways, turning."""
        return self.shape is not None and self.shape[:1] == (3,) and self.unit.count(", ") == 2


def parameter(
    unit: str,
    meaning: str,
    *,
    low: float = -INF,
    high: float = INF,
    default: object = dataclasses.MISSING,
    shape: tuple[int, ...] | None = (),
    role: str = "free",
    **physics: Tree,
) -> Any:
    """Return a dataclass field that carries a `Parameter`. A term is neutral at 0 if `neutral` is not given.

    Parameters
    ----------
    unit : str
        SI unit, "1" for none; one unit for all entries, or one per entry separated by ", ".
    meaning : str
        Meaning of the parameter, in one line.
    low, high : float
        Smallest and largest allowed value of each entry [unit of the field].
    default : object
        Value of the field; arrays are given as lists or tuples.
    shape : tuple of int or None
        Shape of the array; () for a number; None if it depends on the vehicle.
    role : str
        One of ROLES: its use in a default fit.
    **physics : object
        The other fields of `Parameter`.

    Returns
    -------
    dataclasses.Field
        Field for the body of a dataclass.

    Raises
    ------
    Invalid
        If the role is unknown; Invalid is a ValueError.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Wheel:
    ...     radius_m: float = parameter("m", "radius of the wheel", low=0.0, default=0.03)
    >>> Wheel().radius_m
    0.03
    """
    if role not in ROLES:
        raise Invalid.of("field.role", value=repr(role), valid=ROLES)
    if role in TERM_ROLES:
        physics = {"neutral": 0.0} | physics
    metadata = {"parameter": Parameter(unit, low, high, meaning, shape, role, **physics)}
    if isinstance(default, list | tuple):
        values = default
        return dataclasses.field(default_factory=lambda: np.array(values, dtype=float), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def parameters(block: Tree) -> Iterator[tuple[str, Parameter]]:
    """Yield the parameters of a block or of its class, in the order of the fields.

    Parameters
    ----------
    block : object or type
        A dataclass whose fields were made by `parameter`; any other object lacks parameters.

    Yields
    ------
    name : str
        Name of the field.
    parameter : Parameter
        Its properties.

    Examples
    --------
    >>> [name for name, _ in parameters(bq.controllers.Pd)]
    ['alpha', 'beta', 'gamma', 'limit']
    """
    yield from _block_parameters(block if isinstance(block, type) else type(block))


@lru_cache(maxsize=1000)
def _block_parameters(block_class: type) -> tuple[tuple[str, Parameter], ...]:
    fields = dataclasses.fields(block_class) if dataclasses.is_dataclass(block_class) else ()
    return tuple(
        (field.name, field.metadata["parameter"]) for field in fields if "parameter" in field.metadata
    )


def all_parameters(block: Tree, path: str) -> Iterator[tuple[str, Parameter]]:
    """Yield (path, Parameter) of each parameter of a block at `path`; fields that are None are excluded.

    Parameters of blocks within the block are first. A field that contains a block can change the roles of the
    parameters of that block: metadata={"roles": {name: role}}.
    """
    if not dataclasses.is_dataclass(block):
        return
    for field in dataclasses.fields(block):
        inner_block = getattr(block, field.name)
        if not dataclasses.is_dataclass(inner_block):
            continue
        roles = field.metadata.get("roles", {})
        for inner_path, p in all_parameters(inner_block, f"{path}.{field.name}"):
            role = roles.get(inner_path.rpartition(".")[2])
            yield inner_path, p if role is None else p._replace(role=role)
    for name, p in parameters(block):
        if getattr(block, name) is not None:
            yield f"{path}.{name}", p


def document(block: Kind) -> Kind:
    """Complete the section Parameters in the docstring of a block's class from the metadata of its fields.

    So the meaning of a field is written in one place. The section itself describes the fields without metadata; an
    inherited field has the description of the base class. Without Notes and References, the notes name the module
    with the equations.

    Parameters
    ----------
    block : type
        A dataclass; write `@document` above the decorator of the dataclass.

    Returns
    -------
    type
        The same class.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @document
    ... @dataclass
    ... class Wheel:
    ...     radius_m: float = parameter("m", "radius of the wheel", low=0.0, default=0.03)
    >>> print(Wheel.__doc__.splitlines()[-1])
        Radius of the wheel; at least 0. Default 0.03.
    """
    if block.__doc__ is None:  # python -OO
        return block
    entries: dict[str, str] = {}
    for base in reversed(block.__mro__):
        entries |= {
            match[1]: match[0].rstrip()
            for match in SECTION_ENTRY.finditer(_section(inspect.cleandoc(base.__doc__ or "")))
        }
    text = inspect.cleandoc(block.__doc__)
    descriptions = [
        _entry(field) if "parameter" in field.metadata else entries.get(field.name, "")
        for field in dataclasses.fields(block)
    ]
    section = _section(text)
    if section:
        text = text.replace(f"Parameters\n----------\n{section}", "")
    first = SECTION_HEAD.search(text)
    head, tail = (text[: first.start()], text[first.start() :]) if first else (text, "")
    rows = "\n".join(filter(None, descriptions))
    has_equations = "(1)" in (sys.modules[block.__module__].__doc__ or "")
    if has_equations and not any(name in ("Notes", "References") for name in SECTION_HEAD.findall(tail)):
        tail = f"Notes\n-----\nEquations of the module `{block.__module__}`.\n\n{tail}"
    block.__doc__ = f"{head.rstrip()}\n\nParameters\n----------\n{rows}\n\n{tail}".rstrip()
    return block


def _section(doc: str) -> str:
    """Return the entries of the section Parameters of a docstring; "" without this section."""
    sections = list(SECTION_HEAD.finditer(doc))
    for section, next_section in pairwise([*sections, None]):
        if section is not None and section[1] == "Parameters":
            return doc[section.end() + 1 : next_section.start() if next_section else None]
    return ""


def _entry(field: "dataclasses.Field[object]") -> str:
    """Return the entry of a field in the section Parameters: name, unit, meaning, bounds and default."""
    p: Parameter = field.metadata["parameter"]
    shape_text = p.shape or ("" if re.search(r"\(\w+,[ \w]*\)", p.meaning) else "(k,)")
    type_text = "float" if p.shape == () else f"ndarray {shape_text}".rstrip()
    default = field.default_factory() if field.default_factory is not dataclasses.MISSING else field.default
    bounds = [f"at least {p.low:g}"] if p.low > -SHOWN_BOUND else []
    bounds += [f"at most {p.high:g}"] if p.high < SHOWN_BOUND else []
    limits = f"; {', '.join(bounds)}" if bounds else ""
    default_text = "" if default is dataclasses.MISSING else f" Default {_default_text(default)}."
    return f"{field.name} : {type_text} [{p.unit}]\n    {list_item(p.meaning + limits)}{default_text}"


def _default_text(default: object) -> str:
    return str(default.tolist()) if isinstance(default, np.ndarray) else str(default)
