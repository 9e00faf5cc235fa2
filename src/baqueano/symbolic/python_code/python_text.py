"""Convert a `Program` to the code of a Python function: kernel(theta, start, inputs) → first, rows, last carry.

Without a carry, a tick is tick(inputs) → values.
"""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from baqueano.symbolic.graph.emit import LEAF_OPERATORS, EmittedBranch, Statement, scheduled_statements
from baqueano.symbolic.graph.node import Node, nodes_below
from baqueano.symbolic.graph.program import Program
from baqueano.symbolic.ieee import LOGICAL

MAX_PARENTHESES = 20  # largest number of nested parentheses; Python's parser fails at 200
_VARIABLE = re.compile(r"\b[it]\d+\b")  # an input or a term
MIN_BRANCH_OPERATIONS = 4.0  # smallest number of operations for which a branch is faster in Python


class Formats(NamedTuple):
    """The notation of operators; an operator that is not listed is a call of the function `op_`."""

    name: str
    texts: dict[str, str]
    truths_are_numbers: bool = True  # True + True is 2, but not in NumPy


_COMMON_TEXTS = {
    "add": "({} + {})", "sub": "({} - {})", "mul": "({} * {})", "neg": "(-{})",
    "lt": "({} < {})", "le": "({} <= {})", "eq": "({} == {})", "ne": "({} != {})",
}  # fmt: skip
_CONDITION_TEXTS = {
    "and": "({} and {})", "or": "({} or {})", "not": "(not {})", "where": "({1} if {0} else {2})",
    "min": "({0} if {0} < {1} or {0} != {0} else {1})", "max": "({0} if {0} > {1} or {0} != {0} else {1})",
    "isnan": "({0} != {0})",
}  # fmt: skip
# {0} is a known number other than NaN
_BOUND_TEXTS = {"min": "({0} if {0} < {1} else {1})", "max": "({0} if {0} > {1} else {1})"}
_TRUTH_OPERATORS = ("and", "or", "not")
_REPEATED_OPERATORS = ("min", "max", "isnan")  # these operators repeat their arguments in the code
CHECKED_FORMATS = Formats("careful", _COMMON_TEXTS | _CONDITION_TEXTS)
FLOAT_FORMATS = Formats("floats", CHECKED_FORMATS.texts | {"div": "({} / {})"})
ARRAY_FORMATS = Formats("arrays", _COMMON_TEXTS, truths_are_numbers=False)


def kernel_text(
    program: Program, formats: Formats, groups: Sequence[Sequence[Node]], first: Sequence[Node] = ()
) -> str:
    """Return the code of the kernel: it computes `first` before the loop, and per tick a tuple for each of `groups`."""
    tick_nodes = [*program.next_carry, *(node for group in groups for node in group)]
    first_nodes = [*program.initial, *first]
    text = _PythonText(formats, [*tick_nodes, *first_nodes])
    head = [
        "def kernel(theta, start, rows):",
        f"    {text.leaves('p', program.theta)} = theta",
        f"    {text.leaves('s', program.start)} = start",
    ]
    carry, inputs = text.leaves("x", program.carry), text.leaves("i", program.inputs)
    moving_nodes = _moving_nodes(program, tick_nodes)
    fixed_nodes = [node for node in nodes_below([*tick_nodes, *first_nodes]) if node not in moving_nodes]
    head += text.statements(fixed_nodes, "    ", with_all_names=True)
    loop = text.statements([node for node in nodes_below(tick_nodes) if node in moving_nodes], "        ")
    row = "".join(f"{text.tuple_text(group)}, " for group in groups)
    return "\n".join([
        *head,
        f"    first = {text.tuple_text(first)}",
        f"    {carry} = {text.tuple_text(program.initial)}",
        "    out = []",
        f"    for {inputs} in rows:",
        *loop,
        *([f"        out.append(({row}))"] if groups else []),
        f"        {carry} = {text.tuple_text(program.next_carry)}",
        f"    return first, out, {carry}",
    ])  # fmt: skip


def tick_text(formats: Formats, inputs: Sequence[Node], nodes: Sequence[Node]) -> str:
    """Return the code of a tick without parameters and carry; terms of only one arm of a choice are in a branch."""
    text = _PythonText(formats, nodes)
    leaves = text.leaves("i", inputs)
    text.statements([node for node in nodes_below(nodes) if node.op == "const"], "")
    loop = scheduled_statements(
        nodes, lambda node: node.op in LEAF_OPERATORS, min_operations=MIN_BRANCH_OPERATIONS
    )
    lines = text.statements(loop, "    ")
    return "\n".join([
        "def tick(row):",
        *_with_few_names([f"    {leaves} = row", *lines, f"    return {text.tuple_text(nodes)}"]),
    ])  # fmt: skip


