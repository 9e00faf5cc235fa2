"""Trace a call of a step, with symbols instead of numbers, and return its graph.

A matrix of the carry that is symmetric at the start is traced with the same symbol on both sides of the diagonal. If
the step returns the same nodes on both sides, the matrix stays symmetric by induction. Then only half of its entries
are in the carry. Otherwise, the step is traced again without that assumption.
"""

import copy
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from types import FunctionType, MethodType, ModuleType
from typing import NamedTuple, cast

import numpy as np

from baqueano.contracts.time_limit import PREPARE_S, within
from baqueano.contracts.values import Tree
from baqueano.errors import USER_MODULE_PREFIX, Invalid
from baqueano.symbolic.arrays.array import TracedArray, as_array, has_scalars
from baqueano.symbolic.arrays.linalg import is_symmetric
from baqueano.symbolic.arrays.scalar import Scalar
from baqueano.symbolic.arrays.tracing import tracing
from baqueano.symbolic.errors import TraceError, locate_errors
from baqueano.symbolic.graph.node import Graph, Node
from baqueano.symbolic.graph.tree import (
    Branch,
    Leaf,
    Shape,
    build,
    kind_finder,
    leaves,
    size,
    tree_shape,
    values,
    with_kinds,
)


class Trace(NamedTuple):
    """A step as a graph, with all entries of the carry."""

    graph: Graph
    theta: list[Node]
    inputs: list[Node]
    initial: list[Node] | None  # as functions of θ; None if the start is given at run time
    carry: list[Node]  # symbols; mirrored entries share one symbol
    next_carry: list[Node]
    outputs: list[Node]
    output_shape: Shape
    carry_shape: Shape | None  # in this shape, an integer that becomes a float is a float


def trace_function(f: Callable[..., Tree], shapes: Iterable[Shape]) -> Trace:
    """Return the trace of a function of trees of these shapes; its result is the output, without a carry.

    A method of the user is traced on a copy of its block, and twice. Raise TraceError if the second call gives other
    nodes, or if the block then contains nodes: such a method has its own memory, noise or clock.
    """
    graph = Graph()
    kinds: dict[Node, str] = {}
    g = _copy_method(f) if isinstance(f, MethodType) and not _is_in_package(type(f.__self__)) else f
    with tracing(), locate_errors(), _restored_globals(g):
        symbols = [(shape, _symbols(graph, shape, kinds)) for shape in shapes]
        results = [
            within(PREPARE_S, g, *(_argument(*pair) for pair in symbols)) for _ in range(1 if g is f else 2)
        ]
    shape, outputs = _flat_nodes(graph, results[0], "output", kinds)
    for result in results[1:]:
        other_shape, other_nodes = _flat_nodes(graph, result, "output", kinds)
        is_same = other_shape == shape and all(a is b for a, b in zip(outputs, other_nodes, strict=True))
        if not is_same or _has_scalars_inside(g, set()):
            raise TraceError.of("trace.not-pure", function=_name(f))
    return Trace(graph, [], [x for _, nodes in symbols for x in nodes], None, [], [], outputs, shape, None)


def trace_step(
    step: Callable[..., Tree],
    carry: Tree,
    carry_shape: Shape,
    inputs: Shape,
    parameters: int | None,
    symmetric: set[str],
) -> tuple[Trace, set[str]]:
    """Return the trace of a step, and the leaves of `symmetric` that stay symmetric; `carry` is f(θ) or None."""
    while True:
        trace = _traced_step(step, carry, carry_shape, inputs, parameters, symmetric)
        node_iterator = {p for p in symmetric if _stays_symmetric(trace, carry_shape, p)}
        if node_iterator == symmetric:
            return trace, symmetric
        symmetric = node_iterator


def select_output(trace: Trace, name: str) -> Trace:
    """Return the trace with only the field `name` of the output, which must be a container."""
    branch = cast(Branch, trace.output_shape)
    k = branch.keys.index(name)
    first = sum(map(size, branch.children[:k]))
    return trace._replace(
        outputs=trace.outputs[first : first + size(branch.children[k])], output_shape=branch.children[k]
    )


