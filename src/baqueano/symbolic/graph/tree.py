"""Convert trees of NamedTuples, tuples, lists, dicts and dataclasses to rows of floats and back.

A *shape of a tree* (`Shape`) defines the index of each number in the row. Numbers are leaves: float, int, bool and
arrays of them. An int is stored as a float, exact below 2⁵³, and restored as an int. All other values (None, text, …)
are part of the shape.
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid, Misuse
from baqueano.symbolic.arrays.scalar import NUMBER_TYPES, Scalar
from baqueano.symbolic.graph.node import Node
from baqueano.symbolic.ieee import LOGICAL


class Leaf(NamedTuple):
    """The shape of a number, or of an array of numbers."""

    path: str
    shape: tuple[int, ...]
    kind: str  # "f", "i" or "b", as in dtype.kind
    is_array: bool

    @property
    def size(self) -> int:
        """Return the number of entries of the leaf."""
        return int(np.prod(self.shape))

    @property
    def names(self) -> list[str]:
        """Return the name of each entry of the leaf, such as "x.mean[0]"."""
        if not self.is_array:
            return [self.path]
        return [f"{self.path}[{','.join(map(str, index))}]" for index in np.ndindex(self.shape)]


class Branch(NamedTuple):
    """The shape of a container, with the shapes of its children."""

    path: str
    kind: type
    keys: tuple[Tree, ...]  # names of fields, keys of a dict, indices
    children: tuple["Shape", ...]


class ConstantLeaf(NamedTuple):
    """The shape of a value that is not a number: the value is always the same."""

    path: str
    value: Tree


_INTEGER_OPERATORS = ("add", "sub", "mul", "neg", "abs", "min", "max", "where")  # of integers: an integer
Shape: TypeAlias = Leaf | Branch | ConstantLeaf


def tree_shape(tree: Tree, path: str, leaf_kind: Callable[[Tree], str] = lambda _: "f") -> Shape:
    """Return the shape of a tree; `leaf_kind` returns the kind of a scalar: "f", "i" or "b"."""
    if isinstance(tree, np.ndarray):
        return _array_leaf(tree, path, leaf_kind)
    if isinstance(tree, Scalar):
        return Leaf(path, (), leaf_kind(tree), False)
    if isinstance(tree, NUMBER_TYPES):
        return Leaf(path, (), np.asarray(tree).dtype.kind.replace("u", "i"), False)
    items = _items(tree)
    if items is None:
        return ConstantLeaf(path, tree)
    has_names = dataclasses.is_dataclass(tree) or hasattr(tree, "_fields")
    mark = "{}.{}" if has_names else "{}[{!r}]"
    children = [tree_shape(x, mark.format(path, key), leaf_kind) for key, x in items]
    return Branch(path, type(tree), tuple(key for key, _ in items), tuple(children))


def leaves(shape: Shape) -> Iterator[Leaf]:
    """Yield all leaves, in the order of the row."""
    if isinstance(shape, Leaf):
        yield shape
    elif isinstance(shape, Branch):
        for child in shape.children:
            yield from leaves(child)


def with_kinds(shape: Shape, kinds: Iterator[str]) -> Shape:
    """Return the same shape with these `kinds` of leaves, in order."""
    if isinstance(shape, Leaf):
        return shape._replace(kind=next(kinds))
    if isinstance(shape, Branch):
        return shape._replace(children=tuple(with_kinds(child, kinds) for child in shape.children))
    return shape


def size(shape: Shape) -> int:
    """Return the number of entries in a row."""
    return sum(leaf.size for leaf in leaves(shape))


def values(shape: Shape, tree: Tree) -> list[Tree]:
    """Return the leaves of a tree of this shape. Raise Invalid if the tree has another shape."""
    if isinstance(shape, Leaf):
        return [tree]
    if isinstance(shape, ConstantLeaf):
        if tree is not shape.value and not _are_equal(tree, shape.value):
            raise Invalid.of(
                "tree.value", path=shape.path, value=_short_text(tree), expected=_short_text(shape.value)
            )
        return []
    items = _items(tree)
    if items is None or type(tree) is not shape.kind or tuple(key for key, _ in items) != shape.keys:
        raise Invalid.of(
            "tree.branch", path=shape.path, value=_short_text(tree), expected=_description(shape)
        )
    return [v for child, (_, x) in zip(shape.children, items, strict=True) for v in values(child, x)]


def build(shape: Shape, leaves: Iterator[Tree]) -> Tree:
    """Return the tree of this shape with these `leaves`, in order."""
    if isinstance(shape, Leaf):
        return next(leaves)
    if isinstance(shape, ConstantLeaf):
        return shape.value
    return make(shape.kind, shape.keys, [build(child, leaves) for child in shape.children])


def make(container: type, keys: Sequence[Tree], children: Sequence[Tree]) -> Tree:
    """Return an object of the type `container` without a call of __post_init__, whose checks cannot be traced."""
    if container is dict:
        return dict(zip(keys, children, strict=True))
    if container in (tuple, list):
        return container(children)
    if issubclass(container, tuple):
        return tuple.__new__(container, children)
    block = object.__new__(container)
    for key, child in zip(keys, children, strict=True):
        object.__setattr__(block, key, child)
    return block


def as_floats(leaf: Leaf, value: Tree, leading_shape: tuple[int, ...] = ()) -> np.ndarray:
    """Return the value of a leaf as floats, with the leading axes `leading_shape`. Raise Invalid for another shape."""
    array = np.asarray(value)
    if array.shape != leading_shape + leaf.shape or array.dtype.kind not in "fiub":
        raise Invalid.of(
            "tree.numbers",
            path=leaf.path,
            value=str(array.shape),
            dtype=array.dtype,
            expected=str(leading_shape + leaf.shape),
        )
    return array.astype(float, copy=False)


def restore(leaf: Leaf, column: np.ndarray) -> Tree:
    """Return floats converted to the kind of the leaf: an array, or a Python number for a value without axes."""
    column = column != 0.0 if leaf.kind == "b" else column
    column = np.rint(column).astype(np.int64) if leaf.kind == "i" else column
    return column if column.ndim else column.item()


def kind_finder(symbols: dict[Node, str]) -> Callable[[Tree], str]:
    """Return a function that finds the kind of a node from the kinds of the symbols.

    The kind is "i" for a node made only of integers, "b" for a truth value, else "f".
    """
    kinds = dict(symbols)

    def leaf_kind(node: Tree) -> str:
        if not isinstance(node, Node):
            return "f"
        stack = [node]
        while stack:
            open_part = stack[-1]
            unknown_parts = (
                [a for a in open_part.args if a not in kinds] if open_part.op in _INTEGER_OPERATORS else []
            )
            stack += unknown_parts
            if not unknown_parts:
                kinds.setdefault(stack.pop(), _node_kind(open_part, kinds))
        return kinds[node]

    return leaf_kind


def _node_kind(node: Node, node_kinds: dict[Node, str]) -> str:
    if node.op not in _INTEGER_OPERATORS:
        return "b" if node.op in LOGICAL else "f"
    args = node.args[1:] if node.op == "where" else node.args
    kinds = {node_kinds[a] for a in args if a.op != "const"}
    constants = [a.value for a in args if a.op == "const"]
    if kinds == {"b"} and node.op == "where" and all(c in (0.0, 1.0) for c in constants):
        return "b"
    return "i" if kinds == {"i"} and all(c == np.floor(c) for c in constants) else "f"


def _array_leaf(array: np.ndarray, path: str, leaf_kind: Callable[[Tree], str]) -> Leaf:
    if array.dtype == object:
        kinds = {
            leaf_kind(e) if isinstance(e, Scalar) else np.asarray(e).dtype.kind
            for e in array.ravel().tolist()
        }
        return Leaf(path, array.shape, kinds.pop() if len(kinds) == 1 else "f", True)
    if array.dtype.kind not in "fiub":
        raise Misuse.of("tree.dtype", path=path, dtype=str(array.dtype))
    return Leaf(path, array.shape, array.dtype.kind.replace("u", "i"), True)


def _items(tree: Tree) -> list[tuple[Tree, Tree]] | None:
    if isinstance(tree, dict):
        return list(tree.items())
    if hasattr(type(tree), "_fields") and isinstance(tree, tuple):
        return list(zip(type(tree)._fields, tree, strict=True))  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(tree, tuple | list):
        return list(enumerate(tree))
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        return [(field.name, getattr(tree, field.name)) for field in dataclasses.fields(tree)]
    return None


def _are_equal(a: Tree, b: Tree) -> bool:
    return type(a) is type(b) and bool(np.all(a == b))


def _description(shape: Branch) -> str:
    if shape.kind in (tuple, list):
        parts = ", ".join("…" for _key in shape.keys)
        return f"({parts})" if shape.kind is tuple else f"[{parts}]"
    return f"{shape.kind.__name__}({', '.join(map(str, shape.keys))})"


def _short_text(value: Tree) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:57]}…"


def flat_row(shape: Shape, tree: Tree) -> np.ndarray:
    """Return the values of a tree as one row (size,) of floats."""
    if isinstance(shape, Leaf):
        return as_floats(shape, tree).flatten()
    pairs = zip(leaves(shape), values(shape, tree), strict=True)
    return np.concatenate([np.zeros(0), *(as_floats(leaf, value).ravel() for leaf, value in pairs)])


def as_tree(shape: Shape, rows: np.ndarray) -> Tree:
    """Return the tree of rows (…, size); its leaves begin with the same axes (…) as the rows."""
    return build(shape, _columns(shape, rows))


def _columns(shape: Shape, rows: np.ndarray) -> Iterator[Tree]:
    offset = 0
    for leaf in leaves(shape):
        yield restore(leaf, rows[..., offset : offset + leaf.size].reshape(rows.shape[:-1] + leaf.shape))
        offset += leaf.size


def count_ticks(shape: Shape, inputs: Tree) -> int:
    """Return N, the length of the first leaf of `inputs`. Raise Invalid if this leaf does not have an axis of ticks."""
    for leaf, value in zip(leaves(shape), values(shape, inputs), strict=True):
        ticks = np.shape(value)
        if len(ticks) == 1 + len(leaf.shape):
            return ticks[0]
        raise Invalid.of("engine.ticks", path=leaf.path, value=str(ticks), expected=str(leaf.shape))
    raise Invalid.of("engine.no-number")


def symmetric_leaves(shape: Shape, start: np.ndarray | None) -> Iterator[Leaf]:
    """Yield the leaves that are square matrices, symmetric at the start or with an unknown start."""
    offset = 0
    for leaf in leaves(shape):
        if len(leaf.shape) == 2 and leaf.shape[0] == leaf.shape[1] > 1:
            matrix = None if start is None else start[offset : offset + leaf.size].reshape(leaf.shape)
            if matrix is None or np.array_equal(matrix, matrix.T):
                yield leaf
        offset += leaf.size


def input_rows(shape: Shape, inputs: Tree) -> np.ndarray:
    """Return the inputs as rows (N, ·), which are only read: an input that is one suitable array is not copied."""
    if isinstance(shape, Leaf) and type(inputs) is np.ndarray and inputs.dtype == float:
        has_shape = inputs.shape[1:] == shape.shape and inputs.ndim == 1 + len(shape.shape)
        if has_shape and inputs.flags.c_contiguous and inputs.flags.aligned:
            return inputs.reshape(len(inputs), shape.size)
    n = count_ticks(shape, inputs)
    pairs = zip(leaves(shape), values(shape, inputs), strict=True)
    blocks = [as_floats(leaf, value, (n,)).reshape(n, leaf.size) for leaf, value in pairs]
    if len(blocks) == 1:
        return np.require(blocks[0], requirements=["C", "A"])
    columns = [column for block in blocks for column in block.T]
    rows = np.empty((n, len(columns)))
    for row, column in enumerate(columns):  # NumPy copies long columns faster than short rows
        rows[:, row] = column
    return rows
