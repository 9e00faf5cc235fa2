"""Messages are data: each code has one sentence, each sentence has its figures, and no code reads a sentence.

The catalogue of a language contains all sentences, with their codes; a person reads its diff (test_language.py).
"""

import ast
import json
import re
import string
from pathlib import Path

import pytest

from baqueano.diagnostics import Diagnostic, Severity, StopReason, Verdict, note, stop
from baqueano.errors import BaqueanoError, SafetyStop, UsageError, exit_code_error
from baqueano.messages import ROOMS, templates, text
from baqueano.messages.language import use_language
from tests.syntax import SOURCE, function_name, nodes_of, python_files

ROOMS_OF_CODE = sorted(  # all files except the one that makes the sentences
    path.name
    for path in SOURCE.iterdir()
    if path.suffix == ".py" or ((path / "__init__.py").exists() and path.name != "messages")
)
MACHINES_WORDS = {
    "Raspberry Pi", "calibrate imu",  # words in files by which a machine names itself
    "arrays used as ind", "field limit",  # of errors of NumPy and of csv, which have no codes
}  # fmt: skip
NAMES = {  # with a space: cases of studies, verdicts on a filter
    "cannot tell", "not reported", "too sure", "too cautious", "at its limit", "no reading lost", "wrong start",
    "left inverted", "right inverted", "clean, other start",
}  # fmt: skip
LISTS_OF_NAMES = {
    "SOUND_DATA",
    "REPAIRS",
    "ROBOT_FAULTS",
    "UNCOMPARED_PARAMETERS",
    "BATTERY_TERM",
    "KINDS",
    "KIND_CODES",
    "FANCY_INDEX_TEXT",
}
FILES = {"file", "vehicle", "vehicle_file"}  # their `text` is TOML
PROSE = {"text", "why", "trouble", "sentence", "message", "remedy", "stopped"}  # names that would hold one
READING = {"startswith", "endswith", "partition", "rpartition", "split", "rsplit", "find", "index", "rstrip",
           "removeprefix", "removesuffix", "strip", "splitlines"}  # fmt: skip
MATCHING = {"match", "search", "fullmatch", "findall", "finditer"}
WORDS = re.compile(r"[A-Za-z]{2,} [A-Za-z]{2,}")


def name_of(node):
    """Return the last name of an expression; text(…) and the str(…) of an error are sentences."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args:
        of_error = node.func.id == "str" and name_of(node.args[0]) in ("error", "value", "why", "damage")
        return "text" if of_error or node.func.id == "text" else ""
    if isinstance(node, ast.Attribute):
        return "" if isinstance(node.value, ast.Name) and node.value.id in FILES else node.attr
    return node.id if isinstance(node, ast.Name) and node.id != "text" else ""  # a text by itself is a file's


def nodes_in(text):
    """Return all nodes of a text, the module first."""
    return list(ast.walk(ast.parse(text)))


def prose(node, constants):
    """Return whether a literal, or a constant of the module, has two words in a row."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(prose(element, constants) for element in node.elts)
    if isinstance(node, ast.Name):
        return node.id in constants - LISTS_OF_NAMES
    if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
        return False
    return node.value not in MACHINES_WORDS | NAMES and bool(WORDS.search(node.value))


def readers(nodes):
    """Yield the lines on which the code of a module reads a sentence."""
    constants = {
        target.id
        for node in nodes[0].body
        if isinstance(node, ast.Assign) and prose(node.value, set())
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    for node in nodes:
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            about = name_of(node.func.value)
            reads = node.func.attr in READING
            if reads and (about in PROSE or any(prose(arg, constants) for arg in node.args)):
                yield node.lineno
            if node.func.attr in MATCHING and any(name_of(arg) in PROSE for arg in node.args):
                yield node.lineno
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            if any(prose(side, constants) for side in sides):
                yield node.lineno
            is_membership = any(isinstance(op, ast.In | ast.NotIn) for op in node.ops)
            is_membership &= not (isinstance(node.left, ast.Name) and node.left.id in LISTS_OF_NAMES)
            is_membership &= not (isinstance(node.left, ast.Constant) and node.left.value in MACHINES_WORDS)
            if is_membership and any(name_of(side) in PROSE for side in node.comparators):
                yield node.lineno


@pytest.mark.parametrize("room", ROOMS_OF_CODE)
def test_no_source_code_reads_a_sentence(room):
    files = [SOURCE / room] if room.endswith(".py") else python_files(SOURCE / room)
    offenders = [
        f"{path.relative_to(SOURCE)} line {line}" for path in files for line in readers(nodes_of(path))
    ]
    assert not offenders, f"these decide by words: give what they ask for a code. {offenders}"


@pytest.mark.parametrize(
    "line",
    [
        'uno.trouble.startswith(("the latched stop", "x"))', "trouble.startswith(KINDS)", 'x == "the battery is low"',
        '"is no run" in said', '"latched" in why', "str(error).split()[4]", 're.search("[0-9]+", event.text)',
        'text(why).partition(":")', 'LOW = "the battery is low"\nwhy == LOW',
    ],
)  # fmt: skip
def test_code_that_reads_a_sentence_is_detected(line):
    assert list(readers(nodes_in(line)))


@pytest.mark.parametrize(
    "line", ['name.startswith("-")', "why.code == StopReason.TILT", "host.partition(':')", "x in why.figures"]
)
def test_code_that_reads_codes_and_names_is_accepted(line):
    assert not list(readers(nodes_in(line)))


OF_PROGRAMMERS = {"ValueError", "TypeError"}  # of Python: caught within the room, or for a programmer
OF_PYTHON = {"on_demand.py"}  # the AttributeError of a module, in Python's words


def literal_raises(nodes):
    """Yield the lines on which an error is raised with a sentence in place of a code."""
    for node in nodes:
        if not (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)):
            continue
        kind, arguments = ast.unparse(node.exc.func).rpartition(".")[2], node.exc.args
        of_class = kind[:1].isupper()  # self.wrong(place, …) makes an error with a code
        if kind in OF_PROGRAMMERS or not of_class:
            continue
        is_translated = any(isinstance(arg, ast.Call) and ast.unparse(arg.func) == "_" for arg in arguments)
        if is_translated or any(isinstance(arg, ast.JoinedStr) or prose(arg, set()) for arg in arguments):
            yield node.lineno


