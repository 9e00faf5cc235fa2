"""Define type aliases for numbers, arrays and their containers that may be numeric or symbolic."""

from typing import Any, TypeAlias

Value: TypeAlias = Any
"""A scalar or an array, numeric (NumPy) or symbolic (`symbolic`). A block is traced with symbolic values to compile it.
The two kinds share their operators, but no common NumPy type. A function of `Value` accepts both.
"""

Tree: TypeAlias = Any
"""A nested container of values: NamedTuples, tuples, dicts and frozen dataclasses (a pytree of JAX). Examples: the
state of a block, and the arguments and the result of a compiled function. The type of a state is private to its block.
"""

TableRow: TypeAlias = dict[str, Any]
"""A row of a printed table, or of `rows` in JSON: column → number, text, boolean, or None if the value is unknown."""

JsonObject: TypeAlias = dict[str, Any]
"""A JSON object or a TOML table: key → number, text, boolean, None, list, or nested object."""


def array_text(value: Value) -> str:
    """Return an array as text on one line, without its middle if it is long.

    >>> import numpy as np
    >>> array_text(np.full((6, 6), np.nan))
    '[[nan, ..., nan], ..., [nan, ..., nan]]'
    """
    import numpy as np  # the process of the page uses the types above without NumPy

    text = np.array2string(np.asarray(value), threshold=6, edgeitems=1, separator=", ")
    return " ".join(text.split())
