"""Sentences and names for users are plain: at most 25 words, and the terms of the field."""

import ast
import re
from pathlib import Path

import pytest

from baqueano.messages import templates

SOURCE = Path(__file__).parents[1] / "src" / "baqueano"
WORDS = 25  # of a sentence; a figure counts as one
NEGATION = re.compile(r"\b(is|are|was|were|has|have|had) (no|none|neither|nobody)\b(?! longer| more| effect)")
SAYING = re.compile(r"\b(told|foretells?|coloured|whoever|whatever|cannot be (told|seen))\b")
RIDDLE = re.compile(r"(What|Whether|That|How|Where|Who|Those|Whose)\b")
DEFINED = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef


def test_a_message_is_in_plain_language():
    for code, template in templates().items():
        bare = re.sub(r"\{[^{}]*\}", "x", template)
        long = [sentence for sentence in re.split(r"[.;:!?] ", bare) if len(sentence.split()) > WORDS]
        assert not long, f"{code}: over {WORDS} words: {long}"
        assert not NEGATION.search(bare), f'{code}: say "is not a", "does not exist": {template}'
        assert not SAYING.search(bare), (
            f"{code}: a term of the field, in place of a verb of saying: {template}"
        )


DOCS = Path(__file__).parents[1]
PAGES = (  # except those that the code writes
    "README.md",
    *(
        path.relative_to(DOCS).as_posix()
        for path in sorted((DOCS / "docs").glob("*.md"))
        if path.stem != "vehicle-file"
    ),
    *(
        path.relative_to(DOCS).as_posix()
        for path in sorted((DOCS / "docs" / "es").glob("*.md"))
        if path.stem != "vehicle-file"
    ),
)
SINGLE = re.compile(r"[^\W_]+(?:['’.,-][^\W_]+)*")


def sentences_of(page: str) -> list[str]:
    """Return the sentences of a page, with x in the place of code and of what a link says.

    >>> sentences_of("One is [here](a.md), `two` there. Three | four")
    ['One is x, x there.', 'Three', 'four']
    """
    text = re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"!?\[[^\]]*\]\([^)]*\)|`[^`\n]*`", "x", text)
    parts = re.split(r"\n\s*\n|\n(?=\s*[-*#\d]+[. ])|\||^#.*$", text, flags=re.MULTILINE)
    pieces = [
        sentence
        for part in parts
        for sentence in re.split(r"(?<=[.;:!?])[\s*)\"]+|[()]", " ".join(part.split()))
    ]
    return [sentence.strip() for sentence in pieces if sentence.strip()]


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_in_plain_language(page):
    sentences = sentences_of((DOCS / page).read_text(encoding="utf-8"))
    long = [sentence for sentence in sentences if len(SINGLE.findall(sentence)) > WORDS]
    assert not long, f"over {WORDS} words: {long}"
    assert not [sentence for sentence in sentences if NEGATION.search(sentence)], (
        'say "is not a", "does not exist"'
    )


def nodes(*folders: Path):
    """Return the nodes of all packages, or of these folders, with their file."""
    for folder in folders or (SOURCE,):
        for path in sorted(folder.rglob("*.py")):
            file = path.relative_to(SOURCE if folder == SOURCE else DOCS).as_posix()
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                yield file, node


def test_no_docstring_begins_with_a_question_word():
    riddles = [
        f"{file}: {text}"
        for file, node in nodes()
        if isinstance(node, DEFINED) and RIDDLE.match(text := ast.get_docstring(node) or "")
    ]
    assert not riddles, f'"Return …", or the noun itself: {riddles}'


EQUATION = re.compile(r"[=∂Σ≤≥≈√∫∈→±×·ᵀ²]")
NO_SUBJECT = re.compile(
    r"\b(is|are|was|were|has|have|had) (no\b(?! longer| more| effect|[,.])|none\b|neither\b|nobody\b)"
)


