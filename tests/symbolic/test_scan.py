"""The results of a scan with every back end, compared with a simple loop."""

import gc
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.c_code.compile import find_compiler

BACKENDS = [
    "numpy",
    "python",
    pytest.param("c", marks=pytest.mark.skipif(not find_compiler().compiler, reason="no cc")),
]
N = 7
DT = 0.1


class State(NamedTuple):
    t_ns: int
    x: np.ndarray  # (2,)
    cov: np.ndarray  # (2, 2)
    is_armed: bool


class Push(NamedTuple):
    t_ns: int
    u: float
    is_new: bool
    z: np.ndarray | None


@dataclass(frozen=True, slots=True, eq=False)
class FilterOutput:
    t_ns: int
    y: np.ndarray
    is_late: bool
    label: str = "measured"


def move(x, u, theta):
    return np.array([x[0] + DT * x[1], x[1] + DT * (u - theta[0] * np.sin(x[0]) - theta[1] * x[1])])


def filtered(theta, state, push):
    """A small extended Kalman filter over a pendulum, with a derivative inside."""
    G = jacobian(move)(state.x, push.u, theta)
    x, cov = move(state.x, push.u, theta), G @ state.cov @ G.T + theta[2] * np.eye(2)
    H = np.array([[1.0, 0.0]])
    K = np.linalg.solve(H @ cov @ H.T + 0.04, H @ cov).T
    A = np.eye(2) - K @ H
    correction = x + K @ (push.z - H @ x), A @ cov @ A.T + 0.04 * K @ K.T
    x, cov = (np.where(push.is_new, a, b) for a, b in zip(correction, (x, cov), strict=True))
    is_armed = state.is_armed | push.is_new
    return State(push.t_ns, x, cov, is_armed), FilterOutput(push.t_ns, x, push.t_ns - state.t_ns > 10)


def residuals(theta, state, push):
    state, output = filtered(theta, state, push)
    return state, np.concatenate([output.y - push.z, [state.cov[0, 0]]])


def effort(theta, state, push):
    state, output = filtered(theta, state, push)
    return state, output.y @ output.y + theta[1] ** 2


START = State(-1, np.array([0.3, 0.0]), np.eye(2), False)
EXAMPLE = Push(0, 0.0, True, np.zeros(1))
THETA = np.array([9.0, 0.4, 0.01])


def pushes(seed=0):
    draw = np.random.default_rng(seed)
    z = draw.normal(size=(N, 1))
    return Push(np.arange(N) * 10 + 2**50, draw.normal(size=N), draw.random(N) > 0.5, z)


def tick(pushes, k):
    return Push(int(pushes.t_ns[k]), float(pushes.u[k]), bool(pushes.is_new[k]), pushes.z[k])


def by_hand(step, theta, state=START, inputs=None):
    inputs, outputs = pushes() if inputs is None else inputs, []
    for k in range(N):
        state, output = step(theta, state, tick(inputs, k))
        outputs.append(output)
    return state, outputs


def close(result, expected, tolerance=1e-12):
    np.testing.assert_allclose(result, expected, rtol=tolerance, atol=tolerance)


@pytest.fixture(scope="module", params=BACKENDS)
def backend(request):
    return request.param


@pytest.fixture(scope="module")
def kernel(backend):
    return scan(filtered, START, EXAMPLE, THETA, backend=backend)


def differences(f, theta, h=1e-6):
    return np.stack([(f(theta + h * e) - f(theta - h * e)) / (2 * h) for e in np.eye(len(theta))], axis=-1)


def test_a_run_equals_the_loop_over_the_ticks(kernel, backend):
    assert kernel.backend == backend
    last, output = kernel.run(pushes(), THETA)
    expected, outputs = by_hand(filtered, THETA)
    assert type(last) is State
    assert type(output) is FilterOutput
    close(last.x, expected.x)
    close(last.cov, expected.cov)
    close(output.y, [output.y for output in outputs])
    assert output.y.shape == (N, 2)


def test_integers_booleans_and_strings_are_returned_unchanged(kernel):
    last, output = kernel.run(pushes(), THETA)
    assert type(last.t_ns) is int
    assert last.t_ns == 2**50 + 10 * (N - 1)
    assert last.is_armed is True
    assert output.t_ns.dtype == np.int64
    assert output.is_late.dtype == bool
    assert output.is_late.tolist() == [True] + [False] * (N - 1)
    assert output.label == "measured"


def test_a_run_may_start_from_another_state(kernel):
    start = START._replace(x=np.array([1.0, -1.0]), t_ns=5)
    close(kernel.run(pushes(), THETA, carry=start)[0].x, by_hand(filtered, THETA, start)[0].x)


def test_a_nonsymmetric_start_matrix_is_used_unchanged(kernel):
    start = START._replace(cov=np.array([[1.0, 0.2], [0.7, 1.0]]))
    close(kernel.run(pushes(), THETA, carry=start)[0].cov, by_hand(filtered, THETA, start)[0].cov)


