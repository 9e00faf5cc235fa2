"""NumPy is changed only during a trace and only in the tracing thread, and is restored afterwards."""

import threading

import numpy as np
import pytest

from baqueano.symbolic import function, jacobian
from baqueano.symbolic.arrays.array import TracedArray
from baqueano.symbolic.arrays.tracing import tracing

NAMES = ("array", "asarray", "zeros", "eye", "empty", "full", "zeros_like", "concatenate")


def originals():
    return [getattr(np, name) for name in NAMES]


def test_numpy_is_restored_after_a_trace_and_after_an_error():
    before = originals()
    function(lambda x: np.array([x, jacobian(np.sin)(x)]), 1.0, backend="python")
    assert originals() == before
    with pytest.raises(KeyError):
        function(lambda x: {}["nothing"], 1.0, backend="python")
    assert originals() == before


def test_a_nested_trace_does_not_end_the_outer_trace():
    def f(x):
        slope = jacobian(lambda x: np.array([x[0] * x[1], x[1]]))(x)
        A = np.zeros((2, 2))
        A[0, 1] = x[0]
        return slope + A

    fast = function(f, np.ones(2), backend="python")
    np.testing.assert_allclose(fast(np.array([2.0, 3.0])), [[3.0, 4.0], [0.0, 1.0]])


def test_tracing_does_not_change_numpy_in_other_threads():
    entry_event, leave, types = threading.Event(), threading.Event(), []

    def trace():
        with tracing():
            entry_event.set()
            leave.wait(10.0)
            types.append(type(np.zeros(2)))

    thread = threading.Thread(target=trace)
    thread.start()
    entry_event.wait(10.0)
    types.append(type(np.zeros(2)))
    types.append(np.array([1.0]).dtype)
    leave.set()
    thread.join()
    assert types == [np.ndarray, np.dtype(float), TracedArray]
    assert type(np.zeros(2)) is np.ndarray


def test_simultaneous_traces_in_many_threads_give_correct_results():
    results: dict[int, np.ndarray] = {}
    before = originals()

    def work(k):
        def f(x):
            A = np.zeros((3, 3))
            A[0] = x * float(k)
            return np.array([A[0, 0], jacobian(lambda y: y[0] * y[1])(x)[0]])

        for _ in range(5):
            results[k] = function(f, np.ones(3), backend="python")(np.array([1.0, 2.0, 3.0]))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {k: v.tolist() for k, v in results.items()} == {k: [float(k), 2.0] for k in range(6)}
    assert originals() == before


def test_only_float_arrays_become_traced_arrays():
    with tracing():
        assert type(np.zeros(2)) is TracedArray
        assert type(np.array([1.0, 2.0])) is TracedArray
        assert np.zeros(2, dtype=int).dtype == int
        assert np.array([1, 2]).dtype.kind == "i"
        assert np.array([True, False]).dtype == bool
        assert np.array(["a"]).dtype.kind == "U"
        assert np.array([None, "a"], dtype=object).dtype == object
        assert type(np.array([None, "a"], dtype=object)) is np.ndarray
        assert type(np.asarray(np.arange(3.0))) is np.ndarray


def test_numpy_computes_constant_values_during_a_trace():
    with tracing():
        A = np.eye(2) * 2.0
        assert type(A) is TracedArray
        assert np.linalg.eigvalsh(A).tolist() == [2.0, 2.0]
        assert (A > 1.0).dtype == bool
        assert bool(np.all(A >= 0.0))
        assert float(A[0, 0]) == 2.0
        assert np.zeros(3)[np.argmax(np.diag(A))] == 0.0
        assert A.astype(int).dtype == int
        assert f"{A[0, 0]:.1f}" == "2.0"


def test_writing_to_a_view_changes_its_base():
    def f(x):
        A = np.zeros((2, 2))
        row = A[0]
        row[1] = x
        row += 1.0
        return A

    assert function(f, 1.0, backend="python")(5.0).tolist() == [[1.0, 6.0], [0.0, 0.0]]
