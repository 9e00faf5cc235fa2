"""Ordinary NumPy code gives the same results when it runs, when it is traced, and when it is differentiated."""

import numpy as np
import pytest
from numpy import array  # bound before any trace

from baqueano.symbolic import function, interp, jacobian, scan, where
from baqueano.symbolic.c_code.compile import find_compiler

TABLE = np.array([-2.0, -0.5, 0.1, 1.0]), np.array([3.0, -1.0, 0.5, 0.25])
T = np.array([[1.0, 0.0, 0.5], [0.0, 2.0, 0.0], [0.25, 0.0, 3.0]])


def fill(x, maker):
    A = maker()
    A[0, 1] = x[0]
    A[1, 1:] = x[1:]
    A += 1.0
    return A @ x


def diagonal_filled(x):
    A = np.zeros((3, 3))
    np.fill_diagonal(A, 2.0)
    np.fill_diagonal(A[:2, :2], x[0])
    return A


def changed_where(x):
    y = x * 2.0
    y[y < 0.5] = 0.0
    return y


def written_later(x):
    y = np.array(x)
    y[1] = x[0] * x[1]
    return y


def after_a_product(x, A):
    B = np.array(A @ T)
    B[0, 0] = x[0]
    return B @ A.T


IDIOMS = {
    "sin and cos": lambda x, y, A: np.sin(x) * np.cos(y),
    "tan of a quotient": lambda x, y, A: np.tan(x / (2.0 + y)),
    "inverse functions": lambda x, y, A: np.arcsin(x / 3) + np.arccos(y / 3) + np.arctan(x),
    "hyperbolic": lambda x, y, A: np.sinh(x) + np.cosh(y) - np.tanh(x * y),
    "exp and log": lambda x, y, A: np.exp(x) + np.log(2.0 + y) + np.log10(3.0 + x) + np.log2(3.0 + x),
    "sqrt, hypot, arctan2": lambda x, y, A: np.sqrt(x * x + 1.0) + np.hypot(x, y) + np.arctan2(y, x),
    "absolute values": lambda x, y, A: abs(x) + np.abs(y) + np.fabs(x) + np.sign(x),
    "powers": lambda x, y, A: x**2 + x**3.0 + (2.0 + y) ** 0.5 + (3.0 + x) ** y + 2.0**x + (2.0 + x) ** -2,
    "square, reciprocal": lambda x, y, A: np.square(x) + np.reciprocal(y + 3.0) + np.positive(x),
    "minimum and maximum": lambda x, y, A: (
        np.minimum(x, 0.2) + np.maximum(x, y) + np.fmin(x, y) - np.fmax(x, 0.1)
    ),
    "clip": lambda x, y, A: np.clip(x, -0.3, 0.4) + x.clip(min=0.0) + np.clip(x[0], y[0], None),
    "where": lambda x, y, A: np.where(x > y, x * x, -y) + where(x[0] > 0.0, y, 1.0),
    "where of arrays from elsewhere": lambda x, y, A: (
        where(array([x[0] > 0.0, True]), array([y[0], x[1]]), array([1.0, y[1]]))
        + interp(array([x[0], y[0]]), *TABLE)
    ),
    "where of rows": lambda x, y, A: np.where((x > 0.0)[:, None], A, A.T),
    "select": lambda x, y, A: np.select([x < -0.5, x < 0.5], [y, 2.0 * y], default=x),
    "conditions": lambda x, y, A: (
        np.where((x > 0) & (y > 0) | ~(x < y), x, y) + 1.0 * (x >= y) + (x <= y) * 2.0
    ),
    "conditions with names": lambda x, y, A: (
        np.logical_and(x > 0, y > 0) + 2 * np.logical_or(x > 0, y > 0) - 1.0 * np.logical_not(x != y)
    ),
    "exclusive or": lambda x, y, A: np.where((x > 0) ^ (y > 0), x, y) + np.logical_xor(x > 0.1, y > 0.2) * x,
    "counting": lambda x, y, A: (
        np.sum(np.isfinite(x)) + np.sum(x > 0) * x[0] + np.isnan(x) + 1.0 * np.isinf(y)
    ),
    "any and all": lambda x, y, A: np.where(np.any(x > 0.5), x, y) + np.where((x > -3).all(), x, 0.0),
    "floor, ceil, trunc": lambda x, y, A: np.floor(3 * x) + np.ceil(3 * y) + np.trunc(5 * x),
    "rounding": lambda x, y, A: np.round(3 * x) + np.rint(7 * y) + (x * 9.0).round() + np.round(x, 2),
    "mod and floor division": lambda x, y, A: x % 0.7 + (5 * y) // 0.9 + np.mod(x, -0.3) + 2.0 % (y + 3.0),
    "wrapping an angle": lambda x, y, A: (9 * x + np.pi) % (2 * np.pi) - np.pi,
    "degrees": lambda x, y, A: np.radians(x) + np.deg2rad(y) + np.degrees(x) + np.rad2deg(y),
    "copysign": lambda x, y, A: np.copysign(x, y),
    "interp": lambda x, y, A: np.interp(x, *TABLE) + interp(y[0], *TABLE),
    "interp with ends": lambda x, y, A: np.interp(3.0 * x, *TABLE, left=-1.0, right=y[0]),
    "interp of values": lambda x, y, A: np.interp(x, [-1.0, 0.0, 2.0], y),
    "reversed operators": lambda x, y, A: 1.0 - x + (2.0 / (3.0 + y)) - (-x) + np.float64(2.0) * x[0] + (+y),
    "array of scalars": lambda x, y, A: np.array([x[0], 0.0, y[1]]) * np.asarray([x[0] * y[0], 1, 2.0]),
    "array of rows": lambda x, y, A: np.array([x, y, [1.0, x[0], 0.0]]) @ x,
    "rotation": lambda x, y, A: (
        np.array([[np.cos(x[0]), -np.sin(x[0])], [np.sin(x[0]), np.cos(x[0])]]) @ y[:2]
    ),
    "concatenate": lambda x, y, A: np.concatenate([x, [y[0], 1.0], A[0]]),
    "concatenate lists": lambda x, y, A: np.maximum(np.concatenate([[x[0]], [y[0]]]), 0.0),
    "stack": lambda x, y, A: (
        np.stack([x, y]) @ np.vstack([x, y]).T + np.column_stack([x, y]).T @ np.stack([y, x], 1)
    ),
    "hstack and block": lambda x, y, A: np.block([[A, np.zeros((3, 1))], [np.hstack([x, 1.0])]]),
    "diagonals": lambda x, y, A: np.diag(x) @ np.diag(T) + np.diag(A) + np.trace(A) + np.diag(x[:2], 1) @ y,
    "outer, cross, kron": lambda x, y, A: np.outer(x, y) @ np.cross(x, y) + np.kron(x[:1], y),
    "dot, inner, vdot": lambda x, y, A: np.dot(A, x) + x.dot(y) + A.dot(y) + np.inner(x, y) + np.vdot(x, y),
    "einsum": lambda x, y, A: np.einsum("ij,j->i", A, x) + np.einsum("ij,ij", A, A),
    "constant matrix": lambda x, y, A: T @ x + x @ T + T @ A @ T.T @ y,
    "sums": lambda x, y, A: (
        A.sum(axis=0) + np.sum(A, axis=1) + x.sum() + np.mean(A) + A.mean(axis=1) + sum(y)
    ),
    "products and running sums": lambda x, y, A: (
        np.prod(x) + np.cumsum(x) + x.cumsum() + np.diff(y, append=0.0)
    ),
    "variance": lambda x, y, A: np.var(x) + A.var(axis=0) + np.std(x),
    "largest and smallest": lambda x, y, A: np.max(x) + y.min() + A.max(axis=1) + np.ptp(x),
    "norm": lambda x, y, A: np.linalg.norm(x) + np.linalg.norm(A, axis=1) + np.linalg.norm(A),
    "solve": lambda x, y, A: np.linalg.solve(A + 4.0 * np.eye(3), x) + np.linalg.solve(T, y),
    "solve for a matrix": lambda x, y, A: np.linalg.solve(A @ A.T + np.eye(3), A),
    "solve with a zero pivot": lambda x, y, A: np.linalg.solve(np.array([[0.0, 1.0], [1.0, x[0]]]), y[:2]),
    "inv and det": lambda x, y, A: np.linalg.inv(A + 4.0 * np.eye(3)) * np.linalg.det(A + 4.0 * np.eye(3)),
    "det with a zero pivot": lambda x, y, A: np.linalg.det(np.array([[0.0, 1.0], [x[0], 2.0]])),
    "quadratic form": lambda x, y, A: A @ np.diag([1.0, 2.0, 3.0]) @ A.T + (np.eye(3) - np.outer(x, y)) @ T,
    "slices": lambda x, y, A: x[::-1] + A[1, :] + A[:, 2] + A[[0, 2, 1], [1, 1, 0]] + x[np.array([2, 0, 1])],
    "masks that are known": lambda x, y, A: x[np.array([True, False, True])] + A[T > 1.5],
    "a known condition": lambda x, y, A: x[np.zeros(3) < 1.0] if (np.zeros(3) + 2.0)[0] > 1.0 else y,
    "unpacking": lambda x, y, A: np.array([a * b for a, b in zip(x, y, strict=True)]),
    "reshape and transpose": lambda x, y, A: (
        (A.T.reshape(9)[:3] + A.ravel()[3:6] + np.transpose(A)[0]) @ A.swapaxes(0, 1)
    ),
    "new axes": lambda x, y, A: (x[:, None] * y[None, :]).squeeze() + x[np.newaxis],
    "roll, tile, repeat": lambda x, y, A: (
        np.roll(x, 1) + np.tile(y[:1], 3) + np.repeat(x[1:2], 3) + x[0].reshape(1)
    ),
    "filled zeros": lambda x, y, A: fill(x, lambda: np.zeros((3, 3))),
    "a constructor as an argument": lambda x, y, A: fill(x, lambda make=np.zeros: make((3, 3))),
    "filled identity": lambda x, y, A: fill(x, lambda: np.eye(3)),
    "filled copies": lambda x, y, A: (
        fill(x, lambda: np.zeros_like(T)) + fill(x, lambda: np.full((3, 3), 2.0))
    ),
    "filled ones": lambda x, y, A: fill(x, lambda: np.ones((3, 3))) + fill(x, lambda: np.array(T)),
    "a filled diagonal": lambda x, y, A: diagonal_filled(x) @ y,
    "filled with a value": lambda x, y, A: np.full((2, 2), x[0]) + np.full_like(A, y[0])[:2, :2],
    "like the argument": lambda x, y, A: fill(x, lambda: np.zeros_like(A)) + np.ones_like(x) * y,
    "assignment where": lambda x, y, A: changed_where(x),
    "a written copy": lambda x, y, A: written_later(x),
    "a product written to": lambda x, y, A: after_a_product(x, A),
    "astype": lambda x, y, A: x.astype(float) + np.array(y, dtype=float) + np.asarray(x, float),
    "astype of a number": lambda x, y, A: x[0].astype(bool) * 2.0 + y,
    "dot of three axes": lambda x, y, A: np.dot(np.stack([A * x, A]), np.stack([A, A * y])),
    "isclose": lambda x, y, A: np.where(np.isclose(x, y), 1.0, x),
    "formatting": lambda x, y, A: x * len(f"{x[0]}") * 0.0 + y,
    "scalar attributes": lambda x, y, A: x[0].T + x[1].clip(0.0, 1.0) + np.size(x[0]) + np.ndim(x[1]) + y,
    "ndim and shape": lambda x, y, A: x * A.ndim + A.shape[0] + len(A) + np.shape(x)[0],
    "list results": lambda x, y, A: [x[0], 2.0, y[1]],
    "a number": lambda x, y, A: x[0] * y[1],
}
POINTS = [
    (np.array([0.31, -0.73, 1.23]), np.array([0.41, 0.93, -0.37]), T + 0.3),
    (np.array([-0.9, 0.21, 0.64]), np.array([-1.3, 0.11, 0.77]), T.T * 0.7 - 0.2),
]
BACKENDS = [
    "python",
    pytest.param("c", marks=pytest.mark.skipif(not find_compiler().compiler, reason="no C compiler")),
]


