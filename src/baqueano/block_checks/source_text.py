"""Read the text in which a class of the user is written: that of its file, or of a notebook's cell."""

import inspect
import linecache
from types import FunctionType


def is_ours(kind: type) -> bool:
    """Return True if a class comes with the package, whose version every run records."""
    return kind.__module__.partition(".")[0] == "baqueano"


def source_text(kind: type) -> str:
    """Return the text of the file or of the notebook's cell in which a class is written.

    It is "" if Python does not keep it, as for a class that was typed into a terminal.
    """
    file = _file_of(kind)
    linecache.checkcache(file)  # a file may have changed; a notebook keeps its cells
    return "".join(linecache.getlines(file))


def _file_of(kind: type) -> str:
    """Return the name under which Python keeps the text: that of a method, as a notebook's cell is in no file."""
    methods = [method for method in vars(kind).values() if isinstance(method, FunctionType)]
    files = [method.__code__.co_filename for method in methods if method.__module__ == kind.__module__]
    try:
        return next((f for f in files if f != "<string>"), "") or inspect.getsourcefile(kind) or ""
    except (OSError, TypeError):
        return ""
