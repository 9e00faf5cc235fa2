"""Add to the carry of a program the sums of its outputs over the ticks, and their derivatives with respect to θ.

    S⁺ = S + y,    ∂S⁺ = ∂S + ∂y,    ∂x⁺ = ∂f/∂x ∂x + ∂f/∂θ                                              (1)

All these values are scalars of the graph, so the back ends run the program in batches, like any other step. As in
tangents.py, the arms of `where` are combined by a choice.
"""

from collections.abc import Iterable

from baqueano.symbolic.derivatives.derive import partials
from baqueano.symbolic.derivatives.tangents import active_nodes
from baqueano.symbolic.graph.node import Graph, Node, nodes_below
from baqueano.symbolic.graph.program import Program


def with_sums(program: Program, derivative_count: int) -> Program:
    """Return the program without outputs; its carry ends with m sums and their m · `derivative_count` derivatives."""
    graph, zero = program.graph, program.graph.const(0.0)
    carry, initial, next_carry = list(program.carry), list(program.initial), list(program.next_carry)
    sum_rows = [list(program.outputs)]
    for theta in program.theta[:derivative_count]:
        moving_nodes = active_nodes(program, [theta])
        drifts = {x: graph.symbol("drift") for x in program.carry if x in moving_nodes}
        at_start = _derivatives(graph, program.initial, {theta: graph.const(1.0)})
        rows = _derivatives(
            graph, (*program.outputs, *program.next_carry), {theta: graph.const(1.0)} | dict(drifts)
        )
        for x, begin, end in zip(program.carry, program.initial, program.next_carry, strict=True):
            if x in drifts:
                carry.append(drifts[x])
                initial.append(at_start.get(begin, zero))
                next_carry.append(rows.get(end, zero))
        sum_rows.append([rows.get(y, zero) for y in program.outputs])
    for term in (term for terms in sum_rows for term in terms):
        total = graph.symbol("sum")
        carry.append(total)
        initial.append(zero)
        next_carry.append(graph.make("add", total, term))
    full_program = program._replace(
        initial=tuple(initial), carry=tuple(carry), next_carry=tuple(next_carry), outputs=()
    )
    return full_program._replace(is_quick=derivative_count > 0)


def _derivatives(graph: Graph, roots: Iterable[Node], seeds: dict[Node, Node]) -> dict[Node, Node]:
    """Return the derivatives of all nodes below the roots, from the derivatives of the `seeds`; zeros are omitted."""
    rows, zero = dict(seeds), graph.const(0.0)
    for node in nodes_below(roots):
        if node in seeds or not any(a in rows for a in node.args):
            continue
        if node.op == "where":
            condition, a, b = node.args
            if a in rows or b in rows:
                rows[node] = graph.make("where", condition, rows.get(a, zero), rows.get(b, zero))
            continue
        terms = [graph.make("mul", derivative, rows[a]) for a, derivative in partials(node) if a in rows]
        for term in terms:
            rows[node] = graph.make("add", rows[node], term) if node in rows else term
    return rows
