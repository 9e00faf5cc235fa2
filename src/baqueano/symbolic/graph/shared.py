"""Split the step of a batch: terms that are equal for all members are computed once per tick, not once per member.

    s_{k+1}, w_k = shared(s_k, v_k),          x_{k+1}, y_k = member(θ, x_k, u_k, v_k, w_k)                (1)

The inputs v are the same for all members, such as the time; the inputs u differ. The part s of the carry depends only
on v and on start values that are the same for all. The rest of the step reads w, such as the reference at this time.
"""

from collections.abc import Iterable, Set
from typing import NamedTuple

from baqueano.symbolic.graph.emit import operation_cost, postorder, with_reciprocals
from baqueano.symbolic.graph.node import Node, nodes_below
from baqueano.symbolic.graph.program import Program

MIN_SHARED_OPERATIONS = 20.0  # fewer operations than of one table are not worth a kernel


class SharedSplit(NamedTuple):
    """The two programs of (1)."""

    per_tick: Program  # its outputs are w
    per_member: Program  # its inputs end with w


def split_shared(program: Program, leaves: Set[Node]) -> SharedSplit | None:
    """Return the programs of (1), where `leaves` are the shared inputs and start values; None for a short w."""
    entries = _shared_carry(program, leaves)
    leaves = leaves | entries
    roots = (*program.next_carry, *program.outputs)
    program = with_reciprocals(program, 2, divisors=_terms_above(leaves, roots))
    roots = (*program.next_carry, *program.outputs)
    terms = _terms_above(leaves, roots)
    carry = [k for k, x in enumerate(program.carry) if x in entries]
    members = [k for k, x in enumerate(program.carry) if x not in entries]
    roots = (*(program.next_carry[k] for k in members), *program.outputs)
    read = [a for node in nodes_below(roots) if node not in terms for a in node.args]
    w = [a for a in dict.fromkeys((*read, *roots)) if a in terms and (a.args or a in entries)]
    if operation_cost(postorder(w, lambda term: not term.args)) < MIN_SHARED_OPERATIONS:
        return None

    graph, symbols = program.graph, [program.graph.symbol("shared") for _ in w]
    graph.truths.update(x for x, term in zip(symbols, w, strict=True) if term.is_truth)
    roots = graph.substitute(roots, dict(zip(w, symbols, strict=True)))

    def with_carry(indices: list[int], next_carry: Iterable[Node]) -> Program:
        initial, symbols = (tuple(x[k] for k in indices) for x in (program.initial, program.carry))
        return program._replace(initial=initial, carry=symbols, next_carry=tuple(next_carry))

    per_tick = with_carry(carry, (program.next_carry[k] for k in carry))
    per_member = with_carry(members, roots[: len(members)])
    return SharedSplit(
        per_tick._replace(theta=(), inputs=tuple(x for x in program.inputs if x in leaves), outputs=tuple(w)),
        per_member._replace(inputs=(*program.inputs, *symbols), outputs=tuple(roots[len(members) :])),
    )


def _shared_carry(program: Program, leaves: Set[Node]) -> set[Node]:
    """Return the entries of the carry that are equal for all members by induction."""
    initial = _terms_above(leaves, program.initial)
    carry = {x for x, begin in zip(program.carry, program.initial, strict=True) if begin in initial}
    while True:
        terms = _terms_above(leaves | carry, program.next_carry)
        pairs = zip(program.carry, program.next_carry, strict=True)
        remaining = {x for x, end in pairs if x in carry and end in terms}
        if remaining == carry:
            return carry
        carry = remaining


def _terms_above(leaves: Set[Node], roots: Iterable[Node]) -> set[Node]:
    """Return the nodes below the roots that depend on no other symbols than `leaves`."""
    terms: set[Node] = set()
    for node in nodes_below(roots):
        if node in leaves or (node.op != "symbol" and all(a in terms for a in node.args)):
            terms.add(node)
    return terms
