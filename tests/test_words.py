"""Sentences and names that people read are plain: at most 25 words, and the words of the field."""

import ast
import re
from pathlib import Path

from baqueano.messages import templates

SOURCE = Path(__file__).parents[1] / "src" / "baqueano"
WORDS = 25  # of a sentence; a figure counts as one
NEGATION = re.compile(r"\b(is|are|was|were|has|have|had) (no|none|neither|nobody)\b(?! longer| more| effect)")
SAYING = re.compile(r"\b(told|foretells?|coloured|whoever|whatever|cannot be (told|seen))\b")
RIDDLE = re.compile(r"(What|Whether|That|How|Where|Who|Those|Whose)\b")
DEFINED = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef


def test_a_message_is_plain():
    for code, template in templates().items():
        bare = re.sub(r"\{[^{}]*\}", "x", template)
        long = [one for one in re.split(r"[.;:!?] ", bare) if len(one.split()) > WORDS]
        assert not long, f"{code}: over {WORDS} words: {long}"
        assert not NEGATION.search(bare), f'{code}: say "is not a", "does not exist": {template}'
        assert not SAYING.search(bare), (
            f"{code}: a term of the field, in place of a verb of saying: {template}"
        )


def nodes():
    """Return the nodes of all rooms, with their file."""
    for path in SOURCE.rglob("*.py"):
        file = path.relative_to(SOURCE).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            yield file, node


def test_a_docstring_begins_with_a_verb_or_with_the_thing():
    riddles = [
        f"{file}: {text}"
        for file, node in nodes()
        if isinstance(node, DEFINED) and RIDDLE.match(text := ast.get_docstring(node) or "")
    ]
    assert not riddles, f'"Return …", or the noun itself: {riddles}'


VERBS = {"said", "told", "asked", "known", "seen", "found", "held", "heard", "felt", "believed", "foretold"}
SETTLED = (  # rooms without a local or module-level name of that kind; others join one by one
    "compare", "controllers", "estimators", "guides", "identify", "report", "routes", "runs", "sensors",
    "vehicle_file", "vehicles",
)  # fmt: skip
STILL_THERE = 28  # definitions in the rooms above


def defined_names(node: ast.AST) -> list[str]:
    """Return the names that a node defines: a variable that is set, an argument, a function, a class."""
    if isinstance(node, ast.Name):
        return [node.id] if isinstance(node.ctx, ast.Store) else []
    return [
        name for name in (getattr(node, "arg", None), getattr(node, "name", None)) if isinstance(name, str)
    ]


def test_no_name_is_a_verb_of_saying():
    said = [(file, name) for file, node in nodes() for name in defined_names(node)
            if name.lstrip("_") in VERBS and not isinstance(node, ast.keyword | ast.alias)]  # fmt: skip
    assert not {one for one in said if one[1] in ("told", "foretold")}, "name what it holds"
    here = sorted(f"{file}: {name}" for file, name in said if file.split("/")[0] in SETTLED)
    assert len(here) <= STILL_THERE, f"name what it holds: {here}"


PARTICIPLE = re.compile(r"_?[A-Z][a-z]+(ed|aught|old|eld|een|own|awn)")  # a word alone, which lacks its noun
NO_NOUN_YET = {
    "Begun", "Coded", "Differentiated", "Drawn", "Fitted", "Fixed", "Flashed", "Grouped", "Interrupted",
    "Listed", "Predicted", "Recorded", "Refused", "Served", "Shown", "Stepped", "Stored", "Watched",
}  # fmt: skip
TERMS = {"Unscented", "Field", "Feed", "Screen"}  # of the field, and nouns that look like one


def test_a_class_is_called_by_a_noun():
    alone = {
        f"{file}: {node.name}"
        for file, node in nodes()
        if isinstance(node, ast.ClassDef)
        and PARTICIPLE.fullmatch(node.name)
        and node.name.lstrip("_") not in NO_NOUN_YET | TERMS
    }
    assert not alone, f"a participle is not a noun: {alone}"
