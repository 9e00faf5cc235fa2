"""The house rules that a machine can check: the same commands as the pre-commit hooks."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "baqueano"
BLOCK_ROOMS = ("vehicles", "sensors", "estimators", "guides", "controllers")
DOORS = {"time", "os", "random", "datetime", "pathlib", "io", "sys", "socket", "threading"}


def run(*command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, encoding="utf-8"
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]


def test_code_is_formatted():
    run("ruff", "format", "--check", ".")


def test_code_passes_the_linter():
    run("ruff", "check", ".")


def test_every_signature_is_typed():
    run("pyright", "--warnings")


def test_nothing_imports_upward():
    run("importlinter.cli", "lint")


@pytest.mark.parametrize("room", BLOCK_ROOMS)
def test_blocks_open_no_door_to_the_outside(room):
    for path in (SOURCE / room).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            taken = {name.split(".")[0] for name in names} & DOORS
            assert not taken, (
                f"{path.relative_to(ROOT)} line {node.lineno} imports {taken}: time comes with the signal"
            )


def test_no_file_needs_a_tour():
    long = {
        str(path.relative_to(ROOT)): lines
        for path in SOURCE.rglob("*.py")
        if (lines := path.read_text(encoding="utf-8").count("\n")) > 400
    }
    assert not long, f"longer than 400 lines, so two ideas: {long}"


def test_importing_the_package_loads_neither_scipy_nor_matplotlib():
    heavy = ["scipy", "matplotlib", "jinja2", "rich", "tomlkit", "rosbags", "mcap"]
    code = f"import sys, baqueano; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
