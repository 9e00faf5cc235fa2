"""Define arrays of scalars: an ndarray of objects with NumPy's operators and functions.

An element is a `Scalar` or an ordinary number. Operators act element by element (elementwise.py). NumPy's own functions
move elements (concatenate, stack, reshape, …); `_FUNCTIONS` lists the other functions. If an array contains only
numbers, NumPy computes with floats.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays import linalg
from baqueano.symbolic.arrays.elementwise import TRACED_UFUNCS, UFUNCS, WHERE, elementwise
from baqueano.symbolic.arrays.scalar import OPERANDS, Scalar, apply
from baqueano.symbolic.errors import TraceError, trace_error

_EMPTY = np.empty  # also during a trace, which replaces the name in NumPy


class TracedArray(np.ndarray):
    """An array of objects, each a `Scalar` or a number."""

    origin: linalg.Origin | None = None  # the factors of a product, if known

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Value, **kwargs: Value) -> Value:
        return apply_ufunc(ufunc, method, inputs, kwargs)

    def __array_function__(
        self, function: Callable[..., Value], types: Iterable[type], args: Value, kwargs: Value
    ) -> Value:
        return apply_function(function, args, kwargs)

    def __getitem__(self, key: Value) -> Value:
        return super().__getitem__(_key(key))

    def __setitem__(self, key: Value, value: Value) -> None:
        if not self.flags.writeable:
            raise trace_error("trace.argument-changed")
        if isinstance(key, TracedArray) and has_scalars(key):  # x[x < 0] = 0
            key, value = ..., np.where(key, value, self)
        super().__setitem__(_key(key), value)

    @property
    def T(self) -> "TracedArray":
        """Return the transposed array; its origin is transposed too."""
        result = self.transpose()
        result.origin = self.origin and self.origin.transpose()
        return result

    def dot(self, b: Value, out: Value = None) -> Value:
        """Return self @ b."""
        return np.dot(self, b)

    def clip(self, min: Value = None, max: Value = None, out: Value = None, **_: Value) -> Value:
        """Return np.clip of the array."""
        return _clip(self, min, max)

    def round(self, decimals: Value = 0, out: Value = None) -> Value:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return np.round of the array."""
        return _round(self, decimals)

    def astype(self, dtype: Value, *args: Value, **kwargs: Value) -> Value:
        """Return the array in another type: floats stay objects. Raise TraceError for another type of traced values."""
        if np.dtype(dtype).kind in "fO":
            return self.copy()
        if has_scalars(self):
            raise trace_error("trace.not-convertible", dtype=np.dtype(dtype))
        return as_plain_array(self).astype(dtype, *args, **kwargs)


def _key(key: Value) -> Value:
    """Return an index as an ordinary array, as NumPy requires; unchanged if it has scalars, which NumPy rejects."""
    if isinstance(key, tuple):
        return tuple([_key(k) for k in key])
    return as_plain_array(key) if isinstance(key, TracedArray) and not has_scalars(key) else key


def has_scalars(x: Value) -> bool:
    """Return True if `x` is or contains a `Scalar`, whose value is known only at run time."""
    if isinstance(x, np.ndarray):
        if x.dtype.hasobject:
            for entry in x.ravel().tolist():
                if isinstance(entry, Scalar):
                    return True
        return False
    if isinstance(x, list | tuple):
        return any(map(has_scalars, x))
    return isinstance(x, Scalar)


def as_array(x: Value) -> np.ndarray:
    """Return `x` as an ndarray of objects."""
    if isinstance(x, np.ndarray):
        return x.view(np.ndarray) if x.dtype.hasobject else x.astype(object)
    if isinstance(x, list | tuple):
        return np.asarray(x, dtype=object).view(np.ndarray)
    array = _EMPTY((), dtype=object)
    array[()] = x.item() if isinstance(x, np.generic) else x
    return array


def as_traced(x: Value) -> Value:
    """Return an object array of NumPy as a TracedArray; an array without axes becomes its only element."""
    if isinstance(x, np.ndarray) and x.dtype == object:
        return x.view(TracedArray) if x.ndim else x.item()
    return type(x)([as_traced(e) for e in x]) if type(x) in (list, tuple) else x


