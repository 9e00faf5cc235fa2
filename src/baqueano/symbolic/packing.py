"""Trees ↔ rows, fast: text made for one shape, for calls that take microseconds.

`tree.values` and `tree.build` do the same, slowly, for any shape; they also say what is wrong with a tree.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from baqueano.symbolic.graph.tree import Branch, Fixed, Leaf, Shape, as_floats, leaves, make, restored, values


class ShapeMismatch(ValueError):
    """A tree has another shape than the one that the text was made for."""


def packer(shapes: Sequence[Shape], row: np.ndarray) -> Callable[..., None]:
    """A function of trees of these shapes that writes their numbers into `row`."""
    space: dict[str, Any] = {"row": row, "ndarray": np.ndarray, "number": _number, "array": _array}
    space |= {"numbers": frozenset((float, int, bool, np.float64, np.int64, np.bool_)), "wrong": _wrong}
    lines: list[str] = []
    at = 0
    for k, shape in enumerate(shapes):
        at = _pack(shape, f"a{k}", at, lines, space)
    arguments = ", ".join(f"a{k}" for k in range(len(shapes)))
    return _made("pack", f"def pack({arguments}):", lines or ["pass"], space)


def unpacker(shape: Shape) -> Callable[[np.ndarray], Any]:
    """A function of a row that builds the tree. Its arrays are parts of the row."""
    space: dict[str, Any] = {"make": make, "new": tuple.__new__, "restored": restored}
    text, _ = _unpack(shape, 0, space)
    return _made("unpack", "def unpack(row):", ["item = row.item", f"return {text}"], space)


def _made(name: str, head: str, lines: Sequence[str], space: dict[str, Any]) -> Callable[..., Any]:
    text = "\n".join([head, *(f"    {line}" for line in lines)])
    exec(compile(text, "<baqueano packing>", "exec"), space)
    return space[name]


def _pack(shape: Shape, name: str, at: int, lines: list[str], space: dict[str, Any]) -> int:
    k = len(space)
    space[f"shape{k}"] = shape
    if isinstance(shape, Fixed):
        space[f"value{k}"] = shape.value
        lines.append(f"if {name} is not value{k}: wrong(shape{k}, {name})")
        return at
    if isinstance(shape, Branch):
        space[f"kind{k}"] = shape.kind
        test = f"{name}.__class__ is not kind{k}"
        if shape.kind in (tuple, list):
            test += f" or len({name}) != {len(shape.keys)}"
        if shape.kind is dict:
            space[f"keys{k}"] = shape.keys
            test += f" or tuple({name}) != keys{k}"
        lines.append(f"if {test}: wrong(shape{k}, {name})")
        for n, (key, child) in enumerate(zip(shape.keys, shape.children, strict=True)):
            part = f"{name}_{n}"
            plain = shape.kind in (tuple, list, dict)
            lines.append(f"{part} = {name}[{key!r}]" if plain else f"{part} = {name}.{key}")
            at = _pack(child, part, at, lines, space)
        return at
    if shape.is_array:
        space[f"place{k}"] = space["row"][at : at + shape.size].reshape(shape.shape)
        space[f"size{k}"] = shape.shape
        lines.append(f"if {name}.__class__ is not ndarray or {name}.shape != size{k}: "
                     f"{name} = array(shape{k}, {name})")  # fmt: skip
        lines.append(f"place{k}[...] = {name}")
    else:
        lines.append(f"if {name}.__class__ not in numbers: {name} = number(shape{k}, {name})")
        lines.append(f"row[{at}] = {name}")
    return at + shape.size


def _unpack(shape: Shape, at: int, space: dict[str, Any]) -> tuple[str, int]:
    k = len(space)
    if isinstance(shape, Fixed):
        space[f"value{k}"] = shape.value
        return f"value{k}", at
    if isinstance(shape, Branch):
        space |= {f"kind{k}": shape.kind, f"keys{k}": shape.keys}
        parts = []
        for child in shape.children:
            text, at = _unpack(child, at, space)
            parts.append(text)
        children = f"({''.join(f'{part}, ' for part in parts)})"
        named = issubclass(shape.kind, tuple) and shape.kind is not tuple
        return (f"new(kind{k}, {children})" if named else f"make(kind{k}, keys{k}, {children})"), at
    return _unpack_leaf(shape, at, space, k), at + shape.size


def _unpack_leaf(leaf: Leaf, at: int, space: dict[str, Any], k: int) -> str:
    if not leaf.is_array:
        return {"f": "item({})", "i": "round(item({}))", "b": "(item({}) != 0.0)"}[leaf.kind].format(at)
    part = f"row[{at}:{at + leaf.size}]"
    part = part if len(leaf.shape) == 1 else f"{part}.reshape({leaf.shape})"
    if leaf.kind == "f":
        return part
    space[f"leaf{k}"] = leaf
    return f"restored(leaf{k}, {part})"


def _number(leaf: Leaf, value: Any) -> float:
    return float(_array(leaf, value))


def _array(leaf: Leaf, value: Any) -> np.ndarray:
    try:
        return as_floats(leaf, value)
    except (ValueError, TypeError) as error:
        raise ShapeMismatch(str(error)) from None


def _wrong(shape: Shape, tree: Any) -> None:
    """Tells what is wrong, if it is: a text may be equal and yet another object."""
    try:
        found = values(shape, tree)
    except ValueError as error:
        raise ShapeMismatch(str(error)) from None
    if len(found) != sum(1 for _ in leaves(shape)):
        raise ShapeMismatch(f"another tree than in the example at {shape.path}")
