"""Run a scan over a batch: prepare the inputs, shared by all members or of each member, and sum the outputs."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import Invalid
from baqueano.symbolic.backends import Runner
from baqueano.symbolic.derivatives.sums import with_sums
from baqueano.symbolic.graph.assemble import Assembly
from baqueano.symbolic.graph.carried import with_carried_functions
from baqueano.symbolic.graph.shared import split_shared
from baqueano.symbolic.graph.tree import Leaf, as_floats, leaves, values

if TYPE_CHECKING:
    from baqueano.symbolic.scan import Scan


class Batch(NamedTuple):
    """The arguments of a kernel for a batch of L runs of N ticks."""

    size: int  # L
    ticks: int
    theta: np.ndarray  # (L, p)
    start: np.ndarray | None  # (L, c); None if it follows from θ
    inputs: tuple[np.ndarray, np.ndarray, tuple[bool, ...]]  # shared (N, ·), own (L, N, ·), True if shared
    shared_start: tuple[bool, ...]  # True for each column of `start` that is shared

    @classmethod
    def from_trees(cls, scan: "Scan", inputs: Tree, theta: np.ndarray, carry: Tree) -> "Batch":
        """Return the batch of these trees; a leaf has a batch axis in front if it has one axis more than usual.
        Raise Invalid if the leaves differ in their batch size or number of ticks.
        """
        leaves_and_values = list(zip(leaves(scan.input_shape), values(scan.input_shape, inputs), strict=True))
        is_own_input = [np.ndim(value) == len(leaf.shape) + 2 for leaf, value in leaves_and_values]
        start = scan.example if carry is None else carry
        begin = list(zip(leaves(scan.carry_shape), values(scan.carry_shape, start), strict=True))
        has_many_starts = [np.ndim(value) == len(leaf.shape) + 1 for leaf, value in begin]
        counts = {
            len(value)
            for (_, value), is_own in zip(
                leaves_and_values + begin, is_own_input + has_many_starts, strict=True
            )
            if is_own
        }
        counts |= {len(theta)} if theta.ndim == 2 else set()
        ticks = {
            np.shape(v)[is_own]
            for (_, v), is_own in zip(leaves_and_values, is_own_input, strict=True)
            if np.ndim(v) > is_own
        }
        if len(counts) != 1 or len(ticks) != 1:
            raise Invalid(fault("engine.batch-sizes", sizes=_list(counts), ticks=_list(ticks)))
        (count,), (n,) = counts, ticks
        columns = [
            _columns(leaf, v, (count, n) if o else (n,))
            for (leaf, v), o in zip(leaves_and_values, is_own_input, strict=True)
        ]
        shared_inputs = np.concatenate([np.zeros((n, 0)), *(c for c in columns if c.ndim == 2)], axis=1)
        own_columns = [c for c in columns if c.ndim == 3]  # a single column is used without a copy
        own_columns = own_columns if len(own_columns) == 1 else [np.zeros((count, n, 0)), *own_columns]
        own_inputs = (
            np.ascontiguousarray(own_columns[0])
            if len(own_columns) == 1
            else np.concatenate(own_columns, axis=2)
        )
        is_shared = tuple(c.ndim == 2 for c in columns for _ in range(c.shape[-1]))
        rows = None
        if carry is not None or scan.carry_function is None:
            rows = np.concatenate([np.zeros((count, 0)), *(
                np.broadcast_to(_columns(leaf, v, (count,) if m else ()), (count, leaf.size))
                for (leaf, v), m in zip(begin, has_many_starts, strict=True)
            )], axis=1)  # fmt: skip
        theta = theta if theta.ndim == 2 else np.zeros((count, 0))
        shared_start = tuple(
            not m for (leaf, _), m in zip(begin, has_many_starts, strict=True) for _ in range(leaf.size)
        )
        return cls(count, n, theta, rows, (shared_inputs, own_inputs, is_shared), shared_start)


class BatchSums:
    """The kernels that sum the outputs over the ticks of a batch, and that compute derivatives of the sums.

    The first kernel computes the terms that are equal for all members, once per tick; they are inputs of the other.
    """

    def __init__(self, assembly: Assembly, derivative_count: int, batch: Batch, backend: str) -> None:
        self.assembly, self.derivative_count = assembly, derivative_count
        program, is_shared = with_carried_functions(assembly.program), batch.inputs[2]
        leaves = {x for x, is_same in zip(program.inputs, is_shared, strict=True) if is_same}
        leaves |= {x for x, k in zip(program.start, assembly.first, strict=True) if batch.shared_start[k]}
        self.split = split_shared(program, leaves)
        self.program = with_sums(program if self.split is None else self.split.per_member, derivative_count)
        self.runner = Runner(self.program, backend)
        self.tick_runner = None if self.split is None else Runner(self.split.per_tick, backend)

    def run(self, batch: Batch, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the sums of the outputs (L, m), and their derivatives (L, m, derivative_count)."""
        shared_inputs, own_inputs, is_shared = batch.inputs
        start = np.broadcast_to(start, (batch.size, start.shape[-1]))
        if self.split is not None and self.tick_runner is not None:
            terms = np.empty((batch.ticks, len(self.split.per_tick.outputs)))
            arrays = np.zeros(0), start[0], shared_inputs, terms, np.empty(len(self.split.per_tick.carry))
            self.tick_runner.call("run", *arrays)
            shared_inputs = np.concatenate([shared_inputs, terms], axis=1)
            is_shared += (True,) * terms.shape[1]
        final_carry = np.empty((batch.size, len(self.program.carry)))
        inputs = shared_inputs, own_inputs, is_shared
        self.runner.call("batch", batch.theta, start, *inputs, None, final_carry)
        m, d = len(self.assembly.program.outputs), self.derivative_count
        sums = final_carry[:, final_carry.shape[1] - m * (1 + d) :]
        return sums[:, :m], np.moveaxis(sums[:, m:].reshape(batch.size, d, m), 1, 2)


def _columns(leaf: Leaf, value: Tree, leading_shape: tuple[int, ...]) -> np.ndarray:
    return as_floats(leaf, value, leading_shape).reshape(*leading_shape, leaf.size)


def _list(list_lengths: set[int]) -> str:
    return " and ".join(map(str, sorted(list_lengths))) or "no"
