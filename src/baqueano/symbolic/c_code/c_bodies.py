"""Generate the functions of a kernel as C code: each function is a loop over the ticks with the same arithmetic.

Except `batch`, the functions have one signature: the number n of ticks; inputs θ, start and inputs; a setting; up to
three arrays to fill.
"""

from collections.abc import Sequence
from typing import NamedTuple

from baqueano.contracts.values import Value
from baqueano.symbolic.c_code.c_text import CText
from baqueano.symbolic.derivatives.tangents import Tangents, parameter_blocks, tangents
from baqueano.symbolic.graph.emit import EmitPlan, Term, arguments, operation_cost as cost_of, plan_statements
from baqueano.symbolic.graph.program import Program

SIGNATURE = """\
EXPORT void kernel(int64_t n, const double *restrict theta, const double *restrict start,
                   const double *restrict inputs, double setting,
                   double *restrict first, double *restrict second, double *restrict third) {"""
BATCH_SIGNATURE = """\
EXPORT void kernel(int64_t n, int64_t vehicles, const double *restrict theta, const double *restrict start,
                   const double *restrict shared, const double *restrict own,
                   double *restrict outputs, double *restrict final) {"""
REPEATED_CALL_CODE = """\
typedef uint64_t __attribute__((may_alias)) bits;
EXPORT int again(const int64_t *a) {{
    const bits *inputs = (const bits *)(intptr_t)a[3];
    if (({zeros}) << 1) return 1;
    kernel(a[0], (const double *)(intptr_t)a[1], (const double *)(intptr_t)a[2], (const double *)inputs, 0.0,
           (double *)(intptr_t)a[4], (double *)(intptr_t)a[5], 0);
    return 0;
}}
"""
LANE_COUNT = 8  # vehicles in a vector
TURN_COUNT = 2  # vectors that take turns in a tick
EACH_VECTOR = "for (struct vector *vector = turns; vector < end; ++vector) {"
MAX_UNROLLED = 16  # largest number of parameters whose hessian is summed in straight-line code


class DerivativeProgram(NamedTuple):
    """A program, the rows of its tangents, and the order of the statements, for all functions with derivatives."""

    program: Program
    rows: list[Tangents]
    order: EmitPlan


def differentiate(program: Program) -> DerivativeProgram:
    """Return the program with its tangents, kept or eliminated: the variant with fewer operations per tick."""
    bodies = []
    for eliminate in (False, True):
        rows = [tangents(program, *block, eliminate) for block in parameter_blocks(len(program.theta))]
        changing_nodes = {*program.carry, *program.inputs, *(x for block in rows for x in block.drifts)}
        initial = (*program.initial, *(x for block in rows for x in block.initial))
        row_nodes = (x for block in rows for x in (*block.outputs, *block.next_carry))
        order = plan_statements(initial, (*program.outputs, *program.next_carry, *row_nodes), changing_nodes)
        bodies.append((cost_of(order.loop_statements), DerivativeProgram(program, rows, order)))
    return min(bodies, key=lambda choice: choice[0])[1]


def values(program: Program) -> str:
    """Return the code that fills first (n, m), the outputs, and second (c,), the carry after the last tick.

    The function `again` receives all arguments except the setting in one array: this call costs a third of a call with
    eight arguments. `sensitivities` has it too.
    """
    text = CText(width=1)
    text.lines.append(SIGNATURE)
    order = plan_statements(
        program.initial, (*program.outputs, *program.next_carry), {*program.carry, *program.inputs}
    )
    _symbols(text, program)
    _add_tick_code(text, program, order)
    text.add(*(f"first[{k}] = {text.value(y)};" for k, y in enumerate(program.outputs)))
    text.assign(program.carry, program.next_carry)
    text.add(f"inputs += {len(program.inputs)}, first += {len(program.outputs)};")
    text.close_brace()
    text.add(*(f"second[{k}] = x{k};" for k in range(len(program.carry))))
    return str(text) + _loop_statements(program)


