"""Derivatives: shapes, arguments, nesting, and no objects that remain in memory."""

import gc
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.symbolic import function, jacobian, scan
from baqueano.symbolic.derivatives.dual import Dual, chain_rule
from baqueano.symbolic.graph.node import Node

vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


def bent(x, k=1.0):
    return np.array([np.sin(x[0]) * x[1], np.exp(k * x[2]) + x[0] ** 2])


def length(x):
    return np.sqrt(x @ x + 1.0)


def close(result, expected, tolerance=1e-12):
    np.testing.assert_allclose(result, expected, rtol=tolerance, atol=tolerance)


@settings(max_examples=25)
@given(x=vectors)
def test_es13_the_jacobian_equals_the_jacobian_of_casadi(x):
    s = ca.SX.sym("x", 3)
    y = ca.vertcat(ca.sin(s[0]) * s[1], ca.exp(s[2]) + s[0] ** 2)
    close(jacobian(bent)(x), np.array(ca.Function("f", [s], [ca.jacobian(y, s)])(x)))


@settings(max_examples=25)
@given(x=vectors)
def test_a_second_derivative_equals_the_hessian_of_casadi(x):
    s = ca.SX.sym("x", 3)
    hessian = np.array(ca.Function("f", [s], [ca.hessian(ca.sqrt(ca.dot(s, s) + 1.0), s)[0]])(x))
    close(jacobian(jacobian(length))(x), hessian)
    close(function(jacobian(jacobian(length)), x, backend="python")(x), hessian)


def test_the_shape_of_a_jacobian_is_output_shape_then_argument_shape():
    x = np.ones(3)
    assert jacobian(bent)(x).shape == (2, 3)
    assert jacobian(length)(x).shape == (3,)
    assert jacobian(bent, argument=1)(x, 0.5).shape == (2,)
    assert type(jacobian(lambda t: t * t)(3.0)) is float
    assert jacobian(lambda A: A @ x)(np.eye(3)).shape == (3, 3, 3)
    assert jacobian(lambda x: 2.0)(x).tolist() == [0.0, 0.0, 0.0]
    assert jacobian(lambda x: [x[0], 1.0])(x).tolist() == [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_derivatives_outside_a_trace_are_plain_floats():
    assert jacobian(bent)(np.ones(3)).dtype == float
    assert type(jacobian(bent)(np.ones(3))) is np.ndarray


def test_the_jacobian_with_respect_to_each_argument_is_correct():
    x, y = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    close(jacobian(lambda x, y: x * y, 0)(x, y), np.diag(y))
    close(jacobian(lambda x, y: x * y, 1)(x, y), np.diag(x))


def test_integer_arguments_have_derivatives():
    close(jacobian(lambda x: x**2)(np.array([1, 2])), np.diag([2.0, 4.0]))


def test_a_nested_derivative_does_not_change_the_outer_derivative():
    # d/dx [x · d/dy (x + y)] = 1: the classical confusion of perturbations would give 2
    assert jacobian(lambda x: x * jacobian(lambda y: x + y)(1.0))(1.0) == 1.0
    close(jacobian(lambda x: jacobian(lambda y: x[0] * y * y)(x[1]))(np.array([3.0, 5.0])), [10.0, 6.0])


@pytest.mark.parametrize("backend", ["numpy", "python"])
def test_a_gradient_of_a_step_with_a_derivative_is_correct(backend):
    def step(theta, x, u):
        slope = jacobian(lambda x: np.sin(theta[0] * x) + theta[1] * x * x)(x)
        return x + 0.1 * slope * u, slope * slope

    kernel = scan(step, 0.2, 0.0, np.zeros(2), backend=backend)
    inputs, theta, h = np.array([1.0, -0.5, 2.0, 0.3]), np.array([0.8, 0.4]), 1e-6
    _, gradient = kernel.cost_and_gradient(inputs, theta)
    for k, e in enumerate(np.eye(2) * h):
        close(gradient[k], (kernel.cost(inputs, theta + e) - kernel.cost(inputs, theta - e)) / (2 * h), 1e-7)


@dataclass(frozen=True, slots=True, eq=False)
class Spring:
    stiffness: float

    def force(self, x):
        return -self.stiffness * x**3


def test_methods_and_partial_functions_can_be_differentiated():
    assert jacobian(Spring(2.0).force)(3.0) == -54.0
    close(jacobian(partial(bent, k=2.0))(np.zeros(3))[1], [0.0, 0.0, 2.0])
    assert jacobian(bent).__name__ == "bent"


def test_computing_derivatives_leaves_no_objects_in_memory():
    jacobian(bent)(np.ones(3))
    gc.freeze()  # the objects of other tests are not collected, and not counted
    try:
        for _ in range(20):
            jacobian(bent)(np.ones(3))
        gc.collect()
        assert not [x for x in gc.get_objects() if isinstance(x, Dual | Node)]
    finally:
        gc.unfreeze()


def test_the_chain_rule_gives_the_same_derivatives_also_of_a_derivative():
    def f(x):
        return np.array([np.sin(x[0]) * x[1], x[0] ** 2, x[2]])

    def g(inner):
        return lambda x: inner(np.array([x[0] * x[1], x[2] - 1.0, x[3]])) * x[0]

    x = np.array([0.3, 0.7, 2.0, -0.4])
    np.testing.assert_allclose(chain_rule(f)(x[:3]), f(x[:3]))
    for derivative in (jacobian, lambda h: jacobian(lambda x: jacobian(h)(x).ravel())):
        expected = derivative(g(f))(x)
        np.testing.assert_allclose(derivative(g(chain_rule(f)))(x), expected, rtol=1e-14)
        f_dot = function(derivative(g(chain_rule(f))), x)
        np.testing.assert_allclose(f_dot(x), expected, rtol=1e-14)
