"""Kernels of plain Python against NumPy tick by tick, and against CasADi's derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.symbolic.arrays.scalar import apply
from baqueano.symbolic.graph.node import Graph
from baqueano.symbolic.graph.program import Program
from baqueano.symbolic.python_code.python import make_kernel

from .random_programs import CaseOfKernel, in_casadi, in_numpy, random_program


class Case(CaseOfKernel):
    """A program, its input numbers, and its kernel in Python."""

    make_kernel = staticmethod(make_kernel)


def close(result, expected, tolerance=1e-12):
    np.testing.assert_allclose(result, expected, rtol=tolerance, atol=tolerance)


def one_tick(*outputs, inputs=(), carry=(), next_carry=()):
    graph = (inputs or carry)[0].graph
    nodes = tuple(graph.node(y) for y in outputs)
    return Program(graph, (), (), tuple(graph.const(0.5) for _ in carry), carry, inputs, next_carry, nodes)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_kernel_values_equal_the_numpy_values(seed):
    case = Case(random_program(seed, operations=250, m=40), seed=seed)
    expected = in_numpy(case.program, case.theta, case.start, case.inputs)
    for result, reference in zip(case.run(), expected, strict=True):
        close(result, reference)


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_derivatives_equal_the_derivatives_of_casadi(seed):
    case = Case(random_program(seed), n=3, seed=seed)
    outputs = np.empty((case.n, len(case.program.outputs)))
    slopes = np.empty((*outputs.shape, len(case.theta)))
    case.kernel.sensitivities(*case.given(), outputs, slopes)
    expected, slopes_of_casadi = in_casadi(case.program, case.theta, case.start, case.inputs)
    close(outputs, expected, 1e-11)
    # if_else multiplies an arm that is inf by 0
    slopes_of_casadi = np.where(np.isnan(slopes_of_casadi), slopes, slopes_of_casadi)
    close(slopes, slopes_of_casadi, 1e-9 * max(1.0, np.abs(slopes_of_casadi).max()))


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_several_runs_in_one_call_equal_separate_runs(seed):
    program = random_program(seed)
    case, draw, size = Case(program), np.random.default_rng(seed), 3
    theta = draw.normal(size=(size, len(program.theta)))
    start = draw.normal(size=(size, len(program.start)))
    is_shared = (True, False, True)
    shared_inputs, inputs = case.inputs[:, [0, 2]], draw.normal(size=(size, case.n, 1))
    outputs = np.empty((size, case.n, len(program.outputs)))
    final, final_copy = np.empty((size, len(program.carry))), np.empty((size, len(program.carry)))
    case.kernel.batch(theta, start, shared_inputs, inputs, is_shared, outputs, final)
    case.kernel.batch(theta, start, shared_inputs, inputs, is_shared, None, final_copy)
    close(final_copy, final)
    for k in range(size):
        case.theta, case.start = theta[k], start[k]
        case.inputs = np.column_stack([shared_inputs[:, 0], inputs[k], shared_inputs[:, 1]])
        close(outputs[k], case.run()[0])
        close(final[k], case.run()[1])


def test_a_kernel_continues_correctly_after_a_division_by_zero():
    graph = Graph()
    x = graph.symbol("x")
    program = one_tick(
        1.0 / x, apply("sqrt", x), apply("log", x), apply("floor", x), apply("exp", 1000.0 + x),
        apply("sin", 1.0 / x), apply("where", x < 0.5, 2.0, 1.0 / x), inputs=(x,),
    )  # fmt: skip
    kernel, final = make_kernel(program), np.zeros(0)
    inputs, outputs = np.array([[2.0], [0.0], [-1.0]]), np.empty((3, 7))
    kernel.run(final, final, inputs, outputs, final)
    assert kernel.checks_errors
    close(outputs[0], [0.5, 2**0.5, np.log(2.0), 2.0, np.inf, np.sin(0.5), 0.5])
    close(outputs[1], [np.inf, 0.0, -np.inf, 0.0, np.inf, np.nan, 2.0])
    close(outputs[2], [-1.0, np.nan, np.nan, -1.0, np.inf, np.sin(-1.0), 2.0])


def test_an_inactive_branch_is_not_computed():
    graph = Graph()
    x = graph.symbol("x")
    program = one_tick(apply("where", x != 0.0, 1.0 / x, 0.0), inputs=(x,))
    kernel, outputs = make_kernel(program), np.empty((1, 1))
    kernel.run(np.zeros(0), np.zeros(0), np.zeros((1, 1)), outputs, np.zeros(0))
    assert not kernel.checks_errors
    assert outputs[0, 0] == 0.0


def test_minimum_and_maximum_propagate_nan_like_numpy():
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    program = one_tick(apply("min", x, y), apply("max", x, y), inputs=(x, y))
    rows = np.array([[1.0, np.nan], [np.nan, 1.0], [1.0, 2.0], [2.0, 1.0]])
    outputs = np.empty((4, 2))
    make_kernel(program).run(np.zeros(0), np.zeros(0), rows, outputs, np.zeros(0))
    close(outputs, np.column_stack([np.minimum(*rows.T), np.maximum(*rows.T)]))


def test_a_chain_of_500_terms_can_be_compiled():
    graph = Graph()
    x = graph.symbol("x")
    y = x
    for k in range(500):
        y = apply("sin", y * 1.1 + float(k))
    outputs = np.empty((1, 1))
    none = np.zeros(0)
    make_kernel(one_tick(y, inputs=(x,))).run(none, none, np.ones((1, 1)), outputs, none)
    assert np.isfinite(outputs).all()


def test_booleans_are_added_as_integers_in_a_batch():
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    program = one_tick((x > 0.0) + (y > 0.0), -(x > 0.0), inputs=(x, y))
    outputs = np.empty((2, 1, 2))
    w = np.array([[[1.0, 1.0]], [[-1.0, 1.0]]])
    make_kernel(program).batch(
        np.zeros((2, 0)), np.zeros((2, 0)), np.zeros((1, 0)), w, (False, False), outputs, np.zeros((2, 0))
    )
    close(outputs[:, 0], [[2.0, -1.0], [1.0, 0.0]])


@pytest.mark.parametrize("points", [2, 3, 1000])
def test_table_lookup_equals_numpy(points):
    draw = np.random.default_rng(points)
    table = np.sort(draw.normal(size=points)), draw.normal(size=points)
    graph = Graph()
    x = graph.symbol("x")
    y = apply("interp", x, value=table)
    inputs = np.concatenate([draw.normal(size=50), table[0], [-9.0, 9.0, np.nan]])[:, None]
    outputs, final = np.empty((len(inputs), 1)), np.zeros(0)
    kernel = make_kernel(one_tick(y, inputs=(x,)))
    kernel.run(final, final, inputs, outputs, final)
    close(outputs[:, 0], np.interp(inputs[:, 0], *table))
    w = np.empty((len(inputs), 1, 1))
    kernel.batch(np.zeros((len(inputs), 0)), np.zeros((len(inputs), 0)), np.zeros((1, 0)),
                 inputs[:, None], (False,), w, np.zeros((len(inputs), 0)))  # fmt: skip
    close(w[:, 0, 0], outputs[:, 0])


@pytest.mark.parametrize("seed", range(12))
def test_a_bound_call_equals_a_run_of_one_tick(seed):
    program = random_program(seed)
    bound_nodes = (*program.theta, *program.start, *program.carry)
    tick = Program(program.graph, (), (), (), (), (*bound_nodes, *program.inputs), (), program.outputs * 2)
    draw = np.random.default_rng(seed)
    inputs = draw.normal(size=(1, len(tick.inputs)))
    outputs = np.empty((1, len(tick.outputs)))
    none = np.zeros(0)
    kernel = make_kernel(tick)
    call = kernel.bind(none, none, inputs, outputs, none)
    for _ in range(5):
        inputs[:] = draw.normal(size=inputs.shape)
        assert not call()
        expected = np.empty_like(outputs)
        kernel.run(none, none, inputs, expected, none)
        close(outputs, expected)


def test_a_bound_call_works_after_a_division_by_zero():
    graph = Graph()
    x = graph.symbol("x")
    program = one_tick(1.0 / x, apply("where", x < 0.5, 2.0, 1.0 / x), inputs=(x,))
    inputs, outputs, none = np.array([[0.0]]), np.empty((1, 2)), np.zeros(0)
    call = make_kernel(program).bind(none, none, inputs, outputs, none)
    call()
    assert outputs.tolist() == [[np.inf, 2.0]]
    inputs[0, 0] = 2.0
    call()
    assert outputs.tolist() == [[0.5, 0.5]]
