"""Define the program of a traced step: the contract between the tracer and the back ends."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from baqueano.symbolic.graph.node import Graph, Node, nodes_below

Array: TypeAlias = np.ndarray
NODE_FIELDS = ("theta", "start", "initial", "carry", "inputs", "next_carry", "outputs", "zeros")


class Program(NamedTuple):
    """A step of a scan as a graph, with c entries of the carry, q inputs and m outputs per tick, and p parameters."""

    graph: Graph
    theta: tuple[Node, ...]  # p symbols
    start: tuple[Node, ...]  # s symbols: the start values given at run time
    initial: tuple[Node, ...]  # c expressions of theta and start
    carry: tuple[Node, ...]  # c symbols, without mirrored and dead entries
    inputs: tuple[Node, ...]  # q symbols
    next_carry: tuple[Node, ...]  # c expressions
    outputs: tuple[Node, ...]  # m expressions
    is_quick: bool = False  # True for a long program, which is compiled quickly instead of thoroughly
    zeros: tuple[Node, ...] = ()  # inputs for which this graph was simplified: they must be 0

    @property
    def tables(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return (xp, fp) of each table that `interp` reads, by number."""
        return self.graph.tables

    @property
    def symbols(self) -> tuple[tuple[Node, ...], ...]:
        """Return the symbols, by their role."""
        return self.theta, self.start, self.carry, self.inputs

    @property
    def fingerprint(self) -> bytes:
        """Return a digest of everything that determines the code of `copy()`: equal programs have equal digests."""
        import hashlib  # no vehicle needs it before its first drive

        numbers = {x: (role, k) for role, nodes in enumerate(self.symbols) for k, x in enumerate(nodes)}
        roots = (*self.initial, *self.next_carry, *self.outputs)
        nodes, tables = nodes_below(roots), set()
        order = {node: k for k, node in enumerate(nodes)}
        entries: list = []
        for node in nodes:
            if node.op == "symbol":
                entries += (numbers[node], node in self.graph.truths)
                continue
            entries += (node.op, node.value, [order[a] for a in node.args])
            if node.args and node.value is not None:
                tables.add(node.value)
        sizes = [*map(len, (*self.symbols, self.initial, self.outputs))]
        zeros = [numbers[x] for x in self.zeros]
        parts = entries, [order[x] for x in roots], sizes, zeros, sorted(tables), self.is_quick
        digest = hashlib.blake2b(repr(parts).encode(), digest_size=20)
        for column in (column for k in sorted(tables) for column in self.tables[k]):
            digest.update(b"%d " % len(column) + column.tobytes())
        return digest.digest()

    def copy(self) -> "Program":
        """Return the program in its own graph, so that its code does not depend on other nodes of the trace."""
        graph, copies = Graph(), {}
        graph.tables = list(self.tables)
        roots = (*self.initial, *self.next_carry, *self.outputs)
        for node in nodes_below([*(x for nodes in self.symbols for x in nodes), *roots]):
            copies[node] = graph.copy(node, [copies[a] for a in node.args])
        graph.truths = {copies[x] for x in self.graph.truths if x in copies}
        fields = {name: tuple(copies[x] for x in getattr(self, name)) for name in NODE_FIELDS}
        return Program(graph, **fields, is_quick=self.is_quick)


class NormalEquations(NamedTuple):
    """A sum of squares near θ: cost, gradient, hessian. The Gauss-Newton step is −hessian⁻¹ gradient."""

    cost: float  # Σ ρ(r)
    gradient: np.ndarray  # (p,) Σ ψ(r) ∂r
    hessian: np.ndarray  # (p, p) Σ w ∂r ∂rᵀ, w = ψ(r) / r


class Kernel(Protocol):
    """Protocol of the runnable form of a program, made by a back end.

    Arrays are float64 and C-contiguous: theta (p,), start (s,), inputs (n, q) of n ticks. The caller owns the arrays
    that are filled: outputs (n, m), d_outputs (n, m, p), final (c,).
    """

    @property
    def source(self) -> str:
        """Return the generated code."""
        ...

    def run(self, theta: Array, start: Array, inputs: Array, outputs: Array, final: Array) -> None:
        """Run all ticks: fill outputs, and final, the carry after the last tick."""
        ...

    def bind(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, result: Array, method: str = "run"
    ) -> Callable[[], object]:
        """Return `run` or `sensitivities` bound to these arrays, for repeated calls.

        If one of `Program.zeros` is not 0, the call returns a true value and the outputs are not valid.
        """
        ...

    def sensitivities(
        self, theta: Array, start: Array, inputs: Array, outputs: Array, d_outputs: Array
    ) -> None:
        """Fill outputs, and d_outputs with their derivatives with respect to theta."""
        ...

    def total(
        self, theta: Array, start: Array, inputs: Array, with_gradient: bool
    ) -> tuple[float, Array | None]:
        """Return the sum of the only output over the ticks, and its gradient (p,), or None if not `with_gradient`."""
        ...

    def normal_equations(
        self, theta: Array, start: Array, inputs: Array, huber: float | None
    ) -> tuple[float, Array, Array]:
        """Return the cost, the gradient (p,) and the hessian (p, p) of the outputs as residuals."""
        ...

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
        """Run a batch of L: theta (L, p), start (L, s), final (L, c), outputs (L, n, m) or None.

        Inputs that are True in `is_shared` are the columns of shared (n, ·), in order, the others of own (L, n, ·).
        """
        ...
