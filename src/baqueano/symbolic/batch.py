"""Run a scan over a batch: prepare the inputs, shared by all members or of each member, and sum the outputs."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid
from baqueano.symbolic.backends import Runner
from baqueano.symbolic.derivatives.sums import with_sums
from baqueano.symbolic.graph.assemble import Assembly
from baqueano.symbolic.graph.carried import with_carried_functions
from baqueano.symbolic.graph.shared import split_shared
from baqueano.symbolic.graph.tree import Leaf, Shape, as_floats, leaves, values

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
        entries = _batch_leaves(scan.input_shape, inputs, axes=2)
        begin = _batch_leaves(scan.carry_shape, scan.example if carry is None else carry, axes=1)
        counts = {len(x.value) for x in entries + begin if x.is_own}
        counts |= {len(theta)} if theta.ndim == 2 else set()
        ticks = {np.shape(x.value)[x.is_own] for x in entries if np.ndim(x.value) > x.is_own}
        if len(counts) != 1 or len(ticks) != 1:
            raise Invalid.of("engine.batch-sizes", sizes=_list(counts), ticks=_list(ticks))
        (count,), (n,) = counts, ticks
        rows = None
        if carry is not None or scan.carry_function is None:
            columns = (
                np.broadcast_to(x.columns((count,) if x.is_own else ()), (count, x.leaf.size)) for x in begin
            )
            rows = np.concatenate([np.zeros((count, 0)), *columns], axis=1)
        theta = theta if theta.ndim == 2 else np.zeros((count, 0))
        shared_start = tuple(not x.is_own for x in begin for _ in range(x.leaf.size))
        return cls(count, n, theta, rows, _input_arrays(entries, count, n), shared_start)


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


class _BatchLeaf(NamedTuple):
    leaf: Leaf
    value: Tree
    is_own: bool  # each member has its own value: an axis of the batch is in front

    def columns(self, leading_shape: tuple[int, ...]) -> np.ndarray:
        """Return the value as columns (*leading_shape, size of the leaf)."""
        rows = as_floats(self.leaf, self.value, leading_shape)
        return rows.reshape(*leading_shape, self.leaf.size)


def _batch_leaves(shape: Shape, tree: Tree, axes: int) -> list[_BatchLeaf]:
    """Return the leaves of a tree; with `axes` axes in front of the shape of the leaf, each member has its own."""
    pairs = zip(leaves(shape), values(shape, tree), strict=True)
    return [_BatchLeaf(leaf, value, np.ndim(value) == len(leaf.shape) + axes) for leaf, value in pairs]


def _input_arrays(
    entries: list[_BatchLeaf], count: int, n: int
) -> tuple[np.ndarray, np.ndarray, tuple[bool, ...]]:
    """Return the shared inputs (n, ·), the inputs of each member (count, n, ·), and for each column True if shared."""
    columns = [x.columns((count, n) if x.is_own else (n,)) for x in entries]
    shared_inputs = np.concatenate([np.zeros((n, 0)), *(c for c in columns if c.ndim == 2)], axis=1)
    own_columns = [c for c in columns if c.ndim == 3]
    if len(own_columns) == 1:  # without a copy
        own_inputs = np.ascontiguousarray(own_columns[0])
    else:
        own_inputs = np.concatenate([np.zeros((count, n, 0)), *own_columns], axis=2)
    return shared_inputs, own_inputs, tuple(c.ndim == 2 for c in columns for _ in range(c.shape[-1]))


def _list(list_lengths: set[int]) -> str:
    return " and ".join(map(str, sorted(list_lengths))) or "no"
