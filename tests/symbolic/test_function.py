"""One fast call: the same structure in and out, other shapes refused, blocks with a compiled step."""

import sys
import threading
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest

from baqueano.errors import USER_MODULE_PREFIX
from baqueano.symbolic import compile_block, function
from baqueano.symbolic.c_code.compile import find_compiler
from tests.codes import refused

BACKENDS = [
    "numpy",
    "python",
    pytest.param("c", marks=pytest.mark.skipif(not find_compiler().compiler, reason="no cc")),
]


class Slot(NamedTuple):
    is_new: float
    z: np.ndarray | None


class Belief(NamedTuple):
    t_ns: int
    mean: np.ndarray
    cov: np.ndarray
    slots: dict[str, Slot]
    note: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    low: float
    high: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    gain: np.ndarray
    mode: str = "paper"
    size: int = 2

    def __post_init__(self) -> None:
        if not np.all(self.gain > 0.0):
            raise ValueError("gain")

    def init(self) -> Belief:
        return Belief(-1, np.zeros(self.size), np.eye(self.size), {"imu": Slot(0.0, np.zeros(2))})

    def step(self, belief: Belief, z: np.ndarray, t_ns: int = 0) -> tuple[Belief, Any]:
        mean = (
            belief.mean + self.gain * (z[: self.size] - belief.mean) if self.mode == "paper" else belief.mean
        )
        return belief._replace(mean=mean, t_ns=t_ns), {"fresh": t_ns > belief.t_ns, "box": Box(z[0], z)}


@pytest.fixture(params=BACKENDS)
def backend(request):
    return request.param


def rotate(belief, angle, box, pair):
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -s], [s, c]])
    a, b = pair
    slots = {name: Slot(slot.is_new * a, slot.z) for name, slot in belief.slots.items()}
    return Belief(belief.t_ns + 1, J @ belief.mean, J @ belief.cov @ J.T, slots, "turned"), [
        b,
        np.minimum(box.high, 1),
    ]


ARGUMENTS = (
    Belief(2**52, np.array([1.0, 2.0]), np.diag([2.0, 3.0]), {"imu": Slot(1.0, np.array([4.0, 5.0]))}),
    0.5,
    Box(0.0, np.array([0.5, 7.0])),
    (2.0, True),
)


def assert_same(result, expected):
    assert isinstance(expected, type(result))  # NumPy's float64 is a float
    if isinstance(expected, dict):
        assert result.keys() == expected.keys()
        result, expected = list(result.values()), list(expected.values())
    if isinstance(expected, tuple | list):
        for a, b in zip(result, expected, strict=True):
            assert_same(a, b)
    elif isinstance(expected, Box):
        assert_same((result.low, result.high), (expected.low, expected.high))
    elif isinstance(expected, float | np.ndarray):
        np.testing.assert_allclose(result, expected, rtol=1e-14, atol=1e-14)
    else:
        assert result == expected


def test_a_compiled_function_returns_the_same_structure_and_values(backend):
    turn = function(rotate, *ARGUMENTS, backend=backend)
    assert turn.backend == backend
    assert_same(turn(*ARGUMENTS), rotate(*ARGUMENTS))
    arguments = (ARGUMENTS[0]._replace(mean=np.array([-1.0, 0.5]), t_ns=3), -2.0, *ARGUMENTS[2:])
    assert_same(turn(*arguments), rotate(*arguments))


def test_results_of_two_calls_do_not_share_memory(backend):
    double = function(lambda x: 2.0 * x, np.ones(3), backend=backend)
    first = double(np.ones(3))
    double(np.zeros(3))
    first += 1.0
    assert first.tolist() == [3.0] * 3


def test_arguments_may_be_passed_by_name(backend):
    assert function(lambda x, y: x - y, 1.0, 2.0, backend=backend)(y=1.0, x=3.0) == 2.0


def test_all_numeric_types_are_accepted(backend):
    add = function(lambda x, y: x + y, 1.0, np.ones(2), backend=backend)
    for x in (1, True, 1.0, np.float64(1.0), np.float32(1.0), np.int32(1), np.array(1.0)):
        assert np.asarray(add(x, np.ones(2))).tolist() == [2.0, 2.0]
    assert add(1.0, np.array([1, 2])).tolist() == [2.0, 3.0]
    assert np.asarray(add(1.0, np.ones(4)[::2])).tolist() == [2.0, 2.0]


