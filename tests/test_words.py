"""Sentences and names for users are plain: at most 25 words, and the terms of the field."""

import ast
import doctest
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from baqueano.messages import templates
from baqueano.messages.language import LANGUAGES
from docs.site.reference import catalogue_file
from tests.catalogues import fields, places, read_catalogue
from tests.syntax import ROOT as DOCS, SOURCE, nodes_of, python_files

WORDS = 25  # of a sentence; a figure counts as one
NEGATION = re.compile(r"\b(is|are|was|were|has|have|had) (no|none|neither|nobody)\b(?! longer| more| effect)")
SAYING = re.compile(r"\b(told|foretells?|coloured|whoever|whatever|cannot be (told|seen))\b")
OLD = re.compile(  # words of an earlier style, in place of terms of the field
    r"\b(told|(?<!cannot )tells?|says?|said|believed?|heard|whoever|whatever|nobody|stands?|comes? right|"
    r"without a word|one's own|who noticed)\b",
    re.IGNORECASE,
)
RIDDLE = re.compile(r"(What|Whether|That|How|Where|Who|Those|Whose)\b")
DOC_NODES = ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef
AROUND = "docs/", "tests/", "benchmarks/", "examples/"  # code that is not in the package


def test_a_message_is_in_plain_language():
    for code, template in templates().items():
        text = re.sub(r"\{[^{}]*\}", "x", template)
        long = [sentence for sentence in re.split(r"[.;:!?] ", text) if len(sentence.split()) > WORDS]
        assert not long, f"{code}: over {WORDS} words: {long}"
        assert not NEGATION.search(text), f'{code}: say "is not a", "does not exist": {template}'
        assert not SAYING.search(text), (
            f"{code}: a term of the field, in place of a verb of saying: {template}"
        )


PAGES = (  # except those that the code writes
    "README.md",
    "README.es.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "firmware/uno/README.md",
    *(
        path.relative_to(DOCS).as_posix()
        for folder in ("docs", "docs/derivations", "docs/es", "docs/es/derivations")
        for path in sorted((DOCS / folder).glob("*.md"))
        if path.stem != "vehicle-file"
    ),
)
SINGLE = re.compile(r"[^\W_]+(?:['’.,-][^\W_]+)*")


def sentences_of(page: str) -> list[str]:
    """Return the sentences of a page, with x in the place of code, links and equations.

    >>> sentences_of("One is [here](a.md), `two` there. Three | four is $a + b$.")
    ['One is x, x there.', 'Three', 'four is x.']
    """
    text = re.sub(r"^```.*?^```$|^\$\$.*?\$\$", "", page, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"\$[^$\n]+\$", "x", text)
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
    assert not [sentence for sentence in sentences if OLD.search(sentence)], "use a term of the field"


def test_texts_of_the_reference_and_of_the_promises_are_in_plain_language():
    from docs.site.reference import ROOMS
    from tests.promises import WHY_NOT, promises

    for name, text in (*ROOMS.items(), *promises().items(), *WHY_NOT.items()):
        long = [part for part in re.split(r"[.;:!?] ", text) if len(part.split()) > WORDS]
        assert not long, f"{name}: over {WORDS} words: {long}"
        assert not NEGATION.search(text), f"{name}: {text}"
        assert not OLD.search(text), f"{name}: {text}"


CATALOGUES = [
    (language, path)
    for language in LANGUAGES
    if language != "en"
    for path in (places(language)[0], catalogue_file(language))
]


@pytest.mark.parametrize(("language", "path"), CATALOGUES, ids=lambda value: getattr(value, "name", value))
def test_a_text_of_a_catalogue_is_in_short_sentences(language, path):
    long = [
        sentence
        for entry in read_catalogue(language, path)
        for texts in (entry.id, entry.string)
        for text in ((texts,) if isinstance(texts, str) else texts)
        for sentence in sentences_of(re.sub(r"\{(?:[^{}]|\{[^{}]*\})*\}|%\([^)]*\)[a-z]|%[sd]", "x", text))
        if len(SINGLE.findall(sentence)) > WORDS and not EQUATION.search(sentence)
    ]
    assert not long, f"over {WORDS} words: {long}"


class Contents(NamedTuple):
    """The docstrings and the defined names of a folder, each with its file."""

    docstrings: list[tuple[str, str]]
    names: list[tuple[str, type[ast.AST], str]]


@cache
def contents_of(folder: Path) -> Contents:
    """Return the docstrings and names of all modules of a folder."""
    contents = Contents([], [])
    for path in python_files(folder):
        file = path.relative_to(SOURCE if folder == SOURCE else DOCS).as_posix()
        for node in nodes_of(path):
            if isinstance(node, DOC_NODES) and (docstring := ast.get_docstring(node)):
                contents.docstrings.append((file, docstring))
            contents.names.extend((file, type(node), name) for name in defined_names(node))
    return contents


