"""The code of the tutorial runs completely, and the page of each language shows the output of the programs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

DOCS = Path(__file__).parents[1] / "docs"
PAGES = {"en": DOCS / "first-evening.md", "es": DOCS / "es" / "first-evening.md"}
NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")


def shape(line):
    """Return a line without its figures and column widths, which depend on the machine."""
    return " ".join(NUMBER.sub("0", line).split())


@pytest.fixture(scope="module", params=sorted(PAGES))
def evening(request, tmp_path_factory):
    """Type the commands of the page in their order; return the folder, and (printed text, text on the page).

    Those of the Spanish page are the same, so it is enough to type them until the last output on the page.
    """
    folder, printed, pairs = tmp_path_factory.mktemp("evening"), "", []
    page = PAGES[request.param].read_text(encoding="utf-8")
    fences = re.findall(r"^```(\w+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    if request.param == "es":
        last = max(k for k, (kind, _) in enumerate(fences) if kind == "text")
        fences = fences[: last + 1]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8", "BAQUEANO_LANG": request.param}
    for kind, text in fences:
        if kind == "text":
            pairs.append((printed, text))
            continue
        lines = [("-c", text)] if kind == "python" else [line.split() for line in text.splitlines()]
        for line in lines:
            if line[0] == "cd":
                folder = folder / line[1]
                continue
            arguments = line if kind == "python" else ("-m", *line)
            done = subprocess.run(
                [sys.executable, *arguments],
                cwd=folder,
                env=environment,
                capture_output=True,
                encoding="utf-8",
            )
            assert done.returncode == 0, f"{line}: {done.stderr[-2000:]}"
            printed += done.stdout + done.stderr
    return folder, pairs


@pytest.mark.parametrize("evening", ["en"], indirect=True)
def test_every_command_of_the_first_evening_page_runs_and_writes_its_files(evening):
    folder, _ = evening
    assert len(list((folder / "runs").glob("*.mcap"))) == 6
    assert {"fit.html", "vehicle.toml", "first_evening.ipynb"} <= {path.name for path in folder.iterdir()}
    assert (folder / "routes" / "lap.csv").exists()


def test_the_page_shows_the_output_of_the_commands(evening):
    _, pairs = evening
    assert len(pairs) > 2
    for printed, text in pairs:
        lines = {shape(line) for line in printed.splitlines()}
        assert not [line for line in text.splitlines() if shape(line) not in lines]
