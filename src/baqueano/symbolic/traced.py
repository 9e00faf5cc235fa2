"""Trace a step that is repeated over time, and run its compiled code.

    carry_{k+1}, output_k = step(θ, carry_k, input_k)                                                     (1)

`scan` traces the step immediately and once, so that it raises the errors of the step. Code is generated and compiled
when a method is first called. With the back end "numpy" the step is not traced, but runs unchanged.
"""

from collections.abc import Callable
from copy import copy
from functools import reduce

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.errors import Invalid
from baqueano.symbolic.backends import Runner, resolve_backend
from baqueano.symbolic.batch import Batch, BatchSums
from baqueano.symbolic.graph.assemble import Assembly, assemble
from baqueano.symbolic.graph.node import nodes_below
from baqueano.symbolic.graph.program import NormalEquations
from baqueano.symbolic.graph.trace import select_output, trace_step
from baqueano.symbolic.graph.tree import as_tree, flat_row, input_rows, leaves, symmetric_leaves
from baqueano.symbolic.plain import PlainScan
from baqueano.symbolic.scan import Scan


def scan(
    step: Callable[..., Tree], carry: Tree, inputs: Tree, theta: Tree = None, *, backend: str = "auto"
) -> Scan:
    """Return a step that is ready to run over time; its result equals the result of this loop:

        outputs = []
        for x in inputs:
            carry, output = step(theta, carry, x)
            outputs.append(output)

    Parameters
    ----------
    step : callable
        (carry, x) → (carry, output), or (theta, carry, x) → (carry, output): pure NumPy code without `if` on values.
    carry : tree
        The carry at the start, or a function of theta that returns it.
    inputs : tree
        An example of the inputs of one tick: any values of the correct shapes.
    theta : array_like (p,), optional
        An example of the parameters [unit of each].
    backend : str
        "auto", "c", "python", or "numpy": the step then runs unchanged.

    Returns
    -------
    Scan
        The scan; code is compiled when a method is first called.

    Raises
    ------
    Invalid
        If theta is not a vector; Invalid is a ValueError.
    TraceError
        If the step cannot be traced; the message names the line.

    Examples
    --------
    >>> kernel = scan(lambda p, v, u: (v + 0.1 * (u - p[0] * v), v), 0.0, 0.0, theta=[0.5])
    >>> last, speeds = kernel.run(np.ones(3), [0.5])
    >>> print(speeds.round(3))
    [0.    0.1   0.195]
    """
    name = resolve_backend(backend)
    theta = None if theta is None else np.array(theta, dtype=float)
    if theta is not None and theta.ndim != 1:
        raise Invalid.of("engine.theta-vector", value=str(theta.shape))
    if name == "numpy":
        return PlainScan(step, carry, inputs, theta)
    return TracedScan(step, carry, inputs, theta, name)


