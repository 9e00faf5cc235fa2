"""The rules for the code that a machine can check, with the same commands as the pre-commit hooks."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.promises import WHY_NOT, keepers, promises
from tests.syntax import ROOT, SOURCE, function_name, nodes_of, python_files

SMALL_FOLDERS = ("door", "robot", "robot/uno", "robot/imu", "robot/service", "robot/workshop", "robot/setup")
BLOCK_ROOMS = ("vehicles", "sensors", "estimators", "guides", "controllers")
FUNCTIONS = ast.FunctionDef, ast.AsyncFunctionDef
MODULES, NAMES = 12, 20  # of a folder
FRONT_DOOR = 26  # names of `import baqueano as bq`
AROUND_BLOCKS = {  # the supervisor, and modules that wrap or watch any block
    "Supervisor", "GuardedBlock", "FallbackBlock", "BudgetedBlock", "Watchdog", "AgreementMonitor",
    "AdjustableController",
    "MyEstimator",
    "MyGuide", "MyController", "PacedGuide",
}  # fmt: skip


def run(*command: str) -> None:
    result = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, encoding="utf-8"
    )
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]


def test_code_is_formatted():
    run("ruff", "format", "--check", ".")


def test_code_passes_the_linter():
    run("ruff", "check", ".")


@pytest.mark.long
def test_every_signature_is_typed():
    run("pyright", "--warnings")


def test_folders_have_limited_numbers_of_modules_and_names():
    """At most MODULES files and NAMES public names."""
    full = {
        str(folder.relative_to(SOURCE.parent).as_posix())
        for folder in {path.parent for path in python_files(SOURCE)}
        if len(modules_in(folder)) > MODULES
        or len(public_names(folder / "__init__.py")) > (FRONT_DOOR if folder == SOURCE else NAMES)
    }
    assert not full, f"more than {MODULES} modules or {NAMES} names, so two ideas: {full}"


def modules_in(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*.py") if path.name not in ("__init__.py", "__main__.py")]


def public_names(face: Path) -> list[str]:
    """Return the names of `__all__` of a package; without one, the names that its face defines without a _."""
    body = nodes_of(face)[0].body if face.exists() else []
    names: list[str] = []
    for node in body:
        if isinstance(node, ast.Assign):
            targets = [target.id for target in node.targets if isinstance(target, ast.Name)]
            if targets == ["__all__"]:
                return list(ast.literal_eval(node.value))
            names += targets
        elif isinstance(node, (*FUNCTIONS, ast.ClassDef)):
            names.append(node.name)
    return [name for name in names if not name.startswith("_")]


def blocks_in(paths: Iterable[Path]) -> set[str]:
    return {
        node.name
        for path in paths
        for node in nodes_of(path)[0].body
        if isinstance(node, ast.ClassDef)
        and "Protocol" not in [getattr(base, "id", "") for base in node.bases]
        and {"init", "step"} <= {member.name for member in node.body if isinstance(member, FUNCTIONS)}
    }


@pytest.mark.parametrize("room", ["estimators", "guides", "controllers"])
def test_a_block_package_exports_every_block_of_its_modules(room):
    assert blocks_in(python_files(SOURCE / room)) <= set(public_names(SOURCE / room / "__init__.py"))


def test_no_block_is_defined_outside_the_block_packages():
    paths = [path for path in python_files(SOURCE) if path.relative_to(SOURCE).parts[0] not in BLOCK_ROOMS]
    hidden_blocks = blocks_in(paths)
    assert not hidden_blocks - AROUND_BLOCKS, (
        "a block stands in vehicles/, sensors/, estimators/, guides/ or controllers/"
    )


def test_no_module_tests_for_a_specific_vehicle_class():
    """Protocol and parameter metadata describe a vehicle completely, so a user vehicle is treated like a built-in
    one."""
    offenders = {
        str(path.relative_to(SOURCE))
        for path in python_files(SOURCE)
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom)
        and node.module == "baqueano.vehicles"
        and {"Car", "Kinematic", "Planar"} & {name.name for name in node.names}
    }
    assert not offenders, f"{offenders} import a class of vehicle"


HASATTRS = 15  # calls of hasattr: what a system offers, and what the author of a block wrote
MAX_ANY = 500  # mentions of Any


def sources() -> dict[Path, str]:
    return {path: path.read_text(encoding="utf-8") for path in python_files(SOURCE)}


def test_the_number_of_hasattr_calls_is_limited():
    assert sum(text.count("hasattr(") for text in sources().values()) <= HASATTRS, "ask contracts/optional.py"


def test_signatures_rarely_use_any():
    assert sum(len(re.findall(r"\bAny\b", text)) for text in sources().values()) <= MAX_ANY, (
        "a promise or a type of contracts/, or the class itself"
    )


@pytest.mark.parametrize("room", ["vehicles", "sensors", "estimators", "guides", "controllers"])
def test_no_built_in_block_class_is_named_outside_its_package(room):
    kinds = blocks_in(python_files(SOURCE / room)) | {
        "Imu",
        "Wheels",
        "Odometer",
        "Pose",
        "Mark",
        "Compass",
        "Beacon",
    }
    offenders = [
        f"{path.relative_to(SOURCE)} line {node.lineno}"
        for path, text in sources().items()
        if path.parent != SOURCE / room and "isinstance" in text
        for node in nodes_of(path)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance"
        and {name_node.id for name_node in ast.walk(node.args[1]) if isinstance(name_node, ast.Name)} & kinds
    ]  # fmt: skip
    assert not offenders, offenders


def test_no_file_has_more_than_400_lines():
    sizes = {
        str(path.relative_to(ROOT)): lines
        for room in (SOURCE, ROOT / "tests", ROOT / "benchmarks", ROOT / "docs")
        for path in python_files(room)
        if (lines := path.read_text(encoding="utf-8").count("\n")) > 400
    }
    assert not sizes, f"longer than 400 lines, so two ideas: {sizes}"


@pytest.mark.parametrize("room", SMALL_FOLDERS)
def test_each_package_exports_few_names_to_other_packages(room):
    """At most NAMES. Packages are added here one by one."""
    package = f"baqueano.{room.replace('/', '.')}"
    modules = {package, *(f"{package}.{path.stem}" for path in modules_in(SOURCE / room))}
    names = {
        f"{node.module}.{name.name}"
        for path in python_files(SOURCE)
        if path.parent != SOURCE / room
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and node.module in modules
        for name in node.names
    }
    assert len(names) <= NAMES, f"{len(names)} names of {room} are used elsewhere: {sorted(names)}"


def test_every_public_object_has_a_docstring():
    members, dumb = {}, []
    for path in python_files(SOURCE):
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                members[node.name] = {
                    member.name
                    for member in node.body
                    if isinstance(member, FUNCTIONS) and ast.get_docstring(member)
                }
    for path in python_files(SOURCE):
        tree = nodes_of(path)[0]
        dumb += [f"{path.relative_to(ROOT)}: {name}" for name in without_docstring(tree, "", set(), members)]
    assert not dumb, "no docstring, so a reader has to guess:\n" + "\n".join(dumb)


def without_docstring(scope: ast.AST, prefix: str, base_names: set[str], members: dict[str, set[str]]):
    """Return the public names without a docstring. A docstring of a base class, or the `help=` of a command, is
    enough."""
    if isinstance(scope, ast.Module) and not ast.get_docstring(scope):
        yield "the module"
    for node in ast.iter_child_nodes(scope):
        if not isinstance(node, (*FUNCTIONS, ast.ClassDef)) or node.name.startswith("_"):
            continue
        verb = any(
            isinstance(decorator, ast.Call) and any(key.arg == "help" for key in decorator.keywords)
            for decorator in node.decorator_list
        )
        if not (verb or node.name in base_names or ast.get_docstring(node)):
            yield prefix + node.name
        if isinstance(node, ast.ClassDef):
            bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
            inherited_names = set[str]().union(*(members.get(base, set()) for base in bases))
            yield from without_docstring(node, f"{prefix}{node.name}.", inherited_names, members)


def test_each_result_class_with_table_and_verdict_has_rows():
    mute = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in python_files(SOURCE)
        for node in nodes_of(path)
        if isinstance(node, ast.ClassDef)
        and {"table", "verdict"}
        <= (methods := {member.name for member in node.body if isinstance(member, FUNCTIONS)})
        and "rows" not in methods
    ]
    assert not mute, f"--json asks for rows(): {mute}"


def test_each_promise_named_by_a_test_exists():
    assert not keepers().keys() - promises().keys()
    assert promises().keys() - keepers().keys() == WHY_NOT.keys()  # a promise without a test has a reason


def calls():
    """Return each call of the package, with its file."""
    for path in python_files(SOURCE):
        for node in nodes_of(path):
            if isinstance(node, ast.Call):
                yield path.relative_to(SOURCE).as_posix(), node


def test_ne1_only_the_page_server_opens_network_ports():
    for file, call in calls():
        name = function_name(call)
        if file != "web/server.py":  # tests/web: only on loopback, unless shared
            assert name.rpartition(".")[2] not in {
                "create_server",
                "start_server",
                "HTTPServer",
                "TCPServer",
            }, file
        if name == "socket.socket" and file != "web/share.py":  # sends nothing
            assert ast.unparse(call.args[0]) == "socket.AF_UNIX", file


def test_lg7_fi5_no_file_content_is_executed_as_code():
    """A user block is code and is executed; a study reads only files that it pickled itself."""
    risky = re.compile(r"(pickle|marshal|shelve|yaml)\.\w+|eval|exec|read_pickle")
    offenders = {file for file, call in calls() if risky.fullmatch(function_name(call))}
    engine = {"symbolic/packing.py", "symbolic/python_code/python.py"}
    assert offenders <= {"blocks.py", "study/identification/result.py", *engine}
    assert not [file for file, call in calls() if "allow_pickle" in {key.arg for key in call.keywords}]


def test_su1_at_most_six_packages_are_needed_on_board():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert len(project["dependencies"]) <= 6


@pytest.mark.parametrize("lock", ["run", "test"])
def test_su2_each_package_of_a_lock_has_its_hash(lock):
    text = (ROOT / f"requirements/{lock}.lock").read_text(encoding="utf-8")
    packages = re.findall(r"^[\w.\-\[\]]+==.*\n(.*)", text, re.MULTILINE)
    assert len(packages) > 5
    assert all("--hash=sha256:" in following for following in packages)


# the demo, and the simulation that the paper describes
SIMULATED = {"demo.py", "paper"}
HARMLESS = {
    "tick_times",
    "PerfectState",
    "truth_sensor",
    "initial_pose",
    "replay_blocks",
    "replay",
    "drive_stop_reason",
    "first_drive",
    "check_compilable",
    "repeat",
    "closure",
    "lap_closure",
    "LapEnd",
    "lap_end",
    "end_closure",
    "MARK_SOURCE",
    "RoomWatch",
}


def test_no_study_simulates_data_with_the_fitted_model():
    """Data of the fitted model always agree with it, so data come from study/truth or from recordings."""
    for path in python_files(SOURCE / "study"):
        modules = {
            name.name
            for node in nodes_of(path)
            if isinstance(node, ast.ImportFrom)
            and (node.module or "").split(".")[:2]
            in [["baqueano", room] for room in ("simulate", "worlds", "drive")]
            for name in node.names
        }
        calls = [node for node in nodes_of(path) if isinstance(node, ast.Call)]
        drives = [node for node in calls if getattr(node.func, "id", "") in ("first_drive", "repeat")]
        worlds = all("world" in {key.arg for key in node.keywords} for node in drives)
        if path.relative_to(SOURCE / "study").parts[0] not in SIMULATED:
            assert modules <= HARMLESS, f"{path.relative_to(ROOT)} imports {modules - HARMLESS}"
            assert worlds, f"{path.relative_to(ROOT)}: a drive without a world is simulated by our step"


FITTED_STEP = {"simulate", "simulate_loop", "simulate_many", "experiment", "case_run"}


def test_no_test_measures_coverage_on_data_of_the_fitted_model():
    """Tests and benchmarks count the 95 % intervals that contain the truth only on data from study/truth."""
    paths = (*python_files(ROOT / "tests"), *(ROOT / "benchmarks").glob("*.py"))
    for path in (path for path in paths if "1.96" in path.read_text(encoding="utf-8")):
        functions = {node.name: node for node in nodes_of(path) if isinstance(node, FUNCTIONS)}
        for name, node in functions.items():
            comparisons = [ast.unparse(part) for part in ast.walk(node) if isinstance(part, ast.Compare)]
            if any("1.96" in part for part in comparisons) and re.search(r"(mean|sum)\(", ast.unparse(node)):
                mirrors = names_behind(name, functions) & FITTED_STEP
                assert not mirrors, f"{path.relative_to(ROOT)}: {name} judges coverage on data of {mirrors}"


def names_behind(name: str, functions: dict[str, ast.FunctionDef | ast.AsyncFunctionDef]) -> set[str]:
    """Return the names that a function and its fixtures use, and those that functions of its module use for it."""
    names, waiting = set(), [name]
    while waiting:
        parts = list(ast.walk(functions[waiting.pop()]))
        names_used = {part.id for part in parts if isinstance(part, ast.Name)}
        names_used |= {part.arg for part in parts if isinstance(part, ast.arg)}
        waiting += [single for single in names_used - names if single in functions]
        names |= names_used
    return names
