"""Every benchmark runs to its end at its smallest size and prints finite numbers. No speed is asserted.

A benchmark is a module of benchmarks/ with `benches`, for `python -m benchmarks NAME`, or with `main`, for
`python -m benchmarks.NAME`. Every other module there must be imported by one of these.
"""

import ast
import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from benchmarks.__main__ import BENCHES

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[1]
PATIENCE_S = 300.0  # timeout of a benchmark
TREES = {
    path.stem: ast.parse(path.read_text(encoding="utf-8"))
    for path in sorted((ROOT / "benchmarks").glob("*.py"))
    if not path.stem.startswith("__")
}


def with_function(name: str) -> list[str]:
    """Return the benchmark modules that define this function."""
    return [
        module
        for module, tree in TREES.items()
        if any(isinstance(node, ast.FunctionDef) and node.name == name for node in tree.body)
    ]


@cache
def run_module(*words: str) -> tuple[str, str]:
    """Return what a command printed at the smallest size, and its messages."""
    result = subprocess.run(
        [sys.executable, "-m", *words, "--smallest"], cwd=ROOT, capture_output=True, text=True,
        encoding="utf-8", timeout=PATIENCE_S, env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout, result.stderr


def refuse_constant(number: str) -> float:
    raise AssertionError(f"a row holds {number}")


@pytest.mark.parametrize("name", with_function("benches"))
def test_a_benchmark_succeeds_with_finite_numbers_in_each_row(name):
    output, tables = run_module("benchmarks", name, "--json")
    rows = json.loads(output, parse_constant=refuse_constant)["rows"]
    assert rows or "left out. Type: " in tables
    for row in rows:
        assert any(isinstance(value, float) for value in row.values()), row


@pytest.mark.parametrize("name", with_function("benches"))
def test_omitted_parts_of_a_benchmark_are_reported_as_a_skip(name):
    _, tables = run_module("benchmarks", name, "--json")
    if left_out := [line for line in tables.splitlines() if "left out. Type: " in line]:
        pytest.skip("; ".join(left_out))


@pytest.mark.parametrize("name", with_function("main"))
def test_a_benchmark_table_is_printed_with_finite_numbers(name):
    output, _ = run_module(f"benchmarks.{name}")
    assert re.search(r"\d", output)
    assert not re.search(r"\b(nan|inf)", output), output


def test_each_benchmark_module_is_a_command_or_is_imported():
    assert sorted(BENCHES) == with_function("benches")
    texts = {name: ast.unparse(tree) for name, tree in TREES.items()}
    for name in set(TREES) - set(with_function("benches")) - set(with_function("main")):
        import_pattern = re.compile(rf"from benchmarks import .*\b{name}\b|from benchmarks\.{name} import")
        assert any(import_pattern.search(text) for text in texts.values()), (
            f"nobody runs benchmarks/{name}.py"
        )
