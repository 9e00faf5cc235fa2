"""Every use of a kernel against NumPy tick by tick, and against CasADi's derivatives."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from baqueano.symbolic.c_code import c, compile
from baqueano.symbolic.c_code.c import make_kernel
from baqueano.symbolic.c_code.c_text import header
from baqueano.symbolic.graph.node import Graph
from baqueano.symbolic.graph.program import Program

from .random_programs import CaseOfKernel, in_casadi, in_numpy, random_program

pytestmark = pytest.mark.skipif(compile.find_compiler().compiler is None, reason="no C compiler")

PARAMETERS = (1, 4, 5, 8, 11, 21)  # one block of rows, less than one, several


class Case(CaseOfKernel):
    """A program, its input numbers, and its kernel in C."""

    make_kernel = staticmethod(make_kernel)

    def sensitivities(self) -> tuple[np.ndarray, np.ndarray]:
        outputs = np.empty((self.n, len(self.program.outputs)))
        slopes = np.empty((*outputs.shape, len(self.theta)))
        self.kernel.sensitivities(*self.given(), outputs, slopes)
        return outputs, slopes


def close(result, expected, scale=1.0) -> None:
    np.testing.assert_allclose(result, expected, rtol=1e-12 * scale, atol=1e-12 * scale)


@pytest.fixture(scope="module")
def cases() -> dict[int, Case]:
    return {p: Case(random_program(seed=p, p=p)) for p in PARAMETERS}


@settings(max_examples=4)
@given(seed=st.integers(0, 10**6))
def test_kernel_values_equal_the_numpy_values(seed):
    case = Case(random_program(seed, operations=250, m=40), seed=seed)
    expected = in_numpy(case.program, case.theta, case.start, case.inputs)
    for result, reference, off_kinks in zip(case.run(), expected, off_the_kinks(case, expected), strict=True):
        assume(off_kinks.mean() > 0.5)
        close(result[off_kinks], reference[off_kinks])


def off_the_kinks(case, expected):
    """Return True where a change of the last digits changes nothing: on a kink, back ends may use either side."""
    draw, steady = np.random.default_rng(0), [np.ones(reference.shape, bool) for reference in expected]
    for _ in range(8):
        rounded_values = in_numpy(case.program, case.theta, case.start, case.inputs, rounding=draw)
        for k, values in enumerate(rounded_values):
            steady[k] &= np.abs(values - expected[k]) < 1e-6
    return steady


@pytest.mark.parametrize("p", PARAMETERS)
def test_es13_derivatives_equal_the_derivatives_of_casadi(cases, p):
    case = cases[p]
    outputs, slopes = case.sensitivities()
    expected, expected_slopes = in_casadi(case.program, case.theta, case.start, case.inputs)
    close(outputs, expected)
    close(slopes, expected_slopes, scale=max(1.0, np.abs(expected_slopes).max()))


@pytest.mark.parametrize("p", PARAMETERS)
@pytest.mark.parametrize("huber", [None, 0.3])
def test_normal_equations_follow_from_the_sensitivities(cases, p, huber):
    case = cases[p]
    outputs, slopes = case.sensitivities()
    r, jacobian = outputs.ravel(), slopes.reshape(-1, p)
    k = np.inf if huber is None else huber
    is_small = np.abs(r) <= k
    weight = np.where(is_small, 1.0, k / np.maximum(np.abs(r), 1e-9))
    rho = np.where(is_small, 0.5 * r * r, 0.0 if huber is None else k * np.abs(r) - 0.5 * k * k)
    cost, gradient, hessian = case.kernel.normal_equations(*case.given(), huber)
    size = max(1.0, np.abs(jacobian).max() ** 2)
    close(cost, rho.sum())
    close(gradient, jacobian.T @ (weight * r), size)
    close(hessian, jacobian.T @ (weight[:, None] * jacobian), size)
    assert np.array_equal(hessian, hessian.T)


def test_a_kernel_without_parameters_has_a_cost_and_no_derivatives():
    case = Case(random_program(seed=0, p=0))
    outputs, slopes = case.sensitivities()
    assert slopes.size == 0
    cost, gradient, hessian = case.kernel.normal_equations(*case.given(), None)
    close(cost, 0.5 * np.sum(outputs**2))
    assert (gradient.shape, hessian.shape) == ((0,), (0, 0))


@pytest.mark.parametrize("p", [4, 11])
def test_the_total_cost_is_the_sum_of_the_outputs_with_its_gradient(cases, p):
    case = Case(cases[p].program._replace(outputs=cases[p].program.outputs[:1]))
    outputs, slopes = case.sensitivities()
    cost, none = case.kernel.total(*case.given(), False)
    total, gradient = case.kernel.total(*case.given(), True)
    assert none is None
    close(cost, outputs.sum())
    close(total, cost)
    close(gradient, slopes.sum(axis=(0, 1)), max(1.0, np.abs(slopes).max()))


@pytest.mark.parametrize("count", [1, 8, 13])
@pytest.mark.parametrize("shared_inputs", [(True, True, True), (True, False, False)])
def test_several_vehicles_in_one_call_equal_separate_runs(cases, count, shared_inputs):
    case = cases[5]
    draw = np.random.default_rng(count)
    theta, start = draw.normal(size=(count, 5)), draw.normal(size=(count, len(case.start)))
    mask = np.array(shared_inputs)
    w = draw.normal(size=(count, case.n, int((~mask).sum())))
    outputs, final = np.empty((count, case.n, len(case.program.outputs))), np.empty((count, len(case.start)))
    common = np.ascontiguousarray(case.inputs[:, mask])
    case.kernel.batch(theta, start, common, w, shared_inputs, outputs, final)
    only_final = np.empty_like(final)
    case.kernel.batch(theta, start, common, w, shared_inputs, None, only_final)
    close(only_final, final)
    for member in range(count):
        inputs = case.inputs.copy()
        inputs[:, ~mask] = w[member]
        expected, last = in_numpy(case.program, theta[member], start[member], inputs)
        close(outputs[member], expected)
        close(final[member], last)


def test_distributing_vehicles_over_processors_does_not_change_results(cases, monkeypatch):
    case = cases[5]
    draw = np.random.default_rng(0)
    theta, start = draw.normal(size=(43, 5)), draw.normal(size=(43, len(case.start)))
    none = np.empty((43, case.n, 0))
    results = []
    for processors in (1, 3):
        monkeypatch.setattr(
            c,
            "_thread_slices",
            lambda count, n, size=-(-43 // processors): [
                slice(first, min(first + size, count)) for first in range(0, count, size)
            ],
        )
        final = np.empty((43, len(case.start)))
        case.kernel.batch(theta, start, case.inputs, none, (True,) * 3, None, final)
        results.append(final)
    assert np.array_equal(*results)


def test_the_parts_for_processors_contain_every_vehicle_once():
    for count in (1, 7, 8, 100, 10_000):
        for n in (1, 10_000):
            parts = c._thread_slices(count, n)
            assert [i for part in parts for i in range(count)[part]] == list(range(count))
            assert all(part.start % 8 == 0 for part in parts)


def test_a_bound_kernel_reads_its_arrays_at_every_call(cases):
    case = cases[5]
    outputs, final = np.empty((case.n, len(case.program.outputs))), np.empty(len(case.program.carry))
    theta = case.theta.copy()
    call = case.kernel.bind(theta, case.start, case.inputs, outputs, final)
    for shift in (0.0, 0.5):
        theta[:] = case.theta + shift
        call()
        close(outputs, in_numpy(case.program, theta, case.start, case.inputs)[0])


def test_the_c_source_is_available_before_and_after_the_first_run(cases):
    case = Case(cases[5].program)
    before = case.kernel.source
    assert "void kernel(" in before
    case.run()
    assert case.kernel.source == before


def one_step(output, graph: Graph, theta: tuple, x: tuple) -> Case:
    """Return a program of one tick without a carry; the test sets its inputs."""
    return Case(Program(graph, theta, (), (), (), x, (), tuple(output)), n=1)


def test_a_nan_input_affects_only_the_outputs_that_use_it():
    graph = Graph()
    x, y, k = (graph.symbol(name) for name in "xyk")
    make = graph.make
    reads = [make(op, x) for op in ("sin", "exp", "tanh", "log", "sqrt", "abs", "sign", "floor", "atan")]
    reads += [make(op, x, y) for op in ("min", "max", "add", "atan2", "hypot")]
    reads += [make(op, y, x) for op in ("min", "max", "mul", "atan2", "hypot")]
    separate = [
        make("where", make("isnan", x), y, x),
        make("where", make("lt", x, y), x, y),
        make("lt", x, y),
    ]
    case = one_step([*reads, *separate], graph, (k,), (x, y))
    case.inputs[:] = [[np.nan, 2.0]]
    outputs, _ = case.run()
    assert np.isnan(outputs[0, : len(reads)]).all()
    assert outputs[0, len(reads) :].tolist() == [2.0, 2.0, 0.0]


@pytest.mark.parametrize("depth", [1, 12])  # a select, and a branch
def test_an_inactive_branch_adds_no_nan_to_the_derivatives(depth):
    graph = Graph()
    k, x = graph.symbol("k"), graph.symbol("x")
    make = graph.make
    arm = k
    for _ in range(depth):
        arm = make("sqrt", make("mul", x, make("add", arm, k)))  # NaN for x < 0, slope inf at 0
    safe = make("where", make("lt", graph.const(0.0), x), arm, make("mul", x, k))
    case = one_step([safe, make("mul", safe, k)], graph, (k,), (x,))
    case.theta[:] = 0.7
    for value in (-1.0, 0.0):
        case.inputs[:] = value
        outputs, slopes = case.sensitivities()
        close(outputs[0], [value * 0.7, value * 0.49])
        close(slopes[0, :, 0], [value, 2 * value * 0.7])


@pytest.mark.parametrize("size", [2, 3, 7, 5000])
def test_table_lookup_equals_numpy(size):
    draw = np.random.default_rng(size)
    xp, fp = np.sort(draw.normal(size=size)), draw.normal(size=size)
    graph = Graph()
    k, x = graph.symbol("k"), graph.symbol("x")
    table = graph.table(xp, fp)
    y = graph.make("interp", graph.make("mul", x, k), value=table)
    program = Program(graph, (k,), (), (), (), (x,), (), (y,))
    case = Case(program, n=200)
    case.theta[:] = 1.0
    case.inputs[:, 0] = np.concatenate([xp[:50], draw.normal(size=200)])[:200]
    case.inputs[-3:, 0] = -1e9, 1e9, np.nan
    outputs, slopes = case.sensitivities()
    points = case.inputs[:, 0]
    close(outputs[:, 0], np.interp(points, xp, fp))
    is_off = ~np.isin(points, xp) & np.isfinite(points)
    cell = np.clip(np.searchsorted(xp, points) - 1, 0, size - 2)
    slope = np.where((points > xp[0]) & (points < xp[-1]), (np.diff(fp) / np.diff(xp))[cell], 0.0)
    np.testing.assert_allclose(slopes[is_off, 0, 0], (slope * points)[is_off], rtol=1e-9, atol=1e-9)
    final, batch_outputs = np.empty((1, 0)), np.empty((1, 200, 1))
    empty_inputs = np.empty((1, 200, 0))
    case.kernel.batch(
        case.theta[None], np.empty((1, 0)), case.inputs, empty_inputs, (True,), batch_outputs, final
    )
    close(batch_outputs[0], outputs)


def test_columns_of_a_route_are_read_at_one_place_of_its_times():
    graph = Graph()
    x, unused_table = graph.symbol("x"), graph.table(np.arange(7.0), np.arange(7.0))
    tables = [graph.table(np.arange(9.0), column) for column in np.random.default_rng(1).normal(size=(3, 9))]
    program = Program(
        graph, (), (), (), (), (x,), (), tuple(graph.make("interp", x, value=k) for k in tables)
    )
    body = make_kernel(program).source
    declarations = header(body, graph.tables)
    assert (body.count("int64_t cell"), declarations.count("static const double xp")) == (1, 1)
    assert f"fp{unused_table}[" not in declarations


def test_a_run_without_ticks_returns_the_start(cases):
    case = Case(cases[5].program, n=0)
    assert case.run()[0].shape[0] == 0
    close(case.run()[1], in_numpy(case.program, case.theta, case.start, case.inputs)[1])
