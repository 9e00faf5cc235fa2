"""What a block's file may not do: read a clock, a file, a random number; print. Read from its syntax."""

import ast
import inspect
from pathlib import Path
from typing import Any

DOORS = {
    "time": "time comes with the signal: seconds(tick.t_ns, belief.t_ns)",
    "datetime": "time comes with the signal: seconds(tick.t_ns, belief.t_ns)",
    "random": "noise comes from outside, drawn from the seed of the run",
    "secrets": "noise comes from outside, drawn from the seed of the run",
    "os": "a block knows no files and no machine; parameters come from the vehicle file",
    "io": "a block knows no files; parameters come from the vehicle file",
    "pathlib": "a block knows no files; parameters come from the vehicle file",
    "socket": "a block talks to nobody; what it is told comes with the tick",
    "threading": "a block has no life of its own; step() is called at every tick",
    "subprocess": "a block starts nothing",
}
CALLS = {
    "print": "a block prints nothing; what it says goes into its output",
    "open": "a block opens no file; parameters come from the vehicle file",
    "input": "a block asks nobody",
}


def place(kind: Any) -> str:
    """ "my_controller.py line 12": where a class or function is written."""
    try:
        return f"{Path(inspect.getfile(kind)).name} line {inspect.getsourcelines(kind)[1]}"
    except (OSError, TypeError):
        return getattr(kind, "__name__", str(kind))


def doors(kind: type) -> list[str]:
    """A sentence for each door to the outside in the file of a class."""
    try:
        file = Path(inspect.getfile(kind))
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except (OSError, TypeError, SyntaxError):
        return []
    found = []
    for node in ast.walk(tree):
        found += [f"{file.name} line {getattr(node, 'lineno', 0)} {what}." for what in _through(node)]
    return list(dict.fromkeys(found))


def _through(node: ast.AST) -> list[str]:
    """What a node of the tree does that it may not."""
    if isinstance(node, ast.Import):
        names = [alias.name.split(".")[0] for alias in node.names]
        return [f"imports {n}: {DOORS[n]}" for n in names if n in DOORS]
    if isinstance(node, ast.ImportFrom):
        name = (node.module or "").split(".")[0]
        return [f"imports {name}: {DOORS[name]}"] if name in DOORS else []
    if isinstance(node, ast.Attribute) and node.attr == "random" and _is_numpy(node.value):
        return [f"uses numpy's random numbers: {DOORS['random']}"]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CALLS:
        return [f"calls {node.func.id}(): {CALLS[node.func.id]}"]
    if isinstance(node, ast.Global):
        return [f"writes the global {', '.join(node.names)}: what is remembered goes into the state"]
    return []


def _is_numpy(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id in ("np", "numpy")