def sentences(docstring: str) -> list[str]:
    """Return the sentences of a docstring: its paragraphs, without tables, equations of their own and examples."""
    lines = [
        ""
        if re.search(r"\S {3,}\S", line) or line.startswith(("     ", ">>>", "...", "---"))
        else line.strip()
        for line in docstring.split("\n")
    ]
    paragraphs = (part.replace("\n", " ") for part in "\n".join(lines).split("\n\n"))
    return [
        sentence for part in paragraphs for sentence in re.split(r"(?<=[.;:!?]) +", part.strip()) if sentence
    ]


def test_a_docstring_is_in_plain_language():
    long, negated = [], []
    for file, node in nodes():
        if not isinstance(node, DEFINED):
            continue
        for sentence in sentences(ast.get_docstring(node) or ""):
            if NO_SUBJECT.search(sentence):
                negated.append(f"{file}: {sentence}")
            if len(sentence.split()) > WORDS and not EQUATION.search(sentence):
                long.append(f"{file}: {sentence}")
    assert not long, f"over {WORDS} words: {long}"
    assert not negated, f"a subject and a verb: {negated}"


@pytest.mark.parametrize(
    ("docstring", "count"),
    [
        ("Return one.\n\nx  three   spaces are a table of words\nTwo. Three; four: five.", 5),
        ("Return a sentence\nof two lines.\n\n>>> one.two. three\n", 1),
    ],
)
def test_docstring_sentences_are_counted_without_tables_and_examples(docstring, count):
    assert len(sentences(docstring)) == count


VERBS = {
    "said", "told", "asked", "known", "seen", "found", "held", "heard", "felt", "believed", "foretold",
    "says", "tells", "asks", "knows", "sees", "hears", "feels", "believes", "wants",
    "spoken", "sought", "wanted", "meant", "wished", "so_far", "what_is",
}  # fmt: skip
NAMED = SOURCE, DOCS / "tests", DOCS / "benchmarks", DOCS / "examples"


def defined_names(node: ast.AST) -> list[str]:
    """Return the names that a node defines: a variable or attribute that is set, an argument, a function, a class."""
    if isinstance(node, ast.Name):
        return [node.id] if isinstance(node.ctx, ast.Store) else []
    if isinstance(node, ast.Attribute):
        return [node.attr] if isinstance(node.ctx, ast.Store) else []
    return [
        name for name in (getattr(node, "arg", None), getattr(node, "name", None)) if isinstance(name, str)
    ]


def test_no_name_in_the_code_is_a_verb_of_saying():
    names = {
        f"{file}: {name}"
        for file, node in nodes(*NAMED)
        for name in defined_names(node)
        if name.lstrip("_") in VERBS and not isinstance(node, ast.keyword | ast.alias)
    }
    assert not names, f"name what it holds: {sorted(names)}"


SPEECH = {"say", "tell", "ask", "hear", "want", "know", "believe", "feel"}  # of a function or an argument


def test_no_function_or_argument_is_a_verb_of_saying():
    names = {
        f"{file}: {name}"
        for file, node in nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.arg)
        for name in defined_names(node)
        if name in SPEECH
    }
    assert not names, f"name what it does: {sorted(names)}"


PAST = re.compile(r"[a-z]+ed")  # a participle alone, which lacks its verb or its noun
VERBS_IN_ED = {"feed", "speed", "embed", "exceed"}


def test_a_function_name_is_not_a_participle():
    participles = {
        f"{file}: {node.name}"
        for file, node in nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and PAST.fullmatch(node.name)
        and node.name not in VERBS_IN_ED
    }
    assert not participles, f"a verb, or the quantity that is returned: {participles}"


PARTICIPLE = re.compile(r"_?[A-Z][a-z]+(ed|aught|old|eld|een|own|awn)")  # a word alone, which lacks its noun
TERMS = {"Unscented", "Field", "Feed", "Screen"}  # of the field, and nouns that look like one


def test_a_class_name_is_a_noun():
    participles = {
        f"{file}: {node.name}"
        for file, node in nodes()
        if isinstance(node, ast.ClassDef)
        and PARTICIPLE.fullmatch(node.name)
        and node.name.lstrip("_") not in TERMS
    }
    assert not participles, f"a participle is not a noun: {participles}"
