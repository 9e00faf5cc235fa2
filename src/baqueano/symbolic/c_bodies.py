"""The functions that a kernel may have, as C text: one loop over the ticks each, around the same arithmetic.

All but `lanes` have one signature: n ticks; θ, start and inputs in; one setting; up to three arrays out.
"""

from collections.abc import Sequence

from .c_text import Text
from .emit import Plan, plan

SIGNATURE = """\
EXPORT void kernel(int64_t n, const double *restrict theta, const double *restrict start,
                   const double *restrict inputs, double setting,
                   double *restrict first, double *restrict second, double *restrict third) {"""
LANES_SIGNATURE = """\
EXPORT void kernel(int64_t n, int64_t vehicles, const double *restrict theta, const double *restrict start,
                   const double *restrict shared, const double *restrict own,
                   double *restrict outputs, double *restrict final) {"""
LANES = 8  # vehicles side by side


def values(program) -> str:
    """first (n, m): the outputs; second (c,): the carry after the last tick."""
    text = Text(width=1)
    text.lines.append(SIGNATURE)
    order = plan(program.initial, (*program.outputs, *program.next_carry), {*program.carry, *program.inputs})
    _symbols(text, program)
    _begin(text, program, order)
    text.add(*(f"first[{k}] = {text.value(y)};" for k, y in enumerate(program.outputs)))
    text.assign(program.carry, program.next_carry)
    text.add(f"inputs += {len(program.inputs)}, first += {len(program.outputs)};")
    text.close()
    text.add(*(f"second[{k}] = x{k};" for k in range(len(program.carry))))
    return str(text)


def lanes(program, shared: Sequence[bool], outputs: bool) -> str:
    """outputs (L, n, m) if asked for; final (L, c). `shared` tells which columns of the inputs are common to
    all vehicles, (n, ·), and which are each vehicle's own, (L, n, ·). The last vehicle fills idle lanes."""
    text = Text(width=LANES)
    text.lines.append(LANES_SIGNATURE)
    wanted = program.outputs if outputs else ()
    order = plan(program.initial, (*wanted, *program.next_carry), {*program.carry, *program.inputs}, False)
    sizes = {"theta": len(program.theta), "start": len(program.start), "final": len(program.carry)}
    strides = {"own": f"n * {len(shared) - sum(shared)}", "outputs": f"n * {len(wanted)}"} | sizes
    text.open(f"for (int64_t group = 0; group < vehicles; group += {LANES}) {{")
    text.add(*(f"int64_t at_{name}[{LANES}];" for name in strides))
    text.open(f"for (int lane = 0; lane < {LANES}; ++lane) {{")
    text.add("int64_t vehicle = group + lane < vehicles ? group + lane : vehicles - 1;")
    text.add(*(f"at_{name}[lane] = vehicle * {stride};" for name, stride in strides.items()))
    text.close()
    for name, symbols in (("theta", program.theta), ("start", program.start)):
        text.symbols(symbols, name + "{}")
        text.add(*(f"const v_{LANES} {name}{k} = gather_{LANES}({name} + {k}, at_{name});"
                   for k in range(len(symbols))))
    text.symbols(program.inputs, "u{}")
    _begin(text, program, order, _load_inputs(shared))
    text.add(*(f"scatter_{LANES}(outputs + tick * {len(wanted)} + {k}, at_outputs, {text.whole(y)});"
               for k, y in enumerate(wanted)))
    text.assign(program.carry, program.next_carry)
    text.close()
    text.add(*(f"scatter_{LANES}(final + {k}, at_final, x{k});" for k in range(len(program.carry))))
    text.close()
    return str(text)


def _symbols(text: Text, program) -> None:
    text.symbols(program.theta, "theta[{}]")
    text.symbols(program.start, "start[{}]")
    text.symbols(program.inputs, "inputs[{}]")


def _begin(text: Text, program, order: Plan, head: Sequence[str] = ()) -> None:
    """All down to the last statement of a tick."""
    text.symbols(program.carry, "x{}")
    text.statements(order.before)
    text.add(*(f"v_{text.width} x{k} = {text.whole(x)};" for k, x in enumerate(program.initial)))
    text.open("for (int64_t tick = 0; tick < n; ++tick) {")
    text.add(*head)
    text.statements(order.loop)


def _load_inputs(shared: Sequence[bool]) -> list[str]:
    common, own, lines = 0, 0, []
    width = {True: sum(shared), False: len(shared) - sum(shared)}
    for k, is_shared in enumerate(shared):
        if is_shared:
            source, common = f"splat_{LANES}(shared[tick * {width[True]} + {common}])", common + 1
        else:
            source, own = f"gather_{LANES}(own + tick * {width[False]} + {own}, at_own)", own + 1
        lines.append(f"const v_{LANES} u{k} = {source};")
    return lines
