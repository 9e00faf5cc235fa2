"""A field of a block that is a parameter: its unit, its bounds and one line of meaning stand beside it.

The vehicle file, the bounds of a fit and the labels of a report are all read from here.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

INF = float("inf")


class Parameter(NamedTuple):
    """What is known of a field before any value is."""

    unit: str  # SI, "1" for none; one for all entries, or one per entry separated by ", "
    low: float  # smallest allowed value of any entry
    high: float  # largest allowed value
    meaning: str  # one line
    shape: tuple[int, ...] | None  # of the array; () for a number; None where it depends on the vehicle


def parameter(
    unit: str,
    meaning: str,
    *,
    low: float = -INF,
    high: float = INF,
    default: Any = dataclasses.MISSING,
    shape: tuple[int, ...] | None = (),
) -> Any:
    """A dataclass field that carries a `Parameter`. Array defaults are given as lists or tuples."""
    metadata = {"parameter": Parameter(unit, low, high, meaning, shape)}
    if isinstance(default, list | tuple):
        values = default
        return dataclasses.field(default_factory=lambda: np.array(values, dtype=float), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def parameters(block: Any) -> Iterator[tuple[str, Parameter]]:
    """(field name, Parameter) of a block or of its class, in the order of the fields."""
    for field in dataclasses.fields(block):
        if "parameter" in field.metadata:
            yield field.name, field.metadata["parameter"]
