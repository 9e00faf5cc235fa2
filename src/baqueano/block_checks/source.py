"""Find forbidden calls in the syntax tree of a block's file: clocks, files, random numbers, print; decimal commas."""

import ast
import inspect
from pathlib import Path
from typing import Any

from baqueano.block_checks.source_text import method_code
from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import cell_name
from baqueano.messages.language import translate as _

OUTSIDE_MODULES = {  # forbidden module → replacement
    "time": note("outside.time"), "datetime": note("outside.time"),
    "random": note("outside.random"), "secrets": note("outside.random"),
    "os": note("outside.machine"), "io": note("outside.files"), "pathlib": note("outside.files"),
    "socket": note("outside.talks"), "threading": note("outside.threads"), "subprocess": note("outside.starts"),
}  # fmt: skip
OUTSIDE_CALLS = {
    "print": note("outside.prints"),
    "open": note("outside.files"),
    "input": note("outside.input"),
}


def place(code_object: Any) -> str:
    """Return the file or the cell and the line of a class or function, as "my_controller.py line 12"."""
    try:
        return location_text(inspect.getfile(code_object), inspect.getsourcelines(code_object)[1])
    except (OSError, TypeError):
        code = method_code(code_object)
        if code is not None and cell_name(code.co_filename):
            return location_text(code.co_filename, code.co_firstlineno)
        return getattr(code_object, "__name__", str(code_object))


def method_place(block_class: type, method_name: str) -> str:
    """Return the place of a method, or that of its class if it inherits the method or does not have it."""
    method = getattr(block_class, method_name, block_class)
    return place(method if getattr(method, "__module__", "") == block_class.__module__ else block_class)


def location_text(file: Path | str, line: int) -> str:
    """Return a line of a file, or of a cell of a notebook, as text in the current language."""
    return _("{file} line {line}", file=cell_name(str(file)) or Path(file).name, line=str(line))


def outside_accesses(block_class: type) -> list[Diagnostic]:
    """Return a diagnostic for each forbidden access in the file of a class: clocks, files, random numbers, print.

    A script or a notebook also does other work, so there only the text of the class itself is examined.
    """
    try:
        file = Path(inspect.getfile(block_class))
        tree = ast.parse(file.read_bytes())
    except (OSError, TypeError, SyntaxError):
        return []
    if block_class.__module__ == "__main__":
        classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
        tree = ast.Module([node for node in classes if node.name == block_class.__name__], [])
    faults = [
        fault(
            f"outside.{door}",
            subject=block_class.__name__,
            place=location_text(file, line),
            name=name,
            advice=advice,
        )
        for node in ast.walk(tree)
        for line, door, name, advice in _forbidden_accesses(node)
    ]
    return list(dict.fromkeys(faults))


def _forbidden_accesses(node: ast.AST) -> list[tuple[int, str, str, Diagnostic]]:
    """Return line, kind of access, name and replacement for each forbidden access in a node."""
    if isinstance(node, ast.Import):
        names = [alias.name.split(".")[0] for alias in node.names]
        return [(node.lineno, "imports", n, OUTSIDE_MODULES[n]) for n in names if n in OUTSIDE_MODULES]
    if isinstance(node, ast.ImportFrom):
        name = (node.module or "").split(".")[0]
        return [(node.lineno, "imports", name, OUTSIDE_MODULES[name])] if name in OUTSIDE_MODULES else []
    if isinstance(node, ast.Attribute) and ast.unparse(node) in ("np.random", "numpy.random"):
        return [(node.lineno, "draws", "numpy.random", OUTSIDE_MODULES["random"])]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in OUTSIDE_CALLS:
        return [(node.lineno, "calls", node.func.id, OUTSIDE_CALLS[node.func.id])]
    if isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) == "float":
        match node.value:
            case ast.Tuple([ast.Constant(int() as whole), ast.Constant(int() as digits)]):
                advice = note("outside.decimal", value=f"{whole}.{digits}")
                return [(node.lineno, "comma", ast.unparse(node.target), advice)]
    if isinstance(node, ast.Global):
        return [(node.lineno, "global", ", ".join(node.names), note("outside.state"))]
    return []