def _traced_step(
    step: Callable[..., Tree],
    carry: Tree,
    carry_shape: Shape,
    inputs: Shape,
    parameters: int | None,
    symmetric: set[str],
) -> Trace:
    graph = Graph()
    kinds: dict[Node, str] = {}
    initial = None
    with tracing(), locate_errors():
        theta = [graph.symbol(f"theta[{k}]") for k in range(parameters or 0)]
        theta_arguments = (
            () if parameters is None else (_freeze(np.array(theta, dtype=object).view(TracedArray)),)
        )
        if carry is not None:
            initial = _matching_nodes(graph, carry(*theta_arguments), carry_shape, "carry(theta)")
        symbols = _symbols(graph, carry_shape, kinds, symmetric)
        input_symbols = _symbols(graph, inputs, kinds)
        arguments = _argument(carry_shape, symbols), _argument(inputs, input_symbols)
        result = within(PREPARE_S, step, *theta_arguments, *arguments)
        if type(result) is not tuple or len(result) != 2:
            raise TraceError.of("trace.pair", function=_name(step), kind=type(result).__name__)
    next_carry = _matching_nodes(graph, result[0], carry_shape, "the step")
    carry_kinds = _stable_kinds(carry_shape, symbols, next_carry, kinds)
    shape, outputs = _flat_nodes(graph, result[1], "output", kinds)
    return Trace(graph, theta, input_symbols, initial, symbols, next_carry, outputs, shape, carry_kinds)


def _stable_kinds(shape: Shape, symbols: list[Node], next_carry: list[Node], kinds: dict[Node, str]) -> Shape:
    """Return the shape of a carry with stable kinds, and update `kinds`.

    An integer or truth value that becomes a float in a step is converted to a float at the start.
    """
    changed_symbols = symbols
    while changed_symbols:
        find_kind = kind_finder(kinds)
        pairs = [(x, y) for x, y in zip(symbols, next_carry, strict=True) if kinds.get(x, "f") != "f"]
        changed_symbols = [x for x, y in pairs if kinds[x] != (_const_kind(y, kinds[x]) or find_kind(y))]
        for x in changed_symbols:
            del kinds[x]
    own_kinds, offset = [], 0
    for leaf in leaves(shape):
        leaf_kinds = {kinds.get(x, "f") for x in symbols[offset : offset + leaf.size]}
        own_kinds.append(leaf_kinds.pop() if len(leaf_kinds) == 1 else "f")
        offset += leaf.size
    return with_kinds(shape, iter(own_kinds))


def _const_kind(node: Node, kind: str) -> str:
    """Return `kind` if the node is a constant of this kind, "f" for another constant, "" if it is not a constant."""
    if node.op != "const":
        return ""
    return kind if node.value in ((0.0, 1.0) if kind == "b" else (np.floor(node.value),)) else "f"


def _symbols(graph: Graph, shape: Shape, kinds: dict[Node, str], symmetric: Iterable[str] = ()) -> list[Node]:
    nodes: list[Node] = []
    for leaf in leaves(shape):
        leaf_symbols = [graph.symbol(name) for name in leaf.names]
        if leaf.path in symmetric:
            square = np.array(leaf_symbols, dtype=object).reshape(leaf.shape)
            leaf_symbols = np.where(np.tri(len(square), dtype=bool).T, square, square.T).ravel().tolist()
        kinds |= dict.fromkeys(leaf_symbols, leaf.kind)
        graph.truths |= set(leaf_symbols) if leaf.kind == "b" else set()
        nodes += leaf_symbols
    return nodes


def _argument(shape: Shape, nodes: list[Node]) -> Tree:
    """Return a new tree of this shape with these nodes; its arrays cannot be changed."""
    node_iterator = iter(nodes)

    def value(leaf: Leaf) -> Tree:
        if not leaf.is_array:
            return next(node_iterator)
        array = np.empty(leaf.size, dtype=object)
        array[:] = list(islice(node_iterator, leaf.size))
        return _freeze(array.reshape(leaf.shape).view(TracedArray))

    return build(shape, map(value, leaves(shape)))


def _freeze(array: TracedArray) -> TracedArray:
    array.flags.writeable = False
    return array


