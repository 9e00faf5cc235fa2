"""Make a `Program` runnable as Python code of plain floats, for machines without a C compiler.

A value that is used once is written into the expression that uses it; other values are local names. Python raises if
IEEE arithmetic returns inf or NaN (1/0, sqrt of −1). Then the code runs again with functions that do not raise, and
later calls use these functions too. For derivatives, the code computes the Jacobian of one tick, and NumPy multiplies
it into the tangents. For a batch, the same code runs on arrays with one entry per member.
"""

import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.symbolic import ieee
from baqueano.symbolic.derivatives.derive import jacobian_rows
from baqueano.symbolic.derivatives.residuals import normal_equations
from baqueano.symbolic.graph.node import Node, nodes_below
from baqueano.symbolic.graph.program import Array, Program
from baqueano.symbolic.python_code.python_text import (
    ARRAY_FORMATS,
    CHECKED_FORMATS,
    FLOAT_FORMATS,
    Formats,
    kernel_text,
    tick_text,
)

_FAST_OPERATORS = ieee.OPERATORS | {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos,
    "sinh": math.sinh, "cosh": math.cosh, "exp": math.exp, "log": math.log, "sqrt": math.sqrt,
    "pow": math.pow, "floor": math.floor,
}  # fmt: skip
_BATCH_OPERATORS = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan,
    "atan2": np.arctan2, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh, "exp": np.exp, "log": np.log,
    "sqrt": np.sqrt, "hypot": np.hypot, "abs": np.abs, "sign": np.sign, "min": np.minimum, "max": np.maximum,
    "floor": np.floor, "pow": np.power, "and": np.logical_and, "or": np.logical_or, "not": np.logical_not,
    "isnan": np.isnan, "where": np.where, "div": np.divide, "interp": lambda x, table: np.interp(x, *table),
    "interp_slope": np.vectorize(lambda x, table: ieee.interp_slope(x, *table), excluded={1}, otypes=[float]),
}  # fmt: skip


class TangentCode(NamedTuple):
    """The entries of a Jacobian that are not 0: their flat indices in the matrix, and their nodes."""

    indices: list[int]
    nodes: list[Node]


def make_kernel(program: Program) -> "PythonKernel":
    """Return the kernel of a program, without generated code yet."""
    return PythonKernel(program)


