"""Convert statements to C code.

A scalar is printed as a double (width 1) or, for many vehicles at once, as a vector: each element (lane) is
a vehicle. A row of tangents is a vector in which each lane is a parameter.
"""

import pkgutil
import re
from collections.abc import Iterable, Sequence
from functools import cache

from baqueano.symbolic.graph.emit import EmitPlan, EmittedBranch, Statement, Term, flat_statements

INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
COMPARISONS = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
CONJUNCTIONS = {"and": "&", "or": "|"}
MASKS = {*COMPARISONS, *CONJUNCTIONS, "not", "isnan"}  # they become 0.0 or 1.0 if used as numbers
LONG_FUNCTIONS = ("sin_", "cos_", "tan_", "sinh_", "cosh_", "tanh_", "atan2_", "hypot_", "exp_", "log_")
MAX_INLINED_CALLS = 100  # largest number of inlined calls: with more calls the compilation takes too long
TABLE_OPERATORS = ("interp", "interp_slope")
NAN = '__builtin_nan("")'
ROW_OPERATORS = ("row", "choose", "unit", "drift")
CALL = re.compile(r"\b(\w++)(?<=\d)\(")
FUNCTION = re.compile(r"^(?:LOCAL|LONG) \w+ FN\((\w+)\)(?:.*\}.*\n|(?:.*\n)+?\}\n)", re.MULTILINE)
SCALAR_FUNCTION = re.compile(r"^SCALAR\w*\((\w+)\)\n", re.MULTILINE)


def header(body: str, tables: Sequence) -> str:
    """Return the declarations for the body: elementary functions of its widths, and the tables of `interp`."""
    names_and_widths = (call.rpartition("_")[::2] for call in set(CALL.findall(body)))
    calls = {(name, max(int(width), 2)) for name, width in names_and_widths}
    has_many_calls = sum(map(body.count, LONG_FUNCTIONS)) > MAX_INLINED_CALLS
    widths = sorted({2, *map(int, re.findall(r"v_(\d+)", body))} - {1})
    texts = ["#define CALLED\n"] if has_many_calls else []
    for width in widths:
        functions = _elementary_functions({name for name, lanes in calls if lanes == width})
        texts.append(f"#define LANES {width}\n{functions}#undef LANES\n")
    columns = {f"xp{_grid(tables, k)}": xp for k, (xp, _) in enumerate(tables)}
    columns |= {f"fp{k}": fp for k, (_, fp) in enumerate(tables)}
    for name in dict.fromkeys(re.findall(r"\b[xf]p\d+\b", body)) if tables else ():
        cells = (
            ", ".join(map(float.hex, columns[name].tolist())).replace("inf", "INFINITE").replace("nan", NAN)
        )
        texts.append(f"static const double {name}[] = {{{cells}}};\n")
    texts.append("#ifdef _WIN32\n#define EXPORT __declspec(dllexport)\n#else\n#define EXPORT\n#endif\n")
    return "".join(texts)


def _elementary_functions(names: set[str]) -> str:
    """Return these functions of c_math.h and those that they call; gcc would read and translate all others too."""
    text, calls = _math_text()
    callees, new_names = set(), names | {"splat"}
    while new_names:
        callees |= new_names
        new_names = {callee for name in new_names for callee in calls.get(name, ())} - callees
    text = FUNCTION.sub(lambda function: function[0] if function[1] in callees else "", text)
    return SCALAR_FUNCTION.sub(lambda line: line[0] if line[1] in callees else "", text)


@cache
def _math_text() -> tuple[str, dict[str, list[str]]]:
    """Return the text of c_math.h, and for each of its functions the names of the functions that it calls."""
    text = (pkgutil.get_data("baqueano.symbolic", "c_math.h") or b"").decode()
    calls = {function[1]: re.findall(r"FN\((\w+)\)", function[0]) for function in FUNCTION.finditer(text)}
    return text, calls


def literal(value: float) -> str:
    """Return a double as an exact C literal."""
    value = float(value)
    if value != value:
        return NAN
    text = repr(value).replace("inf", "INFINITE")
    return f"({text})" if text.startswith("-") else text


