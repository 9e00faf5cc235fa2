"""A step that depends on more than its arguments: the present value of a global is used, hidden memory is refused."""

from dataclasses import dataclass

import numpy as np
import pytest

from baqueano.symbolic import compile_block, function
from tests.codes import refused

FACTOR, TOTAL = 1.0, 0.0


@dataclass
class GlobalBlock:
    gain: float

    def step(self, x):
        return FACTOR * self.gain * x


def test_a_compiled_step_uses_the_present_value_of_a_global(monkeypatch):
    for factor in (2.0, 3.0):
        monkeypatch.setitem(globals(), "FACTOR", factor)
        assert compile_block(GlobalBlock(5.0), "python").step(1.0) == 5.0 * factor


class WithMemory:
    def __init__(self):
        self.sum, self.time, self.history = 0.0, 0.0, []

    def add(self, x):
        self.sum = self.sum + x
        return self.sum

    def add_to_global(self, x):
        global TOTAL
        TOTAL = TOTAL + x
        return TOTAL

    def append(self, x):
        self.history.append(x)
        return float(len(self.history)) * x

    def integrate_to(self, t):  # a second call at the same time gives the same result
        self.sum, self.time = self.sum + (t - self.time), t
        return self.sum

    def draw(self, x):
        return x + np.random.default_rng().normal()

    def draw_array(self, x):
        """NumPy's compiled code also calls np.empty, and writes floats into the memory of the array."""
        scale, normal = np.empty(3), np.random.default_rng().normal
        scale[:] = x
        return scale * normal(size=3)


@pytest.mark.parametrize("name", ["add", "add_to_global", "append", "integrate_to", "draw", "draw_array"])
def test_a_step_with_memory_or_noise_of_its_own_is_refused_and_its_block_is_unchanged(name):
    block = WithMemory()
    with refused("trace.not-pure"):
        function(getattr(block, name), 1.0, backend="python")
    assert (TOTAL, vars(block)) == (0.0, {"sum": 0.0, "time": 0.0, "history": []})
