"""A sentence in the source passes through gettext: it is a template of messages/, a help text, or an argument of
`_(…)`."""

import ast
import re
from collections.abc import Iterator

from tests.syntax import SOURCE, function_name, nodes_of, python_files

SENTENCE = re.compile(r"(?:[A-Za-z']+,? ){3,}[A-Za-z']+")  # four words in a row
MARKS = {"_", "N_", "parameter", "translate", "mark"}
HELP = {"help", "epilog", "short_help", "metavar"}
ELSEWHERE = {"messages", "project"}  # the templates; files that `new` writes, which their own test reads
OF_DEVELOPERS = {
    "ValueError",
    "TypeError",
    "RuntimeError",
    "KeyError",
    "AttributeError",
    "AssertionError",
    "NotImplementedError",
    "OSError",
}
CODE = re.compile(  # lines to type, code, words of NumPy
    r"^(exec )?baqueano |^sudo |^pip |\.__class__ |^\(\w+, \w+\(t_ns"
)
OTHER_TEXT = {  # with text that users read elsewhere, or never
    "cli/subcommands.py", "cli/blocks.py", "cli/modelling/runs.py", "cli/robot/settings.py",  # constants: help
    "drive/tasks.py", "study/paper/case_study.py", "web/lab/identification.py",  # names of files, and units
    "identify/data/added_channels.py", "runs/importing/sources.py",  # in the catalogue
    "parameter.py",  # docstrings
    "robot/setup/card.py", "robot/setup/install.py", "robot/setup/steps.py",  # of a robot
    "runs/container/messages.py", "runs/export.py",  # schemas of topics, heads of files
    "symbolic/c_code/c_bodies.py", "symbolic/errors.py",  # C, and words of NumPy
}  # fmt: skip
FRACTION = re.compile(r"\.[1-9]\d*[fg]$")
IN_FILE_NOTATION = {  # numbers of TOML, Python, LaTeX, C and SVG; rows of numbers that format themselves
    "block_checks/loop_blocks.py", "door/frames/rows.py", "estimators/covariance.py", "identify/result/assemble.py",
    "report/tables.py", "runs/diagnostics/motion_checks.py", "runs/diagnostics/physical_limits.py",
    "runs/diagnostics/truth.py", "runs/importing/draft.py", "runs/maps/mount.py", "simulate/many.py",
    "study/controllers/result.py", "vehicle_file/tables.py", "vehicle_file/units.py",
}  # fmt: skip
NUMBERS_AND_COMMANDS = {"float", "baqueano_command"}  # calls whose texts no person reads as a sentence


def sentences(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of each sentence that is not translated."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Call) and function_name(node).rpartition(".")[2] in MARKS | OF_DEVELOPERS:
            continue
        if isinstance(node, ast.keyword) and node.arg in HELP:
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue  # a docstring
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and SENTENCE.search(node.value):
            yield node.lineno, node.value
        yield from sentences(node)


def test_every_displayed_sentence_is_translated():
    texts = []
    for path in python_files(SOURCE):
        place = path.relative_to(SOURCE)
        if place.parts[0] in ELSEWHERE or place.as_posix() in OTHER_TEXT:
            continue
        sentence_list = sentences(nodes_of(path)[0])
        texts += [f"{place}:{line}: {words!r}" for line, words in sentence_list if not CODE.search(words)]
    assert texts == [], "write a template of messages/, or _(…)"


def test_an_untranslated_sentence_is_detected():
    assert list(sentences(ast.parse('talk(f"the run {name} has gone out of its way")')))
    assert list(sentences(ast.parse('say("asking what is not there")')))
    assert not list(sentences(ast.parse('talk(_("the run has gone out of its way"))')))


def bare_fractions(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of each fraction that is written without `number`, so always with a decimal point."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Call) and function_name(child) in NUMBERS_AND_COMMANDS:
            continue
        if isinstance(child, ast.FormattedValue) and child.format_spec is not None:
            spec = ast.unparse(child.format_spec)[2:-1]
            if FRACTION.search(spec) and "number(" not in ast.unparse(child.value):
                yield child.lineno, ast.unparse(child)
        yield from bare_fractions(child)


def test_every_displayed_fraction_has_the_decimal_sign_of_the_language():
    """A fraction travels as a number in a figure of a message, or passes through `number`."""
    texts = []
    for path in python_files(SOURCE):
        place = path.relative_to(SOURCE)
        if "symbolic" in place.parts or "animation" in place.parts or place.as_posix() in IN_FILE_NOTATION:
            continue
        texts += [f"{place}:{line}: {words}" for line, words in bare_fractions(nodes_of(path)[0])]
    assert texts == [], "give the number to note(…), or write number(…)"


def test_a_fraction_with_a_fixed_decimal_point_is_detected():
    assert list(bare_fractions(ast.parse('note("x", nis=f"{mean:.2f}")')))
    assert not list(bare_fractions(ast.parse('note("x", nis=f"{number(mean):.2f}", fix=float(f"{s:.3g}"))')))
