"""Differentiate the operators by one rule each, for all arguments of `apply`: floats, nodes, dual numbers.

If a derivative does not exist, a finite value replaces it: 0 for hypot and atan2 at the origin. At a tie, min and max
have the derivative of their first argument. The derivative of sqrt at 0 is large, not infinite, so that 0 · derivative
stays 0.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

from baqueano.contracts.values import Value
from baqueano.symbolic.arrays.scalar import apply, power
from baqueano.symbolic.graph.node import Node, nodes_below

Row: TypeAlias = dict[Value, Value]  # source → derivative
MIN_MAGNITUDE = 1e-300  # added to a divisor, so that it is not 0; 1/MIN_MAGNITUDE is still finite


def argument_derivatives(
    op: str, result: Value, args: Sequence[Value], table: Value = None
) -> tuple[Value, ...]:
    """Return ∂result/∂a of each argument a; 0.0 if the operator is constant in the argument."""
    if table is not None:
        return (apply("interp_slope", *args, value=table) if op == "interp" else 0.0,)
    rule = _DERIVATIVE_RULES.get(op)
    return rule(result, *args) if rule else (0.0,) * len(args)


def partials(node: Node) -> tuple[tuple[Node, Node], ...]:
    """Return (argument, ∂node/∂argument) for each argument whose derivative is not constantly 0."""
    graph = node.graph
    if node not in graph.partials:
        table = graph.tables[node.value] if node.op in ("interp", "interp_slope") else None
        derivatives = argument_derivatives(node.op, node, node.args, table)
        graph.partials[node] = tuple(
            (a, graph.node(d))
            for a, d in zip(node.args, derivatives, strict=True)
            if isinstance(d, Node) or d != 0.0
        )
    return graph.partials[node]


def combine(op: str, args: Sequence[Value], rows: Sequence[Row], factors: Sequence[Value]) -> Row:
    """Return the row {source: derivative} of a result from the rows of its arguments.

    The arms of `where` are combined by a choice, never by a product with 0, because the other arm can be NaN.
    """
    if op == "where":
        _, a, b = rows
        return {source: apply("where", args[0], a.get(source, 0.0), b.get(source, 0.0)) for source in a | b}
    combination: Row = {}
    for row, factor in zip(rows, factors, strict=True):
        is_number = type(factor) is float
        if not row or (is_number and factor == 0.0):
            continue
        terms = row if is_number and factor == 1.0 else {source: factor * x for source, x in row.items()}
        if not combination:
            combination = terms  # a row is never changed, so two results can share one
            continue
        combination = {**combination}
        for source, x in terms.items():
            combination[source] = combination[source] + x if source in combination else x
    return combination


def jacobian_rows(roots: Sequence[Node], sources: Sequence[Node]) -> list[dict[Node, Node]]:
    """Return, for each root, a dict {source: derivative} of nodes, for the sources on which the root depends."""
    rows: dict[Node, Row] = {source: {source: 1.0} for source in sources}
    for node in nodes_below(roots):
        argument_rows = [rows.get(a, {}) for a in node.args]
        if node in rows or not any(argument_rows):
            continue
        table = node.graph.tables[node.value] if node.op in ("interp", "interp_slope") else None
        rows[node] = combine(
            node.op, node.args, argument_rows, argument_derivatives(node.op, node, node.args, table)
        )
    return [{s: r.graph.node(d) for s, d in rows.get(r, {}).items()} for r in roots]


def _choice(first: Value) -> tuple[Value, Value]:
    return apply("where", first, 1.0, 0.0), apply("where", first, 0.0, 1.0)


def _div(r: Value, a: Value, b: Value) -> tuple[Value, Value]:
    inverse = apply("div", 1.0, b)
    return inverse, -(r * inverse)


def _atan2(r: Value, y: Value, x: Value) -> tuple[Value, Value]:
    square = x * x + y * y + MIN_MAGNITUDE
    return apply("div", x, square), -apply("div", y, square)


def _hypot(r: Value, a: Value, b: Value) -> tuple[Value, Value]:
    return apply("div", a, r + MIN_MAGNITUDE), apply("div", b, r + MIN_MAGNITUDE)


def _pow(r: Value, a: Value, b: Value) -> tuple[Value, Value]:
    base_derivative = b * power(a, b - 1.0)
    is_positive = apply("lt", 0.0, a)
    return base_derivative, apply("where", is_positive, r * apply("log", a), 0.0)


def _asin(a: Value) -> Value:
    return apply("div", 1.0, apply("sqrt", 1.0 - a * a))


_DERIVATIVE_RULES: dict[str, Callable[..., tuple[Value, ...]]] = {
    "add": lambda r, a, b: (1.0, 1.0),
    "sub": lambda r, a, b: (1.0, -1.0),
    "mul": lambda r, a, b: (b, a),
    "div": _div,
    "neg": lambda r, a: (-1.0,),
    "sin": lambda r, a: (apply("cos", a),),
    "cos": lambda r, a: (-apply("sin", a),),
    "tan": lambda r, a: (1.0 + r * r,),
    "asin": lambda r, a: (_asin(a),),
    "acos": lambda r, a: (-_asin(a),),
    "atan": lambda r, a: (apply("div", 1.0, 1.0 + a * a),),
    "atan2": _atan2,
    "sinh": lambda r, a: (apply("cosh", a),),
    "cosh": lambda r, a: (apply("sinh", a),),
    "tanh": lambda r, a: (1.0 - r * r,),
    "exp": lambda r, a: (r,),
    "log": lambda r, a: (apply("div", 1.0, a),),
    "sqrt": lambda r, a: (apply("div", 0.5, r + MIN_MAGNITUDE),),
    "hypot": _hypot,
    "abs": lambda r, a: (apply("sign", a),),
    "min": lambda r, a, b: _choice(apply("le", a, b)),
    "max": lambda r, a, b: _choice(apply("le", b, a)),
    "pow": _pow,
    "where": lambda r, c, a, b: (0.0, *_choice(c)),
}