def test_each_error_is_raised_with_a_code():
    offenders = [
        f"{path.relative_to(SOURCE)} line {line}"
        for path in python_files(SOURCE)
        if path.relative_to(SOURCE).as_posix() not in OF_PYTHON
        for line in literal_raises(nodes_of(path))
    ]
    assert not offenders, f"raise it with Error.of(code, …), and write a template: {offenders}"


LITERAL = 'raise UsageError("no such run")', 'raise OSError(5, f"{x} is shut")', 'raise AnswerNo(_("no"))'


@pytest.mark.parametrize("line", LITERAL)
def test_an_error_with_a_literal_sentence_is_detected(line):
    assert list(literal_raises(nodes_in(line)))


TESTS = Path(__file__).parent
MAX_QUOTES = 94  # assertions that repeat a message: of tables, pages and terminals, whose subject is the text


def triples(sentence):
    """Each three words in a row of a sentence."""
    for part in re.split(r"\{[^{}]*\}|[.;:,!?()\"]+(?=\s|$)", sentence.replace("\\", "")):
        words = part.lower().split()
        threes = zip(words, words[1:], words[2:], strict=False)
        yield from (three for three in threes if "".join(three).isalpha())


def quotations(nodes, phrases):
    """Return the lines on which an assertion has a literal with three words in a row of a message."""

    def quotes(node):
        literals = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
        return any(phrases.intersection(triples(text)) for text in literals if isinstance(text, str))

    lines = {
        key.value.lineno
        for key in nodes
        if isinstance(key, ast.keyword) and key.arg == "match" and quotes(key.value)
    }
    checks = [node.test for node in nodes if isinstance(node, ast.Assert)]
    for node in (part for check in checks for part in ast.walk(check)):
        if isinstance(node, ast.Compare):
            sides = [side for side in (node.left, *node.comparators) if not isinstance(side, ast.Call)]
            if any(map(quotes, sides)) and ".code" not in ast.unparse(node):
                lines.add(node.lineno)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            reads = node.func.attr in READING | MATCHING | {"count"} and any(map(quotes, node.args))
            lines |= {node.lineno} if reads else set()
    return lines


def test_tests_assert_codes_and_rarely_quote_a_message():
    phrases = {three for template in templates().values() for three in triples(template)}
    places = [
        f"{path.relative_to(TESTS)} line {line}"
        for path in python_files(TESTS)
        for line in sorted(quotations(nodes_of(path), phrases))
    ]
    assert len(places) <= MAX_QUOTES, f"assert code and figures (tests/codes.py): {places}"


def test_an_assertion_that_quotes_a_message_is_detected():
    phrases = set(triples("the {name} bus is stuck low"))
    assert quotations(nodes_in('assert "bus is stuck" in words'), phrases) == {1}
    assert quotations(nodes_in('with refused(kind, match="bus is stuck low"):\n    pass'), phrases) == {1}
    assert quotations(nodes_in('assert reason.code == "bus.stuck"'), phrases) == set()


def test_each_code_has_one_template():
    rooms = [
        __import__(f"baqueano.messages.english.{room}", fromlist=["TEMPLATES"]).TEMPLATES for room in ROOMS
    ]
    assert sum(map(len, rooms)) == len(templates())


