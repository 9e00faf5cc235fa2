"""A page shows what the program prints in the language of the page: the texts are those of the catalogue."""

import re
from functools import cache
from pathlib import Path

import pytest

from baqueano.messages.language import shown_unit, use_language
from tests.catalogues import read_catalogue

DOCS = Path(__file__).parents[1] / "docs"
FOLDERS = {"en": DOCS, "es": DOCS / "es"}
PAGES = [
    (language, path.name)
    for language, folder in FOLDERS.items()
    for path in sorted(folder.glob("*.md"))
    if "```text\n" in path.read_text(encoding="utf-8")
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FIELD = re.compile(r"\{(?:[^{}]|\{[^{}]*\})*\}")
FIGURE = re.compile(r"\d+(?:[.,]\d+)?")
CODE = re.compile(r"\S*[\w.…][_./=\[-]\S*|--\S+")  # paths, keys, options
LETTERS = 6  # that a template needs beside its fields: fewer would match any text
QUOTE = re.compile(
    r'"([^"\n]{4,160})"|«([^»\n]+)»|(?<![*\w])\*([^*|\n]{3,160})\*(?!\*)|`([a-z]+ [^`\n]*)`|\b([A-Z]{4,})\b'
)
DISPLAY = re.compile(r"[a-z]+ [\w +,.]+")  # a line of the screen; other spans in backticks are code
STATES = {"READY", "STOPPED"}  # of the service, which `robot status` prints in every language


@cache
def texts(language: str) -> list[str]:
    """Return all texts that the program prints in a language."""
    entries = [entry for entry in read_catalogue("es") if entry.id and isinstance(entry.id, str)]
    return [str(entry.id if language == "en" else entry.string) for entry in entries]


@cache
def templates(language: str) -> list[re.Pattern[str]]:
    """Return the patterns of the texts with fields."""
    parts = [FIELD.split(text.strip()) for text in texts(language) if FIELD.search(text)]
    return [
        re.compile("(.+?)".join(map(re.escape, pieces)))
        for pieces in parts
        if sum(character.isalpha() for character in "".join(pieces)) >= LETTERS
    ]


def printed_in(language: str, cell: str) -> bool:
    """Return if the program prints this part of a line in a language."""
    with use_language(language):
        unit = shown_unit("N per unit of u").removeprefix("N ")
    words = CODE.sub("", cell.replace(unit, ""))
    if not re.search(r"[^\W\d]{4,}", words) or cell in texts(language):
        return True
    if any(pattern.fullmatch(cell) for pattern in templates(language)):
        return True
    if cell[0] + cell[-1] == "()":
        return all(printed_in(language, part) for part in cell[1:-1].split(", "))
    head, colon, reason = cell.partition(": ")
    return bool(colon) and printed_in(language, head) and printed_in(language, reason)


def outputs(language: str, page: str) -> list[list[str]]:
    """Return the cells of each block of output on a page, each cell with its further lines."""
    text = (FOLDERS[language] / page).read_text(encoding="utf-8")
    return [block_cells(block) for kind, block in FENCE.findall(text) if kind == "text"]


def block_cells(block: str) -> list[str]:
    """Return the cells of a block; a line below the last cell of a table is the rest of this cell."""
    cells: list[str] = []
    last_column = 0
    for line in block.splitlines():
        if last_column and len(line) - len(line.lstrip()) == last_column:
            cells[-1] += " " + line.strip()
            continue
        cells += re.split(r" {2,}", line.strip())
        last_column = line.rindex("  ") + 2 if "  " in line.strip() else 0
    return cells


@pytest.mark.parametrize(("language", "page"), PAGES)
def test_output_on_a_page_is_printed_by_the_program_in_this_language(language, page):
    cells = [cell for block in outputs(language, page) for cell in block]
    assert [cell for cell in cells if not printed_in(language, cell)] == []


@pytest.mark.parametrize("page", sorted({page for _, page in PAGES}))
def test_output_has_the_same_figures_in_both_languages(page):
    def figures(language):
        return [
            [figure.replace(",", ".") for cell in block for figure in FIGURE.findall(cell)]
            for block in outputs(language, page)
        ]

    assert figures("es") == figures("en")


def test_a_further_line_of_the_last_cell_belongs_to_it():
    block = "gyro_scale   0.98  the true rotation\n                   is 1.02\n  heading  20\n"
    assert block_cells(block) == ["gyro_scale", "0.98", "the true rotation is 1.02", "heading", "20"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "LOCALIZED: after 3 laps the estimator expects errors within ± 5.2 cm across the path, "
            "± 31° in heading (95 %)",
            False,
        ),
        (
            "LOCALIZADO: después de 3 vueltas el estimador espera errores dentro de ± 5,2 cm a los lados del camino, "
            "± 31° de rumbo (95 %)",
            True,
        ),
        ("N m per unit of u", False),
        ("N m por unidad de u", True),
        ("/dev/serial/by-id/usb-…", True),
    ],
)
def test_english_output_on_a_spanish_page_is_detected(line, expected):
    assert printed_in("es", line) is expected


def is_printed(language: str, quote: str) -> bool:
    """Return if a text contains this quote; one word must be a whole text."""
    return any(quote in text if " " in quote else quote == text for text in texts(language))


@pytest.mark.parametrize(
    "page",
    [
        path.name
        for path in sorted(FOLDERS["es"].glob("*.md"))
        if path.stem not in ("glossary", "vehicle-file")
    ],
)
def test_a_spanish_page_does_not_quote_english_output(page):
    text = FENCE.sub("", (FOLDERS["es"] / page).read_text(encoding="utf-8"))
    prose = re.sub(r"`([^`\n]*)`", lambda span: span[0] if DISPLAY.fullmatch(span[1]) else "", text)
    quotes = {next(filter(None, groups)) for groups in QUOTE.findall(prose)} - STATES
    assert [quote for quote in quotes if is_printed("en", quote) and not is_printed("es", quote)] == []
