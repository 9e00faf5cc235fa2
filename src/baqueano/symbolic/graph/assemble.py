"""Convert a trace to the program that runs, without the mirrored, constant and dead entries of the carry.

*Mirrored*: the other side of a symmetric matrix. *Constant*: an entry that a step returns unchanged, or that is 0 at
the start and stays 0 by induction. *Dead*: an entry on which no requested result depends. The removed entries are
restored after the run.
"""

from collections.abc import Container, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.symbolic.graph.node import Graph, Node, nodes_below
from baqueano.symbolic.graph.program import Program
from baqueano.symbolic.graph.trace import Trace


class Assembly(NamedTuple):
    """A program, and the indices that restore the whole carry from the carry of the program."""

    program: Program
    first: np.ndarray  # (s,) index of each start value in the whole carry
    carry_indices: np.ndarray  # index of each entry of the whole carry in (final carry, start values)
    mirrored_entries: np.ndarray  # index of each mirrored entry of the whole carry
    mirror: np.ndarray  # index of the entry that it must equal at the start
    zeros: np.ndarray  # index of each entry of the whole carry that must be 0 at the start
    unused_carry: tuple[int, ...]  # indices in the whole carry

    def whole_carry(self, final: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return the whole carry (…, c) after a run, from the final carry (…, k) and the start values (…, s)."""
        return np.concatenate([final, start], axis=-1)[..., self.carry_indices]


def assemble(trace: Trace, keep_all: bool, given_start: bool, zero_entries: Container[int] = ()) -> Assembly:
    """Return the program of a trace.

    With `keep_all` the final carry is computed as well as the outputs. With `given_start` the start values are given at
    run time, even if the trace contains them as functions of θ; those of `zero_entries` are 0.
    """
    graph, has_start = trace.graph, given_start or trace.initial is None
    entries = _distinct_entries(trace, has_start)
    symbols = [*entries.place]
    constant = {
        x: entries.begin[x] for x in symbols if entries.next_node[x] is x and (has_start or not keep_all)
    }
    zeros: set[int] = set()  # indices of `symbols`
    if has_start or not keep_all:
        zeros = {
            k for k, x in enumerate(symbols)
            if (entries.place[x] in zero_entries if has_start else _is_zero(entries.begin[x]))
        }  # fmt: skip
        zeros = remaining_zeros(graph, symbols, list(entries.next_node.values()), zeros)
    constant |= {symbols[k]: graph.const(0.0) for k in zeros}
    roots = graph.substitute([*trace.outputs, *entries.next_node.values()], constant)
    outputs = roots[: len(trace.outputs)]
    next_values = dict(zip(symbols, roots[len(trace.outputs) :], strict=True))
    moving_entries = {x for x in symbols if x not in constant}
    used_entries = moving_entries if keep_all else _used_entries(outputs, next_values, moving_entries)
    carry = [x for x in symbols if x in used_entries]
    program = Program(
        graph, tuple(trace.theta), entries.start, tuple(entries.begin[x] for x in carry), tuple(carry),
        tuple(trace.inputs), tuple(next_values[x] for x in carry), tuple(outputs),
    )  # fmt: skip
    kept_index = {x: k for k, x in enumerate(carry)}
    kept_index |= {x: len(carry) + k for k, x in enumerate(symbols) if x in constant}
    used_nodes = set(nodes_below([*trace.outputs, *(entries.next_node[x] for x in carry)]))
    is_used = {x: x in used_entries or (x in constant and x in used_nodes) for x in symbols}
    mirrored_places = [k for k, x in enumerate(trace.carry) if entries.place[x] != k]
    return Assembly(
        program,
        np.array([*entries.place.values()] if has_start else [], dtype=int),
        np.array([kept_index.get(x, 0) for x in trace.carry], dtype=int),
        np.array(mirrored_places, dtype=int),
        np.array([entries.place[trace.carry[k]] for k in mirrored_places], dtype=int),
        np.array([entries.place[symbols[k]] for k in sorted(zeros)] if has_start else [], dtype=int),
        tuple(k for k, x in enumerate(trace.carry) if not is_used[x]),
    )


class _DistinctEntries(NamedTuple):
    """The entries of the carry, each once: a symmetric matrix has the same entry at two places."""

    place: dict[Node, int]  # the first place of each entry in the carry
    next_node: dict[Node, Node]  # the value after a tick
    begin: dict[Node, Node]  # the value before the first tick
    start: tuple[Node, ...]  # the symbols of `begin`, if they are given at run time


def _distinct_entries(trace: Trace, has_start: bool) -> _DistinctEntries:
    place: dict[Node, int] = {}
    for k, x in enumerate(trace.carry):
        place.setdefault(x, k)
    next_node = {x: trace.next_carry[k] for x, k in place.items()}
    start = tuple(trace.graph.symbol(f"start {x.value}") for x in place) if has_start else ()
    begin = start or [(trace.initial or [])[k] for k in place.values()]
    return _DistinctEntries(place, next_node, dict(zip(place, begin, strict=True)), start)


def remaining_zeros(
    graph: Graph, carry: Sequence[Node], next_carry: Sequence[Node], zero: set[int]
) -> set[int]:
    """Return the indices of `zero` that stay 0 by induction: if these entries are 0, the step returns 0 for them."""
    zero_node = graph.const(0.0)
    while zero:
        order = sorted(zero)
        nodes = graph.substitute([next_carry[k] for k in order], {carry[k]: zero_node for k in order})
        zero_places = {k for k, node in zip(order, nodes, strict=True) if _is_zero(node)}
        if zero_places == zero:
            break
        zero = zero_places
    return zero


def _is_zero(node: Node) -> bool:
    return node.op == "const" and node.value == 0.0


def _used_entries(outputs: Sequence[Node], next_node: dict[Node, Node], carry: set[Node]) -> set[Node]:
    """Return the entries of the carry that the outputs of this or a later tick depend on."""
    used_nodes: set[Node] = set()
    new_entries = {node for node in nodes_below(outputs) if node in carry}
    while new_entries:
        used_nodes |= new_entries
        new_entries = {
            node for node in nodes_below([next_node[x] for x in new_entries]) if node in carry
        } - used_nodes
    return used_nodes