def defined_names(node: ast.AST) -> list[str]:
    """Return the names that a node defines: a variable or attribute that is set, an argument, a function, a class."""
    if isinstance(node, ast.keyword | ast.alias):
        return []
    if isinstance(node, ast.Name):
        return [node.id] if isinstance(node.ctx, ast.Store) else []
    if isinstance(node, ast.Attribute):
        return [node.attr] if isinstance(node.ctx, ast.Store) else []
    return [
        name for name in (getattr(node, "arg", None), getattr(node, "name", None)) if isinstance(name, str)
    ]


def docstrings() -> Iterator[tuple[str, str]]:
    """Yield file and docstring of each module, class and function of the package, and of the code around it."""
    for folder in (SOURCE, *(DOCS / name for name in AROUND)):
        yield from contents_of(folder).docstrings


def test_no_docstring_begins_with_a_question_word():
    riddles = [f"{file}: {text}" for file, text in docstrings() if RIDDLE.match(text)]
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
    long, negations, old = [], [], []
    for file, text in docstrings():
        for sentence in sentences(text):
            if file.startswith(AROUND) and OLD.search(re.sub(r"`[^`]*`", "", sentence)):
                old.append(f"{file}: {sentence}")
            if NO_SUBJECT.search(sentence):
                negations.append(f"{file}: {sentence}")
            if len(sentence.split()) > WORDS and not EQUATION.search(sentence):
                long.append(f"{file}: {sentence}")
    assert not long, f"over {WORDS} words: {long}"
    assert not negations, f"a subject and a verb: {negations}"
    assert not old, f"a term of the field: {old}"


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
SPEECH = {"say", "tell", "ask", "hear", "want", "know", "believe", "feel"}  # of a function or an argument
NAMED = SOURCE, *(DOCS / name for name in AROUND)
FUNCTIONS, VALUES = (ast.FunctionDef, ast.AsyncFunctionDef), (ast.Name, ast.arg)


