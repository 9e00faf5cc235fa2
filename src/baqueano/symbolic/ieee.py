"""Compute with doubles as IEEE 754 defines it: an operator of this package never raises and never warns.

Python raises if the hardware returns inf or NaN (1/0, exp of 1000, sqrt of −1); then NumPy computes the value without a
warning.
"""

import math
import operator
from bisect import bisect_right
from collections.abc import Callable, Sequence

import numpy as np

from baqueano.contracts.values import Value


def _without_errors(fast: Callable[..., float], exact: Value) -> Callable[..., float]:
    def with_nan(*args: float) -> float:
        try:
            return fast(*args)
        except (ArithmeticError, ValueError):
            with np.errstate(all="ignore"):
                return float(exact(*map(float, args)))

    return with_nan


def minimum(a: float, b: float) -> float:
    """Return the smaller number; NaN if either is NaN."""
    return a if a < b or a != a else b


def maximum(a: float, b: float) -> float:
    """Return the larger number; NaN if either is NaN."""
    return a if a > b or a != a else b


def sign(a: float) -> float:
    """Return −1, 0 or 1; NaN for NaN."""
    return float(a > 0.0) - float(a < 0.0) if a == a else a


def interp(x: float, xp: Sequence[float], fp: Sequence[float]) -> float:
    """Return the piecewise linear interpolation, constant outside the table, like np.interp; NaN for NaN."""
    if x <= xp[0]:
        return fp[0]
    if x >= xp[-1]:
        return fp[-1]
    j = _cell(x, xp)
    return fp[j] + (x - xp[j]) * ((fp[j + 1] - fp[j]) / (xp[j + 1] - xp[j]))


def interp_slope(x: float, xp: Sequence[float], fp: Sequence[float]) -> float:
    """Return the slope of the segment that begins at or before x; 0 outside the table."""
    if x < xp[0] or x > xp[-1]:
        return 0.0
    j = _cell(x, xp)
    return (fp[j + 1] - fp[j]) / (xp[j + 1] - xp[j])


def _cell(x: float, xp: Sequence[float]) -> int:
    return max(min(bisect_right(xp, x) - 1, len(xp) - 2), 0)


OPERATORS: dict[str, Callable[..., Value]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": _without_errors(operator.truediv, np.divide),
    "neg": operator.neg,
    "sin": _without_errors(math.sin, np.sin),
    "cos": _without_errors(math.cos, np.cos),
    "tan": _without_errors(math.tan, np.tan),
    "asin": _without_errors(math.asin, np.arcsin),
    "acos": _without_errors(math.acos, np.arccos),
    "atan": math.atan,
    "atan2": math.atan2,
    "sinh": _without_errors(math.sinh, np.sinh),
    "cosh": _without_errors(math.cosh, np.cosh),
    "tanh": math.tanh,
    "exp": _without_errors(math.exp, np.exp),
    "log": _without_errors(math.log, np.log),
    "sqrt": _without_errors(math.sqrt, np.sqrt),
    "hypot": math.hypot,
    "abs": abs,
    "sign": sign,
    "min": minimum,
    "max": maximum,
    "floor": _without_errors(lambda a: float(math.floor(a)), np.floor),
    "pow": _without_errors(math.pow, np.power),
    "lt": operator.lt,
    "le": operator.le,
    "eq": operator.eq,
    "ne": operator.ne,
    "and": lambda a, b: bool(a) and bool(b),
    "or": lambda a, b: bool(a) or bool(b),
    "not": operator.not_,
    "isnan": lambda a: a != a,
    "where": lambda c, a, b: a if c else b,
    "interp": lambda x, value: interp(x, *value),
    "interp_slope": lambda x, value: interp_slope(x, *value),
}
LOGICAL = frozenset(("lt", "le", "eq", "ne", "and", "or", "not", "isnan"))  # their result is a truth value
COMMUTATIVE = frozenset(("add", "mul", "min", "max", "hypot", "eq", "ne", "and", "or"))