def sensitivities(derivatives: DerivativeProgram) -> str:
    """Return the code that fills first (n, m), the outputs, and second (n, m, p), their derivatives with respect to
    θ."""
    text, program, rows = _tick_with_tangents(derivatives), derivatives.program, derivatives.rows
    p = len(program.theta)
    for k, y in enumerate(program.outputs):
        text.add(f"first[{k}] = {text.value(y)};")
        for block in rows:
            row, width = text.value(block.outputs[k]), min(block.lanes, p - block.first)
            text.add(f"store_{block.lanes}(second + {k * p + block.first}, {row}, {width});")
    text.add(f"first += {len(program.outputs)}, second += {len(program.outputs) * p};")
    _end_with_tangents(text, program, rows)
    return str(text) + _loop_statements(program)


def cost(program: Program) -> str:
    """Return the code that fills first (1,), the sum of the only output."""
    text = CText(width=1)
    order = plan_statements(
        program.initial, (*program.outputs, *program.next_carry), {*program.carry, *program.inputs}
    )
    text.lines += [SIGNATURE, "    double sum = 0.0;"]
    _symbols(text, program)
    _add_tick_code(text, program, order)
    text.add(f"sum += {text.value(program.outputs[0])};")
    text.assign(program.carry, program.next_carry)
    text.add(f"inputs += {len(program.inputs)};")
    text.close_brace()
    text.add("first[0] = sum;")
    return str(text)


def gradient(derivatives: DerivativeProgram) -> str:
    """Return the code that fills first (1,), the sum of the only output, and second (p,), its gradient."""
    text = _tick_with_tangents(derivatives, "double sum = 0.0;", "v_{lanes} gradient{first} = {{0}};")
    program, rows = derivatives.program, derivatives.rows
    text.add(f"sum += {text.value(program.outputs[0])};")
    text.add(*(f"gradient{block.first} += {text.value(block.outputs[0])};" for block in rows))
    _end_with_tangents(text, program, rows)
    text.add("first[0] = sum;", *_store_lines("second", "gradient", rows, len(program.theta)))
    return str(text)


def normal_equations(derivatives: DerivativeProgram) -> str:
    """Return the code of the normal equations for residuals r with Huber's ρ and the threshold k = setting.

    ρ = ½ r² for |r| <= k, else k |r| − ½ k²;  w = ρ′/r. The code fills first (1,): Σ ρ; second (p,): Σ w r ∂r; third
    (p, p): Σ w ∂r ∂rᵀ, of which only the upper triangle is valid.
    """
    program, rows, p = derivatives.program, derivatives.rows, len(derivatives.program.theta)
    text = _tick_with_tangents(
        derivatives,
        "const unsigned int mode = tiny_as_zero();",
        "double sum = 0.0;",
        "v_{lanes} gradient{first} = {{0}};",
        f"v_{{lanes}} hessian{{first}}[{p}] = {{{{0}}}};",
    )
    for k, r in enumerate(program.outputs):
        text.add(
            f"const double size{k} = __builtin_fabs({text.value(r)});",
            f"const double w{k} = size{k} <= setting ? 1.0 : setting / size{k};",
            f"sum += size{k} <= setting ? 0.5 * size{k} * size{k} : setting * (size{k} - 0.5 * setting);",
        )
        for block in rows:
            text.add(
                f"const v_{block.lanes} j{k}_{block.first} = {text.value(block.outputs[k])};",
                f"const v_{block.lanes} wj{k}_{block.first} = w{k} * j{k}_{block.first};",
                f"gradient{block.first} += {text.value(r)} * wj{k}_{block.first};",
            )
    _add_to_hessian(text, rows, range(len(program.outputs)), p)
    _end_with_tangents(text, program, rows)
    text.add("first[0] = sum;", *_store_lines("second", "gradient", rows, p))
    for i in range(p):
        text.add(*_store_lines(f"third + {i * p}", "hessian", rows, p, f"[{i}]"))
    text.add("as_before(mode);")
    return str(text)


def _add_to_hessian(text: CText, rows: list[Tangents], residuals: range, p: int) -> None:
    """Add the blocks on and above the diagonal, as loops for over MAX_UNROLLED parameters: they compile faster."""
    if p > MAX_UNROLLED:
        size = rows[-1].first + rows[-1].lanes
        for k in residuals:
            text.add(f"double column{k}[{size}];")
            text.add(*(f"store_{b.lanes}(column{k} + {b.first}, wj{k}_{b.first}, {b.lanes});" for b in rows))
    for block in rows:
        count = min(p, block.first + block.lanes)
        if p > MAX_UNROLLED:
            terms = (f"column{k}[i] * j{k}_{block.first}" for k in residuals)
            sums = " + ".join((f"hessian{block.first}[i]", *terms))
            text.add(f"for (int i = 0; i < {count}; ++i) hessian{block.first}[i] = {sums};")
            continue
        for i in range(count):
            multiple_of_8 = i - i % 8
            terms = (f"wj{k}_{multiple_of_8}[{i - multiple_of_8}] * j{k}_{block.first}" for k in residuals)
            text.add(f"hessian{block.first}[{i}] = {' + '.join((f'hessian{block.first}[{i}]', *terms))};")


