"""The README moves its one picture, and installs as the tutorial does, with extras that exist."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, ROOT / "README.es.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXTRAS = re.compile(r"(?:\.|baqueano)\[([a-z,]+)\]")
FENCE = re.compile(r"^```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ACTIVATE = {"PowerShell": ".venv\\Scripts\\Activate.ps1", "POSIX": "source .venv/bin/activate"}
ALLOW = "Set-ExecutionPolicy -Scope Process RemoteSigned"


def blocks(page: Path) -> list[list[str]]:
    """Return the lines of each block of code."""
    return [block.splitlines() for block in FENCE.findall(page.read_text(encoding="utf-8"))]


def test_the_readme_contains_one_picture_and_it_is_animated():
    pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README.read_text(encoding="utf-8"))
    assert pictures == ["docs/pictures/demo.svg"]
    picture = (ROOT / pictures[0]).read_text(encoding="utf-8")
    names = set(re.findall(r"@keyframes (\w+)", picture))
    animations_used = set(re.findall(r"animation:\s*(\w+) ", picture)) - {"none"}
    assert animations_used
    assert animations_used <= names, "an animation without keyframes stands still"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_installs_only_extras_that_exist(page):
    existing = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    animation_names = {
        extra for extras in EXTRAS.findall(page.read_text(encoding="utf-8")) for extra in extras.split(",")
    }
    assert animation_names <= set(existing["optional-dependencies"])


def test_the_readme_installs_extras():
    assert EXTRAS.findall(README.read_text(encoding="utf-8"))


@pytest.mark.parametrize("system", ACTIVATE)
@pytest.mark.parametrize("page", ["docs/first-evening.md", "docs/es/first-evening.md"])
def test_the_tutorial_installs_with_the_lines_of_the_readme(system, page):
    (expected,) = [lines for lines in blocks(README) if ACTIVATE[system] in lines]
    (lines,) = [lines for lines in blocks(ROOT / page) if ACTIVATE[system] in lines]
    assert [*lines, "baqueano demo"] == expected


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_that_activates_in_powershell_permits_the_script(page):
    text = page.read_text(encoding="utf-8")
    assert ACTIVATE["PowerShell"] not in text or ALLOW in text