class PythonKernel:
    """The kernel as Python functions of plain floats; see program.Kernel."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.functions: dict[str, Callable[..., Value]] = {}
        self.checks_errors = False  # True after a division by zero or another arithmetic error
        self.slopes: tuple[TangentCode, TangentCode] | None = None  # derivatives of the start, and of a tick

    @property
    def source(self) -> str:
        """Return the code of `run`."""
        return kernel_text(self.program, FLOAT_FORMATS, [self.program.outputs])

    def run(self, theta: Array, start: Array, inputs: Array, outputs: Array, final: Array) -> None:
        """Run all ticks: fill outputs, and final, the carry after the last tick."""
        _, rows, last = self._call((), [self.program.outputs], theta, start, inputs)
        outputs[:] = np.array([y for (y,) in rows], dtype=float).reshape(outputs.shape)
        final[:] = last

    def bind(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, result: Array, method: str = "run"
    ) -> Callable[[], object]:
        """Return `run` or `sensitivities` bound to these arrays."""
        if len(inputs) != 1 or self.program.carry or self.program.theta or self.program.start:
            return partial(getattr(self, method), theta, start, inputs, outputs, result)
        return self._tick(inputs[0], outputs[0])

    def sensitivities(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, d_outputs: Array
    ) -> None:
        """Fill outputs, and d_outputs with their derivatives with respect to theta."""
        program = self.program
        c, m, p = len(program.carry), len(program.outputs), len(program.theta)
        at_start, tick_code = self._tangent_codes()
        begin, rows, _ = self._call(at_start.nodes, [program.outputs, tick_code.nodes], theta, start, inputs)
        tangents, tick = np.zeros((c, p)), np.zeros((m + c, c + p))
        tangents.put(at_start.indices, begin)
        for k, (y, slopes) in enumerate(rows):
            tick.put(tick_code.indices, slopes)
            row = tick[:, :c] @ tangents + tick[:, c:]
            outputs[k], d_outputs[k], tangents = y, row[:m], row[m:]

    def total(
        self, theta: Array, start: Array, inputs: Array, with_gradient: bool
    ) -> tuple[float, Array | None]:
        """Return the sum of the only output over the ticks, and its gradient (p,), or None if not `with_gradient`."""
        outputs, jacobians = np.empty((len(inputs), 1)), np.empty((len(inputs), 1, len(theta)))
        if with_gradient:
            self.sensitivities(theta, start, inputs, outputs, jacobians)
            return float(outputs.sum()), jacobians.sum((0, 1))
        self.run(theta, start, inputs, outputs, np.empty(len(self.program.carry)))
        return float(outputs.sum()), None

    def normal_equations(
        self, theta: Array, start: Array, inputs: Array, huber: float | None
    ) -> tuple[float, Array, Array]:
        """Return the cost, the gradient (p,) and the hessian (p, p) of the outputs as residuals."""
        outputs = np.empty((len(inputs), len(self.program.outputs)))
        jacobians = np.empty((*outputs.shape, len(theta)))
        self.sensitivities(theta, start, inputs, outputs, jacobians)
        return normal_equations(outputs, jacobians, huber)

    def batch(
        self,
        theta: Array,
        start: Array,
        shared_inputs: Array,
        own_inputs: Array,
        is_shared: Sequence[bool],
        outputs: Array | None,
        final: Array,
    ) -> None:
        """Run all members in parallel, tick by tick; arguments as in program.Kernel."""
        order = np.argsort(np.argsort([not x for x in is_shared], kind="stable"), kind="stable")
        ticks = (
            [[*shared_inputs[k], *own_inputs[:, k].T][i] for i in order] for k in range(len(shared_inputs))
        )
        groups = [] if outputs is None else [self.program.outputs]
        kernel = self._function(ARRAY_FORMATS, _BATCH_OPERATORS, (), groups)
        with np.errstate(all="ignore"):
            _, rows, last = kernel(theta.T, start.T, ticks)
        for column, value in enumerate(last):
            final[:, column] = value
        if outputs is not None:
            for k, (row,) in enumerate(rows):
                for column, value in enumerate(row):
                    outputs[:, k, column] = value

    def _tick(self, inputs: Array, outputs: Array) -> Callable[[], object]:
        """Return a function that runs a tick: it converts only the inputs in use, and writes each output once."""
        program, value_index = self.program, {node: k for k, node in enumerate(self.program.inputs)}
        nodes = list(dict.fromkeys(program.outputs))
        used_inputs = sorted(value_index[node] for node in nodes_below(nodes) if node in value_index)
        zeros, nonzero = (
            np.array(x, dtype=np.intp) for x in ([value_index[node] for node in program.zeros], used_inputs)
        )
        zero_bytes, outputs_ = bytes(8 * len(zeros)), np.empty(len(nodes))
        node_index = {node: k for k, node in enumerate(nodes)}
        output_indices = np.array([node_index[node] for node in program.outputs], dtype=np.intp)
        write, to = struct.Struct(f"={len(nodes)}d").pack_into, outputs_.data.cast("B")

        def make_tick(formats: Formats, operators: dict[str, Callable[..., Value]]) -> Callable[..., Value]:
            text = tick_text(formats, [program.inputs[k] for k in used_inputs], nodes)
            return self._execute(text, operators)["tick"]

        ticks = [make_tick(FLOAT_FORMATS, _FAST_OPERATORS)]

        def call() -> bool:
            if zero_bytes and inputs.take(zeros).tobytes() != zero_bytes:
                return True
            row = inputs.take(nonzero).tolist()
            try:
                values = ticks[-1](row)
            except (ArithmeticError, ValueError):
                ticks.append(make_tick(CHECKED_FORMATS, ieee.OPERATORS))
                values = ticks[-1](row)
            write(to, 0, *values)
            outputs_.take(output_indices, out=outputs, mode="clip")  # "raise" would copy twice
            return False

        return call

    def _tangent_codes(self) -> tuple[TangentCode, TangentCode]:
        """Return the nonzero entries of ∂carry₀/∂θ, and of ∂(outputs, next carry)/∂(carry, θ)."""
        if self.slopes is None:
            p, m = self.program, len(self.program.outputs)
            begin = jacobian_rows(p.initial, p.theta)
            rows = jacobian_rows([*p.outputs, *p.next_carry], [*p.carry, *p.theta])
            dependent_nodes = _dependent_nodes(p, begin, rows[m:])
            rows = [{source: d for source, d in row.items() if source in dependent_nodes} for row in rows]
            self.slopes = _nonzero_pattern(begin, p.theta), _nonzero_pattern(rows, [*p.carry, *p.theta])
        return self.slopes

    def _call(
        self,
        first: Sequence[Node],
        groups: Sequence[Sequence[Node]],
        theta: Array,
        start: Array,
        inputs: Array,
    ) -> Value:
        lists = theta.tolist(), start.tolist(), inputs.tolist()
        if not self.checks_errors:
            try:
                return self._function(FLOAT_FORMATS, _FAST_OPERATORS, first, groups)(*lists)
            except (ArithmeticError, ValueError):
                self.checks_errors = True
        return self._function(CHECKED_FORMATS, ieee.OPERATORS, first, groups)(*lists)

    def _function(
        self,
        formats: Formats,
        operators: dict[str, Callable[..., Value]],
        first: Sequence[Node],
        groups: Sequence[Sequence[Node]],
    ) -> Callable[..., Value]:
        key = f"{formats.name} {len(first)} {len(groups)}"
        if key not in self.functions:
            text = kernel_text(self.program, formats, groups, first)
            self.functions[key] = self._execute(text, operators)["kernel"]
        return self.functions[key]

    def _execute(self, text: str, operators: dict[str, Callable[..., Value]]) -> dict[str, Value]:
        space: dict[str, object] = {f"{op}_": function for op, function in operators.items()}
        space |= {f"table{k}": tuple(x.tolist() for x in t) for k, t in enumerate(self.program.tables)}
        space |= {"inf": math.inf, "nan": math.nan}
        exec(compile(text, "<baqueano kernel>", "exec"), space)
        return space


def _dependent_nodes(
    program: Program, begin: list[dict[Node, Node]], next_values: list[dict[Node, Node]]
) -> set[Node]:
    """Return θ and the entries of the carry that depend on θ; other derivatives are not needed."""
    dependent_nodes, size = set(program.theta), -1
    while size != len(dependent_nodes):
        size = len(dependent_nodes)
        dependent_nodes |= {
            x
            for x, a, b in zip(program.carry, begin, next_values, strict=True)
            if a or dependent_nodes & b.keys()
        }
    return dependent_nodes


def _nonzero_pattern(rows: list[dict[Node, Node]], sources: Sequence[Node]) -> TangentCode:
    column = {source: k for k, source in enumerate(sources)}
    indices = [i * len(sources) + column[source] for i, row in enumerate(rows) for source in row]
    return TangentCode(indices, [d for row in rows for d in row.values()])