WRONG = {
    "too few": (
        ARGUMENTS[:3],
        ("engine.arguments", {"value": 3, "expected": 4, "names": "belief, angle, box, pair"}),
    ),
    "another size": (
        (ARGUMENTS[0]._replace(mean=np.ones(3)), *ARGUMENTS[1:]),
        ("tree.numbers", {"path": "belief.mean", "value": "(3,)"}),
    ),
    "one number for many": (
        (ARGUMENTS[0]._replace(mean=1.0), *ARGUMENTS[1:]),
        ("tree.numbers", {"path": "belief.mean", "value": "()"}),
    ),
    "an array for a number": (
        (ARGUMENTS[0], np.ones(1), *ARGUMENTS[2:]),
        ("tree.numbers", {"path": "angle", "value": "(1,)"}),
    ),
    "nothing for a number": (
        (ARGUMENTS[0], None, *ARGUMENTS[2:]),
        ("tree.numbers", {"path": "angle", "value": "()", "dtype": "object", "expected": "()"}),
    ),
    "another key": (
        (ARGUMENTS[0]._replace(slots={"gps": ARGUMENTS[0].slots["imu"]}), *ARGUMENTS[1:]),
        ("tree.branch", {"path": "belief.slots"}),
    ),
    "something for nothing": (
        (ARGUMENTS[0]._replace(note="x"), *ARGUMENTS[1:]),
        ("tree.value", {"path": "belief.note", "value": "'x'", "expected": "None"}),
    ),
    "a longer tuple": ((*ARGUMENTS[:3], (1.0, 2.0, 3.0)), ("tree.branch", {"expected": "(…, …)"})),
    "another type": (
        (*ARGUMENTS[:2], 3.0, ARGUMENTS[3]),
        ("tree.branch", {"path": "box", "value": "3.0", "expected": "Box(low, high)"}),
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_different_shape_is_refused_with_its_name(name):
    arguments, expected = WRONG[name]
    with refused(expected[0], (ValueError, TypeError), **expected[1]):
        function(rotate, *ARGUMENTS, backend="python")(*arguments)


def test_a_string_argument_equal_to_the_traced_string_is_accepted():
    label = function(lambda x, word: x * len(word), 1.0, "north", backend="python")
    assert label(2.0, "".join(["no", "rth"])) == 10.0


def test_a_compiled_block_gives_the_same_steps_as_the_block(backend):
    block = Filter(np.array([0.5, 0.25]))
    fast = compile_block(block, backend=backend)
    belief, fast_belief = block.init(), fast.init()
    for k in range(4):
        z = np.array([1.0, -k, 2.0])
        belief, output = block.step(belief, z, k)
        fast_belief, fast_output = fast.step(fast_belief, z, t_ns=k)
        assert_same(fast_belief, belief)
        assert_same(fast_output["box"], output["box"])
        assert fast_output["fresh"] == output["fresh"]
    assert fast.backend == backend


def test_a_compiled_block_is_compiled_once_for_each_shape():
    fast = compile_block(Filter(np.array([0.5, 0.25])), backend="python")
    belief = fast.init()
    for z in (np.ones(2), np.ones(3), np.ones(2), np.ones(3)):
        assert fast.step(belief, z, 1)[0].mean.tolist() == [0.5, 0.25]
    assert len(fast._steps) == 2


@dataclass
class ScaledBlock:
    gain: float

    def step(self, x):
        return self.gain * x


@pytest.fixture
def kept_traces(monkeypatch):
    module = sys.modules["baqueano.symbolic.function"]
    monkeypatch.setattr(module, "_cache", {})
    for block_class in (ScaledBlock, Filter):
        monkeypatch.setattr(block_class, "__module__", f"{USER_MODULE_PREFIX}file")
    return module._cache


def test_only_blocks_with_equal_parameters_share_a_compiled_step(kept_traces):
    for k, gain in enumerate((2.0, 2, 0.0, -0.0)):
        for _ in range(2):
            assert compile_block(ScaledBlock(gain), "python").step(3.0) == 3.0 * gain
            assert len(kept_traces) == k + 1
    for k in range(30):
        block = Filter(np.array([1.0, 2.0 + k]))
        belief, _ = compile_block(block, "python").step(block.init(), np.ones(2))
        assert belief.mean.tolist() == [1.0, 2.0 + k]
    assert len(kept_traces) == sys.modules["baqueano.symbolic.function"].MAX_CACHED


def test_a_block_with_additional_attributes_is_traced_at_each_compilation(kept_traces):
    for gain in (2.0, 3.0):
        block = ScaledBlock(1.0)
        block.gain, block.hidden = gain, None
        assert compile_block(block, "python").step(1.0) == gain
    assert not kept_traces


def test_truth_values_of_the_state_are_joined_and_the_bits_of_an_integer_are_refused(backend):
    def step(flag, mask, x):
        return flag & (x > 0.0), ~mask | (x > 1.0), mask ^ flag, np.where(x > 0.0, flag, mask[0]) & True

    fast = function(step, np.True_, np.array([True, False]), 1.0, backend=backend)
    for x in (2.0, 0.5, -1.0):
        for flag in (np.True_, np.False_):
            arguments = flag, np.array([True, False]), x
            assert all(map(np.array_equal, fast(*arguments), step(*arguments)))
    if backend != "numpy":
        with refused("trace.bits"):
            function(lambda n: n & 1, 3, backend=backend)


def test_a_compiled_block_has_the_fields_of_the_block():
    block = Filter(np.array([0.5, 0.25]), mode="off")
    fast = compile_block(block)
    assert fast.mode == "off"
    assert fast.block is block
    assert fast.gain is block.gain
    with pytest.raises(AttributeError, match="nothing"):
        _ = fast.nothing
    assert "Filter" in repr(fast)


def test_simultaneous_calls_in_several_threads_give_correct_results(backend):
    f = function(lambda x: np.cumsum(x), np.zeros(50), backend=backend)
    errors = []

    def work(value):
        for _ in range(300):
            if f(np.full(50, value))[-1] != 50 * value:
                errors.append(value)

    threads = [threading.Thread(target=work, args=(float(k),)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors


def test_a_function_without_arguments_or_numbers_is_compiled(backend):
    assert function(lambda: 3.0, backend=backend)() == 3.0
    assert function(lambda x: None, 1.0, backend=backend)(1.0) is None
    assert function(lambda word: word, "yes", backend=backend)("yes") == "yes"


class Counting:
    """A block whose step loops over whole seconds."""

    def init(self):
        return 0, 0.0

    def step(self, state, t):
        for second in self.rows_before(state, t):
            state, _ = self.row(state, second)
        return self.row(state, t)

    def rows_before(self, state, t):
        return range(state[0] + 1, t)

    def row(self, state, t):
        return (t, 0.5 * state[1] + t), state[1]


@pytest.mark.parametrize("backend", ["c", "python", "numpy"])
def test_a_step_that_loops_over_its_time_argument_can_be_compiled(backend):
    block, fast = Counting(), compile_block(Counting(), backend)
    for t in (1, 2, 7):
        assert fast.step((0, 1.0), t) == block.step((0, 1.0), t)


class Belief2(NamedTuple):
    t_ns: int
    mean: np.ndarray
    cov: np.ndarray


class Apart:
    """Two states without mutual effect: the zeros between them stay zero."""

    def __init__(self):
        self.G = np.array([[1.0, 0.1, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.5]])

    def init(self):
        return Belief2(-1, np.array([1.0, 2.0, 0.0]), np.diag([1.0, 2.0, 3.0]))

    def step(self, belief, z):
        mean = self.G @ belief.mean + np.array([z, 0.0, 0.0])
        return Belief2(belief.t_ns + 1, mean, self.G @ belief.cov @ self.G.T), mean[0]


def test_a_step_uses_values_that_the_user_wrote_into_the_state(backend):
    block, fast = Apart(), compile_block(Apart(), backend=backend)
    belief, fast_belief = block.init(), fast.init()
    for k in range(6):
        belief, output = block.step(belief, 0.5 * k)
        fast_belief, result = fast.step(fast_belief, 0.5 * k)
        for state in (belief, fast_belief):
            if k == 2:
                state.mean[1] = -7.0
        assert_same(fast_belief, belief)
        assert result == pytest.approx(output, rel=1e-14)
        assert type(fast_belief.t_ns) is int
    before = fast_belief.mean.copy()
    kept_belief, _ = fast.step(fast_belief, 9.0)  # a result is never overwritten
    assert_same(fast_belief.mean, before)
    assert_same(fast.step(fast_belief, 9.0)[0], kept_belief)


def test_a_changed_constant_zero_selects_the_general_kernel(backend):
    block, fast = Apart(), compile_block(Apart(), backend=backend)
    belief, _ = fast.step(fast.init(), 1.0)
    for entry, value in ((0, 2), 0.3), ((2, 1), -0.2), ((1, 2), 0.7):
        belief.cov[entry] = value
        for state in (belief, belief._replace(t_ns=5)):
            assert_same(fast.step(state, 1.0)[0], block.step(state, 1.0)[0])
    assert_same(fast.step(fast.init(), 1.0)[0], block.step(block.init(), 1.0)[0])
    belief = fast.init()._replace(mean=np.array([1.0, 2.0, 4.0]))
    assert_same(fast.step(belief, 1.0)[0], block.step(belief, 1.0)[0])


@pytest.mark.parametrize("backend", BACKENDS[1:])
def test_constant_zeros_are_omitted_from_the_source(backend):
    fast = compile_block(Apart(), backend=backend)
    fast.step(fast.init(), 1.0)
    (step_function,) = fast._steps.values()
    first = step_function._runner._kernel.program
    assert len(first.zeros) == 1 + 4  # of the mean, and between the third state and the others
    fast.step(fast.init()._replace(cov=np.ones((3, 3))), 1.0)
    assert len(fast._steps) == 1


def test_the_minimum_of_more_values_than_python_can_nest_is_compiled():
    """Before, the examination of clips in clips ended a guide along 1441 points with a RecursionError."""
    x = np.linspace(3.0, 2.0, 1500)
    assert function(lambda x: np.minimum(2.5, np.min(x)), x, backend="python")(x) == 2.0
