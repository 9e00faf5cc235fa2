"""Sums over a batch of runs equal the sums of each run, with derivatives, in every back end."""

import numpy as np
import pytest

from baqueano.symbolic import scan, where
from baqueano.symbolic.c_code import c
from baqueano.symbolic.graph.assemble import assemble
from baqueano.symbolic.graph.node import nodes_below
from tests.symbolic.test_scan import BACKENDS

X = np.sin(np.arange(30.0)).reshape(-1, 1) + np.array([0.0, 0.5])


def step(p, x, u):
    """A pendulum with a pushing force and a stop; its two outputs have different magnitudes."""
    angle, rate = x
    rate = rate + 0.1 * (p[1] * u[0] - np.sin(angle) - p[0] * rate + p[2] * u[1])
    angle = where(angle > 0.8, 0.8 - 0.1 * p[0], angle + 0.1 * rate)
    return (angle, rate), (angle**2, np.sqrt(1.0 + rate * rate))


@pytest.fixture(params=BACKENDS)
def kernel(request):
    return scan(step, lambda p: (0.1 * p[0], 0.0), np.zeros(2), np.ones(3), backend=request.param)


def test_sums_over_a_batch_equal_the_sums_of_separate_runs(kernel):
    theta = np.random.default_rng(1).uniform(0.5, 3.0, (11, 3))
    sums, slopes = kernel.batch_sums(X, theta, 2)
    assert (sums.shape, slopes.shape) == ((11, 2), (11, 2, 2))
    for k, p in enumerate(theta):
        y, derivatives = kernel.sensitivities(X, p)
        np.testing.assert_allclose(sums[k], y.sum(0), rtol=1e-12)
        np.testing.assert_allclose(slopes[k], derivatives.sum(0)[:, :2], rtol=1e-10, atol=1e-12)
    assert kernel.batch_sums(X, theta)[1].shape == (11, 2, 0)
    np.testing.assert_allclose(kernel.batch_sums(X, theta)[0], sums, rtol=1e-12)


def test_each_run_of_a_batch_may_have_different_inputs_and_start(kernel):
    theta, inputs = np.ones((3, 3)), np.stack([X, 2.0 * X, -X])
    start = (np.array([0.0, 0.1, 0.2]), np.zeros(3))
    sums, _ = kernel.batch_sums(inputs, theta, 1, carry=start)
    for k in range(3):
        _, y = kernel.run(inputs[k], theta[k], carry=(start[0][k], 0.0))
        np.testing.assert_allclose(sums[k], [np.sum(y[0]), np.sum(y[1])], rtol=1e-12)


ROUTE = np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.7, -0.4])


def follow(p, x, t):
    """A vehicle follows a route over time; its guide keeps the time of the start."""
    begin, heading, turns = x
    begin = np.where(begin < 0.0, t, begin)
    target = np.interp((t - begin) % 2.0, *ROUTE)
    error = target - np.sin(heading)
    heading = heading + 0.1 * p[0] * error / (1.0 + t * t)
    return (begin, heading, turns + 1.0), (error * error, np.cos(heading) * np.sin(heading), target)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("begin", [-1.0, np.array([-1.0, 0.3, 0.9])], ids=["shared", "own"])
def test_terms_that_are_equal_for_all_members_are_shared_only_if_they_are_equal(backend, begin):
    kernel = scan(follow, (-1.0, 0.2, 0.0), 0.0, np.ones(1), backend=backend)
    t, theta = np.arange(0.5, 3.0, 0.1), np.array([[0.5], [1.0], [4.0]])
    sums, slopes = kernel.batch_sums(t, theta, 1, carry=(begin, 0.2, 0.0))
    for k, p in enumerate(theta):
        y, derivatives = kernel.sensitivities(t, p, carry=(np.broadcast_to(begin, 3)[k], 0.2, 0.0))
        np.testing.assert_allclose(sums[k], y.sum(0), rtol=1e-12)
        np.testing.assert_allclose(slopes[k], derivatives.sum(0), rtol=1e-10, atol=1e-12)


def test_a_batch_reads_a_shared_table_once_per_tick_and_computes_no_sine_twice():
    kernel = scan(follow, (-1.0, 0.2, 0.0), 0.0, np.ones(1))
    kernel.batch_sums(np.ones(3), np.ones((2, 1)))
    (sums,) = kernel.sums.values()
    tick, member = ([node.op for node in nodes_of(program)] for program in sums.split)
    assert "interp" in tick
    assert not {"interp", "floor", "div"} & {*member}
    assert member.count("sin") == 1


@pytest.mark.parametrize("name", ["cost", "gradient"])
def test_a_cost_passes_the_sine_of_the_heading_to_the_next_tick(name):
    trace = scan(follow, (-1.0, 0.2, 0.0), 0.0, np.ones(1), backend="python").trace
    kernel = c.make_kernel(assemble(trace, keep_all=False, given_start=True).program)
    assert kernel._text(name).split("for (int64_t tick")[1].count("sin_1(") == 1


def nodes_of(program):
    return nodes_below((*program.next_carry, *program.outputs))
