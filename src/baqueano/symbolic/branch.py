"""Choose between two results in a step that runs as Python code and that is traced, too."""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Tree, Value

BOOLEAN_TYPES = (bool, np.bool_)  # types of a condition with a known value, in contrast to a traced condition


def branch(condition: Value, if_true: Callable[[], Tree], if_false: Callable[[], Tree]) -> Tree:
    """Return if_true() if the condition is true, else if_false().

    While a step is traced, compute both and return `tree_where` of them.
    """
    if isinstance(condition, BOOLEAN_TYPES):
        return if_true() if condition else if_false()
    return tree_where(condition, if_true(), if_false())


def tree_where(condition: Value, a: Tree, b: Tree) -> Tree:
    """Return a tree with np.where(condition, …) of each pair of leaves; `a` and `b` have the same structure."""
    if isinstance(a, tuple):
        return tuple.__new__(type(a), [tree_where(condition, x, y) for x, y in zip(a, b, strict=True)])
    if isinstance(a, dict):
        return {name: tree_where(condition, a[name], b[name]) for name in a}
    leaf = None if a is None else np.where(condition, a, b)
    return leaf[()] if isinstance(leaf, np.ndarray) else leaf
