"""Random programs and their values: tick by tick through NumPy, and as one CasADi expression."""

import operator
from collections.abc import Callable, Iterable

import casadi as ca
import numpy as np

from baqueano.symbolic import ieee
from baqueano.symbolic.graph.emit import postorder
from baqueano.symbolic.graph.node import Graph, Node
from baqueano.symbolic.graph.program import Kernel, Program

SMOOTH = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")
KINKS = ("abs", "sign", "floor", "not")
TWO = ("add", "sub", "mul", "div", "pow", "hypot", "atan2", "min", "max", "lt", "le", "eq", "ne", "and", "or")


def random_program(
    seed: int, p: int = 5, c: int = 4, q: int = 3, m: int = 5, operations: int = 80
) -> Program:
    """Return a program that is bounded for any input, and smooth except for kinks that random numbers miss."""
    draw = np.random.default_rng(seed)
    graph = Graph()
    theta, start, carry, inputs = (
        tuple(graph.symbol(f"{name}{k}") for k in range(size))
        for name, size in (("theta", p), ("start", c), ("carry", c), ("input", q))
    )
    initial = [*theta, *start, *map(graph.const, (0.5, -2.0, 3.0))]
    tick = [*initial[:p], *carry, *inputs, *carry]
    for pool, count in ((initial, 10), (tick, operations)):
        for _ in range(count):
            pool.append(_random_node(graph, pool, draw))
    return Program(
        graph, theta, start, tuple(initial[-c:]), carry, inputs,
        next_carry=tuple(graph.make("sin", node) for node in tick[-2 * c : -c]), outputs=tuple(tick[-m:]),
    )  # fmt: skip


def _random_node(graph: Graph, pool: list[Node], draw: np.random.Generator) -> Node:
    def pick() -> Node:
        return pool[
            draw.integers(len(pool) // 2, len(pool)) if draw.random() < 0.5 else draw.integers(len(pool))
        ]

    def bounded(node: Node) -> Node:  # (-0.9, 0.9)
        return graph.make("mul", graph.const(0.9), graph.make("sin", node))

    def positive(node: Node) -> Node:  # (0.1, 1.9)
        return graph.make("add", graph.const(1.0), bounded(node))

    op = str(draw.choice([*SMOOTH, *KINKS, *TWO, "neg", "where", "where", "where"]))
    if op == "where":
        return graph.make("where", graph.make("lt", pick(), pick()), pick(), pick())
    if op in ("log", "sqrt"):
        return graph.make(op, positive(pick()))
    if op in (*SMOOTH, *KINKS, "neg"):
        return graph.make(op, bounded(pick()))
    if op in ("div", "pow"):
        return graph.make(op, positive(pick()), positive(pick()))
    if op == "atan2":  # away from its cut: the sign of a zero is not defined
        y = positive(pick())
        return graph.make(op, graph.make("neg", y) if draw.random() < 0.5 else y, pick())
    return graph.make(op, bounded(pick()), pick())


def _values(roots: Iterable[Node], inputs: dict[Node, object], apply: Callable) -> list:
    values = dict(inputs)
    for node in postorder(roots, lambda node: node in values):
        values[node] = node.value if node.op == "const" else apply(node, [values[a] for a in node.args])
    return [values[root] for root in roots]


def _in_numpy(node: Node, args: list[float]) -> float:
    if node.op == "interp":
        return float(np.interp(args[0], *node.graph.tables[node.value]))
    return float(ieee.OPERATORS[node.op](*args))


IN_CASADI: dict[str, Callable] = {
    "neg": operator.neg, "add": operator.add, "sub": operator.sub, "mul": operator.mul,
    "div": operator.truediv, "lt": operator.lt, "le": operator.le, "eq": operator.eq, "ne": operator.ne,
    "pow": operator.pow, "abs": ca.fabs, "min": ca.fmin, "max": ca.fmax, "and": ca.logic_and,
    "or": ca.logic_or, "not": ca.logic_not, "hypot": lambda a, b: ca.sqrt(a * a + b * b), "where": ca.if_else,
}  # fmt: skip


def _in_casadi(node: Node, args: list) -> object:
    return (IN_CASADI.get(node.op) or getattr(ca, node.op))(*map(ca.SX, args))


def _unrolled(program: Program, theta, start, inputs, apply: Callable) -> tuple[list, list]:
    """Return (outputs of all ticks, carry after the last tick)."""
    inputs_by_node = dict(zip((*program.theta, *program.start), (*theta, *start), strict=True))
    carry = _values(program.initial, inputs_by_node, apply)
    outputs = []
    for row in inputs:
        values = inputs_by_node | dict(zip((*program.carry, *program.inputs), (*carry, *row), strict=True))
        results = _values((*program.outputs, *program.next_carry), values, apply)
        outputs += results[: len(program.outputs)]
        carry = results[len(program.outputs) :]
    return outputs, carry


def in_numpy(program: Program, theta, start, inputs, rounding=None) -> tuple[np.ndarray, np.ndarray]:
    """Return outputs (N, m) and the last carry (c,); `rounding` changes the last digit of every operation."""

    def apply(node: Node, args: list[float]) -> float:
        value = _in_numpy(node, args)
        return value if rounding is None else value * (1.0 + 1e-15 * rounding.normal())

    with np.errstate(all="ignore"):
        outputs, carry = _unrolled(program, theta, start, inputs, apply)
    return np.reshape(np.array(outputs, float), (len(inputs), len(program.outputs))), np.array(carry, float)


def in_casadi(program: Program, theta, start, inputs) -> tuple[np.ndarray, np.ndarray]:
    """Return outputs (N, m) and their derivatives (N, m, p)."""
    symbols = ca.SX.sym("theta", len(theta))
    outputs, _ = _unrolled(program, ca.vertsplit(symbols), start, inputs, _in_casadi)
    stack = ca.vertcat(*outputs)
    values, slopes = ca.Function("f", [symbols], [stack, ca.jacobian(stack, symbols)])(theta)
    n = len(inputs)
    return np.reshape(np.array(values), (n, -1)), np.reshape(np.array(slopes), (n, -1, len(theta)))


class CaseOfKernel:
    """A program, its input numbers, and its kernel."""

    make_kernel: Callable[[Program], Kernel]

    def __init__(self, program: Program, n: int = 4, seed: int = 0) -> None:
        draw = np.random.default_rng(seed)
        self.program, self.n = program, n
        self.theta = draw.normal(size=len(program.theta))
        self.start = draw.normal(size=len(program.start))
        self.inputs = draw.normal(size=(n, len(program.inputs)))
        self.kernel = self.make_kernel(program)

    def given(self) -> tuple:
        return self.theta, self.start, self.inputs

    def run(self) -> tuple[np.ndarray, np.ndarray]:
        outputs, final = np.empty((self.n, len(self.program.outputs))), np.empty(len(self.program.carry))
        self.kernel.run(*self.given(), outputs, final)
        return outputs, final
