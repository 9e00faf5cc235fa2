"""Define the scalars of a trace: a hash-consed graph, in which equal operations on equal arguments are one node.

Only the graph creates nodes. It folds constants and applies the local rules of simplify.py. A graph belongs to one
trace and is deleted with it. Truth values are the numbers 0 and 1.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from itertools import chain
from operator import attrgetter
from threading import RLock

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic import ieee
from baqueano.symbolic.arrays.scalar import Scalar
from baqueano.symbolic.errors import trace_error
from baqueano.symbolic.graph.simplify import RULES
from baqueano.symbolic.ieee import COMMUTATIVE

_INDEX, _ARGS = attrgetter("index"), attrgetter("args")


def _operator(op: str, is_swapped: bool = False) -> Callable[[Value, Value], Value]:
    """Return + − × ÷ of two nodes of one graph, or of a node and a float, without the search of `apply`."""
    general = getattr(Scalar, f"__{'r' if is_swapped else ''}{'truediv' if op == 'div' else op}__")

    def method(self: "Node", other: Value) -> Value:
        graph = self.graph
        if type(other) is float:
            other = graph.const(other)
        elif type(other) is not Node or other.graph is not graph:
            return general(self, other)
        node = graph.make(op, other, self) if is_swapped else graph.make(op, self, other)
        return node.value if node.op == "const" else node

    return method


class Node(Scalar):
    """A scalar of a trace. It is hashed by identity; == creates a node, so compare nodes with `is`."""

    __slots__ = ("args", "graph", "index", "op", "value")

    def __init__(self, graph: "Graph", op: str, args: tuple["Node", ...], value: Value, index: int) -> None:
        self.graph = graph
        self.op = op  # "const", "symbol" or a name in ieee.OPERATORS
        self.args = args
        self.value = value  # value of a constant, name of a symbol, or number of a table
        self.index = index  # order of creation: arguments have a smaller index

    __add__, __radd__ = _operator("add"), _operator("add", is_swapped=True)
    __sub__, __rsub__ = _operator("sub"), _operator("sub", is_swapped=True)
    __mul__, __rmul__ = _operator("mul"), _operator("mul", is_swapped=True)
    __truediv__, __rtruediv__ = _operator("div"), _operator("div", is_swapped=True)

    def apply(self, op: str, args: tuple[Value, ...], value: Value) -> Value:
        """Return the node of an operation; a constant result is returned as a float or a bool."""
        graph = self.graph
        if value is not None:
            value = graph.table(*value)
        nodes = [a if type(a) is Node and a.graph is graph else graph.node(a) for a in args]
        node = graph.make(op, *nodes, value=value)
        if node.op != "const":
            return node
        return np.bool_(node.value) if op in ieee.LOGICAL else node.value

    @property
    def is_truth(self) -> bool:
        if self.op in ("where", "min", "max", "mul"):
            return all(a.is_truth for a in self.args[self.op == "where" :])
        is_bit = self.op == "const" and self.value in (0.0, 1.0)
        return is_bit or self.op in ieee.LOGICAL or self in self.graph.truths


class Graph:
    """The nodes of one trace, and the tables that `interp` reads.

    Nodes are numbered in the order of creation. The `lock` ensures that only one thread at a time creates them.
    """

    def __init__(self) -> None:
        self.lock = RLock()
        self.nodes: dict[Hashable, Node] = {}
        self.truths: set[Node] = set()  # symbols of truth values
        self.sign_arguments: dict[
            Node, frozenset[Node]
        ] = {}  # of signs and their products: arguments of these signs
        self.tables: list[tuple[np.ndarray, np.ndarray]] = []
        self.partials: dict[Node, tuple[tuple[Node, Node], ...]] = {}  # those known: derivatives/derive.py

    def node(self, value: Value) -> Node:
        """Return a number as a constant node, or a node of this trace unchanged. Raise TraceError for another trace."""
        if not isinstance(value, Node):
            return self.const(value)
        if value.graph is not self:
            raise trace_error("trace.another-trace")
        return value

    def const(self, value: float) -> Node:
        """Return the node of a constant; 0 and −0 are different nodes."""
        value = float(value)
        key = value if value and value == value else value.hex()  # 0 == −0, and NaN differs from itself
        return self._intern(key, "const", (), value)

    def symbol(self, name: str) -> Node:
        """Return a new node for a value known only at run time; two symbols are never the same node."""
        return self._intern(("symbol", len(self.nodes)), "symbol", (), name)

    def make(self, op: str, *args: Node, value: Value = None) -> Node:
        """Return the node of this operation, simplified by a local rule if one applies."""
        for a in args:
            if a.op != "const":
                break
        else:
            table = () if value is None else (self.tables[value],)
            return self.const(ieee.OPERATORS[op](*[a.value for a in args], *table))
        if op in COMMUTATIVE:
            a, b = args  # a constant first, else the older node
            if b.op == "const" or (a.op != "const" and b.index < a.index):
                args = b, a
        rule = RULES.get(op)
        if rule is not None:
            simple = rule(self, *args)
            if simple is not None:
                return simple
        if len(args) == 2:  # most operations, without the cost of `map`
            a, b = args
            key = op, value, a.index, b.index
        else:
            key = op, value, *map(_INDEX, args)
        node = self.nodes.get(key)
        return self._intern(key, op, args, value) if node is None else node

    def copy(self, node: Node, args: Sequence[Node]) -> Node:
        """Return the copy of a node of another graph with the same tables, with these arguments, not simplified."""
        if node.op == "const":
            return self.const(node.value)
        if node.op == "symbol":
            return self.symbol(node.value)
        return self._intern((node.op, node.value, *map(_INDEX, args)), node.op, tuple(args), node.value)

    def table(self, xp: np.ndarray, fp: np.ndarray) -> int:
        """Return the number of the table (xp, fp). Equal tables have one number, and equal xp are one array."""
        for k, (x, f) in enumerate(self.tables):
            if np.array_equal(x, xp) and np.array_equal(f, fp):
                return k
        grids = [x for x, _ in self.tables if np.array_equal(x, xp)] or [np.array(xp, dtype=float)]
        self.tables.append((grids[0], np.array(fp, dtype=float)))
        return len(self.tables) - 1

    def substitute(self, roots: Iterable[Node], replacements: Mapping[Node, Node]) -> list[Node]:
        """Return the roots after the replacement of nodes by `replacements`, simplified again."""
        roots = list(roots)
        new_nodes = {old: new for old, new in replacements.items() if new is not old}
        for node in nodes_below(roots):
            if node not in replacements and not new_nodes.keys().isdisjoint(node.args):
                args = [new_nodes.get(a, a) for a in node.args]
                if (new := self.make(node.op, *args, value=node.value)) is not node:
                    new_nodes[node] = new
        return [new_nodes.get(root, root) for root in roots]

    def _intern(self, key: Hashable, op: str, args: tuple[Node, ...], value: Value) -> Node:
        node = self.nodes.get(key)
        if node is None:
            node = self.nodes[key] = Node(self, op, args, value, len(self.nodes))
            if op == "sign":
                self.sign_arguments[node] = frozenset(args)
            elif op == "mul" and self.sign_arguments and not self.sign_arguments.keys().isdisjoint(args):
                self.sign_arguments[node] = frozenset().union(*(self.sign_arguments.get(a, ()) for a in args))
        return node


def nodes_below(roots: Iterable[Node]) -> list[Node]:
    """Return the roots and all nodes on which they depend, arguments before users."""
    nodes: set[Node] = set()
    new_nodes = set(roots)
    while new_nodes:
        nodes |= new_nodes
        new_nodes = set(chain.from_iterable(map(_ARGS, new_nodes))) - nodes
    return sorted(nodes, key=_INDEX)
