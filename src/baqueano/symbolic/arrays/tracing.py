"""Replace NumPy's constructors of arrays during a trace by functions whose arrays can contain scalars.

`np.array([x, 0.0])` does not call methods of its elements, and `A = np.zeros((3, 3)); A[0, 1] = x` needs an array of
objects. So these names of the module `numpy` are replaced while a trace runs in any thread, and restored afterwards.
For other threads, and for NumPy's code, the functions work as usual.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.array import TracedArray, filled_later
from baqueano.symbolic.arrays.scalar import NUMBERS, Scalar

_JOINED = ("concatenate", "stack", "vstack", "hstack", "column_stack",
           "block", "outer", "tile", "repeat", "atleast_1d", "atleast_2d")  # fmt: skip
_FILLED = ("zeros", "ones", "empty", "full", "eye", "identity", "zeros_like", "ones_like", "empty_like",
           "full_like")  # fmt: skip


_OURS = ("numpy.", "baqueano.symbolic.")  # modules whose calls do not need arrays for scalars


class _TraceContext(threading.local):
    depth = 0  # of traces within traces in this thread


_context = _TraceContext()
_lock = threading.Lock()
_running = 0
_before: dict[str, Value] = {}


@contextmanager
def tracing() -> Iterator[int]:
    """Let new arrays contain scalars within the context; yield the depth of this trace, 1 for the outermost."""
    global _running
    with _lock:
        if _running == 0:
            for name, maker in _MAKERS.items():
                _before[name] = getattr(np, name)
                setattr(np, name, maker)
        _running += 1
    _context.depth += 1
    try:
        with np.errstate(all="ignore"):
            yield _context.depth
    finally:
        _context.depth -= 1
        with _lock:
            _running -= 1
            if _running == 0:
                for name, original in _before.items():
                    setattr(np, name, original)


def _while_traced(original: Callable[..., Value], make: Callable[..., Value]) -> Callable[..., Value]:
    def call(*args: Value, **kwargs: Value) -> Value:
        if not _context.depth or sys._getframe(1).f_globals.get("__name__", "").startswith(_OURS):
            return original(*args, **kwargs)
        return make(original, *args, **kwargs)

    call.__name__, call.__doc__ = original.__name__, original.__doc__
    return call


def _array(original: Callable[..., Value], obj: Value, dtype: Value = None, **kwargs: Value) -> Value:
    return filled_later(_same_array(original, obj, dtype, **kwargs))


def _same_array(original: Callable[..., Value], obj: Value, dtype: Value = None, **kwargs: Value) -> Value:
    if dtype is not None and np.dtype(dtype).kind not in "fO":
        return original(obj, dtype, **kwargs)
    return _join(original, obj, dtype=dtype, **kwargs)


def _join(original: Callable[..., Value], *args: Value, **kwargs: Value) -> Value:
    dtype = kwargs.pop("dtype", None)
    result = original(*args, **kwargs)
    if isinstance(result, np.ndarray) and result.dtype == object:
        numbers = all(isinstance(e, (Scalar, *NUMBERS)) for e in result.ravel().tolist())
        return result.view(TracedArray) if numbers else result
    return result if dtype is None else original(*args, dtype=dtype, **kwargs)


def _fill(original: Callable[..., Value], *args: Value, **kwargs: Value) -> Value:
    return filled_later(_join(original, *args, **kwargs))


_MAKES: dict[str, Callable[..., Value]] = {"array": _array}
_MAKES |= dict.fromkeys(("asarray", "asanyarray", "ascontiguousarray"), _same_array)
_MAKES |= dict.fromkeys(_JOINED, _join) | dict.fromkeys(_FILLED, _fill)
_MAKERS = {name: _while_traced(getattr(np, name), make) for name, make in _MAKES.items()}
