"""Read the source text of a class of the user, from a file or from a cell of a notebook."""

import inspect
import linecache
from types import CodeType, FunctionType

from baqueano.errors import GENERATED_CODE


def is_in_package(block_class: type) -> bool:
    """Return True if a class is part of the package, whose version every run records."""
    return block_class.__module__.partition(".")[0] == "baqueano"


def source_text(block_class: type) -> str:
    """Return the text of the file or of the notebook's cell in which a class is written.

    Return "" if Python does not store the text, for example if the class was typed in a terminal.
    """
    file = _source_file(block_class)
    linecache.checkcache(file)  # a file can have changed; the cells of a notebook are stored
    return "".join(linecache.getlines(file))


def _source_file(block_class: type) -> str:
    """Return the file name under which Python stores the text of a class; "" if Python does not store the text.

    This is the file name of a method of the class, because a cell of a notebook is not in a file.
    """
    code = method_code(block_class)
    try:
        return code.co_filename if code else inspect.getsourcefile(block_class) or ""
    except (OSError, TypeError):
        return ""


def method_code(block_class: object) -> CodeType | None:
    """Return the code of the first method that is written in a class, or None; a dataclass also has generated ones."""
    methods = [m for m in getattr(block_class, "__dict__", {}).values() if isinstance(m, FunctionType)]
    module = getattr(block_class, "__module__", "")
    codes = [method.__code__ for method in methods if method.__module__ == module]
    return next((code for code in codes if code.co_filename != GENERATED_CODE), None)
