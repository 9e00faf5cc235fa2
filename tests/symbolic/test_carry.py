"""Mirrored, constant and unused entries are omitted from the state of the loop, and are restored at the end."""

from typing import NamedTuple

import numpy as np
import pytest

from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.traced import TracedScan

H = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
Q = np.diag([0.1, 0.2])
R = np.diag([1e-3, 2e-3, 3e-3])
N = 12


class Belief(NamedTuple):
    mean: np.ndarray
    cov: np.ndarray


def move(x):
    return np.array([x[0] + 0.1 * np.sin(x[1]), x[1] + 0.1 * x[2] * x[0], 0.9 * x[2]])


def joseph(cov, G):
    cov = G @ cov @ G.T + R
    K = np.linalg.solve(H @ cov @ H.T + Q, H @ cov).T
    A = np.eye(3) - K @ H
    return K, A @ cov @ A.T + K @ Q @ K.T


def short(cov, G):
    cov = G @ cov @ G.T + R
    K = np.linalg.solve(H @ cov @ H.T + Q, H @ cov).T
    return K, cov - K @ H @ cov


def ekf(update):
    def step(belief, z):
        x = move(belief.mean)
        K, cov = update(belief.cov, jacobian(move)(belief.mean))
        return Belief(x + K @ (z - H @ x), cov), x

    return step


def traced(step, carry, inputs, theta=None) -> TracedScan:
    kernel = scan(step, carry, inputs, theta, backend="python")
    assert isinstance(kernel, TracedScan)
    return kernel


def program(kernel, keep_all=True):
    return kernel._runner(keep_all=keep_all)[0].program


START = Belief(np.array([0.1, 0.5, 1.0]), np.eye(3))


def test_a_covariance_in_joseph_form_is_stored_as_one_triangle():
    kernel = traced(ekf(joseph), START, np.zeros(2))
    assert kernel.symmetric == {"carry.cov"}
    assert len(program(kernel).carry) == 3 + 6
    z = np.random.default_rng(0).normal(size=(N, 2))
    last, _ = kernel.run(z)
    expected, _ = scan(ekf(joseph), START, np.zeros(2), backend="numpy").run(z)
    np.testing.assert_allclose(last.cov, expected.cov, rtol=1e-12, atol=1e-15)
    assert np.array_equal(last.cov, last.cov.T)


def test_symmetry_reduces_the_number_of_operations():
    start = START._replace(cov=np.eye(3) + np.triu(np.full((3, 3), 0.1), 1))  # not symmetric
    full, half = traced(ekf(joseph), start, np.zeros(2)), traced(ekf(joseph), START, np.zeros(2))
    assert full.symmetric == set()
    assert half.operations < 0.9 * full.operations


def test_a_matrix_that_is_symmetric_only_at_the_start_is_stored_completely():
    kernel = traced(ekf(short), START, np.zeros(2))
    assert kernel.symmetric == set()
    assert len(program(kernel).carry) == 3 + 9

    def shift(past, u):
        return np.vstack([u, past[:-1]]), past[-1]

    line = traced(shift, np.zeros((3, 3)), np.zeros(3))
    assert line.symmetric == set()
    u = np.arange(15.0).reshape(5, 3)
    np.testing.assert_array_equal(line.run(u)[1], np.vstack([np.zeros((3, 3)), u[:2]]))


@pytest.mark.parametrize("start", [START.cov, np.triu(START.cov + 0.1), np.zeros((3, 3))])
def test_entries_that_stay_zero_are_omitted_only_for_a_start_with_these_zeros(start):
    def step(theta, cov, x):
        A = np.diag([0.9, theta[0], x]) + np.array([[0.0, x, 0.0], [0.0] * 3, [0.0] * 3])
        cov = A @ cov @ A.T + np.diag([x**2, 0.0, 0.0])
        return cov, np.sum(cov)

    theta, x = np.array([0.7]), np.linspace(0.5, 1.0, N)
    kernel = traced(step, np.diag([1.0, 0.0, 0.0]), 0.0, theta)
    assert len(program(kernel).carry) == 1
    reference = scan(step, kernel.example, 0.0, theta, backend="numpy")
    for carry in (kernel.example, start):
        for method in ("run", "sensitivities", "cost_and_gradient", "normal_equations"):
            results = (getattr(k, method)(x, theta, carry=carry) for k in (kernel, reference))
            for value, expected in zip(*results, strict=True):
                np.testing.assert_allclose(value, expected, rtol=1e-12)
    starts = np.stack([kernel.example, start])
    ends = (k.batch(x, np.stack([theta, theta]), starts)[0] for k in (kernel, reference))
    np.testing.assert_allclose(*ends, rtol=1e-12)
    symmetric = start + start.T
    values = kernel.bind_sensitivities(x)(theta, symmetric.ravel())
    for value, expected in zip(values, reference.sensitivities(x, theta, symmetric), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-12)


