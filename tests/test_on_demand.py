"""Packages import names on demand; a type checker and Python get the same objects."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import baqueano
from baqueano import guides
from baqueano.cli.subcommands import SUBCOMMANDS as COMMANDS
from baqueano.messages.language import use_language
from baqueano.on_demand import on_demand

ROOT = Path(baqueano.__file__).parent
# the top-level package is the first
PACKAGES = sorted(
    path
    for path in ROOT.rglob("__init__.py")
    if any(maker in path.read_text(encoding="utf-8") for maker in ("on_demand(", "front_door("))
)


def read_by_a_type_checker(path: Path) -> dict[str, tuple[str, str]]:
    """Return {name: (module, its name there)} of the imports under `if TYPE_CHECKING`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    branches = [
        branch_node
        for branch_node in tree.body
        if isinstance(branch_node, ast.If) and ast.unparse(branch_node.test) == "TYPE_CHECKING"
    ]
    imports = [node for branch in branches for node in branch.body if isinstance(node, ast.ImportFrom)]
    return {
        alias.asname or alias.name: (str(node.module), alias.name) for node in imports for alias in node.names
    }


def package_of(path: Path):
    """Return the package of an `__init__.py`."""
    return import_module(".".join(["baqueano", *path.parent.relative_to(ROOT).parts]))


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_a_lazy_name_is_the_object_of_its_module(path):
    package = package_of(path)
    modules = read_by_a_type_checker(path)
    assert modules
    for name, (module, member) in modules.items():
        room = import_module(f"baqueano.{name}") if module == "baqueano" else None
        assert getattr(package, name) is (room or getattr(import_module(module), member))
    assert all(hasattr(package, name) for name in package.__all__)


@pytest.mark.parametrize("path", PACKAGES[1:], ids=lambda path: path.parent.name)
def test_no_lazy_name_is_hidden_by_a_submodule(path):
    assert not {entry.stem for entry in path.parent.iterdir()} & read_by_a_type_checker(path).keys()


def test_an_unknown_name_of_a_package_raises_an_attribute_error():
    get = on_demand("baqueano.runs", {"folder": ("find",)})
    with pytest.raises(AttributeError, match=r"module 'baqueano\.runs' does not have attribute 'fnid'"):
        get("fnid")
    with use_language("es"), pytest.raises(AttributeError, match="no tiene el atributo 'fnid'"):
        get("fnid")


@pytest.mark.parametrize(
    ("name", "nearest_name"),
    [("controllers.Lqrr", "Lqr"), ("estimators.Ekff", "Ekf"), ("guides.Repet", "Repeat"), ("routes.examin", "examine"),
     ("guides.shapes.circl", "circle"), ("sensors.Imuu", "Imu"), ("vehicles.Carr", "Car")],
)  # fmt: skip
def test_a_misspelt_block_is_answered_with_the_nearest_name_and_only_public_names(name, nearest_name):
    package, _, member = name.rpartition(".")
    with pytest.raises(AttributeError) as error_info:
        getattr(import_module(f"baqueano.{package}"), member)
    question, _, names = str(error_info.value).partition("?")
    assert question.endswith(f" {nearest_name}")
    assert "__" not in names


def fresh(code: str) -> str:
    """Return the output of a new Python process."""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return result.stdout.strip()


# functions with the names of their packages
SUBCOMMANDS = ["compare", "identify", "report", "simulate", "tune"]


def test_importing_a_package_does_not_hide_the_function_of_the_same_name():
    rooms = "; ".join(f"import baqueano.{verb}" for verb in SUBCOMMANDS)
    output = fresh(f"import baqueano as bq; {rooms}; print([getattr(bq, v).__name__ for v in {SUBCOMMANDS}])")
    assert output == str(SUBCOMMANDS)
    assert (
        fresh("from baqueano.tune import TuneResult; import baqueano as bq; print(callable(bq.tune))")
        == "True"
    )


def test_importing_baqueano_imports_no_subpackage():
    new = "set(sys.modules) - before"
    output = fresh(f"import sys; before = set(sys.modules); import baqueano; print(*sorted({new}))")
    assert output == "baqueano baqueano.on_demand"


def test_the_top_level_functions_match_the_command_line():
    names = {"simulate", "experiment", "identify", "tune", "teach", "repeat", "replay", "compare", "report", "forecast",
            "new"}  # fmt: skip
    assert names <= set(COMMANDS)
    assert names <= set(baqueano.__all__) == set(dir(baqueano)) - {"__version__"}


@pytest.mark.parametrize("name", ["Command", "Estimate", "Reference", "Tick", "circle", "clothoid", "eight", "line",
                                  "rectangle", "sinuous_circle", "slalom"])  # fmt: skip
@pytest.mark.parametrize("package", [baqueano, guides])
def test_a_name_of_another_module_is_reported_with_its_import(package, name):
    with pytest.raises(AttributeError) as error_info:
        getattr(package, name)
    namespace: dict[str, object] = {}
    exec(str(error_info.value).partition(": ")[2], namespace)
    assert callable(namespace[name])
