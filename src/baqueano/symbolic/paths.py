"""Read and replace values in a tree by dotted paths.

Examples are `value_at_path(robot, "friction.linear[0]")` and `with_value(robot, "model.T[0,2]", x)`. A name is a field
of a dataclass or NamedTuple, an attribute of any other object, or a key of a dict; an index is in brackets.
`with_value` and `with_values` copy the objects on the path. They do not call `__post_init__`, because its checks
would be `if`s on values known only at run time.
"""

import dataclasses
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import TypeVar

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import nearest
from baqueano.errors import DiagnosticError, Invalid
from baqueano.symbolic.arrays.array import as_fillable, has_scalars

TreeType = TypeVar("TreeType")


class NoSuchName(DiagnosticError, AttributeError):
    """The error of a path that names a missing field or key."""


_STEP = re.compile(r"\.?([^.\[\]]+)|\[([^\]]*)\]")


def value_at_path(tree: Tree, path: str) -> Tree:
    """Return the value at `path`. Raise NoSuchName for a missing field, and Invalid if `path` cannot be parsed."""
    for step in _steps(path):
        tree = _child(tree, step, path)
    return tree


def with_value(tree: TreeType, path: str, value: Tree) -> TreeType:
    """Return a copy of `tree` with `value` at `path`. Raise Invalid if the old value has another shape."""
    return with_values(tree, [(path, value)])


def with_values(tree: TreeType, values: Iterable[tuple[str, Tree]]) -> TreeType:
    """Return a copy of `tree` with the value of each (path, value), as `with_value` does. Each object is copied once.
    No path may be a part of another."""
    changes = [(_steps(path), value, path) for path, value in values]
    return _replace_at(tree, changes) if changes else tree


@lru_cache(maxsize=1000)
def _steps(path: str) -> tuple[Tree, ...]:
    steps: list[Tree] = []
    offset = 0
    while offset < len(path):
        match = _STEP.match(path, offset)
        if match is None:
            raise Invalid.of("path.not-a-path", path=path)
        name, index = match.groups()
        steps.append(name if index is None else _index(index, path))
        offset = match.end()
    return tuple(steps)


def _index(text: str, path: str) -> tuple[int, ...]:
    try:
        return tuple(int(entry) for entry in text.split(","))
    except ValueError:
        raise Invalid.of("path.index", path=path, value=text) from None


def _child(tree: Tree, step: Tree, path: str) -> Tree:
    if isinstance(step, tuple):
        return tree[step[0] if len(step) == 1 else step]
    names = tree if isinstance(tree, dict) else _names(type(tree)) or getattr(tree, "__dict__", ())
    if step not in names:
        suggestion = nearest(step, map(str, names))
        raise NoSuchName.of(
            "path.no-such-name", path=path, kind=type(tree).__name__, value=step, suggestion=suggestion
        )
    return tree[step] if isinstance(tree, dict) else getattr(tree, step)


@lru_cache(maxsize=1000)
def _names(container_type: type) -> tuple[str, ...]:
    if dataclasses.is_dataclass(container_type):
        return tuple(field.name for field in dataclasses.fields(container_type))
    return tuple(getattr(container_type, "_fields", ()))


def _replace_at(tree: Tree, changes: list[tuple[tuple[Tree, ...], Tree, str]]) -> Tree:
    steps, value, path = changes[-1]
    if not steps:
        if tree is not None and np.shape(tree) != np.shape(value):
            raise Invalid.of(
                "path.shape", path=path, expected=str(np.shape(tree)), value=str(np.shape(value))
            )
        return value
    groups: dict[Tree, list[tuple[tuple[Tree, ...], Tree, str]]] = {}
    for steps, value, path in changes:
        groups.setdefault(steps[0], []).append((steps[1:], value, path))
    children = {step: _replace_at(_child(tree, step, rest[0][2]), rest) for step, rest in groups.items()}
    items = {step: child for step, child in children.items() if isinstance(step, tuple)}
    if items:
        tree = _replace_items(tree, items)
    fields = {step: child for step, child in children.items() if step not in items}
    if not fields:
        return tree
    if isinstance(tree, dict):
        return {**tree, **fields}
    return _replace_names(tree, fields) if isinstance(tree, tuple) else _replace_fields(tree, fields)


def _replace_items(tree: Tree, items: dict[tuple[int, ...], Tree]) -> Tree:
    if isinstance(tree, np.ndarray):
        is_traced = any(map(has_scalars, items.values()))
        copy = as_fillable(tree.astype(float)) if is_traced else tree.copy()
        for index, value in items.items():
            copy[index] = value
        return copy
    entries = list(tree)
    for index, value in items.items():
        entries[index[0]] = value
    return type(tree)(entries) if type(tree) in (tuple, list) else type(tree)(*entries)


def _replace_names(record: Tree, fields: dict[str, Tree]) -> Tree:
    return record._replace(**fields)


def _replace_fields(block: Tree, fields: dict[str, Tree]) -> Tree:
    copy = object.__new__(type(block))
    attributes = getattr(block, "__dict__", {})
    if attributes:
        copy.__dict__.update(attributes)
    for key in _names(type(block)):
        if key not in attributes:  # a slot
            object.__setattr__(copy, key, getattr(block, key))
    for name, value in fields.items():
        object.__setattr__(copy, name, value)
    return copy
