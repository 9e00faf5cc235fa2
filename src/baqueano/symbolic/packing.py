"""Convert trees to rows and back fast, with code generated for one shape, for calls that take microseconds.

`tree.values` and `tree.build` do the same for any shape, but slowly; they also report the errors of a tree.

The state that a step returned is usually the state of its next call. Its arrays are parts of the row that the kernel
filled. Then that row is copied as a whole, with the present content of those arrays.
"""

import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from types import CodeType

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid, error_cause
from baqueano.symbolic.graph.tree import (
    Branch,
    ConstantLeaf,
    Leaf,
    Shape,
    as_floats,
    build,
    leaves,
    make,
    restore,
    size,
    values,
)


class ShapeMismatch(Invalid):
    """The error of a tree whose shape differs from the shape of the generated code."""


def tree_function(
    shapes: Sequence[Shape],
    row: np.ndarray,
    run: Callable[[], object],
    general: Callable[[], object],
    result: np.ndarray,
    shape: Shape,
) -> Callable[..., Tree]:
    """Return a function of trees of these `shapes`, which returns a tree of `shape`.

    The function writes the values of its arguments into `row`, calls `run`, and builds the tree from `result`. If `run`
    returns True, the function calls `general` to fill `result`.
    """
    space: dict[str, Tree] = {
        "row": row, "cells": row.data, "run": run, "general": general, "result": result,
        "lock": threading.Lock(),
        "ndarray": np.ndarray, "number": _scalar_value, "array": _array, "wrong": _check_shape,
        "numbers": frozenset((float, int, bool, np.float64, np.int64, np.bool_)),
        "make": make, "new": tuple.__new__, "restore": restore, "asarray": np.asarray,
    }  # fmt: skip
    packs, offset = [], 0
    for k, input_shape in enumerate(shapes):
        lines: list[str] = []
        offset = _pack(input_shape, f"a{k}", offset, lines, space)
        packs.append(lines)
    state, count = updatable_state(shapes, shape), size(shapes[0]) if shapes else 0
    if state is not None:
        space |= {"last": [(object(), None)], "front": row[:count]}
        constants = [
            "state, numbers_of_it = last[0]",
            "if a0 is state:",
            "    front[...] = numbers_of_it",
            "else:",
        ]
        packs[0] = [*constants, *(f"    {line}" for line in packs[0])]
    body = [line for lines in packs for line in lines]
    head = f"def call({', '.join(f'a{k}' for k in range(len(shapes)))}):"
    text = [
        head,
        "    with lock:",
        *(f"        {line}" for line in [*body, "if run(): general()", "row = result.copy()"]),
    ]
    text += [f"    {line}" for line in _unpack(shape, state, count, space)]
    exec(_code("\n".join(text)), space)
    return space["call"]


@lru_cache(256)
def _code(text: str) -> CodeType:
    """Return the code of a text. Blocks of equal shapes have the same text."""
    return compile(text, "<baqueano packing>", "exec")


def updatable_state(shapes: Sequence[Shape], shape: Shape) -> Shape | None:
    """Return the first output if it has the shape of the first argument and only its values can change; else None."""
    if not shapes or not isinstance(shape, Branch) or shape.kind is not tuple or not shape.children:
        return None
    first = shape.children[0]
    return first if _is_fixed(first) and size(first) and _are_alike(first, shapes[0]) else None


def _is_fixed(shape: Shape) -> bool:
    """Return True if a tree of this shape can change only in its arrays, which are parts of a row."""
    if isinstance(shape, Branch):
        return issubclass(shape.kind, tuple) and all(map(_is_fixed, shape.children))
    return isinstance(shape, ConstantLeaf) or not shape.is_array or (shape.kind == "f" and shape.shape != ())


def _are_alike(a: Shape, b: Shape) -> bool:
    """Return True if two shapes differ at most in the paths and the kinds of their numbers."""
    if isinstance(a, Branch):
        if not isinstance(b, Branch) or (a.kind, a.keys) != (b.kind, b.keys):
            return False
        return all(map(_are_alike, a.children, b.children))
    if isinstance(a, Leaf):
        return isinstance(b, Leaf) and (a.shape, a.is_array) == (b.shape, b.is_array)
    return isinstance(b, ConstantLeaf) and a.value is b.value