def test_a_mirrored_matrix_is_treated_as_symmetric():
    i, j = np.indices((3, 3))
    upper = np.minimum(i, j), np.maximum(i, j)

    def update(cov, G):
        K, cov = short(cov, G)
        return K, cov[upper]

    assert traced(ekf(update), START, np.zeros(2)).symmetric == {"carry.cov"}


def test_a_matrix_product_with_a_changed_entry_is_not_treated_as_symmetric():
    def step(cov, x):
        A = np.array([[1.0, x], [0.0, 2.0]])
        B = A @ cov
        B[0, 1] = x
        return B @ A.T, x

    assert traced(step, np.eye(2), 0.0).symmetric == set()


def test_a_matrix_difference_with_a_changed_entry_is_computed_correctly():
    def step(c, x):
        K = np.array([[x], [2.0 * x]])
        A = np.eye(2) - K @ np.array([[1.0, 0.5]])
        A[0, 0] = 7.0
        return c, A @ np.array([[1.0, x], [3.0, 4.0]])

    inputs = np.array([0.3, -0.4])
    result, expected = (scan(step, 0.0, 0.0, backend=b).run(inputs)[1] for b in ("python", "numpy"))
    np.testing.assert_allclose(result, expected, rtol=1e-14)


def test_an_unchanged_carry_entry_is_treated_as_a_constant():
    def step(carry, u):
        x, bias, scale = carry
        return (x + scale * u + bias[0], bias, scale), x

    start = (0.0, np.array([0.25, 9.0]), 2.0)
    kernel = traced(step, start, 0.0)
    assert len(program(kernel).carry) == 1
    assert kernel.unused_carry == ("carry[1][1]",)
    for carry in (None, (1.0, np.array([0.5, 8.0]), 3.0)):
        last, _ = kernel.run(np.ones(4), carry=carry)
        x, bias, scale = start if carry is None else carry
        assert last[0] == x + 4 * (scale + bias[0])
        assert last[1].tolist() == bias.tolist()
        assert last[2] == scale


def test_a_constant_entry_that_depends_on_theta_has_its_derivative():
    def start(theta):
        return theta[0], theta[1] ** 2

    def step(theta, carry, u):
        return (carry[0] + carry[1] * u, carry[1]), carry[0]

    kernel = traced(step, start, 0.0, np.ones(2))
    theta = np.array([0.5, 3.0])
    assert len(program(kernel, keep_all=False).carry) == 1
    _, slopes = kernel.sensitivities(np.ones(3), theta)
    np.testing.assert_allclose(slopes[:, 0], [[1.0, 0.0], [1.0, 6.0], [1.0, 12.0]])
    assert kernel.run(np.ones(3), theta)[0] == (27.5, 9.0)


def test_unused_carry_entries_are_named_and_omitted():
    def step(theta, carry, u):
        v, pose = carry
        v = v + 0.1 * (u - theta[0] * v)
        return (v, pose + 0.1 * np.array([np.cos(pose[1]), v])), v - 1.0

    kernel = traced(step, (0.0, np.zeros(2)), 0.0, np.ones(1))
    assert kernel.unused_carry == ("carry[1][0]", "carry[1][1]")
    assert len(program(kernel, keep_all=False).carry) == 1
    assert len(program(kernel).carry) == 3
    assert kernel.run(np.ones(5), np.ones(1))[0][1][0] == pytest.approx(0.5, abs=0.01)


def test_an_entry_counts_as_used_if_a_used_entry_depends_on_it():
    def step(theta, carry, u):
        a, b, c, d = carry
        return (a + b, b * theta[0], c + d, d), a

    assert traced(step, (0.0, 1.0, 2.0, 3.0), 0.0, np.ones(1)).unused_carry == ("carry[2]", "carry[3]")


@pytest.mark.parametrize("size", [2, 3])
def test_solving_with_a_symmetric_matrix_needs_fewer_operations(size):
    def step(carry, x):
        A = np.diag(x + 2.0) + np.outer(x, x) + carry
        return carry, np.linalg.solve(A, x)

    inputs = np.random.default_rng(1).normal(size=(4, size))
    half = traced(step, np.zeros((size, size)), np.zeros(size))
    full = traced(step, np.triu(np.full((size, size), 1e-3)), np.zeros(size))
    assert half.operations < full.operations
    for kernel in (half, full):
        expected = scan(step, kernel.example, np.zeros(size), backend="numpy").run(inputs)[1]
        np.testing.assert_allclose(kernel.run(inputs)[1], expected, rtol=1e-12, atol=1e-12)
