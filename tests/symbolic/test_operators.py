"""Every operator: its value by IEEE 754, its derivatives by CasADi, its simplification rules by value."""

import math
import operator
import warnings

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.geometry import wrap
from baqueano.symbolic import ieee
from baqueano.symbolic.arrays.scalar import apply, power
from baqueano.symbolic.derivatives.derive import jacobian_rows, partials
from baqueano.symbolic.derivatives.dual import Dual
from baqueano.symbolic.graph.node import Graph, nodes_below

INF, NAN = math.inf, math.nan
IN_NUMPY = {
    "div": np.divide, "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos,
    "atan": np.arctan, "atan2": np.arctan2, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "exp": np.exp,
    "log": np.log, "sqrt": np.sqrt, "hypot": np.hypot, "abs": np.abs, "sign": np.sign, "min": np.minimum,
    "max": np.maximum, "floor": np.floor, "pow": np.power, "lt": np.less, "le": np.less_equal, "eq": np.equal,
    "ne": np.not_equal, "and": np.logical_and, "or": np.logical_or, "not": np.logical_not, "isnan": np.isnan,
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "neg": np.negative,
}  # fmt: skip
HARD = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -2.5, 1e-320, 1e300, -1e300, 710.0, INF, -INF, NAN]
IN_CASADI = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv,
    "neg": operator.neg, "pow": operator.pow, "abs": ca.fabs, "min": ca.fmin, "max": ca.fmax,
    "atan2": ca.atan2, "hypot": lambda a, b: ca.sqrt(a * a + b * b), "where": ca.if_else,
} | {name: getattr(ca, name) for name in (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
    "sign", "floor",
)}  # fmt: skip
INSIDE = {"asin": 0.9, "acos": 0.9}  # largest argument
number = st.floats(0.05, 3.0)


@pytest.mark.parametrize("op", IN_NUMPY)
def test_every_operator_equals_numpy_without_errors_or_warnings(op):
    two = IN_NUMPY[op].nin == 2
    pairs = [(a, b) for a in HARD for b in HARD] if two else [(a,) for a in HARD]
    for args in pairs:
        if (op, *args) == ("pow", -INF, 0.5):  # NumPy returns the square root, C returns inf
            continue
        with np.errstate(all="ignore"):
            expected = float(IN_NUMPY[op](*args))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = float(ieee.OPERATORS[op](*args))
        np.testing.assert_allclose(result, expected, rtol=4e-16, err_msg=f"{op}{args}")


@pytest.mark.parametrize("op", IN_CASADI)
@settings(max_examples=20)
@given(numbers=st.tuples(number, number, number), signs=st.tuples(*[st.sampled_from([1.0, -1.0])] * 3))
def test_derivatives_equal_the_derivatives_of_casadi(op, numbers, signs):
    count = 3 if op == "where" else 2 if IN_NUMPY.get(op) and IN_NUMPY[op].nin == 2 else 1
    signs = (1.0, 1.0, 1.0) if op in ("log", "sqrt", "pow") else signs
    limit = INSIDE.get(op, INF)
    values = [min(x, limit) * s for x, s in zip(numbers, signs, strict=True)][:count]
    if op in ("min", "max") and values[0] == values[1]:
        return
    x = ca.SX.sym("x", count)
    y = IN_CASADI[op](*(ca.vertsplit(x) if op != "where" else (x[0] > 0, x[1], x[2])))
    expected = np.array(ca.Function("f", [x], [ca.jacobian(y, x)])(values)).ravel()
    level_one = [Dual(v, {k: 1.0}, 1) for k, v in enumerate(values)]
    arguments = level_one if op != "where" else [values[0] > 0, *level_one[1:]]
    result = apply(op, *arguments)
    row = result.row if isinstance(result, Dual) else {}
    np.testing.assert_allclose([row.get(k, 0.0) for k in range(count)], expected, rtol=1e-12, atol=1e-12)


def test_a_power_has_derivatives_by_base_and_exponent():
    a, b = Dual(1.3, {0: 1.0}, 1), Dual(0.7, {1: 1.0}, 1)
    row = power(a, b).row
    np.testing.assert_allclose([row[0], row[1]], [0.7 * 1.3**-0.3, math.log(1.3) * 1.3**0.7], rtol=1e-15)
    assert slope(power(0.0, b)) == 0.0


