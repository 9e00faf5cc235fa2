"""Values that are the same text for NumPy and for the tracer: the one place where a type says less than it could."""

from typing import Any, TypeAlias

Scalar: TypeAlias = Any
"""A number or a truth value that may be traced: a float where the text runs under NumPy, a symbol of `symbolic` where
it is compiled. The two share their operators and no type of NumPy's knows both, so no narrower type would hold."""

Tree: TypeAlias = Any
"""A nest of NamedTuples, tuples, dicts and frozen dataclasses around numbers and arrays, traced or not (a pytree of
JAX). The state of a block is one that only the block knows, so are a function's arguments to the engine."""