def _flat_nodes(graph: Graph, tree: Tree, path: str, kinds: dict[Node, str]) -> tuple[Shape, list[Node]]:
    shape = tree_shape(tree, path, kind_finder(kinds))
    return shape, [graph.node(x) for v in values(shape, tree) for x in as_array(v).ravel().tolist()]


def _matching_nodes(graph: Graph, tree: Tree, shape: Shape, owner: str) -> list[Node]:
    """Return the values of a tree as nodes. Raise TraceError if the tree does not have this shape."""
    try:
        entries = values(shape, tree)
    except Invalid as error:
        raise TraceError.of("trace.another-carry", function=owner, cause=error.diagnostic) from None
    nodes = []
    for leaf, value in zip(leaves(shape), entries, strict=True):
        if not isinstance(value, np.ndarray) and tree_shape(value, leaf.path).__class__ is not Leaf:
            raise TraceError.of(
                "trace.value", function=owner, value=repr(value), path=leaf.path, shape=str(leaf.shape)
            )
        array = as_array(value)
        if array.shape != leaf.shape:
            raise TraceError.of(
                "trace.leaf-shape",
                function=owner,
                path=leaf.path,
                value=str(array.shape),
                expected=str(leaf.shape),
            )
        nodes += [graph.node(x) for x in array.ravel().tolist()]
    return nodes


def _stays_symmetric(trace: Trace, carry_shape: Shape, path: str) -> bool:
    offset = 0
    for leaf in leaves(carry_shape):
        if leaf.path == path:
            lists = (trace.next_carry, trace.initial or trace.next_carry)
            matrices = (as_array(nodes[offset : offset + leaf.size]).reshape(leaf.shape) for nodes in lists)
            return all(map(is_symmetric, matrices))
        offset += leaf.size
    return False


def is_stable(block_class: type) -> bool:
    """Return True for a class of this package, or of a file that a vehicle file names: its globals do not change."""
    module = block_class.__module__
    return _is_in_package(block_class) or module.startswith(USER_MODULE_PREFIX)


def _is_in_package(block_class: type) -> bool:
    return block_class.__module__.partition(".")[0] == __name__.partition(".")[0]


def _copy_method(method: MethodType) -> Callable[..., Tree]:
    """Return the method of a copy of its block; of the block itself if it cannot be copied."""
    try:
        block = copy.deepcopy(method.__self__)
    except Exception:  # a block of the user can contain any object
        block = method.__self__
    return MethodType(method.__func__, block)


@contextmanager
def _restored_globals(f: Callable[..., Tree]) -> Iterator[None]:
    """Restore, after the context, each global of the function's module that contains a node."""
    names = getattr(f, "__globals__", {})
    before = dict(names)
    try:
        yield
    finally:
        names.update({name: value for name, value in before.items() if has_scalars(names.get(name))})


def _has_scalars_inside(x: Tree, visited_ids: set[int]) -> bool:
    """Return True if a scalar is in the attributes or entries of a block, at any depth."""
    if isinstance(x, Scalar | np.ndarray):
        return has_scalars(x)
    if id(x) in visited_ids or isinstance(x, type | ModuleType | FunctionType):
        return False
    visited_ids.add(id(x))
    if isinstance(x, MethodType):
        return _has_scalars_inside(x.__self__, visited_ids)
    parts: list[Tree] = list(x.values()) if isinstance(x, dict) else []
    parts += x if isinstance(x, list | tuple | set | frozenset | deque) else []
    slots = [name for c in type(x).__mro__ for name in getattr(c, "__slots__", ()) if isinstance(name, str)]
    parts += [getattr(x, name, None) for name in slots] + list(getattr(x, "__dict__", {}).values())
    return any(_has_scalars_inside(part, visited_ids) for part in parts)


def _name(f: Callable[..., Tree]) -> str:
    code = getattr(f, "__code__", None) or getattr(getattr(f, "__func__", None), "__code__", None)
    place_text = f" ({code.co_filename}:{code.co_firstlineno})" if code else ""
    return f"{getattr(f, '__qualname__', type(f).__name__)}{place_text}"