def as_plain_array(x: Value) -> Value:
    """Return `x`, which must not contain scalars, as an ordinary array of NumPy."""
    if isinstance(x, TracedArray):
        return np.array(x.tolist()) if x.size else np.zeros(x.shape)
    return type(x)([as_plain_array(e) for e in x]) if type(x) in (list, tuple) else x


def as_fillable(x: Value) -> Value:
    """Return an array of floats as a TracedArray, which can receive scalars; any other value unchanged."""
    if isinstance(x, np.ndarray) and x.dtype.kind == "f" and x.ndim:
        return x.astype(object).view(TracedArray)
    return x


def apply_ufunc(ufunc: np.ufunc, method: str, inputs: tuple[Value, ...], kwargs: dict[str, Value]) -> Value:
    """Return the result of an operator or elementwise function of NumPy. Raise TraceError for an unknown function."""
    if not kwargs and method == "__call__" and ufunc in TRACED_UFUNCS and any(map(has_scalars, inputs)):
        result = as_traced(TRACED_UFUNCS[ufunc](*map(as_array, inputs)))
        if ufunc is np.subtract:
            linalg.store_complement(result, *inputs)
        return result
    target = kwargs.pop("out", (None,))[0]
    if not any(map(has_scalars, inputs)):
        result = as_fillable(getattr(ufunc, method)(*map(as_plain_array, inputs), **kwargs))
    elif ufunc is np.matmul:
        result = linalg.matmul(*inputs)
    elif ufunc.__name__ not in UFUNCS:
        names = ", ".join(sorted(UFUNCS))
        raise trace_error("trace.unknown-ufunc", function=ufunc.__name__, valid=names)
    else:
        options = {k: v for k, v in kwargs.items() if v is not None and k not in ("dtype", "casting")}
        if "axis" in kwargs:
            options["axis"] = kwargs["axis"]
        result = as_traced(getattr(UFUNCS[ufunc.__name__], method)(*map(as_array, inputs), **options))
        if ufunc is np.subtract and method == "__call__":
            linalg.store_complement(result, *inputs)
    if target is None:
        return result
    if not target.flags.writeable:
        raise trace_error("trace.argument-changed")
    target[...] = result
    return target


def apply_function(function: Callable[..., Value], args: Sequence[Value], kwargs: dict[str, Value]) -> Value:
    """Return the result of a NumPy function that is not elementwise. Raise TraceError if it does not accept scalars."""
    if function in _IN_PLACE:
        return _original(function)(*args, **kwargs)
    if not has_scalars([*args, *kwargs.values()]):
        return as_fillable(
            function(*as_plain_array(tuple(args)), **{k: as_plain_array(v) for k, v in kwargs.items()})
        )
    if function in _FUNCTIONS:
        return _FUNCTIONS[function](*args, **kwargs)
    try:
        return as_traced(_original(function)(*args, **kwargs))
    except TraceError:
        raise
    except (TypeError, AttributeError, NotImplementedError) as error:
        raise trace_error("trace.unsupported", function=function.__name__, error=error) from error


def _original(function: Callable[..., Value]) -> Callable[..., Value]:
    return getattr(function, "_implementation", function)


def where(condition: Value, a: Value, b: Value) -> Value:
    """Return np.where(condition, a, b), even for arrays of `from numpy import array` while a step is traced.

    Parameters
    ----------
    condition : bool or ndarray (any shape)
        True for the entries of `a`.
    a, b : float or ndarray (any shape)
        Values of shapes that broadcast [any unit].

    Returns
    -------
    float or ndarray
        The chosen entries [unit of a and b].

    Examples
    --------
    >>> where(np.array([True, False]), 1.0, 2.0)
    array([1., 2.])
    """
    if not has_scalars((condition, a, b)):
        return np.where(condition, a, b)
    return _where(condition, a, b)


def interp(x: Value, xp: Value, fp: Value) -> Value:
    """Return np.interp(x, xp, fp), even for arrays of `from numpy import array` while a step is traced.

    Parameters
    ----------
    x : float or ndarray (any shape)
        The points of interpolation [any unit].
    xp : ndarray (m,)
        Abscissae of the table, increasing [unit of x].
    fp : ndarray (m,)
        Values of the table [any unit]; the end values are used outside its range.

    Returns
    -------
    float or ndarray
        Interpolated values, in the shape of x [unit of fp].

    Examples
    --------
    >>> print(interp(0.5, np.array([0.0, 1.0]), np.array([2.0, 4.0])))
    3.0
    """
    return _interp(x, xp, fp) if has_scalars((x, xp, fp)) else np.interp(x, xp, fp)


