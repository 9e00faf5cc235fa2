"""Syntax trees of the code: each file is parsed once."""

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "baqueano"


@cache
def python_files(folder: Path) -> tuple[Path, ...]:
    """Return the modules below a folder, in the order of their names."""
    return tuple(sorted(folder.rglob("*.py")))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """Return all nodes of a file, the module first. No test may change them."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def function_name(call: ast.Call) -> str:
    """Return the dotted name of the function that is called, such as `np.array`; `.of` for `get(x).of(y)`."""
    names, node = [], call.func
    while isinstance(node, ast.Attribute):
        names.append(node.attr)
        node = node.value
    names.append(node.id if isinstance(node, ast.Name) else "")
    return ".".join(reversed(names))
