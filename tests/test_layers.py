"""Nothing imports upward, neither by an import statement nor by the name of a module in a string."""

import ast
import subprocess
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.syntax import ROOT, SOURCE, nodes_of, python_files
from tests.test_house import BLOCK_ROOMS

DOORS = {"time", "os", "random", "datetime", "pathlib", "io", "sys", "socket", "threading"}


def test_no_layer_imports_from_a_higher_layer():
    code = "from importlinter.cli import lint_imports_command as lint; lint()"
    process = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, encoding="utf-8"
    )
    assert " kept, 0 broken" in process.stdout, process.stdout[-4000:] + process.stderr


def layered_modules():
    """Return, for each list of layers in pyproject.toml, its package and its modules with the height of their layer."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in project["tool"]["importlinter"]["contracts"]:
        for package in contract.get("containers", []):
            layers = [layer.replace("|", ":").split(":") for layer in reversed(contract["layers"])]
            yield package, {name.strip(): height for height, layer in enumerate(layers) for name in layer}


def test_no_layer_names_a_module_of_a_higher_layer_in_a_string():
    """A module that is imported by its name in a string is imported as well. Only the package baqueano, above all,
    names modules of every layer."""
    offenders = [
        f"{path.relative_to(ROOT)} line {node.lineno}: {node.value}"
        for package, heights in layered_modules()
        for path in python_files(SOURCE)
        if (height := heights.get(layer_in(package, module_name(path)))) is not None
        for node in nodes_of(path)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value
        and heights.get(layer_in(package, node.value), 0) > height
    ]  # fmt: skip
    assert not offenders, "a layer above registers the function (on_demand.register):\n" + "\n".join(
        offenders
    )


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)


def layer_in(package: str, module: str) -> str:
    """Return the part of a module's name that follows `package`, or ""."""
    return module.removeprefix(f"{package}.").partition(".")[0] if module.startswith(f"{package}.") else ""


def imports_at_run_time(path: Path) -> set[str]:
    """Return the modules of this package that a file imports, also within its functions, except for types alone."""
    nodes, types = nodes_of(path), set[ast.AST]()
    for node in nodes:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            types |= set(ast.walk(node))
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node not in types]
    return {f"{node.module}.{alias.name}" for node in imports for alias in node.names} | {
        f"{node.module}" for node in imports
    }


# a scalar in an operation with an array is an array, and the array is made of scalars
MUTUAL = {f"baqueano.symbolic.arrays.{name}" for name in ("array", "elementwise", "linalg", "scalar")}


def test_no_module_imports_itself_through_other_modules():
    paths = {module_name(path): path for path in python_files(SOURCE) if path.name != "__init__.py"}
    imports = {
        name: imports_at_run_time(path) & paths.keys() - (MUTUAL if name in MUTUAL else set())
        for name, path in paths.items()
    }
    TopologicalSorter(imports).prepare()  # raises CycleError, which names the modules of the circle


@pytest.mark.parametrize("room", BLOCK_ROOMS)
def test_blocks_import_no_module_with_external_access(room):
    for path in python_files(SOURCE / room):
        for node in nodes_of(path):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            modules = {name.split(".")[0] for name in names} & DOORS
            assert not modules, (
                f"{path.relative_to(ROOT)} line {node.lineno} imports {modules}: time comes with the signal"
            )


def test_importing_the_package_loads_neither_scipy_nor_matplotlib():
    heavy = ["scipy", "matplotlib", "jinja2", "rich", "tomlkit", "rosbags", "mcap"]
    code = f"import sys, baqueano; print([m for m in {heavy} if m in sys.modules])"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"
