"""Code that cannot be traced is refused with the file and line of the user, and with a remedy."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from baqueano.symbolic import TraceError, function, jacobian, scan, with_value
from tests.codes import refused

X, A = np.array([1.0, 2.0, 3.0]), np.eye(3)
RESULTS = []
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
    RESULTS.append(x[0])
    return RESULTS[0] * x[0]


def prints(x):
    print(f"x = {x[0]}")
    return x


CASES = {
    "print": (prints, "trace.prints"),
    "if": (lambda x: x if x[0] > 0 else -x, "trace.decides"),
    "chained comparison": (lambda x: np.where(0 < x[0] < 1, x, 0.0), "trace.decides"),
    "and": (lambda x: np.where(x[0] > 0 and x[1] > 0, x, 0.0), "trace.decides"),
    "builtin max": (lambda x: max(x[0], x[1]), "trace.decides"),
    "builtin sorted": (lambda x: sorted(x)[0], "trace.decides"),
    "math function": (lambda x: math.sin(x[0]), "trace.needs-float"),
    "float of a value": (lambda x: float(x[0]), "trace.needs-float"),
    "index": (lambda x: TABLE[x[0]], "trace.numpy"),
    "array index": (lambda x: TABLE[np.floor(x)], "trace.index"),
    "traced index": (lambda x: x[np.floor(x)], "trace.index"),
    "range": (lambda x: sum(range(x[0])), "trace.needs-index"),
    "whole number": (lambda x: x[0].astype(int), "trace.needs-int"),
    "whole numbers": (lambda x: x.astype(int), "trace.not-convertible"),
    "shapes of a sum": (lambda x: x + np.ones(2), "trace.numpy"),
    "shapes of a product": (lambda x: A[:2, :2] @ x, "trace.product-shapes"),
    "shapes of a solve": (lambda x: np.linalg.solve(A, x[:2] * x[0]), "trace.solve-shapes"),
    "shapes of a stack": (lambda x: np.concatenate([x, A]), "trace.numpy"),
    "ragged array": (lambda x: np.array([[x[0], x[1]], [x[2]]]), "trace.numpy"),
    "bits": (lambda x: x[0] & 1, "trace.bits"),
    "bits of an array": (lambda x: (x > 0.0) | x, "trace.bits"),
    "inverted bits": (lambda x: ~x[0], "trace.bits"),
    "unknown ufunc": (lambda x: np.arctanh(x / 9), "trace.unknown-ufunc"),
    "unknown function": (lambda x: np.linalg.eigh(np.outer(x, x)), "trace.unsupported"),
    "unknown method": (lambda x: x[0].tensor(), "trace.numpy"),
    "matrix norm": (lambda x: np.linalg.norm(np.outer(x, x), 2), "trace.norm"),
    "one-armed where": (lambda x: np.where(x > 0), "trace.where-arms"),
    "period of a table": (lambda x: np.interp(x, [0, 1], [1, 2], period=1.0), "trace.interp-period"),
    "a long unknown table": (
        lambda x: np.interp(x[0], np.arange(200) * x[1], np.ones(200)),
        "trace.interp-points",
    ),
    "singular matrix": (
        lambda x: np.linalg.solve(np.array([[0.0, x[0]], [0.0, 1.0]]), x[:2]),
        "trace.singular",
    ),
    "argument changed": (changes_its_argument, "trace.argument-changed"),
    "argument written": (writes_into_its_argument, "trace.argument-changed"),
    "constant written": (writes_into_a_constant, "trace.needs-float"),
    "unpacking a number": (lambda x: [a for a in x[0]], "trace.numpy"),
    "division by nothing": (lambda x: x / (1 // 0), "trace.numpy"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_trace_error_names_the_line_and_a_remedy(name):
    f, code = CASES[name]
    with refused(code, TraceError) as error_info:
        function(f, X, backend="python")
    place, line, source = re.match(r"(.*):(\d+): (.*)", error_info.value.diagnostic.figures["place"]).groups()
    assert place == __file__
    first = f.__code__.co_firstlineno
    assert first <= int(line) <= first + 2
    assert source in Path(__file__).read_text(encoding="utf-8")


def test_a_trace_error_is_both_a_type_and_a_value_error():
    assert issubclass(TraceError, TypeError)
    assert issubclass(TraceError, ValueError)


def test_a_traced_value_used_in_another_trace_is_refused():
    RESULTS.clear()
    function(keeps_a_value, X, backend="python")
    with refused("trace.another-trace", TraceError):
        function(keeps_a_value, X, backend="python")


def test_an_exception_of_user_code_is_not_changed():
    class OutOfPaper(Exception):
        pass

    def f(x):
        raise OutOfPaper

    with pytest.raises(OutOfPaper):
        function(f, X)


def test_derivatives_outside_a_trace_may_branch_on_values_but_need_floats():
    assert jacobian(lambda x: x * x if x > 0 else -x)(3.0) == 6.0
    with refused("trace.needs-float", TraceError):
        jacobian(lambda x: math.sin(x))(3.0)


def test_a_branch_on_a_configuration_value_is_allowed():
    def f(x, mode="paper", limit=np.inf):
        return x if mode == "paper" and limit > 1.0 and x is not None and len(x) == 3 else -x

    assert function(f, X, backend="python")(X).tolist() == X.tolist()


WRONG_STEPS = {
    "no pair": (lambda c, x: x, "trace.pair", {"kind": "Node"}),
    "another shape": (
        lambda c, x: ((c[0], np.ones(2)), x),
        "trace.leaf-shape",
        {"path": "carry[1]", "value": "(2,)", "expected": "(3,)"},
    ),
    "another kind of tree": (lambda c, x: ([c[0], c[1]], x), "tree.branch", {"expected": "(…, …)"}),
    "a longer tree": (lambda c, x: ((*c, 1.0), x), "tree.branch", {"expected": "(…, …)"}),
    "no tuple": (lambda c, x: [c, x], "trace.pair", {"kind": "list"}),
    "nothing": (lambda c, x: ((None, c[1]), x), "trace.value", {"path": "carry[0]", "value": "None"}),
    "an array for a number": (
        lambda c, x: ((c[1], c[1]), x),
        "trace.leaf-shape",
        {"path": "carry[0]", "value": "(3,)", "expected": "()"},
    ),
}


@pytest.mark.parametrize("name", WRONG_STEPS)
def test_a_step_that_returns_a_different_carry_is_refused(name):
    step, code, figures = WRONG_STEPS[name]
    with refused(code, TraceError, **figures):
        scan(step, (0.0, X), 0.0, backend="python")


def step(theta, c, x):
    return c + theta[0] * x, c


WRONG_CALLS = {
    "theta missing": (lambda k: k.run(X), ("engine.theta-missing", {"parameters": 1, "expected": "(p,)"})),
    "theta too long": (
        lambda k: k.run(X, [1.0, 2.0]),
        ("engine.theta-shape", {"value": "(2,)", "expected": "(p,)", "parameters": 1}),
    ),
    "theta of a batch": (
        lambda k: k.batch(X, [1.0]),
        ("engine.theta-shape", {"value": "(1,)", "expected": "(L, p)", "parameters": 1}),
    ),
    "no time axis": (
        lambda k: k.run(1.0, [1.0]),
        ("engine.ticks", {"path": "inputs", "value": "()", "expected": "()"}),
    ),
    "another input": (
        lambda k: k.run((X, X), [1.0]),
        ("engine.ticks", {"path": "inputs", "value": "(2, 3)"}),
    ),
    "another carry": (
        lambda k: k.run(X, [1.0], carry=np.ones(2)),
        ("tree.numbers", {"path": "carry", "value": "(2,)"}),
    ),
    "text": (lambda k: k.run(np.array(["a"]), [1.0]), ("tree.numbers", {})),
    "batch sizes that differ": (
        lambda k: k.batch(X, np.ones((2, 1)), carry=np.ones(3)),
        ("engine.batch-sizes", {"sizes": "2 and 3", "ticks": "3"}),
    ),
}


@pytest.mark.parametrize("backend", ["numpy", "python"])
@pytest.mark.parametrize("name", WRONG_CALLS)
def test_a_wrong_call_of_a_scan_is_refused_with_the_expected_arguments(name, backend):
    call, expected = WRONG_CALLS[name]
    with refused(expected[0], ValueError, **expected[1]):
        call(scan(step, 0.0, 0.0, np.ones(1), backend=backend))


@pytest.mark.parametrize("backend", ["numpy", "python"])
def test_an_unsupported_request_to_a_scan_is_refused(backend):
    kernel = scan(lambda c, x: (c, (c, x)), 0.0, 0.0, backend=backend)
    with refused("engine.no-theta", ValueError):
        kernel.run(X, [1.0])
    with refused("engine.no-parameters", ValueError):
        kernel.sensitivities(X, [1.0])
    with refused("engine.cost", ValueError, numbers=2):
        kernel.cost(X)
    with refused("engine.no-number", ValueError):
        scan(lambda c, x: (c, c), 0.0, None, backend=backend).run(None)
    with refused("engine.theta-vector", ValueError, value="()"):
        scan(step, 0.0, 0.0, 1.0, backend=backend)
    with refused("engine.backend", ValueError, value="fortran", valid="auto, c, python, numpy"):
        scan(step, 0.0, 0.0, np.ones(1), backend="fortran")


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("frition", ("path.no-such-name", {"path": "frition", "kind": "dict", "value": "frition"})),
        ("friction[x]", ("path.index", {"value": "x"})),
        ("friction..a", ("path.not-a-path", {})),
        ("gains", ("path.shape", {"path": "gains", "expected": "(2,)", "value": "()"})),
    ],
)
def test_an_invalid_parameter_path_is_refused_with_an_explanation(path, expected):
    with refused(expected[0], (ValueError, AttributeError), **expected[1]):
        with_value({"friction": {"a": 1.0}, "gains": np.ones(2)}, path, 1.0)
