"""What a trace of one step leaves behind: the contract between the tracer and the back ends."""

from typing import Any, NamedTuple, Protocol

import numpy as np

from baqueano.symbolic.node import Graph, Node


class Program(NamedTuple):
    """One step of a scan as a graph. c numbers are carried, q come in each tick, m go out, p parameters."""

    graph: Graph
    theta: tuple[Node, ...]  # p symbols
    start: tuple[Node, ...]  # s symbols: the start values given at run time
    initial: tuple[Node, ...]  # c expressions of theta and start
    carry: tuple[Node, ...]  # c symbols; mirrored and dead entries are already gone
    inputs: tuple[Node, ...]  # q symbols
    next_carry: tuple[Node, ...]  # c expressions
    outputs: tuple[Node, ...]  # m expressions

    @property
    def tables(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """(xp, fp) of each table that `interp` reads, by number."""
        return self.graph.tables


class Kernel(Protocol):
    """A program made runnable by a back end."""

    source: str

    def run(self, n: int, theta: Any, start: Any, inputs: Any, outputs: Any, final: Any) -> None: ...
    def sensitivities(self, n: int, theta: Any, start: Any, inputs: Any, outputs: Any, d_outputs: Any) -> None: ...
    def total(
        self, n: int, theta: Any, start: Any, inputs: Any, gradient: bool
    ) -> tuple[float, np.ndarray | None]: ...
    def normal_equations(
        self, n: int, theta: Any, start: Any, inputs: Any, huber: float | None
    ) -> tuple[float, np.ndarray, np.ndarray]: ...