def test_a_verdict_in_a_sentence_is_translated():
    texts_without_entry = {
        code
        for code, template in templates().items()
        for _, name, form, _ in string.Formatter().parse(template)
        if name == "verdict" and form != "word"
    }
    assert texts_without_entry == set()
    with use_language("es"):
        assert text(note("cli.fitted", verdict=Verdict.WARN, reasons="a")) == "CON RESERVAS: a"


def test_each_reason_to_stop_has_a_sentence():
    assert not {str(reason) for reason in StopReason} - set(templates())


def diagnostics_in_the_code():
    """Return code and figure names of each diagnostic that the source makes with literal names."""
    for path in python_files(SOURCE):
        for node in nodes_of(path):
            if not (isinstance(node, ast.Call) and node.args):
                continue
            first, maker = node.args[0], function_name(node)
            is_fault = maker == "fault" or maker.endswith(".of")  # FileError.of(code, …)
            if maker in ("stop", "because") and isinstance(first, ast.Attribute):
                code = str(getattr(StopReason, first.attr, ""))
            elif (is_fault or maker == "note") and isinstance(first, ast.Constant):
                code = str(first.value)
            else:
                continue
            figures = {key.arg for key in node.keywords}
            figures |= {"fix"} if is_fault and len(node.args) > 1 else set()
            if code and None not in figures:
                yield path.relative_to(SOURCE), code, figures


def test_each_diagnostic_contains_the_figures_that_its_template_needs():
    diagnostics = list(diagnostics_in_the_code())
    assert len(diagnostics) > 250
    for path, code, figures in diagnostics:
        figures_of = {name for _, name, _, _ in string.Formatter().parse(templates()[code]) if name}
        figures_of = {name for name in figures_of if not name.startswith(("arg[", "type["))}
        assert figures_of >= figures & {"fix"}, f"{path}: {code} does not show what to type"
        assert figures_of - {"fix", "subject"} <= figures, (
            f"{path}: {code} needs {figures_of}, and gets {figures}"
        )


def codes_in_the_code():
    """Return the literals of the source, and patterns of those with computed parts."""
    literals, patterns = set(), set()
    for path in python_files(SOURCE):
        if "english" in path.parts:
            continue
        for node in nodes_of(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                literals.add(node.value)
            if isinstance(node, ast.JoinedStr) and isinstance(node.values[0], ast.Constant):
                parts = [
                    re.escape(x.value) if isinstance(x, ast.Constant) else "[a-z0-9-]*" for x in node.values
                ]
                patterns |= {"".join(parts)} if "." in node.values[0].value else set()
    return literals, re.compile("|".join(patterns))


def test_each_template_is_used_by_a_code():
    literals, pattern = codes_in_the_code()
    of_errors = {f"error.{error.__name__}" for error in (BaqueanoError, *BaqueanoError.__subclasses__())}
    unused_codes = set(templates()) - literals - of_errors
    assert [code for code in sorted(unused_codes) if not pattern.fullmatch(code)] == []


INNER = stop(StopReason.IMU_ABSENT, cause=UsageError("no bus").diagnostic)


@pytest.mark.parametrize(
    "note",
    [
        stop(StopReason.UNO_SILENT, silent_ms=320.5), stop(StopReason.UNO_LATCHED, "baqueano robot clear HOST"), INNER,
        note("bus.freed", Severity.WARNING, clocks=9),
    ],
)  # fmt: skip
def test_a_diagnostic_is_the_same_after_transmission_and_in_a_run(note):
    assert Diagnostic.from_json(json.loads(json.dumps(note.to_json()))) == note
    assert text(note)


@pytest.mark.parametrize(
    "data",
    [
        None, 3, [], {}, {"code": "x"}, {"code": 1, "severity": "error", "subject": "", "figures": {}, "fix": ""},
        {"code": "x", "severity": "grave", "subject": "", "figures": {}, "fix": ""},
        {"code": "x", "severity": "error", "subject": "", "figures": {"a": []}, "fix": ""},
        {"code": "x", "severity": "error", "subject": "", "figures": {"a": {"code": 3}}, "fix": ""},
    ],
)  # fmt: skip
def test_invalid_diagnostic_data_are_refused(data):
    with pytest.raises(ValueError, match=r"diagnostic|figure|Severity"):
        Diagnostic.from_json(data)


def test_an_unknown_code_is_printed_with_its_figures():
    assert (
        text(note("uno.new", fix="baqueano help", volts=7.1)) == "uno.new (volts = 7.1). Type: baqueano help"
    )
    assert text(stop(StopReason.UNO_SILENT)) == "uno.silent"
    assert (
        text(stop(StopReason.UNO_SILENT, silent_ms="{0.__class__}"))
        == "uno.silent (silent_ms = {0.__class__})"
    )


def test_an_error_has_its_diagnostic_after_transmission():
    reason = stop(StopReason.TILT, tilt_deg=40.0, max_tilt_rad=0.6)
    error = exit_code_error(SafetyStop.exit_code, reason)
    assert (type(error), error.diagnostic, str(error)) == (SafetyStop, reason, text(reason))
