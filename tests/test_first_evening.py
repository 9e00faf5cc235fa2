"""The code of the tutorial and of the course runs, and both languages show the output of the programs."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[1] / "docs"
FOLDERS = {"en": DOCS, "es": DOCS / "es"}
FILES = {  # page → number of its runs, and files that its commands write
    "first-evening": (6, {"fit.html", "vehicle.toml", "first_evening.ipynb"}),
    "course": (18, {"hidden.toml", "pd.toml", "late.toml", "vehicle.toml"}),
}
EXIT_CODE = re.compile(r"#.*(?:exit code|código de salida) (\d)")  # in the comment of a command
NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")


def shape(line):
    """Return a line without its figures and column widths, which depend on the machine."""
    return " ".join(NUMBER.sub("0", line).split())


def commands_of(kind, text):
    """Return the arguments of Python, and the exit code, for each command of a block."""
    if kind == "python":
        return [(["-c", text], 0)]
    codes = [EXIT_CODE.search(line) for line in text.splitlines()]
    lines = [shlex.split(line, comments=True) for line in text.splitlines()]
    return [(["-m", *line], int(code[1]) if code else 0) for line, code in zip(lines, codes, strict=True)]


@pytest.fixture(scope="module", params=[f"{page} {language}" for page in FILES for language in FOLDERS])
def evening(request, tmp_path_factory):
    """Type the commands of a page in their order; return page, folder, and (printed text, text on the page).

    Those of the Spanish page are the same, so it is enough to type them until the last output on the page.
    """
    page, language = request.param.split()
    folder, output, pairs = tmp_path_factory.mktemp("evening"), "", []
    markdown = (FOLDERS[language] / f"{page}.md").read_text(encoding="utf-8")
    fences = re.findall(r"^```(\w+)\n(.*?)^```$", markdown, re.MULTILINE | re.DOTALL)
    if language == "es":
        last = max(k for k, (kind, _) in enumerate(fences) if kind == "text")
        fences = fences[: last + 1]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8", "BAQUEANO_LANG": language}
    for kind, text in fences:
        if kind == "text":
            pairs.append((output, text))
            continue
        for arguments, exit_code in commands_of(kind, text):
            if arguments[1] == "cd":
                folder = folder / arguments[2]
                continue
            result = subprocess.run(
                [sys.executable, *arguments],
                cwd=folder,
                env=environment,
                capture_output=True,
                encoding="utf-8",
            )
            assert result.returncode == exit_code, f"{arguments}: {result.stderr[-2000:]}"
            output += result.stdout + result.stderr
    return page, folder, pairs


@pytest.mark.parametrize("evening", [f"{page} en" for page in FILES], indirect=True)
def test_every_command_of_the_page_runs_and_writes_its_files(evening):
    page, folder, _ = evening
    runs, files = FILES[page]
    assert len(list((folder / "runs").glob("*.mcap"))) == runs
    assert files <= {path.name for path in folder.iterdir()}
    assert (folder / "routes" / "lap.csv").exists()


def test_the_page_shows_the_output_of_the_commands(evening):
    _, _, pairs = evening
    assert len(pairs) > 2
    for output, text in pairs:
        lines = {shape(line) for line in output.splitlines()}
        assert not [line for line in text.splitlines() if shape(line) not in lines]
