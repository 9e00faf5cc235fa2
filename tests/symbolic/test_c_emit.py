"""The schedule of computations: each term once, before its use; outside the loop, or in a branch if it is faster."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.symbolic.c_code import compile
from baqueano.symbolic.c_code.c import make_kernel
from baqueano.symbolic.derivatives.tangents import tangents
from baqueano.symbolic.graph.emit import (
    LEAF_OPERATORS,
    EmittedBranch,
    arguments,
    operation_cost,
    plan_statements,
    scheduled_statements,
    with_reciprocals,
)
from baqueano.symbolic.graph.node import Graph, Node
from baqueano.symbolic.graph.program import Program

from .random_programs import random_program

needs_compiler = pytest.mark.skipif(compile.find_compiler().compiler is None, reason="no C compiler")


def is_leaf(term) -> bool:
    return term.op in LEAF_OPERATORS


def check(statements, symbols_before: set, roots=()) -> set:
    """Check that every argument is computed before its use and no term is computed twice; return the computed terms."""
    symbols_before = set(symbols_before)
    for s in statements:
        if isinstance(s, EmittedBranch):
            assert is_leaf(s.condition) or s.condition in symbols_before
            for arm, body in ((1, s.if_true), (2, s.if_false)):
                values = check(body, symbols_before)
                assert all(is_leaf(c.args[arm]) or c.args[arm] in values for c in s.choices)
            assert not symbols_before.intersection(s.choices)
            symbols_before.update(s.choices)
        else:
            assert s not in symbols_before
            assert all(is_leaf(a) or a in symbols_before for a in s.args)
            symbols_before.add(s)
    assert all(is_leaf(root) or root in symbols_before for root in roots)
    return symbols_before


def branches(statements) -> list[EmittedBranch]:
    branch_list = []
    for s in statements:
        if isinstance(s, EmittedBranch):
            branch_list += [s, *branches(s.if_true), *branches(s.if_false)]
    return branch_list


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), operations=st.integers(1, 400))
def test_every_schedule_computes_terms_before_their_use(seed, operations):
    program = random_program(seed, operations=operations, m=8)
    roots = (*program.outputs, *program.next_carry)
    check(scheduled_statements(roots, is_leaf), set(), roots)
    order = plan_statements(program.initial, roots, {*program.carry, *program.inputs})
    check(order.loop_statements, check(order.statements_before, set(), program.initial), roots)


class Text:
    """Short names for the nodes of one graph."""

    def __init__(self) -> None:
        self.graph = Graph()
        self.x, self.y, self.flag, self.theta = map(self.graph.symbol, ("x", "y", "flag", "theta"))

    def make(self, op: str, *args) -> Node:
        return self.graph.make(op, *(a if isinstance(a, Node) else self.graph.const(a) for a in args))

    def long(self, node: Node, times: int = 30) -> Node:
        for k in range(times):
            node = self.make("add", self.make("mul", node, node), 1.5 + k)
        return node


def test_a_number_times_its_sign_is_simplified_to_its_magnitude():
    t = Text()
    sign, size = t.make("sign", t.x), t.make("abs", t.x)
    assert t.make("mul", t.x, sign) is t.make("mul", sign, t.x) is size
    assert t.make("mul", t.x, t.make("mul", t.theta, sign)) is t.make("mul", t.theta, size)
    assert t.make("mul", t.y, sign).op == "mul"


def test_a_shared_intermediate_value_is_differentiated_only_once():
    """For 15 parameters in two blocks: six terms and three products instead of five terms."""
    t = Text()
    theta, speed = tuple(t.graph.symbol(f"p{k}") for k in range(15)), t.graph.symbol("speed")
    stage = t.make("add", t.x, t.make("mul", t.y, speed))
    users = tuple(t.make(op, stage) for op in ("sin", "cos", "tanh"))
    program = Program(t.graph, theta, (), theta[:2], (t.x, speed), (t.y,), users[:2], users)
    tangent = tangents(program, 0, 8, eliminate=True)
    assert [len(row.args) // 2 for row in tangent.outputs] == [1, 1, 1]


def test_terms_used_in_one_branch_are_computed_only_in_this_branch():
    t = Text()
    product = t.make("mul", t.x, t.y)
    next_count = t.long(product)
    outputs = [
        t.make("where", t.flag, t.make("add", next_count, k), t.make("sub", product, k)) for k in (1.0, 2.0)
    ]
    statements = scheduled_statements(outputs, is_leaf)
    check(statements, set(), outputs)
    (branch,) = branches(statements)
    assert branch.condition is t.flag
    assert set(branch.choices) == set(outputs)
    assert any(s is next_count for s in branch.if_true)
    assert any(s is product for s in statements)


def test_terms_needed_outside_a_branch_are_computed_before_the_branch():
    t = Text()
    common = t.long(t.x)
    output = t.make("where", t.flag, t.long(common), t.long(t.make("mul", common, t.y)))
    statements = scheduled_statements([output, common], is_leaf)
    assert any(s is common for s in statements)
    assert len(branches(statements)) == 1


def test_a_conditional_with_few_operations_is_not_a_branch():
    t = Text()
    output = t.make("where", t.flag, t.make("mul", t.x, 2.0), t.y)
    assert not branches(scheduled_statements([output], is_leaf))


def test_dependent_conditionals_become_consecutive_branches():
    t = Text()
    first = t.make("where", t.flag, t.long(t.x), t.x)
    term = t.make("sin", first)
    second = t.make("where", t.flag, t.long(term), term)
    statements = scheduled_statements([second, term], is_leaf)
    check(statements, set(), [second, term])
    assert len(branches(statements)) == 2


def test_two_mutually_dependent_branches_are_separated():
    t = Text()
    condition = t.make("lt", t.x, t.y)
    a = t.make("where", t.flag, t.long(t.x), t.x)
    b = t.make("where", condition, t.long(t.y), t.y)
    c = t.make("where", condition, t.long(t.make("cos", a)), a)  # in one branch with b, if it did not need a
    d = t.make("where", t.flag, t.long(t.make("cos", b)), b)  # in one branch with a, if it did not need b
    statements = scheduled_statements([c, d], is_leaf)
    check(statements, set(), [c, d])


def test_a_nested_branch_is_emitted_inside_the_outer_branch():
    t = Text()
    gate = t.make("lt", t.x, t.y)
    inner = t.make("where", gate, t.long(t.x), t.long(t.y))
    outer = t.make("where", t.flag, t.make("sin", inner), t.x)
    statements = scheduled_statements([outer], is_leaf)
    check(statements, set(), [outer])
    assert [b.condition for b in branches(statements)] == [t.flag, gate]


@pytest.mark.parametrize("depth", [3, 300])
def test_deep_nesting_and_long_chains_need_no_recursion(depth):
    t = Text()
    nest = chain = t.x
    for k in range(depth):
        nest = t.make("where", t.make("lt", t.x, float(k)), t.make("sin", nest), t.y)
        chain = t.long(chain, 5)
    check(scheduled_statements([nest, chain], is_leaf), set(), [nest, chain])


def test_terms_that_depend_only_on_parameters_are_computed_before_the_loop():
    t = Text()
    exponential = t.make("exp", t.theta)
    output = t.make("mul", exponential, t.x)
    order = plan_statements([], [output, exponential], {t.x, t.y})
    assert order.statements_before == [exponential]
    assert order.loop_statements == [output]
    assert operation_cost(order.loop_statements) == 1.0
    assert set(arguments(order.loop_statements)) == {exponential, t.x}


def program(t: Text, *outputs: Node) -> Program:
    return Program(t.graph, (t.theta,), (), (), (), (t.x, t.y, t.flag), (), outputs)


def test_a_fixed_divisor_is_inverted_before_the_loop():
    t = Text()
    for divisor in (t.theta, t.graph.const(3.0)):
        (output,) = with_reciprocals(program(t, t.make("div", t.x, divisor)), uses=2).outputs
        assert output.op == "mul"


def test_a_divisor_that_is_used_twice_is_inverted_once():
    t = Text()
    once, twice = t.make("div", t.x, t.flag), [t.make("div", a, t.y) for a in (t.x, t.flag)]
    nodes = with_reciprocals(program(t, once, *twice), uses=2).outputs
    assert [node.op for node in nodes] == ["div", "mul", "mul"]
    inverse = t.make("div", 1.0, t.y)
    assert all(inverse in set(node.args) for node in nodes[1:])


@needs_compiler
def test_a_branch_gives_correct_values_for_true_and_false_conditions():
    t = Text()
    x, y = t.x, t.y
    for _ in range(20):
        x, y = t.make("sin", t.make("add", x, t.theta)), t.make("cos", t.make("mul", y, t.theta))
    kernel = make_kernel(program(t, t.make("where", t.flag, x, y)))
    assert "if (" in kernel.source
    inputs = np.array([[0.3, 0.4, flag] for flag in (0.0, 1.0, 2.0, np.nan, -0.0)])
    outputs = np.empty((5, 1))
    kernel.run(np.array([0.7]), np.empty(0), inputs, outputs, np.empty(0))
    a, b = 0.3, 0.4
    for _ in range(20):
        a, b = np.sin(a + 0.7), np.cos(b * 0.7)
    np.testing.assert_allclose(outputs[:, 0], [b, a, a, a, b], rtol=1e-13)
