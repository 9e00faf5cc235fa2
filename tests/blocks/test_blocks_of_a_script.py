"""A block of a script is judged by its own text, and its state and its parts can be objects of any class."""

import runpy
from collections import deque
from dataclasses import dataclass

import numpy as np
import pytest

from baqueano.block_checks import check
from baqueano.block_checks.source import outside_accesses
from baqueano.signals import Command

SCRIPT = """
class Quiet:
    def step(self, state, reference, estimate):
        return state, None


class Loud:
    def step(self, state, reference, estimate):
        print(state)


print("the script")
"""


def test_only_the_text_of_the_class_is_examined_in_a_script(tmp_path, monkeypatch):
    (tmp_path / "lab.py").write_text(SCRIPT, encoding="utf-8")
    script = runpy.run_path(str(tmp_path / "lab.py"), run_name="__main__")
    monkeypatch.setattr("inspect.getfile", lambda _: str(tmp_path / "lab.py"))
    assert outside_accesses(script["Quiet"]) == []
    assert [(fault.code, fault.figures["name"]) for fault in outside_accesses(script["Loud"])] == [
        ("outside.calls", "print")
    ]


class Integral:
    def __init__(self):
        self.sum = 0.0

    def add(self, x):
        self.sum += x
        return self.sum


@dataclass(frozen=True)
class OwnState:
    """A controller whose state is an object."""

    first: object

    def init(self):
        return self.first

    def step(self, state, reference, estimate):
        return state, Command(estimate.t_ns, np.array([reference.nu[0], 0.0, reference.nu[2]]))


@pytest.mark.parametrize("first", [frozenset({1.0}), deque([0.0], maxlen=3), Integral(), {"a": {2, 3}}])
def test_a_state_may_be_an_object_of_any_class(first):
    assert check("controller", OwnState(first)) == []


@dataclass(frozen=True)
class OwnPart(OwnState):
    """A controller whose part has memory."""

    def step(self, state, reference, estimate):
        self.first.add(0.5)
        return state, Command(estimate.t_ns, np.array([reference.nu[0], 0.0, reference.nu[2]]))


def test_a_part_with_memory_is_found():
    assert "check.block-changed" in [fault.code for fault in check("controller", OwnPart(Integral()))]