class CText:
    """C code under construction, and the names of its terms."""

    def __init__(self, width: int) -> None:
        self.width = width  # number of lanes of a scalar
        self.names: dict[Term, str] = {}
        self.cells: dict[tuple[Term, int], str] = {}  # of a table's argument and its grid xp
        self.lines: list[str] = []
        self.depth = 1

    def __str__(self) -> str:
        return "\n".join((*self.lines, "}\n"))

    def add(self, *lines: str) -> None:
        """Add these lines of code with the present indentation."""
        self.lines += ["    " * self.depth + line for line in lines]

    def open_brace(self, line: str) -> None:
        """Add a line that opens a brace, and indent the following lines."""
        self.add(line)
        self.depth += 1

    def close_brace(self) -> None:
        """Close the brace."""
        self.depth -= 1
        self.add("}")

    def symbols(self, terms: Iterable[Term], pattern: str) -> None:
        """Define the names of these leaves: the pattern, with the index of the leaf instead of {}."""
        self.names |= {term: pattern.format(k) for k, term in enumerate(terms)}

    def name_cells(self, plan: EmitPlan, pattern: str) -> None:
        """Name the cell that was read last, for each argument of tables with one grid."""
        for s in flat_statements((*plan.statements_before, *plan.loop_statements)):
            if s.op in TABLE_OPERATORS:
                self.cells.setdefault(
                    (s.args[0], _grid(s.graph.tables, s.value)), pattern.format(len(self.cells))
                )

    def statements(self, statements: Iterable[Statement]) -> None:
        """Add a C statement for each statement, in order; a branch becomes an if with two arms."""
        for s in statements:
            if isinstance(s, EmittedBranch):
                self.branch(s)
            else:
                value = self.expression(s)  # before the name, because the value must not contain its own name
                self.add(f"const {self.type(s)} {self.name(s)} = {value};")

    def branch(self, branch: EmittedBranch) -> None:
        """Add the declarations of the choices, and an if and an else that assign their values."""
        condition = self.mask(branch.condition)
        self.add(*(f"{self.type(choice)} {self.name(choice)};" for choice in branch.choices))
        self.open_brace(f"if ({condition}) {{")
        self.arm(branch.if_true, branch.choices, 1)
        self.depth -= 1
        self.open_brace("} else {")
        self.arm(branch.if_false, branch.choices, 2)
        self.close_brace()

    def arm(self, statements: Iterable[Statement], choices: Iterable[Term], argument: int) -> None:
        """Add an arm of a branch; `argument`, 1 or 2, is the index of the operand that a choice has in this arm."""
        self.statements(statements)
        self.add(*(f"{self.names[c]} = {self.value(c.args[argument])};" for c in choices))

    def assign(self, targets: Sequence[Term], values: Sequence[Term]) -> None:
        """Add assignments that act at the same time: values that are also targets are read before any is written."""
        moves = {x: y for x, y in zip(targets, values, strict=True) if x is not y}
        names = {y: f"old_{self.names[y]}" for y in moves.values() if y in moves}
        self.add(*(f"const {self.type(y)} {name} = {self.names[y]};" for y, name in names.items()))
        self.add(*(f"{self.names[x]} = {names.get(y) or self.vector_code(y)};" for x, y in moves.items()))

    def name(self, term: Term) -> str:
        """Return the variable of a term, or make a new one: r… for rows and t… for all others."""
        return self.names.setdefault(term, f"{'r' if term.op in ROW_OPERATORS else 't'}{len(self.names)}")

    def type(self, term: Term) -> str:
        """Return the C type of a term: a row, a mask or numbers, as wide as the code."""
        if term.op in ROW_OPERATORS:
            return f"v_{term.lanes}"
        return f"m_{self.width}" if term.op in MASKS else f"v_{self.width}"

    def value(self, term: Term) -> str:
        """Return the code of an operand of + − × ÷ and comparisons, which can mix constants and vectors."""
        if term.op == "const":
            return literal(term.value)
        if term.op == "unit":
            return f"(v_{term.lanes}){{{'0.0, ' * term.value}1.0}}"
        name = self.names[term]
        return f"number_{self.width}({name})" if term.op in MASKS else name

    def vector_code(self, term: Term) -> str:
        """Return the code of a function argument; a constant is copied into all lanes."""
        value = self.value(term)
        return f"splat_{self.width}({value})" if term.op == "const" and self.width > 1 else value

    def mask(self, term: Term) -> str:
        """Return the code of a condition: a mask unchanged, a number compared with 0."""
        return self.names[term] if term.op in MASKS else f"({self.vector_code(term)} != 0.0)"

    def expression(self, term: Term) -> str:
        """Return the code that computes a term."""
        op, args, width = term.op, term.args, self.width
        if op == "row":
            pairs = sorted(zip(args[::2], args[1::2], strict=True), key=lambda pair: not _is_sign(pair[0]))
            return " + ".join(self.product(*pair) for pair in pairs) or f"(v_{term.lanes}){{0}}"
        if op == "choose":
            return f"choose_{term.lanes}({self.mask(args[0])}, {self.value(args[1])}, {self.value(args[2])})"
        if op == "where":
            return f"select_{width}({self.mask(args[0])}, {self.vector_code(args[1])}, {self.vector_code(args[2])})"
        if op in CONJUNCTIONS:
            return f"{self.mask(args[0])} {CONJUNCTIONS[op]} {self.mask(args[1])}"
        if op == "not":
            return f"{self.mask(args[0])} == 0"
        if op in INFIX or op in COMPARISONS:
            return f"{self.vector_code(args[0])} {(INFIX | COMPARISONS)[op]} {self.value(args[1])}"
        values = ", ".join(map(self.vector_code, args))
        if op == "neg":
            return f"-{values}"
        if op == "isnan":
            return f"{values} != {values}"
        if op in TABLE_OPERATORS:
            grid = _grid(term.graph.tables, term.value)
            size, cell = f"sizeof xp{grid} / sizeof(double)", self.cells[args[0], grid]
            return f"{op}_{width}({values}, xp{grid}, fp{term.value}, {size}, &{cell})"
        return f"{op}_{width}({values})"

    def product(self, coefficient: Term, row: Term) -> str:
        """Return the code of a coefficient times a row; a coefficient of 1 is omitted."""
        if _is_sign(coefficient):
            return self.value(row) if coefficient.value == 1.0 else f"(-{self.value(row)})"
        return f"{self.value(coefficient)} * {self.value(row)}"


def _grid(tables: Sequence, k: int) -> int:
    """Return the number of the first table with the arguments xp of table k."""
    return next(number for number, (xp, _) in enumerate(tables) if xp is tables[k][0])


def _is_sign(coefficient: Term) -> bool:
    """Return True for a coefficient of ±1. Its row is first, so each later product with its sum is one instruction."""
    return coefficient.op == "const" and coefficient.value in (1.0, -1.0)
