"""Each line that baqueano advises is one that its own parser takes, quoted, with all that it needs."""

import ast
import re
from pathlib import Path

import click
import pytest

import baqueano as package
from baqueano.cli import VERBS, command_of
from baqueano.messages import templates
from baqueano.printable import typed

SOURCE = Path(package.__file__).parent
WORD = r"\{[^}]*\}|[A-Z][A-Z_]*(?:\.[a-z]+)?|--[a-z-]+"  # of a line within a sentence
LINE = re.compile(rf"baqueano ((?:{'|'.join(VERBS)})\b(?: [a-z-]+(?=[ ,.;:)]|$))?(?: (?:{WORD}))*)")
OPEN = "1"  # in the place of a word that is known when the line is made


def of_call(node):
    """The words of typed(…), several at once taken as one and as none."""
    several = any(isinstance(one, ast.Starred) for one in node.args)
    for put in ([OPEN], []) if several else ([],):
        words = []
        for one in node.args:
            words += (
                put
                if isinstance(one, ast.Starred)
                else [one.value if isinstance(one, ast.Constant) else OPEN]
            )
        yield words


def verb_of(node):
    """Whether a call of typed(…) begins with a verb that is known here."""
    return bool(node.args) and isinstance(node.args[0], ast.Constant)


def advised():
    """Each advised line as the ways to read its words, with where it stands."""
    for path in sorted(SOURCE.rglob("*.py")):
        where = path.relative_to(SOURCE)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "typed" and verb_of(node):
                yield f"{where}:{node.lineno}", list(of_call(node))
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found = re.fullmatch(rf"baqueano ((?:{'|'.join(VERBS)})\b[^.]*(?:\.toml[^.]*)?)", node.value)
                if found and "\n" not in node.value:
                    yield f"{where}:{node.lineno}", [found[1].split()]
    for code, template in templates().items():
        for line in LINE.findall(template):
            yield code, [line.split()]


def parsed(words):
    """The context of a command, None of one that shows a help; click's error or KeyError where it is none."""
    words = [OPEN if word.startswith("{") else word for word in words]
    command, rest = command_of(words[0]), words[1:]
    while isinstance(command, click.Group):
        if not rest:
            return None
        command, rest = command.commands[rest[0]], rest[1:]
    if "--help" in rest:
        return None
    return command.make_context("baqueano", rest, help_option_names=["-h", "--help"])  # click keeps them


LINES = list(advised())


def test_lines_are_found():
    assert len(LINES) > 50


@pytest.mark.parametrize(("where", "readings"), LINES, ids=[where for where, _ in LINES])
def test_each_advised_line_can_be_typed(where, readings):
    wrong = []
    for words in readings:
        try:
            parsed(words)
            return
        except (click.ClickException, KeyError) as error:
            wrong.append(error)
    raise AssertionError(f"{where}: baqueano {' '.join(map(str, readings[0]))}: {wrong[0]!r}")


def test_no_line_is_put_together_without_quotes():
    unquoted = re.compile(rf"f\"baqueano (?:{'|'.join(VERBS)}) [^\"]*\{{")
    found = [path.name for path in SOURCE.rglob("*.py") if unquoted.search(path.read_text(encoding="utf-8"))]
    assert found == []


def test_a_line_is_quoted_as_the_shell_wants_it(monkeypatch):
    assert typed("runs", "show", "my runs/1.mcap") == "baqueano runs show 'my runs/1.mcap'"
    monkeypatch.setattr("os.name", "nt")
    assert typed("runs", "show", "my runs/1.mcap") == 'baqueano runs show "my runs/1.mcap"'
