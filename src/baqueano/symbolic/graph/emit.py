"""Order the arithmetic: choose the place of each operation in the code of a kernel.

The code is a list of statements, made depth first from each root. So a value is computed shortly before its first use,
and needs a register only for a short time. Terms that depend neither on the carry nor on the inputs are computed before
the loop. Work that only one arm of `where` needs is moved into a branch. The work must be larger than the cost of a
branch, which the processor sometimes mispredicts. A *term* has `op` and `args`: a scalar `Node`, or a `TangentRow`.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from typing import NamedTuple, TypeAlias

from baqueano.contracts.values import Value
from baqueano.symbolic.graph.node import Node
from baqueano.symbolic.graph.program import Program

Term: TypeAlias = Value  # Node | Row: hashable by identity, with .op and .args

# smallest number of operations of both arms for which a branch replaces a select
MIN_BRANCH_OPERATIONS = 40.0
MAX_BRANCH_DEPTH = 6  # largest number of nested branches
CHOICE_OPERATORS = ("where", "choose")  # args (condition, a, b)
LEAF_OPERATORS = ("const", "symbol", "unit", "drift")
OPERATOR_COSTS = {
    "neg": 0.0,
    "div": 4.0,
    "sqrt": 5.0,
    "hypot": 8.0,
    "pow": 40.0,
    "interp": 20.0,
    "interp_slope": 20.0,
}
OPERATOR_COSTS |= dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "atan2"), 20.0)
OPERATOR_COSTS |= dict.fromkeys(("exp", "log", "sinh", "cosh", "tanh"), 20.0)


class EmittedBranch(NamedTuple):
    """A branch: if (condition) then … else …; afterwards each choice has the value of its arm."""

    condition: Term
    choices: tuple[Term, ...]
    if_true: list["Statement"]
    if_false: list["Statement"]


Statement: TypeAlias = Term | EmittedBranch


class EmitPlan(NamedTuple):
    """The statements before the loop over the ticks, and the statements inside the loop."""

    statements_before: list[Statement]
    loop_statements: list[Statement]


def plan_statements(
    initial: Iterable[Term], roots: Iterable[Term], changing_terms: Container[Term], *, branches: bool = True
) -> EmitPlan:
    """Return the statements for `initial` before the loop, and for `roots` at every tick.

    The leaves `changing_terms` vary from tick to tick; terms of `roots` that do not depend on them are before the loop.
    """
    roots = list(roots)
    moving_terms = _moving_terms(postorder(roots), changing_terms)
    loop = scheduled_statements(
        roots, lambda term: term not in moving_terms or term.op in LEAF_OPERATORS, branches
    )
    fixed_terms = [term for term in (*arguments(loop), *roots) if term not in moving_terms]
    return EmitPlan(
        scheduled_statements(
            [*initial, *fixed_terms], lambda term: term.op in LEAF_OPERATORS, branches=False
        ),
        loop,
    )


def with_reciprocals(program: Program, uses: int, divisors: Container[Node] = ()) -> Program:
    """Replace x / p by x · (1/p) if p does not change from tick to tick, is a divisor `uses` times, or in `divisors`.

    A quotient inside a step function is not replaced: ⌊49 / 49⌋ is 1, but ⌊49 · (1/49)⌋ is 0.
    """
    graph = program.graph
    groups = (program.next_carry, program.outputs)
    roots = [root for group in groups for root in group]
    order: list[Node] = postorder(roots)
    moving_nodes = _moving_terms(order, {*program.carry, *program.inputs})
    step_divisors = _step_divisors(order)
    divisor_counts = Counter(node.args[1] for node in order if node.op == "div" and not _is_reciprocal(node))
    new_nodes: dict[Node, Node] = {}
    frequent = {
        p for p, count in divisor_counts.items() if count >= uses or p not in moving_nodes or p in divisors
    }
    for node in order:
        is_quotient = node.op == "div" and node in moving_nodes and not _is_reciprocal(node)
        is_replaced = is_quotient and node not in step_divisors and node.args[1] in frequent
        if not is_replaced and new_nodes.keys().isdisjoint(node.args):
            continue
        args = [new_nodes.get(a, a) for a in node.args]
        if is_replaced:
            new = graph.make("mul", args[0], graph.make("div", graph.const(1.0), args[1]))
        else:
            new = graph.make(node.op, *args, value=node.value)
        if new is not node:
            new_nodes[node] = new
    next_carry, outputs = (tuple(new_nodes.get(root, root) for root in group) for group in groups)
    return program._replace(next_carry=next_carry, outputs=outputs)


def _step_divisors(order: Sequence[Node]) -> set[Node]:
    """Return the nodes on which floor and comparisons depend, through sums and choices: rounding changes the result."""
    nodes: set[Node] = set()
    for node in reversed(order):
        is_pass_through = node in nodes and node.op in ("add", "sub", "neg", "min", "max", "where")
        if is_pass_through or node.op in ("floor", "lt", "le", "eq", "ne"):
            nodes.update(node.args)
    return nodes


def _is_reciprocal(node: Node) -> bool:
    return node.op == "div" and node.args[0].op == "const" and node.args[0].value == 1.0


def scheduled_statements(
    roots: Iterable[Term],
    is_given: Callable[[Term], bool],
    branches: bool = True,
    min_operations: float = MIN_BRANCH_OPERATIONS,
) -> list[Statement]:
    """Return statements that compute the roots from the given nodes: each term once, after its arguments.

    A branch is made only for at least `min_operations` operations.
    """
    roots = list(roots)
    if not branches:
        return postorder(roots, is_given)
    search = _Branches(roots, is_given, min_operations)
    while True:
        try:
            return _Scheduler(is_given, search.select()).emit(roots)
        except _CyclicBranch as circle:
            search.refused.add(circle.key)


def operation_cost(statements: Iterable[Statement]) -> float:
    """Return the weighted number of operations of the statements, with both arms of each branch."""
    return sum(_cost(s) for s in flat_statements(statements))


def flat_statements(statements: Iterable[Statement]) -> Iterator[Term]:
    """Return the terms of all statements, with both arms of each branch."""
    for s in statements:
        if isinstance(s, EmittedBranch):
            yield from flat_statements((*s.if_true, *s.if_false))
        else:
            yield s


def postorder(roots: Iterable[Term], is_given: Callable[[Term], bool] | None = None) -> list[Term]:
    """Return all terms below the roots, arguments before users; given terms and all terms below these are excluded."""
    members: set[Term] = set()  # terms in the order, and given terms
    order: list[Term] = []
    for root in roots:
        stack = [] if root in members or (is_given and is_given(root)) else [root]
        while stack:
            term = stack[-1]
            open_statements = []
            for a in term.args:
                if a not in members:
                    if is_given and is_given(a):
                        members.add(a)
                    else:
                        open_statements.append(a)
            if open_statements:
                open_statements.reverse()
                stack += open_statements
                continue
            stack.pop()
            if term not in members:
                members.add(term)
                order.append(term)
    return order


def _moving_terms(order: Iterable[Term], changing_terms: Container[Term]) -> set[Term]:
    """Return the terms of a postorder that depend on `changing_terms`."""
    terms: set[Term] = set()
    for term in order:
        if term in changing_terms or not terms.isdisjoint(term.args):
            terms.add(term)
    return terms


def arguments(statements: Iterable[Statement]) -> Iterator[Term]:
    """Return the nodes that the statements read."""
    for s in statements:
        if isinstance(s, EmittedBranch):
            yield s.condition
            yield from (a for choice in s.choices for a in choice.args)
            yield from arguments(s.if_true)
            yield from arguments(s.if_false)
        else:
            yield from s.args


def _cost(term: Term) -> float:
    if term.op == "row":
        return len(term.args) / 2
    return 0.0 if term.op in LEAF_OPERATORS else OPERATOR_COSTS.get(term.op, 1.0)


class _BranchKey(NamedTuple):
    """The key of the `where` nodes that share one branch. Nodes of the same `level` do not depend on each other."""

    place: int  # number of the region that contains the branch
    condition: Term
    level: int


@dataclass(eq=False, slots=True)
class _Region:
    """The place of a statement: the loop, or an arm of a branch inside another region."""

    region_number: int = 0
    parent: "_Region | None" = None
    depth: int = 0
    terms: list[Term] = field(default_factory=list)  # including the terms of the inner regions

    def common_region(self, other: "_Region") -> "_Region":
        """Return the innermost region that contains this region and the other."""
        a, b = self, other
        while a is not b:
            a, b = (b, a) if a.depth < b.depth else (a, b)
            a = a.parent or a
        return a


@dataclass(eq=False, slots=True)
class _BranchGroup:
    """A planned branch: its choices, and the terms that only one of its arms needs."""

    key: _BranchKey
    arms: tuple[_Region, _Region]
    choices: list[Term] = field(default_factory=list)
    needed_terms: list[Term] = field(default_factory=list)  # terms to compute before the branch

    def cost(self) -> float:
        return operation_cost(self.arms[0].terms) + operation_cost(self.arms[1].terms)


class _CyclicBranch(Exception):
    """The error of a branch whose start depends on its own result."""

    def __init__(self, key: _BranchKey) -> None:
        self.key = key


class _Branches:
    """The choice of the branches of one schedule."""

    def __init__(
        self, roots: Sequence[Term], is_given: Callable[[Term], bool], min_operations: float
    ) -> None:
        self.roots, self.order, self.min_cost = roots, postorder(roots, is_given), min_operations
        self.numbers: dict[tuple[_BranchKey, int], int] = {}  # numbers of the two arms of each branch
        self.refused: set[_BranchKey] = set()
        self.refused_branches: set[tuple[Term, int]] = set()  # condition, level
        self.levels: dict[Term, int] = {}

    def select(self) -> dict[Term, _BranchGroup]:
        """Return the group of each choice in a branch; groups of fewer than `min_operations` are removed."""
        while True:
            groups = self.groups()
            group_by_key = {group.key: group for group in groups.values()}  # several choices share a group
            costs = {key: group.cost() for key, group in group_by_key.items()}
            total_cost: defaultdict[tuple[Term, int], float] = defaultdict(float)
            for key, operations in costs.items():
                total_cost[key.condition, key.level] += operations
            small_keys = {key for key, operations in costs.items() if operations < self.min_cost}
            self.refused |= small_keys
            self.refused_branches |= {pair for pair, total in total_cost.items() if total < self.min_cost}
            if not small_keys:
                levels = _levels(self.order, {key.condition for key in costs})
                if levels == self.levels:
                    return groups
                self.levels = levels

    def groups(self) -> dict[Term, _BranchGroup]:
        """Return the group of each choice, with each term in the innermost region that contains all its uses."""
        loop = _Region()
        term_regions: dict[Term, _Region] = dict.fromkeys(self.roots, loop)
        groups: dict[_BranchKey, _BranchGroup] = {}
        term_group: dict[Term, _BranchGroup] = {}
        for term in reversed(self.order):
            own_region = term_regions[term]
            regions: Iterable[_Region] = repeat(own_region)
            key = self.key(term, own_region) if term.op in CHOICE_OPERATORS else None
            if key is not None:
                if key not in groups:
                    groups[key] = _BranchGroup(
                        key, (self.arm(key, 0, own_region), self.arm(key, 1, own_region))
                    )
                group = term_group[term] = groups[key]
                group.choices.insert(0, term)
                regions = [own_region, *group.arms]
            for a, region in zip(term.args, regions, strict=False):
                first_region = term_regions.setdefault(a, region)
                if first_region is not region:
                    term_regions[a] = first_region.common_region(region)
        _assign_regions(self.order, term_regions, list(groups.values()))
        return term_group

    def key(self, term: Term, region: _Region) -> _BranchKey | None:
        if region.depth == MAX_BRANCH_DEPTH:
            return None
        key = _BranchKey(region.region_number, term.args[0], self.levels.get(term, 0))
        return None if key in self.refused or (key.condition, key.level) in self.refused_branches else key

    def arm(self, key: _BranchKey, arm: int, outer_region: _Region) -> _Region:
        """Return the region of an arm; a region has the same number in each round."""
        return _Region(
            self.numbers.setdefault((key, arm), len(self.numbers) + 1), outer_region, outer_region.depth + 1
        )


def _assign_regions(order: list[Term], term_regions: dict[Term, _Region], groups: list[_BranchGroup]) -> None:
    """Set the terms of each arm, and the terms outside each branch that the branch needs."""
    for term in order:
        region = term_regions[term]
        while region.parent is not None:
            region.terms.append(term)
            region = region.parent
    for group in groups:
        inner_terms = {*group.arms[0].terms, *group.arms[1].terms}
        used_terms = [a for arm in group.arms for term in arm.terms for a in term.args]
        used_terms += [a for term in group.choices for a in term.args]
        group.needed_terms = [a for a in dict.fromkeys(used_terms) if a not in inner_terms]


def _levels(order: list[Term], conditions: set[Term]) -> dict[Term, int]:
    """Return the number of nested choices of the same condition below each choice."""
    places: dict[Term, list[int]] = {condition: [] for condition in conditions}
    for place, term in enumerate(order):
        if term.op in CHOICE_OPERATORS and term.args[0] in places:
            places[term.args[0]].append(place)
    levels: dict[Term, int] = {}
    for condition, choices in places.items():
        # only the levels that are not 0, from the first choice to the last
        lower_levels: dict[Term, int] = {}
        for term in order[choices[0] : choices[-1] + 1] if choices else ():
            level = 0
            for a in term.args:
                if a in lower_levels and lower_levels[a] > level:
                    level = lower_levels[a]
            if term.op in CHOICE_OPERATORS and term.args[0] is condition:
                levels[term] = level
                level += 1
            if level:
                lower_levels[term] = level
    return levels


class _Scheduler:
    def __init__(self, is_given: Callable[[Term], bool], plan: dict[Term, _BranchGroup]) -> None:
        self.is_given, self.plan = is_given, plan
        self.done: set[Term] = set()

    def emit(self, roots: Iterable[Term]) -> list[Statement]:
        statements: list[Statement] = []
        open_groups: set[_BranchGroup] = set()
        for root in roots:
            stack = [root]
            while stack:
                term = stack[-1]
                if term in self.done or self.is_given(term):
                    stack.pop()
                    continue
                group = self.plan.get(term)
                arguments = term.args if group is None else group.needed_terms
                open_statements = [a for a in arguments if a not in self.done and not self.is_given(a)]
                if not open_statements:
                    statements.append(term if group is None else self.branch(group))
                    self.done.add(term)
                elif group in open_groups:
                    raise _CyclicBranch(group.key)
                else:
                    stack += reversed(open_statements)
                    open_groups |= {group} if group else set()
        return statements

    def branch(self, group: _BranchGroup) -> EmittedBranch:
        if_true, if_false = (self.emit([t.args[i] for t in group.choices]) for i in (1, 2))
        self.done.update(group.choices)
        return EmittedBranch(group.key.condition, tuple(group.choices), if_true, if_false)
