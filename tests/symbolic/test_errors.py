"""What cannot be traced is refused with the user's file and line, and with what to write instead."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from baqueano.symbolic import TraceError, function, jacobian, put, scan

X, A = np.array([1.0, 2.0, 3.0]), np.eye(3)
KEPT = []
TABLE = np.zeros(3)


def changes_its_argument(x):
    x += 1.0
    return x


def writes_into_its_argument(x):
    x[0] = 1.0
    return x


def writes_into_a_constant(x):
    TABLE[0] = x[0]
    return TABLE


def keeps_a_value(x):
    KEPT.append(x[0])
    return KEPT[0] * x[0]


CASES = {
    "if": (lambda x: x if x[0] > 0 else -x, "write np.where(condition, a, b), np.clip, np.maximum or np.abs"),
    "chained comparison": (lambda x: np.where(0 < x[0] < 1, x, 0.0), "a < x < b"),
    "and": (lambda x: np.where(x[0] > 0 and x[1] > 0, x, 0.0), "join conditions with &, | and ~"),
    "builtin max": (lambda x: max(x[0], x[1]), "np.maximum"),
    "builtin sorted": (lambda x: sorted(x)[0], "np.clip"),
    "math function": (lambda x: math.sin(x[0]), "np.sin"),
    "float of a value": (lambda x: float(x[0]), "a float is needed here"),
    "index": (lambda x: TABLE[x[0]], "np.interp(x, xp, fp)"),
    "array index": (lambda x: TABLE[np.floor(x)], "an index must be known before run time"),
    "traced index": (lambda x: x[np.floor(x)], "np.interp(x, xp, fp) to read a table"),
    "range": (lambda x: sum(range(x[0])), "an index or a length must be known"),
    "whole number": (lambda x: x[0].astype(int), "np.floor"),
    "whole numbers": (lambda x: x.astype(int), "cannot become int64"),
    "shapes of a sum": (lambda x: x + np.ones(2), "(3,) (2,)"),
    "shapes of a product": (lambda x: A[:2, :2] @ x, "shapes (2, 2) and (3,) do not fit"),
    "shapes of a solve": (lambda x: np.linalg.solve(A, x[:2] * x[0]), "(2,)"),
    "shapes of a stack": (lambda x: np.concatenate([x, A]), "dimension"),
    "ragged array": (lambda x: np.array([[x[0], x[1]], [x[2]]]), "inhomogeneous"),
    "unknown ufunc": (
        lambda x: np.arctanh(x / 9),
        "np.arctanh is not known to the tracer: it knows absolute, add",
    ),
    "unknown function": (lambda x: np.linalg.eigh(np.outer(x, x)), "np.eigh does not work"),
    "unknown method": (lambda x: x[0].tensor(), "no attribute 'tensor'"),
    "matrix norm": (lambda x: np.linalg.norm(np.outer(x, x), 2), "np.linalg.norm knows only"),
    "one-armed where": (lambda x: np.where(x > 0), "needs both arms"),
    "period of a table": (lambda x: np.interp(x, [0, 1], [1, 2], period=1.0), "x % period"),
    "a long unknown table": (lambda x: np.interp(x[0], np.arange(200) * x[1], np.ones(200)), "at most 100"),
    "singular matrix": (lambda x: np.linalg.solve(np.array([[0.0, x[0]], [0.0, 1.0]]), x[:2]), "no pivot"),
    "argument changed": (changes_its_argument, "an argument of the function is changed in place"),
    "argument written": (writes_into_its_argument, "an argument of the function is changed in place"),
    "constant written": (writes_into_a_constant, "make arrays that are filled later inside the function"),
    "unpacking a number": (lambda x: [a for a in x[0]], "not iterable"),
    "division by nothing": (lambda x: x / (1 // 0), "ZeroDivisionError"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_trace_error_names_the_line_and_what_to_write(name):
    f, advice = CASES[name]
    with pytest.raises(TraceError) as caught:
        function(f, X, backend="python")
    place, line, source = re.match(r"(.*):(\d+): (.*)", str(caught.value)).groups()
    assert place == __file__
    first = f.__code__.co_firstlineno
    assert first <= int(line) <= first + 2
    assert source in Path(__file__).read_text(encoding="utf-8")
    assert advice in str(caught.value)


def test_a_trace_error_is_both_a_type_and_a_value_error():
    assert issubclass(TraceError, TypeError)
    assert issubclass(TraceError, ValueError)


def test_a_value_of_another_trace_is_refused():
    KEPT.clear()
    function(keeps_a_value, X, backend="python")
    with pytest.raises(TraceError, match="a value of another trace is used"):
        function(keeps_a_value, X, backend="python")


def test_an_error_of_the_users_own_passes_through():
    class OutOfPaper(Exception):
        pass

    def f(x):
        raise OutOfPaper

    with pytest.raises(OutOfPaper):
        function(f, X)


def test_untraced_derivatives_may_branch_on_values_but_not_lose_them():
    assert jacobian(lambda x: x * x if x > 0 else -x)(3.0) == 6.0
    with pytest.raises(TraceError, match=r"np\.sin"):
        jacobian(lambda x: math.sin(x))(3.0)


def test_configuration_may_branch():
    def f(x, mode="paper", limit=np.inf):
        return x if mode == "paper" and limit > 1.0 and x is not None and len(x) == 3 else -x

    assert function(f, X, backend="python")(X).tolist() == X.tolist()


WRONG_STEPS = {
    "no pair": (lambda c, x: x, "<lambda> (" + __file__),
    "another shape": (lambda c, x: ((c[0], np.ones(2)), x), "carry[1] with shape (2,), expected (3,)"),
    "another kind of tree": (lambda c, x: ([c[0], c[1]], x), "expected a tuple of 2 as in the example"),
    "a longer tree": (lambda c, x: ((*c, 1.0), x), "expected a tuple of 2"),
    "no tuple": (lambda c, x: [c, x], "must return (carry, output); it returned list"),
    "nothing": (lambda c, x: ((None, c[1]), x), "returned None for carry[0], expected shape ()"),
    "an array for a number": (lambda c, x: ((c[1], c[1]), x), "carry[0] with shape (3,), expected ()"),
}


@pytest.mark.parametrize("name", WRONG_STEPS)
def test_a_step_that_returns_another_carry_is_refused(name):
    step, message = WRONG_STEPS[name]
    with pytest.raises(TraceError, match=re.escape(message)):
        scan(step, (0.0, X), 0.0, backend="python")


def step(theta, c, x):
    return c + theta[0] * x, c


WRONG_CALLS = {
    "theta missing": (lambda k: k.run(X), "theta is missing: expected 1 parameters, (p,)"),
    "theta too long": (lambda k: k.run(X, [1.0, 2.0]), "theta has shape (2,), expected (p,) with p = 1"),
    "theta of lanes": (lambda k: k.lanes(X, [1.0]), "theta has shape (1,), expected (L, p)"),
    "no time axis": (lambda k: k.run(1.0, [1.0]), "inputs has shape (), expected (N, …)"),
    "another input": (lambda k: k.run((X, X), [1.0]), "inputs has shape (2, 3), expected (N, …)"),
    "another carry": (lambda k: k.run(X, [1.0], carry=np.ones(2)), "carry has shape (2,)"),
    "text": (lambda k: k.run(np.array(["a"]), [1.0]), "expected numbers"),
    "lanes that differ": (lambda k: k.lanes(X, np.ones((2, 1)), carry=np.ones(3)), "2 and 3 lanes"),
}


@pytest.mark.parametrize("backend", ["numpy", "python"])
@pytest.mark.parametrize("name", WRONG_CALLS)
def test_a_wrong_call_of_a_scan_says_what_was_expected(name, backend):
    call, message = WRONG_CALLS[name]
    with pytest.raises(ValueError, match=re.escape(message)):
        call(scan(step, 0.0, 0.0, np.ones(1), backend=backend))


@pytest.mark.parametrize("backend", ["numpy", "python"])
def test_what_a_scan_cannot_give_it_says(backend):
    plain = scan(lambda c, x: (c, (c, x)), 0.0, 0.0, backend=backend)
    with pytest.raises(ValueError, match="this scan has no theta"):
        plain.run(X, [1.0])
    with pytest.raises(ValueError, match="no derivatives without parameters"):
        plain.sensitivities(X, [1.0])
    with pytest.raises(ValueError, match="a cost is one number a tick; this step puts out 2"):
        plain.cost(X)
    with pytest.raises(ValueError, match="the inputs hold no number"):
        scan(lambda c, x: (c, c), 0.0, None, backend=backend).run(None)
    with pytest.raises(ValueError, match=r"theta has shape \(\), expected \(p,\)"):
        scan(step, 0.0, 0.0, 1.0, backend=backend)
    with pytest.raises(ValueError, match='backend = "fortran": expected one of auto, c, python, numpy'):
        scan(step, 0.0, 0.0, np.ones(1), backend="fortran")


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("frition", "dict has no frition; it has friction, gains. Did you mean friction?"),
        ("friction[x]", "an index is one or more whole numbers, not [x]"),
        ("friction..a", "is no path"),
        ("gains", '"gains" has shape (2,), not ()'),
    ],
)
def test_a_wrong_path_is_explained(path, message):
    with pytest.raises((ValueError, AttributeError), match=re.escape(message)):
        put({"friction": {"a": 1.0}, "gains": np.ones(2)}, path, 1.0)
