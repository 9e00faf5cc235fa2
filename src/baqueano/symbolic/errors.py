"""Raise errors that name the line of the user's code: file, line, the fault, and its replacement."""

import linecache
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType

import numpy as np

from baqueano.contracts.values import Value
from baqueano.errors import DiagnosticError, cell_name

_FOREIGN = (str(Path(__file__).parent), str(Path(np.__file__).parent), "<")  # engine, NumPy, generated code
FANCY_INDEX_TEXT = "arrays used as ind"  # part of a message of NumPy
_CAUSES = (TypeError, ValueError, IndexError, AttributeError, ZeroDivisionError)


class TraceError(DiagnosticError, TypeError, ValueError):
    """The error of a function that cannot be traced; the message names its file and line and a remedy.

    Examples
    --------
    >>> scan = bq.symbolic.scan
    >>> try:
    ...     scan(lambda v, u: (v if v > 0.0 else u, v), 0.0, 0.0).run(np.ones(3))
    ... except TraceError as error:
    ...     print(error.diagnostic.code)
    trace.decides
    """


def trace_error(code: str, **figures: Value) -> TraceError:
    """Return the error with this code, for the innermost running line of the user's code."""
    return TraceError.of(code, place=running_line(), **figures)


def running_line() -> str:
    """Return the innermost running line of the user's code, as 'model.py:36: if x[0] > 0:'."""
    frame = sys._getframe(1)
    while frame is not None:
        if _is_user_code(frame.f_code):
            return _place_text(frame.f_code.co_filename, frame.f_lineno)
        frame = frame.f_back
    return "in a line that could not be found"


@contextmanager
def locate_errors() -> Iterator[None]:
    """Convert an error of NumPy within the context (wrong shapes, a missing method) to a TraceError with its line."""
    try:
        yield
    except TraceError:
        raise
    except _CAUSES as error:
        place_text, step = "", error.__traceback__
        while step is not None:
            if _is_user_code(step.tb_frame.f_code):
                place_text = _place_text(step.tb_frame.f_code.co_filename, step.tb_lineno)
            step = step.tb_next
        if not place_text:
            raise
        code = (
            "trace.index"
            if isinstance(error, IndexError) and FANCY_INDEX_TEXT in str(error)
            else "trace.numpy"
        )
        raise TraceError.of(code, place=place_text, kind=type(error).__name__, error=str(error)) from error


def _is_user_code(code: CodeType) -> bool:
    return not code.co_filename.startswith(_FOREIGN)


def _place_text(path: str, line: int) -> str:
    return f"{cell_name(path) or path}:{line}: {linecache.getline(path, line).strip()}"
