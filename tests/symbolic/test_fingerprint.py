"""An equal program finds its library without its code, and another program finds another library."""

from typing import NamedTuple

import numpy as np
import pytest

from baqueano.symbolic import scan
from baqueano.symbolic.c_code import c_bodies
from baqueano.symbolic.graph.assemble import assemble

GRID = np.array([0.0, 1.0, 2.0])


class Pair(NamedTuple):
    value: float
    square: float


def step_of(drag=0.3, table=(0.0, 1.0, 4.0), is_late=False, is_swapped=False):
    """Return a step; each argument changes one property of its program."""

    def step(theta, carry, u):
        v, w = carry
        v = v + theta[0] * (u - drag * v)
        w = np.interp(v if is_late else w, GRID, np.array(table)) + np.sin(v)
        return (v, w), (w - v if is_swapped else v - w)

    return step


def kernel_of(**options):
    return scan(step_of(**options), (0.0, 0.5), 0.0, [0.1], backend="c")


def fingerprint(kernel, given_start=True):
    return assemble(kernel.trace, False, given_start).program.fingerprint


def test_two_traces_of_one_step_have_one_fingerprint():
    assert fingerprint(kernel_of()) == fingerprint(kernel_of())


@pytest.mark.parametrize(
    "options",
    [{"drag": 0.30000000000000004}, {"table": (0.0, 1.0, 4.5)}, {"is_late": True}, {"is_swapped": True}],
)
def test_another_program_has_another_fingerprint(options):
    assert fingerprint(kernel_of()) != fingerprint(kernel_of(**options))


def test_the_sign_of_zero_and_the_start_belong_to_the_fingerprint():
    def kernel(zero, first):
        return scan(
            lambda p, x, u: (x, np.arctan2(x + u, zero)), lambda p: first + p[0], 0.0, [0.1], backend="c"
        )

    signs = {fingerprint(kernel(zero, 1.0), False) for zero in (0.0, -0.0)}
    starts = {fingerprint(kernel(0.0, first), False) for first in (1.0, 2.0)}
    assert len(signs) == len(starts) == 2


@pytest.mark.parametrize("method", ["values", "gradient"])
def test_an_equal_program_generates_no_code(monkeypatch, method):
    inputs, theta = np.ones(5), [0.1]

    def results(kernel):
        return (
            kernel.run(inputs, theta)[1] if method == "values" else kernel.cost_and_gradient(inputs, theta)[1]
        )

    expected_result = results(kernel_of(drag=0.21))
    monkeypatch.setattr(c_bodies, method, None)  # a call raises
    np.testing.assert_array_equal(results(kernel_of(drag=0.21)), expected_result)
    with pytest.raises(TypeError):
        results(kernel_of(drag=0.22 if method == "values" else 0.23))


def test_the_code_of_a_part_is_that_of_the_part_alone():
    def both(theta, x, u):
        v = x * theta[0] + u
        return v, Pair(np.sin(v) * v, np.sin(v) * v * v)

    def one(theta, x, u):
        v = x * theta[0] + u
        return v, np.sin(v) * v * v

    part, step = (
        scan(both, 0.0, 0.0, [0.1], backend="c").part("square"),
        scan(one, 0.0, 0.0, [0.1], backend="c"),
    )
    assert part.source == step.source


@pytest.mark.parametrize("backend", ["c", "python", "numpy"])
def test_a_part_is_a_field_of_the_output(backend):
    pair = scan(lambda p, x, u: (x + p[0] * u, Pair(x, x * x)), 1.0, 0.0, [0.5], backend=backend)
    inputs = np.array([1.0, 2.0, 3.0])
    values = pair.run(inputs, [0.5])[1].value
    np.testing.assert_array_equal(pair.part("value").run(inputs, [0.5])[1], values)
    assert pair.part("square").cost(inputs, [0.5]) == pytest.approx(np.sum(values**2))
    np.testing.assert_allclose(
        pair.part("square").sensitivities(inputs, [0.5])[1][:, 0, 0], [0.0, 2.0 * 1.5, 2.0 * 2.5 * 3.0]
    )
