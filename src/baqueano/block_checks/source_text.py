"""Read the source text of a class of the user, from a file or from a cell of a notebook."""

import inspect
import linecache
from types import FunctionType


def is_ours(block_class: type) -> bool:
    """Return True if a class is part of the package, whose version every run records."""
    return block_class.__module__.partition(".")[0] == "baqueano"


def source_text(block_class: type) -> str:
    """Return the text of the file or of the notebook's cell in which a class is written.

    Return "" if Python does not store the text, for example if the class was typed in a terminal.
    """
    file = _file_of(block_class)
    linecache.checkcache(file)  # a file can have changed; the cells of a notebook are stored
    return "".join(linecache.getlines(file))


def _file_of(block_class: type) -> str:
    """Return the file name under which Python stores the text of a class; "" if Python does not store the text.

    This is the file name of a method of the class, because a cell of a notebook is not in a file.
    """
    methods = [method for method in vars(block_class).values() if isinstance(method, FunctionType)]
    files = [method.__code__.co_filename for method in methods if method.__module__ == block_class.__module__]
    try:
        return next((f for f in files if f != "<string>"), "") or inspect.getsourcefile(block_class) or ""
    except (OSError, TypeError):
        return ""