def test_two_consecutive_runs_equal_one_longer_run(kernel):
    all_pushes, halves = pushes(), []
    for part in (slice(0, 3), slice(3, N)):
        halves.append(Push(*(leaf[part] for leaf in all_pushes)))
    middle, _ = kernel.run(halves[0], THETA)
    close(kernel.run(halves[1], THETA, carry=middle)[0].x, kernel.run(all_pushes, THETA)[0].x)


def test_sensitivities_match_finite_differences(backend):
    kernel = scan(residuals, START, EXAMPLE, THETA, backend=backend)

    def outputs(theta):
        return np.array(by_hand(residuals, theta)[1])

    values, slopes = kernel.sensitivities(pushes(), THETA)
    close(values, outputs(THETA))
    assert slopes.shape == (N, 3, 3)
    close(slopes, differences(outputs, THETA), 1e-7)


def test_bound_sensitivities_follow_theta_and_the_carry(backend):
    def step(theta, x, row):
        x = x + DT * (row - theta * x**3)
        return x, x[0] * theta

    kernel, theta, rows = scan(step, np.ones(2), 0.0, np.ones(2), backend=backend), np.ones(2), pushes().u
    bound = kernel.bind_sensitivities(rows.copy())
    gc.collect()  # the call keeps its rows alive
    for start in (np.ones(2), np.array([0.5, -2.0])):
        theta = theta + 0.3
        for actual, expected in zip(
            bound(theta, start), kernel.sensitivities(rows, theta, start), strict=True
        ):
            np.testing.assert_array_equal(actual, expected)


def test_sensitivities_include_a_start_that_depends_on_the_parameters(backend):
    def start(theta):
        return START._replace(x=np.array([theta[0] * 0.1, theta[1]]), cov=theta[2] * np.eye(2))

    kernel = scan(residuals, start, EXAMPLE, THETA, backend=backend)

    def outputs(theta):
        return np.array(by_hand(residuals, theta, start(theta))[1])

    values, slopes = kernel.sensitivities(pushes(), THETA)
    close(values, outputs(THETA))
    close(slopes, differences(outputs, THETA), 1e-7)
    close(kernel.run(pushes(), THETA)[0].cov, by_hand(residuals, THETA, start(THETA))[0].cov)
    close(kernel.run(pushes(), THETA, carry=START)[0].cov, by_hand(residuals, THETA)[0].cov)
    assert not np.allclose(kernel.sensitivities(pushes(), THETA, carry=START)[1], slopes)


def test_the_cost_is_the_sum_of_the_outputs_and_has_a_gradient(backend):
    kernel = scan(effort, START, EXAMPLE, THETA, backend=backend)

    def total(theta):
        return np.array(sum(by_hand(effort, theta)[1]))

    cost, gradient = kernel.cost_and_gradient(pushes(), THETA)
    close(cost, total(THETA))
    close(kernel.cost(pushes(), THETA), cost)
    close(gradient, differences(total, THETA), 1e-6)


@pytest.mark.parametrize("huber", [None, 0.5])
def test_normal_equations_follow_from_the_sensitivities(backend, huber):
    kernel = scan(residuals, START, EXAMPLE, THETA, backend=backend)
    r, slopes = kernel.sensitivities(pushes(), THETA)
    k = np.inf if huber is None else huber
    w = np.minimum(1.0, k / np.abs(r))
    rho = np.where(np.abs(r) <= k, 0.5 * r * r, 0.0 if huber is None else k * np.abs(r) - 0.5 * k * k)
    equations = kernel.normal_equations(pushes(), THETA, huber=huber)
    close(equations.cost, rho.sum())
    close(equations.gradient, np.einsum("ni,nip->p", w * r, slopes), 1e-11)
    close(equations.hessian, np.einsum("ni,nip,niq->pq", w, slopes, slopes), 1e-11)


def test_a_batch_of_runs_equals_separate_runs(kernel):
    theta = np.array([THETA, 1.1 * THETA, 0.9 * THETA])
    inputs, second = pushes(), pushes(seed=1)
    u = np.stack([inputs.u, second.u, -second.u])
    start = START._replace(x=np.array([[0.3, 0.0], [0.1, 0.2], [-0.5, 1.0]]))
    last, output = kernel.batch(inputs._replace(u=u), theta, carry=start, with_outputs=True)
    assert output.y.shape == (3, N, 2)
    assert last.t_ns.tolist() == [2**50 + 10 * (N - 1)] * 3
    for k in range(3):
        single, x = kernel.run(inputs._replace(u=u[k]), theta[k], carry=START._replace(x=start.x[k]))
        close(last.cov[k], single.cov)
        close(output.y[k], x.y)
    assert kernel.batch(inputs._replace(u=u), theta, carry=start)[1] is None


def test_runs_of_a_batch_start_from_the_example_or_from_theta(kernel, backend):
    theta = np.array([THETA, 1.1 * THETA])
    last, _ = kernel.batch(pushes(), theta)
    close(last.x[1], kernel.run(pushes(), theta[1])[0].x)

    def start(theta):
        return START._replace(x=theta[:2] * 0.1)

    compiled_scan = scan(filtered, start, EXAMPLE, THETA, backend=backend)
    close(compiled_scan.batch(pushes(), theta)[0].x[1], compiled_scan.run(pushes(), theta[1])[0].x)


