"""Scalars of a trace: a hash-consed graph. The same operation on the same arguments is the same node.

A node is made only by its graph, which folds constants and applies the local rules below; a graph belongs to
one trace and goes with it. Booleans are the numbers 0 and 1.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

UNARY: dict[str, Callable[[float], float]] = {
    "neg": lambda a: -a, "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos,
    "atan": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "exp": np.exp, "log": np.log,
    "sqrt": np.sqrt, "abs": np.abs, "sign": np.sign, "floor": np.floor, "not": lambda a: a == 0.0, "isnan": np.isnan,
}  # fmt: skip
BINARY: dict[str, Callable[[float, float], Any]] = {
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b, "div": np.divide,
    "pow": np.power, "atan2": np.arctan2, "hypot": np.hypot, "min": np.minimum, "max": np.maximum,
    "lt": lambda a, b: a < b, "le": lambda a, b: a <= b, "eq": lambda a, b: a == b, "ne": lambda a, b: a != b,
    "and": lambda a, b: (a != 0.0) & (b != 0.0), "or": lambda a, b: (a != 0.0) | (b != 0.0),
}  # fmt: skip
COMMUTATIVE = {"add", "mul", "min", "max", "hypot", "eq", "ne", "and", "or"}
LOGICAL = {"lt", "le", "eq", "ne", "and", "or", "not", "isnan"}


class Node:
    """One scalar of a trace."""

    __slots__ = ("args", "graph", "index", "op", "value")

    def __init__(self, graph: "Graph", op: str, args: tuple["Node", ...], value: Any, index: int) -> None:
        self.graph, self.op, self.args, self.value, self.index = graph, op, args, value, index

    def __repr__(self) -> str:
        if self.op in ("const", "symbol"):
            return str(self.value)
        return f"{self.op}({', '.join(map(repr, self.args))})"


class Graph:
    """The nodes of one trace, and the tables that `interp` reads."""

    def __init__(self) -> None:
        self.known: dict[tuple[Any, ...], Node] = {}
        self.tables: list[tuple[np.ndarray, np.ndarray]] = []
        self.made = 0

    def const(self, value: float) -> Node:
        value = float(value)
        key = ("const", value.hex()) if value == value else ("const", "nan")
        return self._intern(key, "const", (), value)

    def symbol(self, name: str) -> Node:
        """A new free value; two symbols are never the same node."""
        return self._intern(("symbol", self.made), "symbol", (), name)

    def make(self, op: str, *args: Node, value: Any = None) -> Node:
        """The node of this operation, simplified where a local rule allows it."""
        if all(a.op == "const" for a in args) and op in (UNARY if len(args) == 1 else BINARY):
            return self.const(_fold(op, [a.value for a in args]))
        simple = _RULES[op](self, *args) if op in _RULES else None
        if simple is not None:
            return simple
        if op in COMMUTATIVE and args[0].index > args[1].index:
            args = (args[1], args[0])
        return self._intern((op, value, *(a.index for a in args)), op, args, value)

    def table(self, xp: np.ndarray, fp: np.ndarray) -> int:
        """The number of a table; equal tables have one number."""
        for k, (x, f) in enumerate(self.tables):
            if np.array_equal(x, xp) and np.array_equal(f, fp):
                return k
        self.tables.append((np.array(xp, float), np.array(fp, float)))
        return len(self.tables) - 1

    def _intern(self, key: tuple[Any, ...], op: str, args: tuple[Node, ...], value: Any) -> Node:
        node = self.known.get(key)
        if node is None:
            node = self.known[key] = Node(self, op, args, value, self.made)
            self.made += 1
        return node


def _fold(op: str, values: list[float]) -> float:
    with np.errstate(all="ignore"):
        return float(UNARY[op](*values) if len(values) == 1 else BINARY[op](*values))


def _is(node: Node, value: float) -> bool:
    return node.op == "const" and node.value == value


def _add(g: Graph, a: Node, b: Node) -> Node | None:
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    if b.op == "neg":
        return g.make("sub", a, b.args[0])
    if a.op == "neg":
        return g.make("sub", b, a.args[0])
    return None


def _sub(g: Graph, a: Node, b: Node) -> Node | None:
    if _is(b, 0.0):
        return a
    if _is(a, 0.0):
        return g.make("neg", b)
    if a is b:
        return g.const(0.0)
    if b.op == "neg":
        return g.make("add", a, b.args[0])
    return None


def _mul(g: Graph, a: Node, b: Node) -> Node | None:
    if _is(a, 0.0) or _is(b, 0.0):
        return g.const(0.0)
    for x, y in ((a, b), (b, a)):
        if _is(x, 1.0):
            return y
        if _is(x, -1.0):
            return g.make("neg", y)
        if x.op == "neg":
            return g.make("neg", g.make("mul", x.args[0], y))
        if x.op == "const" and y.op == "mul" and y.args[0].op == "const":
            return g.make("mul", g.const(x.value * y.args[0].value), y.args[1])
    return None


def _div(g: Graph, a: Node, b: Node) -> Node | None:
    if _is(b, 1.0):
        return a
    if _is(a, 0.0):
        return a
    if a.op == "neg":
        return g.make("neg", g.make("div", a.args[0], b))
    if b.op == "const" and b.value != 0.0:
        inverse = 1.0 / b.value
        if math.frexp(b.value)[0] in (0.5, -0.5):  # a power of two: exact
            return g.make("mul", a, g.const(inverse))
    return None


def _neg(g: Graph, a: Node) -> Node | None:
    return a.args[0] if a.op == "neg" else g.make("sub", a.args[1], a.args[0]) if a.op == "sub" else None


def _where(g: Graph, c: Node, a: Node, b: Node) -> Node | None:
    if a is b:
        return a
    if c.op == "const":
        return a if c.value != 0.0 else b
    if c.op == "not":
        return g.make("where", c.args[0], b, a)
    return None


def _and(g: Graph, a: Node, b: Node) -> Node | None:
    for x, y in ((a, b), (b, a)):
        if x.op == "const":
            return g.const(0.0) if x.value == 0.0 else _truth(g, y)
    return None


def _or(g: Graph, a: Node, b: Node) -> Node | None:
    for x, y in ((a, b), (b, a)):
        if x.op == "const":
            return _truth(g, y) if x.value == 0.0 else g.const(1.0)
    return None


def _truth(g: Graph, a: Node) -> Node:
    return a if a.op in LOGICAL else g.make("ne", a, g.const(0.0))


def _not(g: Graph, a: Node) -> Node | None:
    return a.args[0] if a.op == "not" and a.args[0].op in LOGICAL else None


def _pow(g: Graph, a: Node, b: Node) -> Node | None:
    if b.op != "const":
        return None
    if b.value == 0.5:
        return g.make("sqrt", a)
    if b.value != int(b.value) or abs(b.value) > 16:
        return None
    n = int(abs(b.value))
    result, square = g.const(1.0), a
    while n:
        if n & 1:
            result = g.make("mul", result, square)
        n >>= 1
        square = g.make("mul", square, square) if n else square
    return result if b.value >= 0 else g.make("div", g.const(1.0), result)


_RULES: dict[str, Callable[..., Node | None]] = {
    "add": _add, "sub": _sub, "mul": _mul, "div": _div, "neg": _neg, "where": _where, "and": _and, "or": _or,
    "not": _not, "pow": _pow,
}  # fmt: skip
