"""Errors that point at the user's own line."""

import linecache
import sys
from pathlib import Path

_ENGINE = str(Path(__file__).parent)
ADVICE = "write np.where(condition, a, b), np.clip, np.maximum or np.abs instead"


class TraceError(TypeError):
    """The text of a block can't be traced; the message names its file and line and what to write."""


def users_line() -> str:
    """'model.py, line 36: `if x[0] > 0:`' of the innermost frame outside the engine and NumPy."""
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_code.co_filename
        if not name.startswith((_ENGINE, "<")) and f"{'numpy'}" not in Path(name).parts:
            text = linecache.getline(name, frame.f_lineno).strip()
            return f"{name}, line {frame.f_lineno}: `{text}`"
        frame = frame.f_back
    return "a line that could not be found"
