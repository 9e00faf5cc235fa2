"""Carry the functions of an entry of the carry that the previous tick has computed, such as the sine of the heading.

A tick that computes f(x_{k+1}) passes the value on:

    c_{k+1} = f(x_{k+1}),    f(x_k) = c_k                                                                 (1)
"""

from baqueano.symbolic.graph.emit import OPERATOR_COSTS
from baqueano.symbolic.graph.node import Node, nodes_below
from baqueano.symbolic.graph.program import Program

MIN_CARRIED_OPERATIONS = 20.0  # of f, as for a sine: cheaper functions are not worth an entry


def with_carried_functions(program: Program) -> Program:
    """Return the program whose carry ends with the costly functions c of (1)."""
    graph = program.graph
    next_node, initial_node = (
        dict(zip(program.carry, x, strict=True)) for x in (program.next_carry, program.initial)
    )
    roots = (*program.next_carry, *program.outputs)
    order = nodes_below(roots)
    end_node: dict[Node, Node] = {}
    for f in order:
        if OPERATOR_COSTS.get(f.op, 0.0) >= MIN_CARRIED_OPERATIONS and {*f.args} <= next_node.keys():
            end_node[f] = graph.make(f.op, *(next_node[x] for x in f.args), value=f.value)
    present_nodes = {*order}
    end_node = {f: end for f, end in end_node.items() if end is not f and end in present_nodes}
    if not end_node:
        return program

    begin = [graph.make(f.op, *(initial_node[x] for x in f.args), value=f.value) for f in end_node]
    symbols = [graph.symbol("carried") for _ in end_node]
    roots = graph.substitute((*roots, *end_node.values()), dict(zip(end_node, symbols, strict=True)))
    count, m = len(program.carry), len(program.outputs)
    return program._replace(
        initial=(*program.initial, *begin),
        carry=(*program.carry, *symbols),
        next_carry=(*roots[:count], *roots[count + m :]),
        outputs=tuple(roots[count : count + m]),
    )