def _with_few_names(lines: Sequence[str]) -> list[str]:
    """Return lines without a loop, with names used again after their last use: Python is slower beyond 256 names.

    Names with many uses in few lines are first, since the first 256 are the fast ones.
    """
    uses: dict[str, list[int]] = {}
    for k, line in enumerate(lines):
        for name in _VARIABLE.findall(line):
            uses.setdefault(name, []).append(k)
    names: dict[str, str] = {}
    lines_of_names: list[int] = []  # the lines of each new name, as bits
    for name, places in sorted(uses.items(), key=lambda item: (item[1][-1] - item[1][0]) / len(item[1])):
        bits = (1 << max(places[-1], places[0] + 1)) - (1 << places[0])  # a line can use its last value again
        k = next(
            (k for k, name_lines in enumerate(lines_of_names) if not name_lines & bits), len(lines_of_names)
        )
        rest = lines_of_names[k:] or [0]
        lines_of_names[k:] = [rest[0] | bits, *rest[1:]]
        names[name] = f"v{k}"
    order = " = ".join(f"v{k}" for k in range(len(lines_of_names)))
    renamed_lines = [_VARIABLE.sub(lambda match: names[match[0]], line) for line in lines]
    return [f"    if False: {order} = 0.0"] * bool(lines_of_names) + renamed_lines


def _moving_nodes(program: Program, roots: Sequence[Node]) -> set[Node]:
    """Return the nodes that change from tick to tick."""
    terms = {*program.carry, *program.inputs}
    for node in nodes_below(roots):
        if any(a in terms for a in node.args):
            terms.add(node)
    return terms


def _truths(node: Node) -> int:
    """Return the number of arguments of a node that are conditions; they are the first arguments."""
    return len(node.args) if node.op in _TRUTH_OPERATORS else 1 if node.op == "where" else 0


class _PythonText:
    """The text of statements that compute nodes; each node is a variable or an expression."""

    def __init__(self, formats: Formats, roots: Sequence[Node]) -> None:
        self.formats = formats
        self.names: dict[Node, str] = {}
        self.depth: dict[Node, int] = {}
        self.uses = dict.fromkeys(nodes_below(roots), 0)
        for node in roots:
            self.uses[node] += 1
        self.numbers: set[Node] = set()  # truth values that are used as numbers; float × bool is slow
        for node in self.uses:
            truths = _truths(node)
            for k, a in enumerate(node.args):
                self.uses[a] += 2 if node.op in _REPEATED_OPERATORS else 1
                if k >= truths and a.op in LOGICAL:
                    self.numbers.add(a)

    def leaves(self, letter: str, nodes: Sequence[Node]) -> str:
        """Define names for symbols and return them as a tuple to assign to."""
        names = [f"{letter}{k}" for k in range(len(nodes))]
        self.names |= zip(nodes, names, strict=True)
        return f"({', '.join(names)},)" if names else "()"

    def statements(self, nodes: Iterable[Statement], indent: str, with_all_names: bool = False) -> list[str]:
        """Return the statements of the nodes, in order; a node that is used once is written into its user."""
        lines = []
        for node in nodes:
            if isinstance(node, EmittedBranch):
                lines += self.branch(node, indent)
                continue
            if node.op == "symbol":
                continue
            text = self.expression(node)
            depth = 1 + max((self.depth.get(a, 0) for a in node.args), default=0)
            if node in self.numbers and self.formats.truths_are_numbers:
                text, depth = f"(1.0 if {text} else 0.0)", depth + 1
            if node.op != "const" and (with_all_names or self.uses[node] > 1 or depth > MAX_PARENTHESES):
                lines.append(f"{indent}t{node.index} = {text}")
                text, depth = f"t{node.index}", 0
            self.names[node], self.depth[node] = text, depth
        return lines

    def branch(self, branch: EmittedBranch, indent: str) -> list[str]:
        """Return the code of an if and an else that assign the values of the choices."""
        lines, inner_indent = [], indent + "    "
        for k, (head, arm) in enumerate(
            ((f"if {self.names[branch.condition]}:", branch.if_true), ("else:", branch.if_false))
        ):
            lines += [indent + head, *self.statements(arm, inner_indent)]
            lines += [f"{inner_indent}t{c.index} = {self.number_text(c.args[k + 1])}" for c in branch.choices]
        for choice in branch.choices:
            self.names[choice], self.depth[choice] = f"t{choice.index}", 0
        return lines

    def expression(self, node: Node) -> str:
        """Return the expression that computes one node."""
        if node.op == "const":
            return repr(node.value)
        truths = _truths(node)
        args = [self.names[a] if k < truths else self.number_text(a) for k, a in enumerate(node.args)]
        is_number = node.args[0].op == "const" and node.args[0].value == node.args[0].value
        if is_number and node.op in _BOUND_TEXTS and node.op in self.formats.texts:
            return _BOUND_TEXTS[node.op].format(*args)
        if node.op in self.formats.texts:
            return self.formats.texts[node.op].format(*args)
        table = [] if node.value is None else [f"table{node.value}"]
        return f"{node.op}_({', '.join(args + table)})"

    def number_text(self, node: Node) -> str:
        """Return the code of a node as a number; a truth value is converted to 0.0 or 1.0."""
        is_truth = node.op in LOGICAL and not self.formats.truths_are_numbers
        return f"(1.0 * {self.names[node]})" if is_truth else self.names[node]

    def tuple_text(self, nodes: Sequence[Node]) -> str:
        """Return the code of a tuple of values."""
        return "(" + "".join(f"{self.number_text(node)}, " for node in nodes) + ")"