def _where(condition: Value, *arms: Value) -> Value:
    if len(arms) != 2:
        raise trace_error("trace.where-arms")
    operands = condition, *arms
    if all(isinstance(x, OPERANDS) for x in operands):  # without arrays
        return apply("where", *[x.item() if isinstance(x, np.generic) else x for x in operands])
    return as_traced(WHERE(*map(as_array, operands)))


def _clip(
    x: Value, a_min: Value = None, a_max: Value = None, *, min: Value = None, max: Value = None, **_: Value
) -> Value:
    low, high = a_min if min is None else min, a_max if max is None else max
    x = x if low is None else np.maximum(x, low)
    return x if high is None else np.minimum(x, high)


def _round(x: Value, decimals: int = 0, out: None = None) -> Value:
    return np.rint(x) if decimals == 0 else np.rint(x * 10.0**decimals) / 10.0**decimals


def _interp(
    x: Value, xp: Value, fp: Value, left: Value = None, right: Value = None, period: None = None
) -> Value:
    if period is not None:
        raise trace_error("trace.interp-period")
    table = (
        None if has_scalars([xp, fp]) else tuple(np.asarray(as_plain_array(t), dtype=float) for t in (xp, fp))
    )

    def read(x: Value) -> Value:
        y = _ramp_interpolation(x, xp, fp) if table is None else apply("interp", x, value=table)
        y = y if left is None else apply("where", apply("lt", x, xp[0]), left, y)
        return y if right is None else apply("where", apply("lt", xp[-1], x), right, y)

    return as_traced(elementwise(read)(as_array(x)))


def _ramp_interpolation(x: Value, xp: Value, fp: Value) -> Value:
    """Return the interpolation in a table known only at run time, as a sum of ramps.

    Raise TraceError for a table of more than 100 points.
    """
    if len(xp) > 100:
        raise trace_error("trace.interp-points", points=len(xp))
    y = fp[0]
    for j in range(len(xp) - 1):
        fraction = apply("div", x - xp[j], xp[j + 1] - xp[j])
        y = y + (fp[j + 1] - fp[j]) * apply("min", apply("max", fraction, 0.0), 1.0)
    return y


def _select(conditions: Sequence[Value], choices: Sequence[Value], default: Value = 0) -> Value:
    for condition, choice in zip(reversed(conditions), reversed(choices), strict=True):
        default = np.where(condition, choice, default)
    return default


def _diag(v: Value, k: int = 0) -> Value:
    v = as_array(v)
    if v.ndim == 2:
        return as_traced(np.diagonal(v, k).copy())
    n = len(v) + abs(k)
    matrix = np.full((n, n), 0.0, dtype=object)
    matrix[np.arange(len(v)) + max(-k, 0), np.arange(len(v)) + max(k, 0)] = v
    return as_traced(matrix)


def _full_like(x: Value, value: Value, *_: Value, **__: Value) -> TracedArray:
    return np.broadcast_to(as_array(value), np.shape(x)).copy().view(TracedArray)


def _filled_like(value: float) -> Callable[..., Value]:
    return lambda x, *_, **__: _full_like(x, value)


_IN_PLACE = (np.copyto, np.fill_diagonal, np.put)
_FUNCTIONS: dict[Callable[..., Value], Callable[..., Value]] = {
    np.where: _where,
    np.clip: _clip,
    np.round: _round,
    np.interp: _interp,
    np.select: _select,
    np.diag: _diag,
    np.zeros_like: _filled_like(0.0),
    np.empty_like: _filled_like(0.0),
    np.ones_like: _filled_like(1.0),
    np.full_like: _full_like,
    np.dot: linalg.dot,
    np.linalg.solve: linalg.solve,
    np.linalg.inv: linalg.inv,
    np.linalg.det: linalg.det,
    np.linalg.norm: linalg.norm,
    np.isclose: lambda a, b, rtol=1e-5, atol=1e-8, **_: np.abs(a - b) <= atol + rtol * np.abs(b),
}
