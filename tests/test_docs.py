"""The documents agree with the code."""

import os
import re
from pathlib import Path

import pytest

import baqueano as bq
from baqueano.cli import baqueano
from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.messages.language import use_language
from docs.vehicle_file_keys import reference_table

ROOT = Path(__file__).parents[1]
DRAWINGS = ("path", "errors", "speed", "commands", "sensors", "estimates", "data", "residuals", "correlation", "runs",
            "search", "corridor")  # fmt: skip


@pytest.mark.parametrize(
    ("language", "page"), [("en", "docs/vehicle-file.md"), ("es", "docs/es/vehicle-file.md")]
)
def test_the_reference_of_the_vehicle_file_is_current(language, page):
    """To renew both pages: `make golden`, and read the diff."""
    with use_language(language):
        table = reference_table()
    if os.environ.get("REGENERATE"):
        (ROOT / page).write_text(table, encoding="utf-8")
    assert (ROOT / page).read_text(encoding="utf-8") == table, "type: make golden, and read the diff"


def test_the_ten_lines_of_the_readme_run_and_print_the_fit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = (
        re.findall(r"```python\n(.*?)```", readme, re.DOTALL)[0]
        .replace("60.0", "20.0")
        .replace("laps=3", "laps=1")
    )
    exec(compile(lines, "README.md", "exec"), {})
    output = capsys.readouterr().out
    assert "friction.linear[0]" in output
    assert "across the path" in output