def batch(program: Program, shared_flags: Sequence[bool], with_outputs: bool) -> str:
    """Return the code that fills outputs (L, n, m), if `with_outputs`, and final (L, c).

    `shared_flags` marks the columns of the inputs that are common to all vehicles, (n, ·); the others belong to each
    vehicle, (L, n, ·). Unused lanes of a vector repeat the last vehicle. In a tick, most operations wait for the
    previous one. So several vectors take turns, and the processor computes their ticks at the same time.
    """
    text = CText(width=LANE_COUNT)
    text.lines.append(BATCH_SIGNATURE)
    tick_outputs = program.outputs if with_outputs else ()
    order = plan_statements(
        program.initial,
        (*tick_outputs, *program.next_carry),
        {*program.carry, *program.inputs},
        branches=False,
    )
    sizes = {"theta": len(program.theta), "start": len(program.start), "final": len(program.carry)}
    strides = {
        "own": f"n * {len(shared_flags) - sum(shared_flags)}",
        "outputs": f"n * {len(tick_outputs)}",
    } | sizes
    for name in ("theta", "start", "carry", "inputs"):
        text.symbols(getattr(program, name), {"carry": "x", "inputs": "u"}.get(name, name) + "{}")
    text.name_cells(order, "vector->cell{}")
    loop_terms = {*arguments(order.loop_statements), *tick_outputs, *program.next_carry}
    fixed_terms = [
        term for term in (*program.theta, *program.start, *order.statements_before) if term in loop_terms
    ]
    variables = [(text.type(term), text.name(term)) for term in (*fixed_terms, *program.carry)]
    fields = [f"int64_t at_{name}[{LANE_COUNT}];" for name in strides]
    fields += [f"int64_t {cell.removeprefix('vector->')};" for cell in text.cells.values()]
    fields += [f"{type_} {name};" for type_, name in variables]
    text.add(f"struct vector {{ {' '.join(fields)} }} turns[{TURN_COUNT}];")
    text.open_brace(f"for (int64_t first = 0; first < vehicles; first += {LANE_COUNT * TURN_COUNT}) {{")
    text.add(
        f"const int64_t vectors = (vehicles - first + {LANE_COUNT - 1}) / {LANE_COUNT};",
        f"struct vector *const end = turns + (vectors < {TURN_COUNT} ? vectors : {TURN_COUNT});",
    )
    _start_vectors(text, program, order, strides, fixed_terms)
    text.open_brace("for (int64_t tick = 0; tick < n; ++tick) {")
    text.open_brace(EACH_VECTOR)
    text.add(
        *(f"const {type_} {name} = vector->{name};" for type_, name in variables), *_load_inputs(shared_flags)
    )
    text.statements(order.loop_statements)
    for k, y in enumerate(tick_outputs):
        to = f"outputs + tick * {len(tick_outputs)} + {k}"
        text.add(f"scatter_{LANE_COUNT}({to}, vector->at_outputs, {text.vector_code(y)});")
    text.add(*(f"vector->x{k} = {text.vector_code(x)};" for k, x in enumerate(program.next_carry)))
    text.close_brace()
    text.close_brace()
    text.open_brace(EACH_VECTOR)
    line = f"scatter_{LANE_COUNT}(final + {{0}}, vector->at_final, vector->x{{0}});"
    text.add(*map(line.format, range(len(program.carry))))
    text.close_brace()
    text.close_brace()
    return str(text)