def all_of_them(x, y, A):
    return tuple(idiom(x, y, A) for idiom in IDIOMS.values())


def close(result, expected, name, tolerance=1e-12):
    np.testing.assert_allclose(result, expected, rtol=tolerance, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
def test_compiled_code_gives_the_numpy_results(backend):
    fast = function(all_of_them, *POINTS[0], backend=backend)
    for point in POINTS:
        for name, result, expected in zip(IDIOMS, fast(*point), all_of_them(*point), strict=True):
            close(result, expected, name)
            assert np.shape(result) == np.shape(expected), name


@pytest.mark.parametrize("backend", BACKENDS)
def test_copysign_takes_the_sign_of_every_number(backend):
    signs = np.array([0.0, -0.0, 1e-320, -1e-320, 2.0, -2.0, np.inf, -np.inf])
    kernel = function(lambda sign: np.copysign(np.full(len(signs), -3.0), sign), signs, backend=backend)
    np.testing.assert_array_equal(kernel(signs), np.copysign(3.0, signs))
    np.testing.assert_array_equal(kernel(-signs), -np.copysign(3.0, signs))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_system_whose_first_pivot_becomes_zero_at_run_time_is_solved(backend):
    def turned(psi, b, y):
        rotation = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
        mixed_array = np.array([[1.0, 3.0], [y, 2.0]])
        return (
            np.linalg.solve(rotation, b),
            np.linalg.solve(mixed_array, b),
            np.linalg.det(rotation) + np.linalg.det(mixed_array),
        )

    def solved(A, b):
        return np.linalg.solve(A, b), np.linalg.inv(A), np.linalg.det(A)

    fast = function(turned, 0.1, np.ones(2), 0.1, backend=backend)
    for psi in (np.pi / 2.0, -np.pi / 2.0, 1.2, 0.0):
        arguments = psi, np.array([1.0, 2.0]), 0.0
        for result, expected in zip(fast(*arguments), turned(*arguments), strict=True):
            close(result, expected, "a rotation")
    draw = np.random.default_rng(0)
    for n in (2, 3, 5):
        fast = function(solved, np.eye(n), np.ones(n), backend=backend)
        for index in np.ndindex(n, n):
            A = draw.normal(size=(n, n))
            A[index] = 0.0
            for result, expected in zip(fast(A, A[1]), solved(A, A[1]), strict=True):
                close(result, expected, "a zero", tolerance=1e-10)


@pytest.mark.parametrize("name", IDIOMS)
def test_es13_derivatives_match_finite_differences(name):
    x, y, A = POINTS[0]
    slope, h = jacobian(IDIOMS[name])(x, y, A), 1e-6
    for k, e in enumerate(np.eye(3) * h):
        ends = [np.array(IDIOMS[name](x + s * e, y, A), dtype=float) for s in (1.0, -1.0)]
        close(slope[..., k], (ends[0] - ends[1]) / (2.0 * h), name, tolerance=1e-7)


@pytest.mark.parametrize("backend", BACKENDS)
def test_traced_derivatives_equal_derivatives_by_dual_numbers(backend):
    def slopes(x, y, A):
        return tuple(jacobian(idiom)(x, y, A) for idiom in IDIOMS.values())

    fast = function(slopes, *POINTS[0], backend=backend)
    for point in POINTS:
        for name, slope, expected in zip(IDIOMS, fast(*point), slopes(*point), strict=True):
            close(slope, expected, name, tolerance=1e-11)


def test_kernel_sensitivities_equal_derivatives_by_dual_numbers():
    y, A = POINTS[0][1:]

    def step(theta, carry, k):
        return carry, np.concatenate([np.ravel(idiom(theta, y, A)) for idiom in IDIOMS.values()])

    theta, slopes = POINTS[0][0], []
    for backend in ("numpy", "python"):
        slopes.append(scan(step, 0.0, 0.0, theta, backend=backend).sensitivities(np.zeros(1), theta))
    close(slopes[1][0], slopes[0][0], "values")
    close(slopes[1][1], slopes[0][1], "slopes", tolerance=1e-11)
