"""Derivatives of a graph: local partials of every operator, and exact forward Jacobians of expressions."""

from baqueano.symbolic.node import Graph, Node


def partials(node: Node) -> tuple[tuple[Node, Node], ...]:
    """(argument, ∂node/∂argument) for each argument that the node depends on smoothly; kinks take one side."""
    return tuple((a, d) for a, d in zip(node.args, _partials(node), strict=True) if d is not None)


def _partials(node: Node) -> list[Node | None]:
    g, a = node.graph, node.args
    m = g.make

    def n(x: float) -> Node:
        return g.const(x)

    match node.op:
        case "add":
            return [n(1.0), n(1.0)]
        case "sub":
            return [n(1.0), n(-1.0)]
        case "mul":
            return [a[1], a[0]]
        case "div":
            inverse = m("div", n(1.0), a[1])
            return [inverse, m("neg", m("mul", node, inverse))]
        case "neg":
            return [n(-1.0)]
        case "sin":
            return [m("cos", a[0])]
        case "cos":
            return [m("neg", m("sin", a[0]))]
        case "tan":
            return [m("add", n(1.0), m("mul", node, node))]
        case "asin" | "acos":
            slope = m("div", n(1.0), m("sqrt", m("sub", n(1.0), m("mul", a[0], a[0]))))
            return [slope if node.op == "asin" else m("neg", slope)]
        case "atan":
            return [m("div", n(1.0), m("add", n(1.0), m("mul", a[0], a[0])))]
        case "sinh":
            return [m("cosh", a[0])]
        case "cosh":
            return [m("sinh", a[0])]
        case "tanh":
            return [m("sub", n(1.0), m("mul", node, node))]
        case "exp":
            return [node]
        case "log":
            return [m("div", n(1.0), a[0])]
        case "sqrt":
            return [m("div", n(0.5), node)]
        case "abs":
            return [m("sign", a[0])]
        case "interp":
            return [m("interp_slope", a[0], value=node.value)]
        case "where":
            return [None, m("where", a[0], n(1.0), n(0.0)), m("where", a[0], n(0.0), n(1.0))]
        case "min" | "max":
            first = m("le", a[0], a[1]) if node.op == "min" else m("le", a[1], a[0])
            return [m("where", first, n(1.0), n(0.0)), m("where", first, n(0.0), n(1.0))]
        case "hypot":
            return [_ratio(g, a[0], node), _ratio(g, a[1], node)]
        case "atan2":
            square = m("add", m("mul", a[0], a[0]), m("mul", a[1], a[1]))
            return [m("div", a[1], square), m("neg", m("div", a[0], square))]
        case "pow":
            slope = m("mul", a[1], m("pow", a[0], m("sub", a[1], n(1.0))))
            return [slope, None if a[1].op == "const" else m("mul", node, m("log", a[0]))]
        case _:  # sign, floor, comparisons and logic are flat
            return [None] * len(a)


def _ratio(g: Graph, a: Node, length: Node) -> Node:
    """a / length, 0 at the origin."""
    zero = g.const(0.0)
    safe = g.make("where", g.make("eq", length, zero), g.const(1.0), length)
    return g.make("div", a, safe)