def words_of(name: str) -> set[str]:
    """Return the words of a name and the name itself, or nothing for a predicate, a test and "held_out".

    >>> sorted(words_of("FoundCompiler")), words_of("is_known")
    (['compiler', 'found', 'foundcompiler'], set())
    """
    name = name.lstrip("_")
    if name.startswith(("is_", "test_")) or "heldout" in name.lower().replace("_", ""):
        return set()
    return {word.lower() for word in (name, *re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+", name))}


def test_no_name_in_the_code_contains_a_verb_of_saying_or_is_an_adverb():
    names = {
        f"{file}: {name}"
        for folder in NAMED
        for file, kind, name in contents_of(folder).names
        if VERBS.intersection(words_of(name))
        or (kind in VALUES and ADVERBS.fullmatch(name.lstrip("_")) and name not in USUAL)
        or (folder == SOURCE and kind in (*FUNCTIONS, ast.arg) and name in SPEECH)
    }
    assert not names, f"name what it holds: {sorted(names)}"


def test_no_key_of_a_row_is_a_verb_of_saying():
    keys = {
        f"{path.relative_to(SOURCE)}: {key.value}"
        for path in python_files(SOURCE)
        for function in nodes_of(path)
        if isinstance(function, ast.FunctionDef) and re.fullmatch(r"_?(\w+_)?(row|rows|cells)", function.name)
        for row in ast.walk(function)
        if isinstance(row, ast.Dict)
        for key in row.keys
        if isinstance(key, ast.Constant) and {*str(key.value).removeprefix("is_held_").split("_")} & VERBS
    }
    assert not keys, f"name the quantity: {sorted(keys)}"


# pronouns, prepositions, adverbs and adjectives, which lack their noun
NO_NOUNS = re.compile(
    "what|who|whose|why|when|where|how|has|is|do|are|was|were|at|of|off|by|one|other|another|same|several|each|every|"
    "few|less|more|most|least|much|many|some|any|all|this|that|then|there|here|now|again|also|already|back|away|out|"
    "over|under|above|below|beyond|before|after|within|without|near|far|apart|aside|instead|because|beside|good|bad|"
    "wrong|lost|spoilt|kept|late|early|wide|similar|different|ours|theirs|way|odd"
)
ADVERBS = re.compile(
    NO_NOUNS.pattern + "|along|around|inside|until|otherwise|alone|anew|both|quiet|whole|never|seldom|hardly|"
    "together|nothing|alike|beneath|me|us|them|which|with|anyway"
)
# usual or public names
USUAL = {
    "before",
    "after",
    "now",
    "other",
    "out",
    "do",
    "lost",
    "of",
    "over",
    "when",
    "where",
    "without",
    "__all__",
}


def test_a_figure_of_a_message_is_named_by_a_noun():
    names = {
        f"{code}: {name}"
        for code, template in templates().items()
        for name in fields(template)
        if {*re.split(r"[_\[\].]", name)} & VERBS or is_without_noun(name)
    }
    assert not names, f"name the quantity: {sorted(names)}"


def is_without_noun(name):
    """Return True if the name lacks a noun, apart from its unit."""
    word = re.sub(r"_(?:n|rad|deg|m|s|s2|ms|cm|kg|hz|v|percent|std)(?=_|$)", "", name)
    return bool(NO_NOUNS.fullmatch(word) or (PAST.fullmatch(word) and word not in {*WORDS_IN_ED, "expected"}))


def test_no_code_of_a_message_is_a_verb_of_saying():
    # held out, held low
    codes = [code for code in templates() if {*re.split(r"[.-]", code)} & (VERBS - {"held"})]
    assert not codes, f"name the event or the value: {codes}"


def test_no_key_of_a_text_of_the_page_is_a_verb_of_saying():
    keys = json.loads((SOURCE / "web" / "static" / "en.json").read_text(encoding="utf-8"))
    verbs = [
        key
        for key in keys
        if {*re.split(r"[.-]", key)} & (VERBS | {"learned", "asking", "honest", "honesty"})
    ]
    assert not verbs, f"name what the text describes: {verbs}"


PAST = re.compile(r"[a-z]+ed")  # a participle alone, which lacks its verb or its noun
VALUE_PARTICIPLE = re.compile(
    PAST.pattern
    + "|broken|caught|chosen|drawn|driven|frozen|given|hidden|made|sent|shown|spent|stuck|taken|written"
)
WORDS_IN_ED = {"feed", "speed", "embed", "exceed", "seed", "red", "bed"}


def test_a_function_name_is_not_a_participle():
    participles = {
        f"{file}: {name}"
        for file, kind, name in contents_of(SOURCE).names
        if issubclass(kind, FUNCTIONS) and PAST.fullmatch(name) and name not in WORDS_IN_ED
    }
    assert not participles, f"a verb, or the quantity that is returned: {participles}"


ADJECTIVES = {
    **dict.fromkeys(
        ("autocorrelated", "closed", "contradicted", "converged", "stopped"), "True or False, or 1 or 0"
    ),
    **dict.fromkeys(("fixed", "measured"), "options of a fit, beside `free` and `per_run`"),
    "correlated": "a kind of entries, beside `collinear`",
}  # a participle that is not used as a noun, and the reason


def test_a_value_is_not_named_by_a_participle_alone():
    values = {
        (file, name)
        for folder in NAMED
        for file, kind, name in contents_of(folder).names
        if kind is ast.Name and VALUE_PARTICIPLE.fullmatch(name) and name not in {*WORDS_IN_ED, "expected"}
    }
    participles = {f"{file}: {name}" for file, name in values if name not in ADJECTIVES}
    assert not participles, f"name the quantity, such as clipped_residuals: {participles}"
    assert not ADJECTIVES.keys() - {name for _, name in values}, "remove what is not used"


FENCE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_a_name_in_an_example_is_neither_a_verb_of_saying_nor_a_participle():
    parse = doctest.DocTestParser().get_examples
    examples = [(file, example.source) for file, text in docstrings() for example in parse(text)]
    examples += [
        (page, code) for page in PAGES for code in FENCE.findall((DOCS / page).read_text(encoding="utf-8"))
    ]
    names = {
        f"{file}: {name}"
        for file, code in examples
        for node in ast.walk(ast.parse(code))
        for name in defined_names(node)
        if isinstance(node, ast.Name) and (name in VERBS or PAST.fullmatch(name)) and name not in WORDS_IN_ED
    }
    assert len(examples) > 200
    assert not names, f"name what it contains: {sorted(names)}"


PARTICIPLE = re.compile(r"_?[A-Z][a-z]+(ed|aught|old|eld|een|own|awn)")  # a word alone, which lacks its noun
TERMS = {"Unscented", "Field", "Feed", "Screen"}  # of the field, and nouns that look like one


def test_a_class_name_is_a_noun():
    participles = {
        f"{file}: {name}"
        for file, kind, name in contents_of(SOURCE).names
        if kind is ast.ClassDef and PARTICIPLE.fullmatch(name) and name.lstrip("_") not in TERMS
    }
    assert not participles, f"a participle is not a noun: {participles}"


def test_a_class_name_is_defined_once():
    files: dict[str, list[str]] = {}
    for file, kind, name in contents_of(SOURCE).names:
        if kind is ast.ClassDef:
            files.setdefault(name, []).append(str(file))
    repeated_names = {name: places for name, places in files.items() if len(places) > 1}
    assert not repeated_names, f"one name for one idea: {repeated_names}"