def _start_vectors(
    text: CText, program: Program, order: EmitPlan, strides: dict[str, Value], fixed_terms: Sequence[Term]
) -> None:
    """Add the code that fills each vector before the first tick: addresses, `fixed_terms`, and the carry."""
    text.open_brace(EACH_VECTOR)
    text.open_brace(f"for (int lane = 0; lane < {LANE_COUNT}; ++lane) {{")
    text.add(f"int64_t vehicle = first + {LANE_COUNT} * (vector - turns) + lane;")
    text.add("vehicle = vehicle < vehicles ? vehicle : vehicles - 1;")
    text.add(*(f"vector->at_{name}[lane] = vehicle * {stride};" for name, stride in strides.items()))
    text.close_brace()
    for name, count in (("theta", len(program.theta)), ("start", len(program.start))):
        line = f"const v_{LANE_COUNT} {name}{{0}} = gather_{LANE_COUNT}({name} + {{0}}, vector->at_{name});"
        text.add(*map(line.format, range(count)))
    text.statements(order.statements_before)
    text.add(*(f"{cell} = 0;" for cell in text.cells.values()))
    text.add(*(f"vector->{text.names[term]} = {text.names[term]};" for term in fixed_terms))
    text.add(*(f"vector->x{k} = {text.vector_code(x)};" for k, x in enumerate(program.initial)))
    text.close_brace()


def _loop_statements(program: Program) -> str:
    zeros = set(program.zeros)
    entries = [f"inputs[{k}]" for k, node in enumerate(program.inputs) if node in zeros]
    return REPEATED_CALL_CODE.format(zeros=" | ".join(entries) or "0")  # << 1 removes the sign


def _tick_with_tangents(derivatives: DerivativeProgram, *declarations: str) -> CText:
    """Return the code up to the last statement of a tick, with the tangents of the outputs and of the carry.

    A declaration with {first} is repeated for each block of θ; without θ it is omitted.
    """
    (program, rows, order), text = derivatives, CText(width=1)
    text.lines.append(SIGNATURE)
    _symbols(text, program)
    for block in rows:
        text.symbols(block.drifts, f"d{{}}_{block.first}")
    for line in declarations:
        block_lines = [line.format(first=block.first, lanes=block.lanes) for block in rows]
        text.add(*(block_lines if "{first}" in line else [line]))
    _add_tick_code(text, program, order, rows)
    return text


def _end_with_tangents(text: CText, program: Program, rows: list[Tangents]) -> None:
    targets = [x for block in rows for x in block.drifts]
    values = [x for block in rows for x in block.next_carry]
    text.assign((*program.carry, *targets), (*program.next_carry, *values))
    text.add(f"inputs += {len(program.inputs)};")
    text.close_brace()


def _store_lines(to: str, name: str, rows: list[Tangents], p: int, index: str = "") -> list[str]:
    return [
        f"store_{block.lanes}({to} + {block.first}, {name}{block.first}{index}, "
        f"{min(block.lanes, p - block.first)});"
        for block in rows
    ]


def _symbols(text: CText, program: Program) -> None:
    text.symbols(program.theta, "theta[{}]")
    text.symbols(program.start, "start[{}]")
    text.symbols(program.inputs, "inputs[{}]")


def _add_tick_code(text: CText, program: Program, order: EmitPlan, rows: Sequence[Tangents] = ()) -> None:
    """Add the code up to the last statement of a tick."""
    text.symbols(program.carry, "x{}")
    text.name_cells(order, "cell{}")
    text.add(*(f"int64_t {name} = 0;" for name in text.cells.values()))
    text.statements(order.statements_before)
    text.add(*(f"v_{text.width} x{k} = {text.vector_code(x)};" for k, x in enumerate(program.initial)))
    for block in rows:
        text.add(
            *(
                f"v_{block.lanes} {text.names[drift]} = {text.value(row)};"
                for drift, row in zip(block.drifts, block.initial, strict=True)
            )
        )
    text.open_brace("for (int64_t tick = 0; tick < n; ++tick) {")
    text.statements(order.loop_statements)


def _load_inputs(shared_flags: Sequence[bool]) -> list[str]:
    shared_count, own_count, lines = 0, 0, []
    width = {True: sum(shared_flags), False: len(shared_flags) - sum(shared_flags)}
    for k, is_shared in enumerate(shared_flags):
        if is_shared:
            source = f"splat_{LANE_COUNT}(shared[tick * {width[True]} + {shared_count}])"
            shared_count += 1
        else:
            source = f"gather_{LANE_COUNT}(own + tick * {width[False]} + {own_count}, vector->at_own)"
            own_count += 1
        lines.append(f"const v_{LANE_COUNT} u{k} = {source};")
    return lines
