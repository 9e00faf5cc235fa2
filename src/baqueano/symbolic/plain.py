"""Run the step of a scan unchanged, under NumPy: for debugging, and for comparison.

print and pdb work in the step. Derivatives are computed with dual numbers.
"""

from collections.abc import Callable, Iterator
from copy import copy

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid
from baqueano.symbolic.arrays.array import TracedArray, as_array
from baqueano.symbolic.arrays.tracing import tracing
from baqueano.symbolic.batch import Batch
from baqueano.symbolic.derivatives.dual import Dual, derivative_rows, seed_array
from baqueano.symbolic.derivatives.residuals import normal_equations
from baqueano.symbolic.errors import locate_errors
from baqueano.symbolic.graph.program import NormalEquations
from baqueano.symbolic.graph.tree import (
    Shape,
    as_floats,
    as_tree,
    build,
    count_ticks,
    flat_row,
    leaves,
    restore,
    size,
    tree_shape,
    values,
    with_kinds,
)
from baqueano.symbolic.scan import Scan


class PlainScan(Scan):
    """A scan as a Python loop over the ticks."""

    @property
    def backend(self) -> str:
        return "numpy"

    def part(self, name: str) -> "PlainScan":
        def step(*args: Tree) -> tuple[Tree, Tree]:
            carry, output = self.step(*args)
            return carry, getattr(output, name)

        part = copy(self)
        part.step = step
        return part

    def run(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> tuple[Tree, Tree]:
        last, outputs = self._loop(inputs, self._theta(theta), carry)
        shape = _common_shape(outputs)
        rows = np.array([flat_row(shape, output) for output in outputs])
        end = flat_row(self.carry_shape, last)
        return as_tree(tree_shape(last, "carry"), end), as_tree(shape, rows)

    def sensitivities(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[np.ndarray, np.ndarray]:
        self._need_theta()
        theta = self._theta(theta)
        with tracing() as level, locate_errors():
            _, outputs = self._loop(inputs, seed_array(theta, level), carry)
            shape = tree_shape(outputs[0], "output")
            flat_rows = [
                np.concatenate([as_array(v).ravel() for v in (0.0, *values(shape, output))])[1:]
                for output in outputs
            ]
        rows = np.array(
            [[x.value if isinstance(x, Dual) else x for x in row] for row in flat_rows], dtype=float
        )
        jacobians = np.array([derivative_rows(row, len(theta), level) for row in flat_rows], dtype=float)
        return rows, jacobians

    def bind_sensitivities(self, inputs: Tree) -> Callable[[np.ndarray, np.ndarray], Tree]:
        return lambda theta, carry: self.sensitivities(inputs, theta, carry)

    def cost(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> float:
        _, outputs = self._loop(inputs, self._theta(theta), carry)
        shape = tree_shape(outputs[0], "output")
        _check_scalar(size(shape))
        return float(sum(flat_row(shape, output)[0] for output in outputs))

    def cost_and_gradient(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[float, np.ndarray]:
        outputs, jacobians = self.sensitivities(inputs, theta, carry)
        _check_scalar(outputs.shape[1])
        return float(outputs.sum()), jacobians.sum((0, 1))

    def normal_equations(
        self, inputs: Tree, theta: Tree, huber: float | None = None, carry: Tree = None
    ) -> NormalEquations:
        return NormalEquations(*normal_equations(*self.sensitivities(inputs, theta, carry), huber))

    def batch(
        self, inputs: Tree, theta: Tree = None, carry: Tree = None, with_outputs: bool = False
    ) -> tuple[Tree, Tree]:
        batch = Batch.from_trees(self, inputs, self._theta(theta, is_batch=True), carry)
        final_carries: list[np.ndarray] = []
        all_outputs: list[Tree] = []
        carry_shape = self.carry_shape
        for member in self._members(batch):
            last, member_outputs = self.run(*member)
            carry_shape = tree_shape(last, "carry")
            final_carries.append(flat_row(carry_shape, last))
            all_outputs.append(member_outputs)
        if not with_outputs:
            return as_tree(carry_shape, np.array(final_carries)), None
        shape = tree_shape(all_outputs[0], "output")
        stacks = [
            np.stack(column)
            for column in zip(*(values(shape, member_outputs) for member_outputs in all_outputs), strict=True)
        ]
        return as_tree(carry_shape, np.array(final_carries)), build(shape, iter(stacks))

    def batch_sums(
        self, inputs: Tree, theta: Tree, derivative_count: int = 0, carry: Tree = None
    ) -> tuple[np.ndarray, np.ndarray]:
        self._need_theta()
        batch = Batch.from_trees(self, inputs, self._theta(theta, is_batch=True), carry)
        results = [self.sensitivities(rows, values, start) for rows, values, start in self._members(batch)]
        return np.array([y.sum(0) for y, _ in results]), np.array(
            [d.sum(0)[:, :derivative_count] for _, d in results]
        )

    def _members(self, batch: Batch) -> Iterator[tuple[Tree, Tree, Tree]]:
        """Yield the inputs, θ and the start of each member of a batch."""
        shared_rows, own_inputs, is_shared = batch.inputs
        rows, mask = np.empty((batch.ticks, len(is_shared))), np.array(is_shared, dtype=bool)
        rows[:, mask] = shared_rows
        for k in range(batch.size):
            rows[:, ~mask] = own_inputs[k]
            start = None if batch.start is None else as_tree(self.carry_shape, batch.start[k])
            yield (
                as_tree(self.input_shape, rows),
                None if self.parameters is None else batch.theta[k],
                start,
            )

    def _loop(self, inputs: Tree, theta: np.ndarray | TracedArray, carry: Tree) -> tuple[Tree, list[Tree]]:
        theta_arguments = () if self.parameters is None else (theta,)
        if carry is None:
            carry = self.carry_function(*theta_arguments) if self.carry_function else self.example
        outputs = []
        for x in self._ticks(inputs):
            carry, output = self.step(*theta_arguments, carry, x)
            outputs.append(output)
        if not outputs:
            raise Invalid.of("engine.no-ticks")
        return carry, outputs

    def _ticks(self, inputs: Tree) -> Iterator[Tree]:
        n = count_ticks(self.input_shape, inputs)
        pairs = zip(leaves(self.input_shape), values(self.input_shape, inputs), strict=True)
        columns = [(leaf, as_floats(leaf, value, (n,))) for leaf, value in pairs]
        for k in range(n):
            yield build(self.input_shape, iter([restore(leaf, column[k]) for leaf, column in columns]))


def _common_shape(outputs: list[Tree]) -> Shape:
    """Return the common shape of all outputs; a value that is an integer only at some ticks is a float."""
    shape = tree_shape(outputs[0], "output")
    kinds = zip(*([leaf.kind for leaf in leaves(tree_shape(y, "output"))] for y in outputs), strict=True)
    return with_kinds(shape, iter([min(set(entry_kinds), key="fib".index) for entry_kinds in kinds]))


def _check_scalar(numbers: int) -> None:
    if numbers != 1:
        raise Invalid.of("engine.cost", numbers=numbers)
