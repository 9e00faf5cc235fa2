"""Choose between two results in a step that runs as Python code and can also be traced."""

from collections.abc import Callable

import numpy as np

from baqueano.contracts.values import Tree, Value

BOOLEAN_TYPES = (bool, np.bool_)  # types of a condition with a known value, in contrast to a traced condition


def branch(condition: Value, if_true: Callable[[], Tree], if_false: Callable[[], Tree]) -> Tree:
    """Return if_true() if the condition is true, else if_false().

    Parameters
    ----------
    condition : bool or traced value
        The condition. While a step is traced, both results are computed and `tree_where` chooses.
    if_true, if_false : callable
        Functions without arguments that return trees of the same structure.

    Returns
    -------
    tree
        The result of one function, or a traced choice.

    Examples
    --------
    >>> branch(2 > 1, lambda: "yes", lambda: "no")
    'yes'
    """
    if isinstance(condition, BOOLEAN_TYPES):
        return if_true() if condition else if_false()
    return tree_where(condition, if_true(), if_false())


def tree_where(condition: Value, a: Tree, b: Tree) -> Tree:
    """Return a tree with np.where(condition, …) of each pair of leaves.

    Parameters
    ----------
    condition : bool or traced value
        The condition.
    a, b : tree
        Trees of the same structure.

    Returns
    -------
    tree
        The leaves of `a` where the condition is true, else those of `b`.

    Examples
    --------
    >>> left, right = tree_where(False, (1.0, 2.0), (3.0, 4.0))
    >>> print(left, right)
    3.0 4.0
    """
    if isinstance(a, tuple):
        return tuple.__new__(type(a), [tree_where(condition, x, y) for x, y in zip(a, b, strict=True)])
    if isinstance(a, dict):
        return {name: tree_where(condition, a[name], b[name]) for name in a}
    leaf = None if a is None else np.where(condition, a, b)
    return leaf[()] if isinstance(leaf, np.ndarray) else leaf