def test_a_batch_accepts_a_nonsymmetric_start_matrix(kernel):
    cov = np.array([np.eye(2), [[1.0, 0.2], [0.7, 1.0]]])
    last, _ = kernel.batch(pushes(), np.array([THETA, THETA]), carry=START._replace(cov=cov))
    close(last.cov[1], by_hand(filtered, THETA, START._replace(cov=cov[1]))[0].cov)


def test_without_parameters_a_step_has_two_arguments(backend):
    kernel = scan(lambda total, x: (total + x, total * 2.0), 1.0, 0.0, backend=backend)
    last, doubled_values = kernel.run(np.array([1.0, 2.0, 3.0]))
    assert last == 7.0
    assert type(last) is float
    close(doubled_values, [2.0, 4.0, 8.0])
    close(kernel.cost(np.array([1.0, 2.0, 3.0])), 14.0)
    close(kernel.batch(np.array([[1.0, 2.0], [5.0, 6.0]]))[0], [4.0, 12.0])


def test_an_integer_state_that_becomes_fractional_is_converted_to_float(backend):
    def step(c, x):
        return (c[0] + 0.5, c[1] + 1, True, 2.5, c[4] - c[0]), c[0]

    kernel = scan(step, (0, 0, False, 0, 0), 0.0, backend=backend)
    last, output = kernel.run(np.zeros(3))
    assert last == (1.5, 3, True, 2.5, -1.5)
    assert [type(x) for x in last] == [float, int, bool, float, float]
    close(output, [0.0, 0.5, 1.0])


def test_lists_dicts_and_none_are_accepted_as_state_and_output(backend):
    def step(carry, x):
        a, b = carry["pair"]
        return {"pair": [b, a + x["u"]], "none": None}, (a, [None, {"b": b}])

    kernel = scan(step, {"pair": [1.0, 2.0], "none": None}, {"u": 0.0}, backend=backend)
    last, (a, (empty, by_name)) = kernel.run({"u": np.array([1.0, 1.0])})
    assert last == {"pair": [2.0, 3.0], "none": None}
    assert empty is None
    close(a, [1.0, 2.0])
    close(by_name["b"], [2.0, 2.0])


def test_a_run_without_ticks_returns_the_start(backend):
    kernel = scan(
        lambda c, x: (c + x, 2.0 * c), 1.5, 0.0, backend="python" if backend == "numpy" else backend
    )
    last, output = kernel.run(np.zeros(0))
    assert last == 1.5
    assert output.shape == (0,)


def test_a_table_of_5000_values_can_be_compiled(backend):
    s = np.linspace(0.0, 10.0, 5000)
    route = np.sin(s)

    def step(theta, t, dt):
        return t + dt, np.interp(theta[0] * t, s, route)

    kernel = scan(step, 0.0, 0.0, np.ones(1), backend=backend)
    values, slopes = kernel.sensitivities(np.full(50, 0.2), np.array([0.7]))
    t = np.arange(50) * 0.2
    close(values[:, 0], np.interp(0.7 * t, s, route), 1e-12)
    close(slopes[:, 0, 0], t * np.cos(0.7 * t), 1e-2)


def test_a_scan_states_its_back_end_operation_count_and_source(kernel, backend):
    assert kernel.backend == backend
    if backend != "numpy":
        assert 50 < kernel.operations < 500
        assert len(kernel.source) > 500


@pytest.mark.parametrize("period", [49.0, 0.1, 2.0 * np.pi, 107.0])
def test_every_back_end_counts_whole_periods_correctly(backend, period):
    t = np.arange(200) * period
    kernel = scan(lambda c, t: (c, np.floor(t / period + 0.0 * c)), 0.0, 0.0, backend=backend)
    assert kernel.run(t)[1].tolist() == np.floor(t / period).tolist()
    by_theta = scan(
        lambda p, c, t: (c, (t / p[0] >= 1.0) + np.floor(t / p[0])), 0.0, 0.0, np.ones(1), backend=backend
    )
    assert by_theta.run(t, [period])[1].tolist() == (np.floor(t / period) + (t >= period)).tolist()


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_input_array_is_read_at_each_call_and_never_changed(backend):
    inputs = np.arange(21.0).reshape(N, 3)
    kernel = scan(
        lambda p, x, u: (x + p[0] * u, x * u), np.zeros(3), np.zeros(3), np.ones(1), backend=backend
    )
    expected = kernel.run(inputs, np.array([2.0]))[1]
    for array in (np.asfortranarray(inputs), inputs.astype(np.int64), np.repeat(inputs, 2, axis=0)[::2]):
        np.testing.assert_array_equal(kernel.run(array, np.array([2.0]))[1], expected)
    kernel.normal_equations(inputs, np.array([2.0]))
    np.testing.assert_array_equal(inputs, np.arange(21.0).reshape(N, 3))
    inputs[0] += 1.0  # between calls the caller may write
    assert not np.array_equal(kernel.run(inputs, np.array([2.0]))[1], expected)
