"""The house rules that a machine can check: the same commands as the pre-commit hooks."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "baqueano"
SEEN_AT_ONCE = ("door", "robot", "robot/uno", "robot/imu", "robot/service", "robot/workshop", "robot/setup")
BLOCK_ROOMS = ("vehicles", "sensors", "estimators", "guides", "controllers")
FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef
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


def test_nothing_asks_which_vehicle_it_has():
    """Its protocol and the metadata of its parameters say all, so that a vehicle of one's own is served as ours are."""
    asks = {
        str(path.relative_to(SOURCE))
        for path in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
        and node.module == "baqueano.vehicles"
        and {"Car", "Kinematic", "Planar"} & {name.name for name in node.names}
    }
    assert not asks, f"{asks} import a class of vehicle"


def test_no_file_needs_a_tour():
    long = {
        str(path.relative_to(ROOT)): lines
        for room in (SOURCE, ROOT / "tests", ROOT / "benchmarks", ROOT / "docs")
        for path in room.rglob("*.py")
        if (lines := path.read_text(encoding="utf-8").count("\n")) > 400
    }
    assert not long, f"longer than 400 lines, so two ideas: {long}"


@pytest.mark.parametrize("room", SEEN_AT_ONCE)
def test_a_room_can_be_seen_at_once(room):
    """At most 12 modules, and at most 20 names that other rooms take from it. Rooms are added here one by one."""
    inside = sorted(path.stem for path in (SOURCE / room).glob("*.py") if path.stem != "__init__")
    assert len(inside) <= 12, f"{room} has {len(inside)} modules: {inside}"
    package = f"baqueano.{room.replace('/', '.')}"
    modules = {package, *(f"{package}.{name}" for name in inside)}
    taken = {
        f"{node.module}.{name.name}"
        for path in SOURCE.rglob("*.py")
        if path.parent != SOURCE / room
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module in modules
        for name in node.names
    }
    assert len(taken) <= 20, f"{len(taken)} names of {room} are used elsewhere: {sorted(taken)}"


def test_whatever_is_public_says_what_it_is():
    told, dumb = {}, []
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                told[node.name] = {
                    one.name for one in node.body if isinstance(one, FUNCTIONS) and ast.get_docstring(one)
                }
    for path in SOURCE.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        dumb += [f"{path.relative_to(ROOT)}: {name}" for name in without_docstring(tree, "", set(), told)]
    assert not dumb, "no docstring, so a reader has to guess:\n" + "\n".join(dumb)


def without_docstring(inside: ast.AST, prefix: str, inherited: set[str], told: dict[str, set[str]]):
    """Names of what is public and does not say what it is. What a base class says, or `help=` of a verb, is enough."""
    if isinstance(inside, ast.Module) and not ast.get_docstring(inside):
        yield "the module"
    for node in ast.iter_child_nodes(inside):
        if not isinstance(node, (*FUNCTIONS, ast.ClassDef)) or node.name.startswith("_"):
            continue
        verb = any(
            isinstance(one, ast.Call) and any(key.arg == "help" for key in one.keywords)
            for one in node.decorator_list
        )
        if not (verb or node.name in inherited or ast.get_docstring(node)):
            yield prefix + node.name
        if isinstance(node, ast.ClassDef):
            bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
            said = set[str]().union(*(told.get(base, set()) for base in bases))
            yield from without_docstring(node, f"{prefix}{node.name}.", said, told)


def test_what_has_a_table_and_a_verdict_has_rows_for_machines():
    mute = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in SOURCE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and {"table", "verdict"} <= (told := {one.name for one in node.body if isinstance(one, FUNCTIONS)})
        and "rows" not in told
    ]
    assert not mute, f"--json asks for rows(): {mute}"


def test_importing_the_package_loads_neither_scipy_nor_matplotlib():
    heavy = ["scipy", "matplotlib", "jinja2", "rich", "tomlkit", "rosbags", "mcap"]
    code = f"import sys, baqueano; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