class TracedScan(Scan):
    """A scan whose step was traced to a graph."""

    def __init__(
        self, step: Callable[..., Tree], carry: Tree, inputs: Tree, theta: np.ndarray | None, backend: str
    ) -> None:
        super().__init__(step, carry, inputs, theta)
        self.requested_backend = backend
        start = None if self.carry_function else self._flat_start(None)  # the start can depend on θ
        candidates = {leaf.path for leaf in symmetric_leaves(self.carry_shape, start)}
        self.fields: tuple[str, ...] = ()  # the part of the output of the step
        self.zero_entries = frozenset() if start is None else frozenset(np.flatnonzero(start == 0.0).tolist())
        self.trace, self.symmetric = self._trace_once(candidates)
        self.runners: dict[tuple[bool, ...], tuple[Assembly, Runner]] = {}
        self.sums: dict[tuple, BatchSums] = {}
        self.default_starts: dict[bool, tuple[tuple[Assembly, Runner], np.ndarray]] = {}

    @property
    def backend(self) -> str:
        return self._runner(keep_all=True)[1].backend

    @property
    def source(self) -> str:
        return self._runner(keep_all=True)[1].source

    @property
    def operations(self) -> int:
        program = self._runner(keep_all=True)[0].program
        return sum(bool(node.args) for node in nodes_below([*program.next_carry, *program.outputs]))

    @property
    def unused_carry(self) -> tuple[str, ...]:
        names = [name for leaf in leaves(self.carry_shape) for name in leaf.names]
        return tuple(names[k] for k in self._runner(keep_all=False)[0].unused_carry)

    def part(self, name: str) -> "TracedScan":
        part = copy(self)
        part.fields, part.trace = (*self.fields, name), select_output(self.trace, name)
        part.runners, part.sums, part.default_starts = {}, {}, {}
        return part

    def run(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> tuple[Tree, Tree]:
        theta, rows = self._theta(theta), input_rows(self.input_shape, inputs)
        (assembly, runner), start = self._prepare(carry, keep_all=True)
        outputs = np.empty((len(rows), len(assembly.program.outputs)))
        final_carry = np.empty(len(assembly.program.carry))
        runner.call("run", theta, start, rows, outputs, final_carry)
        return as_tree(self.trace.carry_shape, assembly.whole_carry(final_carry, start)), as_tree(
            self.trace.output_shape, outputs
        )

    def sensitivities(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[np.ndarray, np.ndarray]:
        self._need_theta()
        theta, rows = self._theta(theta), input_rows(self.input_shape, inputs)
        (assembly, runner), start = self._prepare(carry, keep_all=False)
        outputs = np.empty((len(rows), len(assembly.program.outputs)))
        jacobians = np.empty((*outputs.shape, len(theta)))
        runner.call("sensitivities", theta, start, rows, outputs, jacobians)
        return outputs, jacobians

    def bind_sensitivities(self, inputs: Tree) -> Callable[[np.ndarray, np.ndarray], Tree]:
        self._need_theta()
        rows = input_rows(self.input_shape, inputs)
        assembly, runner = self._runner(keep_all=False, given_start=True, has_zeros=False)
        theta, start = np.empty(self.parameters or 0), np.empty(len(assembly.first))
        outputs = np.empty((len(rows), len(assembly.program.outputs)))
        jacobians = np.empty((*outputs.shape, len(theta)))
        run = runner.call("bind", theta, start, rows, outputs, jacobians, "sensitivities")

        def call(current_theta: np.ndarray, carry: np.ndarray) -> Tree:
            theta[...], start[...] = current_theta, carry[assembly.first]
            run()
            return outputs, jacobians

        return call

    def cost(self, inputs: Tree, theta: Tree = None, carry: Tree = None) -> float:
        return self._run_total(inputs, theta, carry, with_gradient=False)[0]

    def cost_and_gradient(self, inputs: Tree, theta: Tree, carry: Tree = None) -> tuple[float, np.ndarray]:
        self._need_theta()
        return self._run_total(inputs, theta, carry, with_gradient=True)

    def normal_equations(
        self, inputs: Tree, theta: Tree, huber: float | None = None, carry: Tree = None
    ) -> NormalEquations:
        self._need_theta()
        theta, rows = self._theta(theta), input_rows(self.input_shape, inputs)
        (_, runner), start = self._prepare(carry, keep_all=False)
        sums = runner.call("normal_equations", theta, start, rows, huber)
        return NormalEquations(*sums)

    def batch(
        self, inputs: Tree, theta: Tree = None, carry: Tree = None, with_outputs: bool = False
    ) -> tuple[Tree, Tree]:
        batch = Batch.from_trees(self, inputs, self._theta(theta, is_batch=True), carry)
        (assembly, runner), start = self._prepare(carry, batch.start, keep_all=True)
        program, count, n = assembly.program, batch.size, batch.ticks
        start = np.broadcast_to(start, (count, start.shape[-1]))
        all_outputs = np.empty((count, n, len(program.outputs))) if with_outputs else None
        final_carry = np.empty((count, len(program.carry)))
        runner.call("batch", batch.theta, start, *batch.inputs, all_outputs, final_carry)
        last = as_tree(self.trace.carry_shape, assembly.whole_carry(final_carry, start))
        return last, None if all_outputs is None else as_tree(self.trace.output_shape, all_outputs)

    def batch_sums(
        self, inputs: Tree, theta: Tree, derivative_count: int = 0, carry: Tree = None
    ) -> tuple[np.ndarray, np.ndarray]:
        self._need_theta()
        batch = Batch.from_trees(self, inputs, self._theta(theta, is_batch=True), carry)
        (assembly, _), start = self._prepare(carry, batch.start, keep_all=False)
        key = id(assembly), derivative_count, batch.inputs[2], batch.shared_start
        with self.trace.graph.lock:
            if key not in self.sums:
                self.sums[key] = BatchSums(assembly, derivative_count, batch, self.requested_backend)
        return self.sums[key].run(batch, start)

    def _run_total(self, inputs: Tree, theta: Tree, carry: Tree, with_gradient: bool) -> Tree:
        theta, rows = self._theta(theta), input_rows(self.input_shape, inputs)
        (assembly, runner), start = self._prepare(carry, keep_all=False)
        if len(assembly.program.outputs) != 1:
            raise Invalid.of("engine.cost", numbers=len(assembly.program.outputs))
        return runner.call("total", theta, start, rows, with_gradient)

    def _trace_once(self, symmetric: set[str]) -> Tree:
        shapes = self.carry_shape, self.input_shape
        trace, symmetric = trace_step(self.step, self.carry_function, *shapes, self.parameters, symmetric)
        return reduce(select_output, self.fields, trace), symmetric

    def _runner(
        self,
        *,
        keep_all: bool,
        given_start: bool | None = None,
        is_symmetric: bool = True,
        has_zeros: bool = True,
    ) -> Tree:
        given_start = self.carry_function is None if given_start is None else given_start
        key = keep_all, given_start, is_symmetric, has_zeros
        if key not in self.runners:
            with self.trace.graph.lock:
                if key not in self.runners:
                    trace = self.trace if is_symmetric else self._trace_once(set())[0]
                    zero_entries = self.zero_entries if has_zeros else ()
                    assembly = assemble(trace, keep_all, given_start, zero_entries)
                    self.runners[key] = assembly, Runner(assembly.program, self.requested_backend)
        return self.runners[key]

    def _prepare(self, carry: Tree, flat_start: np.ndarray | None = None, *, keep_all: bool) -> Tree:
        """Return the kernel to run, and its start values (…, s): from `carry`, or from the start of the scan."""
        if carry is None and flat_start is None:
            if keep_all not in self.default_starts:
                self.default_starts[keep_all] = self._begin(keep_all=keep_all)
            return self.default_starts[keep_all]
        return self._check(self._flat_start(carry) if flat_start is None else flat_start, keep_all=keep_all)

    def _begin(self, *, keep_all: bool) -> Tree:
        """Return the kernel to run, and its start values for the carry that was given to `scan`."""
        if self.carry_function is not None:
            return self._runner(keep_all=keep_all, given_start=False), np.zeros(0)
        return self._check(self._flat_start(None), keep_all=keep_all)

    def _check(self, flat_start: np.ndarray, *, keep_all: bool) -> Tree:
        pair = self._runner(keep_all=keep_all, given_start=True)
        mirrored_entries, mirror = pair[0].mirrored_entries, pair[0].mirror
        is_symmetric = not len(mirrored_entries) or np.array_equal(
            flat_start[..., mirrored_entries], flat_start[..., mirror], equal_nan=True
        )
        has_zeros = is_symmetric and not flat_start[..., pair[0].zeros].any()
        if not has_zeros:  # the start of the scan had more zeros, or a matrix that was symmetric
            pair = self._runner(
                keep_all=keep_all, given_start=True, is_symmetric=is_symmetric, has_zeros=False
            )
        return pair, np.ascontiguousarray(flat_start[..., pair[0].first])

    def _flat_start(self, carry: Tree) -> np.ndarray:
        return flat_row(self.carry_shape, self.example if carry is None else carry)
