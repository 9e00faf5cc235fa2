"""Compute forward tangents: the derivatives of every value with respect to the parameters, as rows of a few lanes.

For v = f(a, b, …) the row is ∂v = ∂f/∂a ∂a + ∂f/∂b ∂b + …. Each active value is either *kept*, as a separate row, or
*eliminated*: its coefficients are multiplied, as scalars, into the coefficients of its users. If all values are kept,
each edge of the graph costs a vector operation: the growth is linear. A value has s sources; n of them have a
coefficient that is not 1. It has u users; p of them are not sums. With B blocks of parameters its elimination saves
work if

    s u + n p / B <= s + u:                                                                               (1)

the products of coefficients are scalars for all blocks. Both programs are generated, and the cheaper program is used.
The arms of `where` are combined by a choice between rows, never by a product with 0: the other arm can be NaN. If all
sources are the carry and the parameters, which exist at every tick, a choice between coefficients is enough.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from baqueano.symbolic.derivatives.derive import partials
from baqueano.symbolic.graph.emit import postorder
from baqueano.symbolic.graph.node import Node
from baqueano.symbolic.graph.program import Program

SUM_OPERATORS = ("add", "sub", "neg")


class TangentRow:
    """The derivatives of one value with respect to `lanes` parameters. Like a Node, it is hashed by identity."""

    __slots__ = ("args", "lanes", "op", "value")

    def __init__(
        self, op: str, lanes: int, args: tuple["TangentRow | Node", ...] = (), value: int = 0
    ) -> None:
        self.op = op  # "unit" (value: its lane), "drift" (of the carry), "row" (Σ of pairs), "choose"
        self.args = args  # coefficient, row, coefficient, row, …; or condition, row, row
        self.lanes, self.value = lanes, value


class Tangents(NamedTuple):
    """The tangent rows for one block of parameters, as a kernel needs them."""

    first: int  # the block begins with θ[first]
    lanes: int
    drifts: tuple[TangentRow, ...]  # of the carry at the beginning of a tick
    initial: tuple[TangentRow, ...]
    next_carry: tuple[TangentRow, ...]
    outputs: tuple[TangentRow, ...]


Combination = dict[TangentRow, Node]  # Σ coefficient · row


def tangents(program: Program, first: int, lanes: int, eliminate: bool) -> Tangents:
    """Return the rows for θ[first : first + lanes] that a kernel needs."""
    unit = program.graph.const(1.0)
    seeds = program.theta[first : first + lanes]
    drifts = tuple(TangentRow("drift", lanes) for _ in program.carry)
    base: dict[Node, Combination] = {
        x: {TangentRow("unit", lanes, value=j): unit} for j, x in enumerate(seeds)
    }
    dependent_nodes = active_nodes(program, seeds)
    base |= {x: {drift: unit} for x, drift in zip(program.carry, drifts, strict=True) if x in dependent_nodes}
    groups = (program.initial, program.next_carry, program.outputs)
    order = postorder([root for group in groups for root in group])
    count = len(list(parameter_blocks(len(program.theta))))
    rows = _Rows(lanes, base, order, _changing_nodes(program, order), eliminate, count)
    return Tangents(first, lanes, drifts, *(tuple(map(rows.row, group)) for group in groups))


def _changing_nodes(program: Program, order: Iterable[Node]) -> set[Node]:
    """Return the nodes that change from tick to tick: they depend on the carry or the inputs."""
    terms = {*program.carry, *program.inputs}
    for node in order:
        if not terms.isdisjoint(node.args):
            terms.add(node)
    return terms


def active_nodes(program: Program, seeds: Iterable[Node]) -> set[Node]:
    """Return the nodes that depend on the seeds, directly or through the carry."""
    order = postorder((*program.initial, *program.next_carry, *program.outputs))
    nodes = set(seeds)
    size = -1
    while size != len(nodes):
        size = len(nodes)
        for node in order:
            if not nodes.isdisjoint(node.args):
                nodes.add(node)
        carry_values = zip(program.carry, program.initial, program.next_carry, strict=True)
        nodes.update(x for x, begin, end in carry_values if begin in nodes or end in nodes)
    return nodes


class _Rows:
    """The tangent rows of all nodes of an order; `base` contains the rows of the leaves."""

    def __init__(
        self,
        lanes: int,
        base: dict[Node, Combination],
        order: list[Node],
        changing_nodes: set[Node],
        eliminate: bool,
        blocks: int,
    ) -> None:
        self.lanes = lanes
        self.changing_nodes = changing_nodes
        self.eliminate = eliminate
        self.blocks = blocks
        self.sources = {row for combination in base.values() for row in combination}
        self.combinations = dict(base)
        self.rows_by_node: dict[Node, TangentRow] = {}
        self.zero = TangentRow("row", lanes)
        self.uses, self.products = _uses(order)
        for node in order:
            if node not in base and not self.combinations.keys().isdisjoint(node.args):
                self.combine(node)

    def row(self, node: Node) -> TangentRow:
        """Return the derivatives of a node as one row."""
        if node not in self.rows_by_node:
            self.rows_by_node[node] = self.sum(self.combinations.get(node, {}))
        return self.rows_by_node[node]

    def sum(self, combination: Combination) -> TangentRow:
        if not combination:
            return self.zero
        (row, coefficient), *other_terms = combination.items()
        if not other_terms and _is_one(coefficient):
            return row
        return TangentRow("row", self.lanes, tuple(x for row, k in combination.items() for x in (k, row)))

    def combine(self, node: Node) -> None:
        combination = self.choose(*node.args) if node.op == "where" else self.chain(node)
        if not combination:
            return
        self.combinations[node] = combination
        if self.is_kept(node, combination):
            self.combinations[node] = {self.row(node): node.graph.const(1.0)}

    def chain(self, node: Node) -> Combination:
        """Return Σ ∂node/∂a ∂a over the arguments a of a node: a sum of coefficients times rows."""
        make = node.graph.make
        result: Combination = {}
        for a, derivative in partials(node):
            for row, k in self.combinations.get(a, {}).items():
                term = make("mul", derivative, k)
                result[row] = make("add", result[row], term) if row in result else term
        return {row: k for row, k in result.items() if not (k.op == "const" and k.value == 0.0)}

    def choose(self, condition: Node, a: Node, b: Node) -> Combination:
        graph = condition.graph
        unit, zero = graph.const(1.0), graph.const(0.0)
        combination_a, combination_b = self.combinations.get(a, {}), self.combinations.get(b, {})
        all_rows = dict.fromkeys((*combination_a, *combination_b))
        if self.eliminate and self.sources.issuperset(all_rows):
            return {
                r: graph.make("where", condition, combination_a.get(r, zero), combination_b.get(r, zero))
                for r in all_rows
            }
        if not all_rows:
            return {}
        return {TangentRow("choose", self.lanes, (condition, self.row(a), self.row(b))): unit}

    def is_kept(self, node: Node, combination: Combination) -> bool:
        if len(combination) == 1 and all(map(_is_one, combination.values())):
            return False  # it already is the row of another node
        if not self.eliminate or node not in self.changing_nodes:
            return True
        rows, uses = len(combination), self.uses[node]
        scalars = sum(not _is_one(k) for k in combination.values())
        return rows * uses + scalars * self.products[node] / self.blocks > rows + uses


def _uses(order: Iterable[Node]) -> tuple[dict[Node, int], dict[Node, int]]:
    """Return two counts for each node: its uses, and its uses that are not sums."""
    uses: dict[Node, int] = dict.fromkeys(order, 0)
    products = dict(uses)
    for node in uses:
        for a in node.args:
            uses[a] += 1
            products[a] += node.op not in SUM_OPERATORS
    return uses, products


def _is_one(node: Node) -> bool:
    return node.op == "const" and node.value == 1.0


def parameter_blocks(count: int) -> Iterator[tuple[int, int]]:
    """Yield (first parameter, lanes) of the vectors for `count` parameters: eight lanes, or four in the last."""
    for first in range(0, count, 8):
        yield first, 4 if count - first <= 4 else 8
