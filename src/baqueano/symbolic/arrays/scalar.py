"""Represent a number while a function is traced or differentiated: a `Node` of a graph, or a `Dual` number.

Both are elements of object arrays and have the operators of Python and NumPy. Only `apply` applies an operator to its
arguments. With floats it computes a float, with nodes a node of their graph, with dual numbers a value and its
derivatives. A truth value is a bool, or a scalar that is 0 or 1.
"""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic import ieee
from baqueano.symbolic.errors import trace_error

NUMBER_TYPES = (float, int, np.number, np.bool_)
ELEMENT_FUNCTIONS: dict[np.ufunc, Callable[..., Value]] = {}  # for one element: elementwise.py


def apply(op: str, *args: Value, value: Value = None) -> Value:
    """Return the result of an operator on floats and scalars. `value` is the table (xp, fp) of interp."""
    highest, level = None, -1
    for a in args:
        if type(a) is not float and isinstance(a, Scalar) and a.level > level:
            highest, level = a, a.level
    if highest is not None:
        return highest.apply(op, args, value)
    return ieee.OPERATORS[op](*args) if value is None else ieee.OPERATORS[op](*args, value)


def power(a: Value, b: Value) -> Value:
    """Return aᵇ; a small integer exponent becomes a chain of multiplications."""
    if isinstance(b, Scalar):
        return apply("pow", a, b)
    if not isinstance(a, Scalar):
        return ieee.OPERATORS["pow"](a, b)
    if b == 0.5:
        return apply("sqrt", a)
    if b != int(b) or abs(b) > 64:
        return apply("pow", a, float(b))
    n, result = int(abs(b)), 1.0
    while n:
        result = result * a if n & 1 else result
        n >>= 1
        a = a * a if n else a
    return result if b >= 0 else 1.0 / result


def quotient(a: Value, b: Value) -> Value:
    """Return ⌊a / b⌋."""
    return apply("floor", apply("div", a, b))


def remainder(a: Value, b: Value) -> Value:
    """Return a − b ⌊a / b⌋, with the sign of b."""
    return a - b * quotient(a, b)


def round_half_even(a: Value) -> Value:
    """Return the nearest integer; for a tie, the even integer."""
    r = apply("floor", a + 0.5)
    tie = apply("and", apply("eq", r - a, 0.5), apply("ne", remainder(r, 2.0), 0.0))
    return r - tie


def truth(op: str, *args: Value) -> Value:
    """Return & | ^ ~ of truth values, by the operators and, or, ne, not. Raise TraceError for the bits of a number."""
    for a in args:
        if not (a.is_truth if isinstance(a, Scalar) else a in (0, 1)):
            raise trace_error("trace.bits")
    return apply(op, *args)


def _binary(op: str, is_swapped: bool = False) -> Callable[[Value, Value], Value]:
    def method(self: Value, other: Value) -> Value:
        if not isinstance(other, OPERANDS):
            return NotImplemented
        return apply(op, other, self) if is_swapped else apply(op, self, other)

    return method


def _infix_method(
    function: Callable[[Value, Value], Value], is_swapped: bool = False
) -> Callable[[Value, Value], Value]:
    def method(self: Value, other: Value) -> Value:
        if not isinstance(other, OPERANDS):
            return NotImplemented
        return function(other, self) if is_swapped else function(self, other)

    return method


def _unary(op: str) -> Callable[[Value], Value]:
    return lambda self: apply(op, self)


