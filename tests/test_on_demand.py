"""Packages whose names are imported when they are asked for: what a type checker reads is what Python gets."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

import baqueano
from baqueano.on_demand import on_demand

ROOT = Path(baqueano.__file__).parent
PACKAGES = sorted(p for p in ROOT.rglob("__init__.py") if "on_demand(" in p.read_text(encoding="utf-8"))


def read_by_a_type_checker(path: Path) -> dict[str, str]:
    """Name → module, of the imports under `if TYPE_CHECKING`."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    branches = [
        one for one in tree.body if isinstance(one, ast.If) and ast.unparse(one.test) == "TYPE_CHECKING"
    ]
    imports = [one for branch in branches for one in branch.body if isinstance(one, ast.ImportFrom)]
    return {alias.name: str(one.module) for one in imports for alias in one.names}


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_a_name_on_demand_is_that_of_its_module(path):
    package = import_module(f"baqueano.{path.parent.relative_to(ROOT).as_posix().replace('/', '.')}")
    modules = read_by_a_type_checker(path)
    assert modules
    for name, module in modules.items():
        assert getattr(package, name) is getattr(import_module(module), name)
    assert all(hasattr(package, name) for name in package.__all__)
    assert modules.keys() <= set(package.__all__)


@pytest.mark.parametrize("path", PACKAGES, ids=lambda path: path.parent.name)
def test_no_name_on_demand_is_hidden_by_a_submodule(path):
    assert not {one.stem for one in path.parent.iterdir()} & read_by_a_type_checker(path).keys()


def test_a_name_that_no_module_holds_is_no_attribute():
    get = on_demand("baqueano.runs", {"folder": ("find",)})
    with pytest.raises(AttributeError, match=r"module 'baqueano\.runs' does not have attribute 'fnid'"):
        get("fnid")
