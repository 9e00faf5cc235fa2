"""Replace NumPy's constructors of arrays during a trace by functions whose arrays can contain scalars.

`np.array([x, 0.0])` does not call methods of its elements, and `A = np.zeros((3, 3)); A[0, 1] = x` needs an array of
objects. So these names of the module `numpy` are replaced while a trace runs in any thread, and restored afterwards.
For other threads, and for NumPy's code, the functions work as usual.
"""

import builtins
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dis import get_instructions
from functools import lru_cache
from types import CodeType, FrameType

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.array import TracedArray, as_fillable
from baqueano.symbolic.arrays.scalar import OPERANDS
from baqueano.symbolic.errors import trace_error

_JOINING_FUNCTIONS = ("concatenate", "stack", "vstack", "hstack", "column_stack",
           "block", "outer", "tile", "repeat", "atleast_1d", "atleast_2d")  # fmt: skip
_FILLING_FUNCTIONS = ("zeros", "ones", "empty", "full", "eye", "identity", "zeros_like", "ones_like", "empty_like",
           "full_like")  # fmt: skip


_OWN_MODULES = ("numpy.", "baqueano.symbolic.")  # modules whose calls do not need arrays for scalars


class _TraceContext(threading.local):
    depth = 0  # number of nested traces in this thread


_context = _TraceContext()
_lock = threading.Lock()
_running_count = 0
_original_functions: dict[str, Value] = {}
_original_print = print


@contextmanager
def tracing() -> Iterator[int]:
    """Let new arrays contain scalars within the context; yield the depth of this trace, 1 for the outermost."""
    global _running_count, _original_print
    with _lock:
        if _running_count == 0:
            for name, maker in _TRACED_MAKERS.items():
                _original_functions[name] = getattr(np, name)
                setattr(np, name, maker)
            _original_print, builtins.print = print, _print_outside
        _running_count += 1
    _context.depth += 1
    try:
        with np.errstate(all="ignore"):
            yield _context.depth
    finally:
        _context.depth -= 1
        with _lock:
            _running_count -= 1
            if _running_count == 0:
                builtins.print = _original_print
                for name, original in _original_functions.items():
                    setattr(np, name, original)


def _print_outside(*args: Value, **kwargs: Value) -> None:
    """Print, but not from a function that is traced: it would print once, instead of at each step."""
    if _context.depth:
        raise trace_error("trace.prints")
    _original_print(*args, **kwargs)


def _while_traced(original: Callable[..., Value], make: Callable[..., Value]) -> Callable[..., Value]:
    def call(*args: Value, **kwargs: Value) -> Value:
        if _context.depth and _is_called_by(sys._getframe(1), original.__name__):
            return make(original, *args, **kwargs)
        return original(*args, **kwargs)

    call.__name__, call.__doc__ = original.__name__, original.__doc__
    return call


def _is_called_by(frame: FrameType, name: str) -> bool:
    """Return True if the code of this frame calls the function of this name and can receive scalars. Compiled code,
    such as that of `numpy.random`, does not have a frame. It writes floats into the array.
    """
    if frame.f_globals.get("__name__", "").startswith(_OWN_MODULES):
        return False
    names = _called_names(frame)
    values = (frame.f_locals.get(x, frame.f_globals.get(x)) for x in names)
    return name in names or any(getattr(value, "__name__", None) == name for value in values)


def _called_names(frame: FrameType) -> set[str]:
    """Return the names in the expression of the function that the code of this frame calls."""
    starts, names = _expression_names(frame.f_code)
    return names[starts[frame.f_lasti // 2]]


@lru_cache(1_000)
def _expression_names(code: CodeType) -> tuple[list[tuple], dict[tuple, set[str]]]:
    """Return the start (line, column) of the expression of each instruction, and the names that begin there."""
    starts, names = [position[::2] for position in code.co_positions()], defaultdict(set)
    for instruction in get_instructions(code):
        if isinstance(instruction.argval, str):
            names[starts[instruction.offset // 2]].add(instruction.argval)
    return starts, names


def _array(original: Callable[..., Value], obj: Value, dtype: Value = None, **kwargs: Value) -> Value:
    return as_fillable(_same_array(original, obj, dtype, **kwargs))


def _same_array(original: Callable[..., Value], obj: Value, dtype: Value = None, **kwargs: Value) -> Value:
    if dtype is not None and np.dtype(dtype).kind not in "fO":
        return original(obj, dtype, **kwargs)
    return _join(original, obj, dtype=dtype, **kwargs)


def _join(original: Callable[..., Value], *args: Value, **kwargs: Value) -> Value:
    dtype = kwargs.pop("dtype", None)
    result = original(*args, **kwargs)
    if isinstance(result, np.ndarray) and result.dtype.hasobject:
        all_scalars = all(isinstance(e, OPERANDS) for e in result.ravel().tolist())
        return result.view(TracedArray) if all_scalars else result
    return result if dtype is None else original(*args, dtype=dtype, **kwargs)


def _fill(original: Callable[..., Value], *args: Value, **kwargs: Value) -> Value:
    return as_fillable(_join(original, *args, **kwargs))


_ARRAY_MAKERS: dict[str, Callable[..., Value]] = {"array": _array}
_ARRAY_MAKERS |= dict.fromkeys(("asarray", "asanyarray", "ascontiguousarray"), _same_array)
_ARRAY_MAKERS |= dict.fromkeys(_JOINING_FUNCTIONS, _join) | dict.fromkeys(_FILLING_FUNCTIONS, _fill)
_TRACED_MAKERS = {name: _while_traced(getattr(np, name), make) for name, make in _ARRAY_MAKERS.items()}
