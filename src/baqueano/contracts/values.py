"""Define types that are wider than usual, because a narrower type would not be correct."""

from typing import Any, TypeAlias

Value: TypeAlias = Any
"""A number, or an array of them: floats where the text runs under NumPy, symbols of `symbolic` where it is compiled.
They share their operators, and no type that NumPy knows holds both. An annotation of this kind says: it may be traced.
"""

Tree: TypeAlias = Any
"""A nest of NamedTuples, tuples, dicts and frozen dataclasses around values, traced or not (a pytree of JAX). The state
of a block is one that the block alone knows; so are the arguments and the results of a function that is compiled."""

TableRow: TypeAlias = dict[str, Any]
"""A row of a printed table, and of `rows` in JSON: name → number, text, True or False, None where it is not known."""

JsonObject: TypeAlias = dict[str, Any]
"""An object of JSON or a table of TOML: name → number, text, True or False, None, a list of such, another object."""
