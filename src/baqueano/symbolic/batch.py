"""Prepare the inputs of a scan over a batch: inputs common to all members, and separate inputs of each member."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import fault
from baqueano.errors import Invalid
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
        return cls(count, n, theta, rows, (shared_inputs, own_inputs, is_shared))


def _columns(leaf: Leaf, value: Tree, leading_shape: tuple[int, ...]) -> np.ndarray:
    return as_floats(leaf, value, leading_shape).reshape(*leading_shape, leaf.size)


def _list(list_lengths: set[int]) -> str:
    return " and ".join(map(str, sorted(list_lengths))) or "no"