def test_derivatives_at_a_kink_are_finite():
    zero = Dual(0.0, {0: 1.0}, 1)
    assert slope(apply("hypot", zero, zero)) == 0.0
    assert slope(apply("atan2", zero, zero)) == 0.0
    assert slope(apply("sqrt", zero * zero)) == 0.0
    assert slope(apply("sqrt", apply("max", Dual(-1.0, {0: 1.0}, 1), 0.0))) == 0.0
    assert slope(apply("abs", zero)) == 0.0
    assert slope(apply("where", True, 3.0 * zero, apply("log", zero))) == 3.0


def slope(result):
    return sum(result.row.values()) if isinstance(result, Dual) else 0.0


SIMPLE = [
    (lambda x, y: x + 0.0, "x"),
    (lambda x, y: 0 + x, "x"),
    (lambda x, y: x - 0.0, "x"),
    (lambda x, y: x * 1, "x"),
    (lambda x, y: x / 1.0, "x"),
    (lambda x, y: -(0.0 - x), "x"),
    (lambda x, y: x**1, "x"),
    (lambda x, y: +x, "x"),
    (lambda x, y: x * 0.0, 0.0),
    (lambda x, y: 0.0 / x, 0.0),
    (lambda x, y: x - x, 0.0),
    (lambda x, y: x**0, 1.0),
    (lambda x, y: apply("where", x < y, 2.0, 2.0), 2.0),
    (lambda x, y: apply("where", True, x, y), "x"),
    (lambda x, y: apply("min", x, INF), "x"),
    (lambda x, y: apply("max", -INF, x), "x"),
    (lambda x, y: apply("min", x, x), "x"),
    (lambda x, y: 0.5 * (x + x), "x"),
    (lambda x, y: x < x, np.False_),
    (lambda x, y: x > INF, np.False_),
    (lambda x, y: (x < y) & False, np.False_),
    (lambda x, y: (x < y) | True, np.True_),
    (lambda x, y: apply("isnan", x < y), np.False_),
]
EQUAL = [
    (lambda x, y: x + y, lambda x, y: y + x),
    (lambda x, y: x * y, lambda x, y: y * x),
    (lambda x, y: x - (-y), lambda x, y: x + y),
    (lambda x, y: x + (-y), lambda x, y: x - y),
    (lambda x, y: -(x - y), lambda x, y: y - x),
    (lambda x, y: (-x) * y, lambda x, y: -(x * y)),
    (lambda x, y: (-x) - y, lambda x, y: -(x + y)),
    (lambda x, y: x * -1.0, lambda x, y: -x),
    (lambda x, y: 2.0 * (3.0 * x), lambda x, y: 6.0 * x),
    (lambda x, y: -(2.0 * x), lambda x, y: -2.0 * x),
    (lambda x, y: (-x) / y, lambda x, y: x / (-y)),
    (lambda x, y: x / 4.0, lambda x, y: 0.25 * x),
    (lambda x, y: x**2, lambda x, y: x * x),
    (lambda x, y: x**0.5, lambda x, y: apply("sqrt", x)),
    (lambda x, y: x**-1, lambda x, y: 1.0 / x),
    (lambda x, y: apply("not", apply("not", x < y)), lambda x, y: x < y),
    (lambda x, y: x > y, lambda x, y: y < x),
    (lambda x, y: (x < y) & (x < y), lambda x, y: x < y),
    (lambda x, y: (x < y) & True, lambda x, y: x < y),
    (lambda x, y: (x < y) & ~(x < x), lambda x, y: x < y),
    (lambda x, y: (x < y) | False, lambda x, y: x < y),
    (lambda x, y: apply("where", apply("not", x < y), x, y), lambda x, y: apply("where", x < y, y, x)),
    (lambda x, y: apply("where", x < y, 1.0, 0.0), lambda x, y: x < y),
    (lambda x, y: apply("where", x < y, 0.0, 1.0), lambda x, y: apply("not", x < y)),
    (
        lambda x, y: apply("where", x < y, apply("where", x < y, x, 2.0), y),
        lambda x, y: apply("where", x < y, x, y),
    ),
    (
        lambda x, y: apply("where", x < y, x, apply("where", x < y, 2.0, y)),
        lambda x, y: apply("where", x < y, x, y),
    ),
    (lambda x, y: (x < y) > 0.0, lambda x, y: x < y),
    (lambda x, y: (x < y) != 0.0, lambda x, y: x < y),
    (lambda x, y: (x < y) > 0.5, lambda x, y: x < y),
    (lambda x, y: abs(-x), lambda x, y: abs(x)),
    (lambda x, y: apply("cos", -x), lambda x, y: apply("cos", x)),
    (lambda x, y: apply("floor", apply("floor", x)), lambda x, y: apply("floor", x)),
    (lambda x, y: apply("and", x, y), lambda x, y: (x != 0.0) & (y != 0.0)),
    (lambda x, y: apply("max", x, 0.0) + apply("min", x, 0.0), lambda x, y: 0.0 + x),
    (lambda x, y: apply("max", abs(x), 0.0), lambda x, y: abs(x)),
    (
        lambda x, y: apply("min", apply("max", apply("min", apply("max", x, -1.0), 1.0), -2.0), 1.0),
        lambda x, y: apply("min", apply("max", x, -1.0), 1.0),
    ),
    (
        lambda x, y: abs(apply("min", apply("max", x, -1.0), 1.0)) < INF,
        lambda x, y: apply("not", apply("isnan", apply("min", apply("max", x, -1.0), 1.0))),
    ),
]


