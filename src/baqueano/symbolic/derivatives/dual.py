"""Compute forward derivatives with dual numbers: a value, and its derivatives with respect to the seeds.

Value and derivatives have the type of the arguments. They are floats without a trace, nodes while a step is traced, and
dual numbers of a lower level inside an outer derivative. So `jacobian` works in all three cases, without side effects.
"""

from collections.abc import Callable
from functools import update_wrapper

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.array import TracedArray, as_array, as_fillable, has_scalars
from baqueano.symbolic.arrays.scalar import Scalar, apply
from baqueano.symbolic.arrays.tracing import tracing
from baqueano.symbolic.derivatives.derive import Row, argument_derivatives, combine
from baqueano.symbolic.errors import locate_errors
from baqueano.symbolic.ieee import LOGICAL


class Dual(Scalar):
    """A value with a dict {seed: derivative}; seeds are numbered within their level."""

    __slots__ = ("level", "row", "value")

    def __init__(self, value: Value, row: Row, level: int) -> None:
        self.value, self.row, self.level = value, row, level

    def apply(self, op: str, args: tuple[Value, ...], value: Value) -> Value:
        """Return the result with its derivatives by the chain rule; a plain value for a result without derivatives."""
        level = self.level
        values, rows = list(args), [_NO_ROW] * len(args)
        for k, a in enumerate(args):
            if type(a) is Dual and a.level == level:
                values[k], rows[k] = a.value, a.row
        result = apply(op, *values, value=value)
        if op in LOGICAL:
            return result
        row = combine(
            op, values, rows, () if op == "where" else argument_derivatives(op, result, values, value)
        )
        return Dual(result, row, level) if row else result

    # Most operations of a model are sums and products with floats or dual numbers of this level: without `apply`.
    def __add__(self, other: Value) -> Value:
        if type(other) is float:
            return Dual(self.value + other, self.row, self.level)
        if type(other) is Dual and other.level == self.level:
            return self._combined("add", self.value + other.value, other, 1.0, 1.0)
        return super().__add__(other)

    def __radd__(self, other: Value) -> Value:
        if type(other) is float:
            return Dual(other + self.value, self.row, self.level)
        return super().__radd__(other)

    def __sub__(self, other: Value) -> Value:
        if type(other) is float:
            return Dual(self.value - other, self.row, self.level)
        if type(other) is Dual and other.level == self.level:
            return self._combined("sub", self.value - other.value, other, 1.0, -1.0)
        return super().__sub__(other)

    def __rsub__(self, other: Value) -> Value:
        if type(other) is not float:
            return super().__rsub__(other)
        return Dual(other - self.value, {source: -1.0 * x for source, x in self.row.items()}, self.level)

    def __mul__(self, other: Value) -> Value:
        if type(other) is float:
            return self._scale(self.value * other, other)
        if type(other) is Dual and other.level == self.level:
            return self._combined("mul", self.value * other.value, other, other.value, self.value)
        return super().__mul__(other)

    def __rmul__(self, other: Value) -> Value:
        return self._scale(other * self.value, other) if type(other) is float else super().__rmul__(other)

    def _scale(self, value: Value, factor: float) -> Value:
        if factor == 0.0:
            return value
        return Dual(value, {source: factor * x for source, x in self.row.items()}, self.level)

    def _combined(self, op: str, value: Value, other: "Dual", *factors: Value) -> Value:
        row = combine(op, (), (self.row, other.row), factors)
        return Dual(value, row, self.level) if row else value


_NO_ROW: Row = {}


def seed_array(values: np.ndarray, level: int) -> TracedArray:
    """Return an array whose entries are the seeds 0, 1, …, in order."""
    seeds = np.empty(values.shape, dtype=object)
    entries = values.ravel().tolist()
    seeds.ravel()[:] = [Dual(x, {k: 1.0}, level) for k, x in enumerate(entries)]
    return seeds.view(TracedArray)


def derivative_rows(values: np.ndarray, count: int, level: int) -> np.ndarray:
    """Return the derivatives (size, count) of the entries with respect to `count` seeds, as objects."""
    rows = np.full((values.size, count), 0.0, dtype=object)
    for i, x in enumerate(values.ravel().tolist()):
        if isinstance(x, Dual) and x.level == level:
            for k, d in x.row.items():
                rows[i, k] = d
    return rows


def jacobian(f: Callable[..., Value], argument: int = 0) -> Callable[..., Value]:
    """Return the function that computes ∂f/∂x exactly, without finite differences.

    Parameters
    ----------
    f : callable
        A pure function in NumPy.
    argument : int
        Index of the argument x.

    Returns
    -------
    callable
        Function of the same arguments. It returns (m, n) for vectors, (n,) if f is a number, (m,) if x is a number.

    Examples
    --------
    >>> jacobian(lambda x: np.array([x[0] * x[1], x[1] ** 2]))(np.array([2.0, 3.0]))
    array([[3., 2.],
           [0., 6.]])
    """

    def derivative(*args: Value) -> Value:
        with tracing() as level, locate_errors():
            x = as_array(args[argument])
            seeds = seed_array(x, level) if x.ndim else Dual(x.item(), {0: 1.0}, level)
            if isinstance(seeds, TracedArray):
                seeds.flags.writeable = False
            y = as_array(f(*args[:argument], seeds, *args[argument + 1 :]))
            result = derivative_rows(y, x.size, level).reshape(y.shape + x.shape)
        if has_scalars(result):
            return result.view(TracedArray) if result.ndim else result.item()
        result = result.astype(float)
        return (as_fillable(result) if level > 1 else result) if result.ndim else float(result)

    return update_wrapper(derivative, f)


def chain_rule(f: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the vector function f (n,) → (m,) with the chain rule: ∂f/∂x is computed for the n entries of x, and then
    multiplied by the derivatives of x. This is cheaper if these are with respect to more than n variables."""

    def value_and_rows(x: np.ndarray) -> np.ndarray:
        entries = as_array(x).tolist()
        level = max((entry.level for entry in entries if isinstance(entry, Dual)), default=0)
        if not level:
            return f(x)
        parts = [
            (e.value, e.row) if isinstance(e, Dual) and e.level == level else (e, _NO_ROW) for e in entries
        ]
        inner_values = np.array([value for value, _ in parts], dtype=object).view(TracedArray)
        rows, results = [row for _, row in parts], []
        for y, slopes in zip(
            as_array(f(inner_values)).tolist(), as_array(jacobian(f)(inner_values)).tolist(), strict=True
        ):
            row = combine("add", (), rows, slopes)
            results.append(Dual(y, row, level) if row else y)
        return np.array(results, dtype=object).view(TracedArray)

    return value_and_rows
