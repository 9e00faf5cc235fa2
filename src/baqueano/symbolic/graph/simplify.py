"""Simplify nodes by local rules: x + 0 is x, x · 0 is 0, two negations cancel.

A rule receives a graph and the arguments of one operator, and returns a simpler node or None. If the order of the
arguments is free, constants are first. x · 0 and x − x become 0 even though x can be inf or NaN: otherwise matrices
would not stay sparse. So finiteness is tested as |x| < inf, never as x − x = 0.
"""

import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from baqueano.contracts.values import Value
from baqueano.symbolic.ieee import LOGICAL

if TYPE_CHECKING:
    from baqueano.symbolic.graph.node import Graph, Node

CLIP_DEPTH = 4  # a command that is clipped twice: min(max(min(max(…))))


def _is(node: "Node", value: float) -> bool:
    return node.op == "const" and node.value == value


def _add(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if _is(a, 0.0):
        return b
    if a is b:
        return g.make("mul", g.const(2.0), a)
    if b.op == "neg":
        return g.make("sub", a, b.args[0])
    if a.op == "neg":
        return g.make("sub", b, a.args[0])
    if a.op == b.op:
        if a.op == "mul" and a.args[0].op == b.args[0].op == "const" and a.args[1] is b.args[1]:
            return g.make("mul", g.const(a.args[0].value + b.args[0].value), a.args[1])
        return None
    pair = _SUMS_OF_PAIRS.get((a.op, b.op))
    if pair is None or not _have_same_args(a, b):
        return None
    if pair == "add":  # equal gains both ways
        return g.make("add", *a.args)
    return g.make("mul", g.const(2.0), (a if a.op == "sub" else b).args[0])  # (p − q) + (p + q) is 2 p


# of two operators on the same arguments: min and max have the sum of both, difference and sum twice the first
_SUMS_OF_PAIRS = {("min", "max"): "add", ("max", "min"): "add", ("sub", "add"): "mul", ("add", "sub"): "mul"}


def _have_same_args(a: "Node", b: "Node") -> bool:
    return {x.index for x in a.args} == {x.index for x in b.args}


def _sub(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if a is b:
        return g.const(0.0)
    if _is(b, 0.0):
        return a
    if _is(a, 0.0):
        return g.make("neg", b)
    if b.op == "neg":
        return g.make("add", a, b.args[0])
    if a.op == "neg":
        return g.make("neg", g.make("add", a.args[0], b))
    return _without_common_term(g, a, b)


def _without_common_term(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    """Return x − y for (t + x) − (t + y), and y − x for (t − x) − (t − y); else None."""
    if a.op == b.op == "sub" and a.args[0] is b.args[0]:
        return g.make("sub", b.args[1], a.args[1])
    if a.op == b.op == "add":
        for k, term in enumerate(a.args):
            for n, second in enumerate(b.args):
                if term is second:
                    return g.make("sub", a.args[1 - k], b.args[1 - n])
    return None


def _mul(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if a.op == "const":
        if a.value in (0.0, 1.0):
            return b if a.value else g.const(0.0)
        if a.value == -1.0:
            return g.make("neg", b)
        if b.op == "neg":
            return g.make("mul", g.const(-a.value), b.args[0])
        if b.op == "mul" and b.args[0].op == "const":
            return g.make("mul", g.const(a.value * b.args[0].value), b.args[1])
    if a.op == "neg":
        return g.make("neg", g.make("mul", a.args[0], b))
    if a in g.sign_arguments.get(b, ()):
        return _with_magnitude(g, a, b)
    if b.op == "neg":
        return g.make("neg", g.make("mul", b.args[0], a))
    return _with_magnitude(g, b, a) if b in g.sign_arguments.get(a, ()) else None


def _with_magnitude(g: "Graph", x: "Node", y: "Node") -> "Node":
    """Return |x| for x · y, where sign(x) is among the factors of y, as in the derivative of d |x| x."""
    if y.op == "sign":
        return g.make("abs", x)
    a, b = y.args if x in g.sign_arguments.get(y.args[0], ()) else y.args[::-1]
    return g.make("mul", b, _with_magnitude(g, x, a))


def _div(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if _is(a, 0.0) or _is(b, 1.0):
        return a
    if b.op == "const" and b.value and abs(math.frexp(b.value)[0]) == 0.5 and abs(b.value) < 2.0**1000:
        return g.make("mul", g.const(1.0 / b.value), a)  # a power of two: exact
    for x in (a, b):
        if x.op == "neg":
            args = (x.args[0], b) if x is a else (a, x.args[0])
            return g.make("neg", g.make("div", *args))
    return None


def _neg(g: "Graph", a: "Node") -> "Node | None":
    if a.op == "neg":
        return a.args[0]
    if a.op == "sub":
        return g.make("sub", a.args[1], a.args[0])
    if a.op == "mul" and a.args[0].op == "const":
        return g.make("mul", g.const(-a.args[0].value), a.args[1])
    return None


def _even_function(op: str) -> Callable[..., Value]:
    return lambda g, a: g.make(op, a.args[0]) if a.op == "neg" else None


def _where(g: "Graph", c: "Node", a: "Node", b: "Node") -> "Node | None":
    if a is b or (a.op == "const" and _is(b, a.value)):  # 0 and −0 are equal
        return a
    if c.op == "const":
        return a if c.value else b
    if c.op == "not":
        return g.make("where", c.args[0], b, a)
    if c.op in LOGICAL and _is(b, 0.0) and _is(a, 1.0):
        return c
    if c.op in LOGICAL and _is(a, 0.0) and _is(b, 1.0):
        return g.make("not", c)
    if a.op == "where" and a.args[0] is c:
        return g.make("where", c, a.args[1], b)
    if b.op == "where" and b.args[0] is c:
        return g.make("where", c, a, b.args[2])
    return None


def _and(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if a.op == "const":
        return _truth(g, b) if a.value else g.const(0.0)
    return _truth(g, a) if a is b else _simplify_truths(g, "and", a, b)


def _or(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if a.op == "const":
        return g.const(1.0) if a.value else _truth(g, b)
    return _truth(g, a) if a is b else _simplify_truths(g, "or", a, b)


def _simplify_truths(g: "Graph", op: str, a: "Node", b: "Node") -> "Node | None":
    if a.op in LOGICAL and b.op in LOGICAL:
        return None
    return g.make(op, _truth(g, a), _truth(g, b))


def _truth(g: "Graph", a: "Node") -> "Node":
    return a if a.op in LOGICAL else g.make("ne", a, g.const(0.0))


def _not(g: "Graph", a: "Node") -> "Node | None":
    return _truth(g, a.args[0]) if a.op == "not" else None


def _ne(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    return b if _is(a, 0.0) and b.op in LOGICAL else None


def _lt(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    if a is b or _is(a, math.inf) or _is(b, -math.inf):
        return g.const(0.0)
    if b.op in LOGICAL and a.op == "const" and 0.0 <= a.value < 1.0:
        return b  # 0 < truth
    if a.op == "abs" and _is(b, math.inf) and _is_clipped(a.args[0]):
        return g.make("not", g.make("isnan", *a.args))  # |x| < inf
    return None


def _isnan(g: "Graph", a: "Node") -> "Node | None":
    return g.const(0.0) if a.op in LOGICAL else None


def _floor(g: "Graph", a: "Node") -> "Node | None":
    return a if a.op == "floor" else None


def _min(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    return b if a is b or (a.op == "const" and _is_bounded(b, "min", a.value)) else None


def _max(g: "Graph", a: "Node", b: "Node") -> "Node | None":
    return b if a is b or (a.op == "const" and _is_bounded(b, "max", a.value)) else None


def _is_clipped(x: "Node") -> bool:
    max_float = sys.float_info.max
    return _is_bounded(x, "min", max_float) and _is_bounded(x, "max", -max_float)


def _is_bounded(x: "Node", op: str, bound: float, depth: int = CLIP_DEPTH) -> bool:
    """Return True if x is at most the bound ("min") or at least ("max"), or NaN, as a command that is clipped twice.
    Only `depth` nested clips are examined: the minimum of many values is a long chain.
    """
    if math.isinf(bound) and (bound > 0.0) == (op == "min"):
        return True
    if x.op == "const":
        return x.value <= bound if op == "min" else x.value >= bound
    if x.op in ("min", "max"):
        all_or_any = any if x.op == op else all
        return depth > 0 and all_or_any(_is_bounded(a, op, bound, depth - 1) for a in x.args)
    return op == "max" and bound <= 0.0 and (x.op in ("abs", "sqrt", "hypot") or x.op in LOGICAL)


RULES: dict[str, Callable[..., "Node | None"]] = {
    "add": _add,
    "sub": _sub,
    "mul": _mul,
    "div": _div,
    "neg": _neg,
    "cos": _even_function("cos"),
    "cosh": _even_function("cosh"),
    "abs": _even_function("abs"),
    "min": _min,
    "max": _max,
    "floor": _floor,
    "where": _where,
    "and": _and,
    "or": _or,
    "not": _not,
    "ne": _ne,
    "lt": _lt,
    "isnan": _isnan,
}