def _pack(shape: Shape, name: str, offset: int, lines: list[str], space: dict[str, Tree]) -> int:
    k = len(space)
    space[f"shape{k}"] = shape
    if isinstance(shape, ConstantLeaf):
        space[f"value{k}"] = shape.value
        lines.append(f"if {name} is not value{k}: wrong(shape{k}, {name})")
        return offset
    if isinstance(shape, Branch):
        space[f"kind{k}"] = shape.kind
        test = f"{name}.__class__ is not kind{k}"
        if shape.kind in (tuple, list):
            test += f" or len({name}) != {len(shape.keys)}"
        if shape.kind is dict:
            space[f"keys{k}"] = shape.keys
            test += f" or tuple({name}) != keys{k}"
        lines.append(f"if {test}: wrong(shape{k}, {name})")
        child_names = [f"{name}_{n}" for n in range(len(shape.keys))]
        if issubclass(shape.kind, tuple) and child_names:
            lines.append(f"{', '.join(child_names)}, = {name}")
        for child_name, key, child in zip(child_names, shape.keys, shape.children, strict=True):
            if not issubclass(shape.kind, tuple):
                is_plain = shape.kind in (list, dict)
                lines.append(
                    f"{child_name} = {name}[{key!r}]" if is_plain else f"{child_name} = {name}.{key}"
                )
            offset = _pack(child, child_name, offset, lines, space)
        return offset
    if shape.is_array:
        space[f"place{k}"] = space["row"][offset : offset + shape.size].reshape(shape.shape)
        space[f"size{k}"] = shape.shape
        lines.append(f"if {name}.__class__ is not ndarray or {name}.shape != size{k}: "
                     f"{name} = array(shape{k}, {name})")  # fmt: skip
        if shape.size:
            lines.append(f"place{k}[...] = {name}")
    else:
        lines.append(f"if {name}.__class__ not in numbers: {name} = number(shape{k}, {name})")
        lines.append(f"cells[{offset}] = {name}")
    return offset + shape.size


def _unpack(shape: Shape, state: Shape | None, count: int, space: dict[str, Tree]) -> list[str]:
    """Return the lines of code that convert a row to a tree. NumPy splits the row in one call, as a record."""
    names = [f"x{k}" for k, _ in enumerate(leaves(shape))]
    fields = {name: leaf for name, leaf in zip(names, leaves(shape), strict=True) if leaf.size}
    space["record"] = np.dtype([(name, "f8", leaf.shape) for name, leaf in fields.items()])
    # an array without entries cannot change, so all results share it
    space |= {
        name: np.zeros(leaf.shape) for name, leaf in zip(names, leaves(shape), strict=True) if not leaf.size
    }
    lines = [f"{''.join(f'{name}, ' for name in fields)}= ndarray((), record, row).item()"] if fields else []
    if state is None or not isinstance(shape, Branch):
        return [*lines, f"return {_tree(shape, iter(names), space)}"]
    unused_names = iter(names)
    first, *remaining = (_tree(child, unused_names, space) for child in shape.children)
    lines += [f"state = {first}", f"last[0] = state, row[:{count}]"]
    return [*lines, f"return (state, {''.join(f'{text}, ' for text in remaining)})"]


def _tree(shape: Shape, names: Tree, space: dict[str, Tree]) -> str:
    """Return the code that builds the tree from variables, one for each leaf."""
    k = len(space)
    if isinstance(shape, ConstantLeaf):
        space[f"value{k}"] = shape.value
        return f"value{k}"
    if isinstance(shape, Leaf):
        return _leaf(shape, next(names), k, space)
    if not size(shape) and _is_fixed(shape):  # it cannot change, so all results share it
        space[f"value{k}"] = build(shape, (space[next(names)] for _ in leaves(shape)))
        return f"value{k}"
    space |= {f"kind{k}": shape.kind, f"keys{k}": shape.keys}
    children = f"({''.join(f'{_tree(child, names, space)}, ' for child in shape.children)})"
    if shape.kind is tuple:
        return children
    is_tuple = issubclass(shape.kind, tuple)
    return f"new(kind{k}, {children})" if is_tuple else f"make(kind{k}, keys{k}, {children})"


def _leaf(leaf: Leaf, name: str, k: int, space: dict[str, Tree]) -> str:
    if leaf.shape == ():
        real_text = f"asarray({name})" if leaf.is_array else name
        return {"f": real_text, "i": f"round({name})", "b": f"({name} != 0.0)"}[leaf.kind]
    if leaf.kind == "f":
        return name
    space[f"leaf{k}"] = leaf
    return f"restore(leaf{k}, {name})"


def _scalar_value(leaf: Leaf, value: Tree) -> float:
    return float(_array(leaf, value))


def _array(leaf: Leaf, value: Tree) -> np.ndarray:
    try:
        return as_floats(leaf, value)
    except (ValueError, TypeError) as error:
        raise ShapeMismatch(error_cause(error)) from None


def _check_shape(shape: Shape, tree: Tree) -> None:
    """Raise ShapeMismatch if the tree does not have this shape. An equal text is accepted, even as another object."""
    try:
        entries = values(shape, tree)
    except ValueError as error:
        raise ShapeMismatch(error_cause(error)) from None
    if len(entries) != sum(1 for _ in leaves(shape)):
        raise ShapeMismatch.of("tree.another", path=shape.path)
