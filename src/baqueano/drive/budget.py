"""Limit the time of blocks that run as Python code. A block that hangs raises an error that names its line.

A compiled block consists of arithmetic without loops and cannot hang, but Python code can. While the block of a vehicle
is stuck inside C, no command is sent, and the firmware's dead-man timer stops the motors.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.time_limit import within
from baqueano.contracts.values import Tree
from baqueano.symbolic.function import CompiledBlock

BUDGET_S = 0.1  # ten ticks: a third of the firmware's dead-man time


@dataclass(frozen=True, slots=True, eq=False)
class BudgetedBlock:
    """A wrapper of a block: its `init` and `step` raise TimeoutError if they take longer than `budget_s`."""

    inner_blocks: ClassVar[tuple[str, ...]] = ("block",)

    block: Any
    budget_s: float = BUDGET_S

    def init(self, *start: object) -> Any:
        """Return the initial state of the wrapped block, within the budget."""
        return within(self.budget_s, self.block.init, *start)

    def step(self, state: Tree, *inputs: object) -> Any:
        """Return the result of the wrapped block's step, within the budget. It cannot change its inputs."""
        return within(self.budget_s, self.block.step, state, *map(_read_only, inputs))


def _read_only(value: Any) -> Any:
    """Return a signal whose arrays cannot be changed: they also belong to the record and to other blocks."""
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    elif isinstance(value, tuple):
        value_class: Any = type(value)
        return (tuple if value_class is tuple else value_class._make)(map(_read_only, value))
    return value


def may_hang(block: Tree) -> bool:
    """Return True for a block that runs as Python code and contains code that can be the user's."""
    if isinstance(block, CompiledBlock):
        return False
    parts = [getattr(block, name, None) for name in optional.attribute(block, "inner_blocks")]
    return not optional.attribute(block, "is_interpreted") or any(map(may_hang, parts))