@pytest.mark.parametrize("case", range(len(SIMPLE)))
def test_constant_expressions_are_simplified_without_a_node(case):
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    make, expected = SIMPLE[case]
    node = make(x, y)
    assert node is x if expected == "x" else (type(node) is type(expected) and node == expected)


@pytest.mark.parametrize("case", range(len(EQUAL)))
def test_equal_expressions_share_one_node(case):
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    first, second = EQUAL[case]
    assert first(x, y) is second(x, y)
    for a, b in ((0.7, 1.9), (1.9, 0.7), (1.3, 1.3)):
        np.testing.assert_allclose(float(first(a, b) + 0.0), float(second(a, b) + 0.0), rtol=1e-15)


def test_an_angle_is_wrapped_without_a_quotient():
    graph = Graph()
    assert "div" not in {node.op for node in nodes_below([wrap(graph.symbol("x"))])}


def test_signed_zeros_are_different_constants_and_all_nan_are_equal():
    graph = Graph()
    assert graph.const(0.0) is not graph.const(-0.0)
    assert graph.const(NAN) is graph.const(-NAN)


def test_equal_tables_are_stored_once():
    graph = Graph()
    x = graph.symbol("x")
    table = np.array([0.0, 1.0]), np.array([2.0, 4.0])
    assert apply("interp", x, value=table) is apply("interp", x, value=tuple(t.copy() for t in table))
    assert apply("interp", graph.const(0.5), value=table) == 3.0
    assert len(graph.tables) == 1


def test_an_expression_is_simplified_after_a_substitution():
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    (node,) = graph.substitute([x * y + apply("sin", y)], {y: graph.const(0.0)})
    assert node.op == "const"
    assert node.value == 0.0


def test_the_node_order_places_arguments_before_the_nodes_that_use_them():
    graph = Graph()
    x = graph.symbol("x")
    order = nodes_below([x * x + 1.0, x])
    assert order.index(x) < next(k for k, node in enumerate(order) if node.op == "mul")


def test_partial_derivatives_equal_to_zero_are_omitted():
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    assert partials(x < y) == ()
    assert next(a for a, _ in partials(apply("where", x < y, x, y))) is x
    assert jacobian_rows([graph.node(x * y)], [x])[0][x] is y


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_forward_derivatives_of_random_expressions_equal_casadi(seed):
    from .random_programs import in_casadi, in_numpy, random_program

    program = random_program(seed, p=3, operations=30)._replace(carry=(), next_carry=(), initial=(), start=())
    from baqueano.symbolic.python_code.python import PythonKernel

    draw = np.random.default_rng(seed)
    theta, inputs = draw.normal(size=3), draw.normal(size=(1, 3))
    symbols_used = {n for n in nodes_below(program.outputs) if n.op == "symbol"} - {
        *program.theta,
        *program.inputs,
    }
    outputs = program.graph.substitute(program.outputs, {s: program.graph.const(0.3) for s in symbols_used})
    program = program._replace(outputs=tuple(outputs))
    y, slopes = np.empty((1, len(outputs))), np.empty((1, len(outputs), 3))
    PythonKernel(program).sensitivities(theta, np.zeros(0), inputs, y, slopes)
    expected, slopes_of_casadi = in_casadi(program, theta, np.zeros(0), inputs)
    np.testing.assert_allclose(y, in_numpy(program, theta, np.zeros(0), inputs)[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(y, expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(slopes, slopes_of_casadi, rtol=1e-9, atol=1e-9)