def method_code(page):
    """The code of a page, in order."""
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def test_the_code_of_the_page_on_python_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = "docs/python.md"
    exec(compile("\n".join(method_code(page)), page, "exec"), {"__name__": "page"})
    output = capsys.readouterr().out
    assert "USABLE" in output
    assert "dead reckoning, " in output
    assert {"errors.pdf", "fit.html", "figures"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize("page", ["docs/sweep.md", "docs/es/sweep.md"])
def test_the_page_on_sweeps_names_every_figure(page):
    from baqueano.sweep.figures import RMS_FIGURES, SINGLE_FIGURES

    text = (ROOT / page).read_text(encoding="utf-8")
    assert {name for name in (*RMS_FIGURES, *SINGLE_FIGURES) if f"`{name}`" not in text} == set()


def test_the_code_of_the_page_on_sweeps_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    exec(compile(method_code("docs/sweep.md")[0], "docs/sweep.md", "exec"), names)
    assert len(names["frame"]) == 12
    assert "kanayama" in capsys.readouterr().out


@pytest.mark.parametrize("page", ["docs/python.md", "docs/es/python.md"])
def test_the_page_on_python_lists_every_public_name_and_plot(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    assert {name for name in bq.__all__ if f"`{name}`" not in text} == set()
    assert {name for name in DRAWINGS if f"`{name}`" not in text} == set()


def options_of(command):
    """Return all options of a command and of its subcommands."""
    w = {option for param in command.params for option in (*param.opts, *param.secondary_opts)}
    return w.union(*(options_of(subcommand) for subcommand in getattr(command, "commands", {}).values()))


PAGES = (
    "README.md",
    "README.es.md",
    "CHANGELOG.md",
    *(path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs").rglob("*.md"))),
)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_only_existing_commands_and_options(page):
    verbs = {name: load_command(name) for name in SUBCOMMANDS}
    options = options_of(baqueano).union(*map(options_of, verbs.values()))
    text = (ROOT / page).read_text(encoding="utf-8")
    assert {
        option for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", text) if option not in options
    } == set()
    lines = re.findall(r"(?:`|^)baqueano ([a-z][^`\n]*)", text, re.MULTILINE)
    for verb, *rest in map(str.split, lines):
        assert verb in verbs, f"{page}: there is no baqueano {verb}"
        subcommands = set(getattr(verbs[verb], "commands", ()))
        names = {word for before, word in zip(["·", *rest], rest, strict=False) if before == "·"}
        assert not subcommands or names <= subcommands, (
            f"{page}: baqueano {verb} has no {' or '.join(names - subcommands)}"
        )
        assert {word for word in rest if word.startswith("--")} <= options_of(verbs[verb]), (
            f"{page}: baqueano {verb} {rest}"
        )


@pytest.mark.parametrize(("page", "heading"), [("page.md", "## Security"), ("es/page.md", "## Seguridad")])
def test_each_security_row_of_the_page_names_existing_tests(page, heading):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8").partition(heading)[2]
    rows = [line for line in text.splitlines() if line.startswith("| ")][1:]
    assert len(rows) >= 16
    tests = "\n".join(
        path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("test_*.py"))
    )
    for row in rows:
        names = re.findall(r"`(test_\w+)`", row)
        assert names, row
        assert {name for name in names if f"def {name}(" not in tests} == set()


def test_every_erratum_named_in_the_code_is_listed_in_the_errata():
    errata_numbers = set(
        re.findall(r"^\| (\d+) \|", (ROOT / "docs/errata.md").read_text(encoding="utf-8"), re.MULTILINE)
    )
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py")]
    names = [
        re.findall(r"\d+", number) for text in texts for number in re.findall(r"[Ee]rrat\w+ ([\d, ]+)", text)
    ]
    assert len(names) > 10
    assert set().union(*names) <= errata_numbers


def anchors(page):
    """Return the anchor of each heading, which a link may name after #."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES)
def test_every_link_of_a_page_has_an_existing_target(page):
    page_file = ROOT / page
    for link in re.findall(r"\]\(([^)\s]+)\)", page_file.read_text(encoding="utf-8")):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = (page_file.parent / path).resolve() if path else page_file
        assert target.exists(), f"{page}: there is no {link}"
        assert not anchor or anchor in anchors(target), f"{page}: {target.name} has no heading {anchor}"


def test_the_glossary_is_sorted_and_links_to_existing_pages():
    text = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:5] for line in text.splitlines() if line.startswith("| ")][1:]
    terms = [row[0].strip().lower() for row in rows]
    assert terms == sorted(terms)
    for row in rows:
        assert all(cell.strip() for cell in row), row
        assert (ROOT / "docs" / re.findall(r"\((.*?)\)", row[3])[0]).exists(), row


@pytest.mark.parametrize("page", ["estimators.md", "es/estimators.md"])
def test_the_page_on_estimators_refers_to_the_page_of_measured_figures(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert [row for row in rows if len(re.findall(r"(?<![\w.])\d+[.,]\d", row)) > 2] == []
    assert len(re.findall(r"\]\(benchmarks\.md#", text)) == 5


PLAIN = str.maketrans("áéíóú", "aeiou")
LESS = {"the", "con", "del"}


def uses(term, page):
    """Return if a page uses each word of a term, in any form: the first five letters of each word count."""
    text = page.read_text(encoding="utf-8").lower().translate(PLAIN)
    words = set(re.findall(r"[\w-]{3,}", term.lower().translate(PLAIN))) - LESS
    return all(word[:5] in text for word in words)


@pytest.mark.parametrize("page", ["glossary.md", "es/glossary.md"])
def test_a_term_of_the_glossary_is_used_on_the_page_that_its_row_names(page):
    glossary = ROOT / "docs" / page
    rows = [
        line.split("|")[1:5] for line in glossary.read_text(encoding="utf-8").splitlines() if "](" in line
    ]
    assert len(rows) > 80
    for term, translation, _meaning, link in rows:
        target = (glossary.parent / re.findall(r"\((.*?)\)", link)[0]).resolve()
        uses_own = uses(term, target)
        assert uses_own or ("es/" in page and uses(translation, target)), f"{term}: not on {target.name}"


TERMS = {  # of the pages, which are not in a first-year textbook
    "augmented", "autocorrelat", "backlash", "brown-out", "clock offset", "clothoid", "collinear", "cornering",
    "corridor", "coulomb", "covariance", "cramér-rao", "cross-track", "curvature", "d-optimal", "dead man",
    "dead reckoning", "dead zone", "encoder", "estimator", "excitation", "feed-forward", "gauss-newton",
    "held-out", "huber", "innovation", "jackknife", "kalman", "kinematic", "latched", "lever arm", "likelihood",
    "mark", "multiple shooting", "odometer", "pose gate", "prior", "process noise",
    "residual", "runge-kutta", "sandwich", "score test", "sensitivit", "skid-steered", "slew", "slip",
    "smooth", "student", "tag", "unscented", "watchdog", "white noise", "jerk",
    "open loop", "outlier", "χ² test",
}  # fmt: skip


def test_a_term_that_the_pages_use_is_in_the_glossary():
    sources = [path for path in (*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/derivations").glob("*.md"))]
    pages = "\n".join(path.read_text(encoding="utf-8") for path in sources if path.stem != "glossary").lower()
    text = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    terms = "\n".join(line.split("|")[1].lower() for line in text.splitlines() if line.startswith("| "))

    def begins_a_word(term, text):
        return re.search(rf"(?<!\w){re.escape(term)}", text) is not None

    assert {term for term in TERMS if not begins_a_word(term, pages)} == set(), "a term that no page uses"
    assert {term for term in TERMS if not begins_a_word(term, terms)} == set(), "add it to both glossaries"


NOT_TERMS = """
AD0 AP ARM CPM CSV DART DHCP DNS EEPROM ENA ENB GB GBP GND GPIO GPS HTML HTTP IGMP IN1 IN4 JAX JSON LB LED MB NTP OUT
PC QR RAM RB RFID ROS RX SCL SD SDA SI STBY TLS TT TX USB VCC VM WPA2 WPA3 BALANCED CONFIG DEGRADED DRIVE GET GUESS
HEAD HOST NAME ON PREPARING README READY RESET RUNS SETTINGS STOP STOPPED UNBALANCED US
"""  # products, pins, units, any computer; words that a person types or reads


def test_each_abbreviation_of_the_pages_is_in_the_glossary():
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs/derivations").glob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages if page.stem != "glossary")
    prose = re.sub(r"```.*?```|`[^`\n]*`|\*\*.*?\*\*|\]\([^)]*\)", " ", text, flags=re.DOTALL)
    glossary = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    abbreviations_used = set(re.findall(r"(?<![\w-])[A-Z]{2,}\d?(?![\w-])", prose))
    assert abbreviations_used - set(NOT_TERMS.split()) - set(re.findall(r"[A-Z]{2,}\d?", glossary)) == set()
