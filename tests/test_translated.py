"""A sentence in the source passes through gettext: it is a template of messages/, a help text, or stands in `_(…)`."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from baqueano.cli import VERBS

SOURCE = Path(__file__).parents[1] / "src" / "baqueano"
SENTENCE = re.compile(r"(?:[A-Za-z']+,? ){3,}[A-Za-z']+")  # four words in a row
MARKS = {"_", "N_", "parameter", "translated", "marked"}
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


def sentences(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of each sentence that nothing translates."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func).rpartition(".")[2]
            if name in MARKS | OF_DEVELOPERS:
                continue
            node.keywords = [one for one in node.keywords if one.arg not in HELP]
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue  # a docstring
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and SENTENCE.search(node.value):
            yield node.lineno, node.value
        yield from sentences(node)


def test_a_sentence_is_translated_where_it_is_shown():
    for path in sorted(SOURCE.rglob("*.py")):
        where = path.relative_to(SOURCE)
        if where.parts[0] in ELSEWHERE:
            continue
        for line, words in sentences(ast.parse(path.read_text(encoding="utf-8"))):
            print(f"{where}:{line}: {words[:110]!r}")
    raise AssertionError
