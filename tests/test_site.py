"""The documents as a site in two languages: every page exists in both, with the same code and equations."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

from docs.site.reference import ROOMS
from tests.web.chromium import CHROMIUM, SIZES, Chromium

ROOT = Path(__file__).parents[1]
DOCS, SPANISH = ROOT / "docs", ROOT / "docs" / "es"


def names_of(folder):
    """Return the names of the pages of a language, such as "robot" and "derivations/kalman"."""
    paths = (*folder.glob("*.md"), *(folder / "derivations").glob("*.md"))
    return sorted(path.relative_to(folder).with_suffix("").as_posix() for path in paths)


NAMES = names_of(DOCS)
TWINS = {"the README": (ROOT / "README.md", ROOT / "README.es.md")} | {
    name: (DOCS / f"{name}.md", SPANISH / f"{name}.md") for name in NAMES
}
OTHER_SPANISH_WORDS = (  # for sintonizar, valores verdaderos, cambio brusco, joystick
    r"\bajust\w+ (las |sus |los )?ganancias", r"\b(la|una) verdad\b", r"\bsacudidas\b", r"con un mando\b",
)  # fmt: skip
UNREACHABLE = """[...document.querySelectorAll(".equation")].filter((one) => {
  const left = one.getBoundingClientRect().left - one.scrollLeft;
  const ends = [...one.querySelectorAll("*")].map((part) => part.getBoundingClientRect().right);
  return Math.max(...ends) - left > one.scrollWidth + 16;
}).map((one) => one.textContent.trim().slice(0, 40))"""  # equations whose end no scrolling shows
needs_sphinx = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("sphinx", "myst_parser", "furo")),
    reason="the site needs the extra docs: pip install '.[docs]'",
)


def blocks(page):
    """Return (language, text) of each block of code, without comments and the words of drawings."""
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [(kind, without_comments(text)) for kind, text in fences]


def without_comments(text):
    """Return the code without its comments."""
    return [line for line in (re.sub(r"(^|\s+)#.*", "", line).rstrip() for line in text.splitlines()) if line]


def method_code(page):
    """Return the blocks without output of programs, whose words tests/test_printed_output.py compares."""
    return [block for block in blocks(page) if block[0] != "text"]


def headings(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    lines = re.findall(r"^#+ .*", text, re.MULTILINE)
    assert not [line for line in lines if len(line) > 80], f"{page}: a heading has a line of its own"
    return [len(line.split()[0]) for line in lines]


def equations(page):
    """Return the displayed equations of a page in order, and the others; without words, and with decimal points."""
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"\\(?:text|mathrm)\{[^}]*\}", "", text.replace("{,}", "."))
    displayed_equation = re.compile(r"\$\$.*?\$\$", re.DOTALL)
    return displayed_equation.findall(text), set(re.findall(r"\$[^$\n]+\$", displayed_equation.sub("", text)))


def paragraphs(page):
    """Return how many parts a page has: paragraphs, list entries, tables and blocks of code."""
    text = re.sub(r"^```.*?^```$", "\n\ncode\n\n", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return len([part for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text) if part.strip()])


def table_rows(page):
    return len(re.findall(r"^\|", page.read_text(encoding="utf-8"), re.MULTILINE))


def test_every_page_exists_in_both_languages():
    assert names_of(SPANISH) == NAMES


@pytest.mark.parametrize("name", TWINS)
def test_a_page_has_the_same_structure_in_both_languages(name):
    english, spanish = TWINS[name]
    assert method_code(spanish) == method_code(english)
    assert headings(spanish) == headings(english)
    assert equations(spanish) == equations(english)
    assert table_rows(spanish) == table_rows(english)
    assert paragraphs(spanish) == paragraphs(english)


@pytest.mark.parametrize("name", TWINS)
def test_a_spanish_page_links_to_spanish_pages_and_has_decimal_commas(name):
    page = TWINS[name][1]
    text = page.read_text(encoding="utf-8")
    english_pages = {english for english, _ in TWINS.values()}
    for link in re.findall(r"\]\(([^)\s#]+)[^)\s]*\)", text):
        if link.startswith("http"):
            continue
        target = (page.parent / link).resolve()
        assert target.exists(), link
        assert target not in english_pages, f"{link}: this page exists in Spanish"
    prose = re.sub(r"^```.*?^```$|`[^`\n]*`|\]\([^)]*\)|\[[^\]]*\]", "", text, flags=re.M | re.S)
    assert not re.findall(
        r"(?<![\w.])\d+\.\d+(?![\w.]) (?:m|s|cm|mm|ms|V|A|°|%|N|kg|GHz|kΩ|dólares)\b", prose
    )


@pytest.mark.parametrize("word", OTHER_SPANISH_WORDS)
def test_one_idea_has_one_spanish_word(word):
    """Pages and messages use the same words: a reader of `tune --help` searches for its word on the pages."""
    pages = {
        path.name: path.read_text(encoding="utf-8")
        for path in (*SPANISH.rglob("*.md"), TWINS["the README"][1])
    }
    messages = {path.name: path.read_text(encoding="utf-8") for path in ROOT.glob("*/**/*.po")}
    assert not [name for name, text in (pages | messages).items() if re.search(word, text, re.IGNORECASE)]


def test_the_glossaries_have_the_same_terms():
    def rows(page):
        text = page.read_text(encoding="utf-8")
        return [
            [cell.strip() for cell in line.split("|")[1:5]]
            for line in text.splitlines()
            if line.startswith("| ")
        ]

    english, spanish = rows(DOCS / "glossary.md")[1:], rows(SPANISH / "glossary.md")[1:]
    assert {(row[0], row[1]) for row in english} == {(row[1], row[0]) for row in spanish}
    terms = [row[0].lower() for row in spanish]
    assert terms == sorted(terms, key=lambda word: word.translate(str.maketrans("áéíóúñ", "aeioun")))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the whole site; a warning is an error."""
    if find_spec("sphinx") is None:
        pytest.skip("the site needs the extra docs: pip install '.[docs]'")
    out = tmp_path_factory.mktemp("site") / "site"
    result = subprocess.run(
        [sys.executable, "-m", "docs.site", str(out)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr[-3000:]
    assert "WARNING" not in result.stderr
    return out


class AddressReader(HTMLParser):
    """Collects the addresses that a browser loads without a click, and the targets of links."""

    def __init__(self):
        super().__init__()
        self.fetched, self.links = list[str](), list[str]()

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag in ("script", "img", "iframe", "source"):
            self.fetched.append(attributes.get("src") or "")
        elif tag == "link":
            self.fetched.append(attributes.get("href") or "")
        elif tag == "a":
            self.links.append(attributes.get("href") or "")


def page_parts(page):
    reader = AddressReader()
    reader.feed(page.read_text(encoding="utf-8"))
    return reader


@needs_sphinx
def test_the_site_needs_no_network_and_has_no_dead_link(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        parts = page_parts(page)
        assert not [address for address in parts.fetched if re.match(r"(https?:)?//", address)], page
        for link in (*parts.fetched, *parts.links):
            path = re.sub(r"[#?].*", "", link)
            if path and not re.match(r"[a-z]+:", path):
                assert (page.parent / path).exists(), f"{page.relative_to(site)}: {link}"
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\(\s*['\"]?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet


@needs_sphinx
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
def test_on_a_phone_every_equation_can_be_scrolled_to_its_end(site):
    """No page is wider than a phone; what is wider scrolls by itself; a table of sentences names its columns."""
    pages = [site / "es" / "glossary.html", *sorted((site / "derivations").glob("*.html"))]
    with Chromium() as browser:
        tab = browser.tab()
        tab.size(*SIZES["phone"])
        for page in pages:
            tab.goto(page.as_uri())
            assert tab.js("document.documentElement.scrollWidth") == SIZES["phone"][0], page
            assert tab.js(UNREACHABLE) == [], page
        tab.goto(pages[0].as_uri())
        heading_js = "getComputedStyle(document.querySelector('.cards td:nth-child(2)'), '::before').content"
        assert "English" in tab.js(heading_js)


@needs_sphinx
def test_every_page_links_to_its_other_language(site):
    for name in NAMES:
        page, up = "index" if name == "README" else name, "../" * name.count("/")
        assert f"{up}es/{page}.html" in page_parts(site / f"{page}.html").links
        assert f"../{up}{page}.html" in page_parts(site / "es" / f"{page}.html").links


@needs_sphinx
def test_the_reference_describes_the_public_names(site):
    import baqueano as bq

    door = (site / "reference/baqueano.html").read_text(encoding="utf-8")
    functions = [name for name in bq.__all__ if callable(getattr(bq, name))]
    assert len(functions) > 15
    assert not [name for name in functions if f'id="baqueano.{name}"' not in door]
    assert "rad per unit of u" in (site / "reference/vehicles.html").read_text(encoding="utf-8")


@needs_sphinx
def test_the_spanish_reference_describes_each_function_of_the_front_door(site):
    import baqueano as bq

    page = site / "es/reference/baqueano.html"
    door = page.read_text(encoding="utf-8")
    functions = [name for name in bq.__all__ if not isinstance(getattr(bq, name), ModuleType)]
    assert not [name for name in functions if f'id="baqueano.{name}"' not in door]
    assert "Repite una ruta con los bloques del archivo." in door
    assert "Return " not in door
    contents = (site / "es/reference/index.html").read_text(encoding="utf-8")
    assert not [
        about for about in ROOMS.values() if f">{about}<" in contents.replace("<p>", "").replace("</p>", "")
    ]
    links = {link.rstrip("#") for link in page_parts(page).links}
    assert {"../../reference/baqueano.html", "../../reference/estimators.html"} <= links
    assert "../es/reference/baqueano.html" in page_parts(site / "reference/baqueano.html").links


@needs_sphinx
@pytest.mark.parametrize("name", ["blocks", "signals", "contracts.blocks", "compare", "report"])
def test_a_block_and_its_results_are_described_in_spanish(site, name):
    text = (site / f"es/reference/{name}.html").read_text(encoding="utf-8")
    assert not re.search(r">(Return|Protocol|Time) ", text)
    assert f'id="baqueano.{name}.' in text


@needs_sphinx
def test_an_entry_that_cites_equations_of_its_module_shows_them(site):
    text = re.sub(r"<[^>]*>", "", (site / "reference/estimators.html").read_text(encoding="utf-8"))
    assert "ν = ν̄ + L ((z + n − h(0) − b)/(1 + s) − H ν̄)" in text


@needs_sphinx
def test_the_search_index_of_each_language_contains_its_words(site):
    assert "first-evening" in (site / "searchindex.js").read_text(encoding="utf-8")
    spanish = (site / "es/searchindex.js").read_text(encoding="utf-8")
    assert "corrid" in spanish
    assert "glossary: 4" in (site / "es/_static/language_data.js").read_text(
        encoding="utf-8"
    )  # its order of pages


@needs_sphinx
def test_the_theme_of_a_spanish_page_is_in_spanish(site):
    from docs.site.build import THEME_TEXTS, theme_in

    page = (site / "es/robot.html").read_text(encoding="utf-8")
    assert theme_in(page, "es") == page
    assert ">Siguiente<" in page
    assert "Toggle" not in page
    assert ">Next<" in (site / "robot.html").read_text(encoding="utf-8")
    assert theme_in('<a title="Home"> Next </a>', "es") == '<a title="Inicio"> Siguiente </a>'
    assert len(THEME_TEXTS["es"]) == len(set(THEME_TEXTS["es"].values()))


@needs_sphinx
def test_equations_are_written_as_mathml():
    from docs.site.mathematics import mathml

    mathematics = mathml(r"\dot\nu = f(\nu, u) \tag{3}", True)
    assert "<math" in mathematics
    assert ">(3)<" in mathematics
    assert "tag" not in mathematics
    assert "<mn>0,2</mn>" in mathml(r"e^{0{,}2\,n}", False)
    assert "<msub>" in mathml(r"\dot e_y", False)


@pytest.mark.skipif(find_spec("docutils") is None, reason="the site needs the extra docs")
def test_a_docstring_is_converted_to_markdown():
    from docs.site.docstring import markdown

    text = markdown(
        "Return *x*_1 of `a_b`: docs/derivations/kalman.md\n\n    P = G P\n\n    R = 1\n\n"
        "Parameters\n----------\nrun : Run\n    One drive.\n"
        "\nExamples\n--------\n>>> 1 + 1\n2\n"
    )
    assert r"\*x\*\_1 of `a_b`: [docs/derivations/kalman.md](../derivations/kalman.md)" in text
    assert "```text\nP = G P\n\nR = 1\n```" in text
    assert "- `run`, Run: One drive." in text
    assert "```pycon\n>>> 1 + 1\n2\n```" in text