class Scalar:
    """A number that behaves as np.float64 does."""

    __slots__ = ()
    __hash__ = object.__hash__
    level = 0  # of derivation: a dual number of an inner derivative has a higher level than one of the outer derivative
    shape, ndim, size = (), 0, 1

    def apply(self, op: str, args: tuple[Value, ...], value: Value) -> Value:
        """Return the result of the operator `op` on `args`, of which this scalar has the highest level."""
        raise NotImplementedError

    __add__, __radd__ = _binary("add"), _binary("add", is_swapped=True)
    __sub__, __rsub__ = _binary("sub"), _binary("sub", is_swapped=True)
    __mul__, __rmul__ = _binary("mul"), _binary("mul", is_swapped=True)
    __truediv__, __rtruediv__ = _binary("div"), _binary("div", is_swapped=True)
    __pow__, __rpow__ = _infix_method(power), _infix_method(power, is_swapped=True)
    __mod__, __rmod__ = _infix_method(remainder), _infix_method(remainder, is_swapped=True)
    __floordiv__, __rfloordiv__ = _infix_method(quotient), _infix_method(quotient, is_swapped=True)
    __lt__, __gt__ = _binary("lt"), _binary("lt", is_swapped=True)
    __le__, __ge__ = _binary("le"), _binary("le", is_swapped=True)
    __eq__, __ne__ = _binary("eq"), _binary("ne")  # pyright: ignore[reportAssignmentType]
    __and__ = _infix_method(partial(truth, "and"))
    __rand__ = _infix_method(partial(truth, "and"), is_swapped=True)
    __or__ = _infix_method(partial(truth, "or"))
    __ror__ = _infix_method(partial(truth, "or"), is_swapped=True)
    __xor__ = _infix_method(partial(truth, "ne"))
    __rxor__ = _infix_method(partial(truth, "ne"), is_swapped=True)
    __neg__, __abs__ = _unary("neg"), _unary("abs")

    def __invert__(self) -> Value:
        return truth("not", self)

    @property
    def is_truth(self) -> bool:
        """Return True for a value that is known to be 0 or 1."""
        return False

    def __pos__(self) -> "Scalar":
        return self

    def __bool__(self) -> bool:
        raise trace_error("trace.decides")

    def _no_float(self) -> Value:
        raise trace_error("trace.needs-float")

    __float__ = __int__ = __complex__ = _no_float

    def __index__(self) -> int:
        raise trace_error("trace.needs-index")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Value, **kwargs: Value) -> Value:
        function = None if kwargs or method != "__call__" else ELEMENT_FUNCTIONS.get(ufunc)
        if function is not None and all(isinstance(x, OPERANDS) for x in inputs):  # without arrays
            return function(*[x.item() if isinstance(x, np.generic) else x for x in inputs])
        from baqueano.symbolic.arrays.array import apply_ufunc

        return apply_ufunc(ufunc, method, inputs, kwargs)

    def __array_function__(
        self, function: Callable[..., Value], types: Iterable[type], args: Value, kwargs: Value
    ) -> Value:
        from baqueano.symbolic.arrays.array import apply_function

        return apply_function(function, args, kwargs)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} at run time>"

    def __format__(self, spec: str) -> str:
        return repr(self)

    @property
    def T(self) -> "Scalar":
        """Return the scalar unchanged, because it does not have axes."""
        return self

    def item(self) -> "Scalar":
        """Return the scalar, as NumPy's item() of one element."""
        return self

    copy = conjugate = item

    def clip(self, low: Value = None, high: Value = None) -> Value:
        """Return np.clip of the scalar."""
        return np.clip(self, low, high)  # pyright: ignore[reportCallIssue, reportArgumentType]

    def reshape(self, *shape: Value) -> Value:
        """Return np.reshape of the scalar."""
        from baqueano.symbolic.arrays.array import as_array

        return as_array(self).reshape(*shape)

    def astype(self, dtype: Value) -> "Scalar":
        """Return the scalar as a float or a truth value. Raise TraceError for an integer type, which rounds."""
        if np.dtype(dtype).kind in "iu":
            raise trace_error("trace.needs-int")  # fmt: skip
        return apply("ne", self, 0.0) if np.dtype(dtype).kind == "b" else self


OPERANDS = (Scalar, *NUMBER_TYPES)
# NumPy calls these methods of the elements if an object array is not a TracedArray.
_METHODS = {"arcsin": "asin", "arccos": "acos", "arctan": "atan"} | {
    name: name for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor")
}
for _name, _op in _METHODS.items():
    setattr(Scalar, _name, _unary(_op))
