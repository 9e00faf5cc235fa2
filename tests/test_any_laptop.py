"""Windows and macOS laptops, as far as Linux can simulate them.

POSIX modules and the compiler are absent, the home folder has accents and a space, and the terminal uses cp1252.
"""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from baqueano.messages.printable import baqueano_command
from tests.syntax import ROOT, SOURCE, nodes_of, python_files

MISSING = ("fcntl", "termios", "curses", "_curses", "smbus2", "resource", "pwd", "grp")
LAPTOP = f"""
import builtins, os, sys
for name in {MISSING!r}:
    sys.modules[name] = None
for name in ("fdatasync", "fork", "sched_setscheduler", "getuid"):
    if hasattr(os, name):
        delattr(os, name)
"""


@pytest.fixture
def laptop(tmp_path: Path):
    """Run `baqueano ...` as on such a laptop and return the finished process, with its text decoded from cp1252."""
    home = tmp_path / "José Núñez"
    home.mkdir()
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(LAPTOP, encoding="utf-8")
    environment = {
        "HOME": str(home),
        "USERPROFILE": str(home),
        "PATH": "",
        "PYTHONPATH": os.pathsep.join((str(site), str(ROOT / "src"))),
        "PYTHONIOENCODING": "cp1252",
        "PYTHONUTF8": "0",
        "LC_ALL": "C",
        "SYSTEMROOT": os.environ.get("SYSTEMROOT", ""),
        "MPLCONFIGDIR": str(home / "mpl"),
    }

    @contextmanager
    def running(*args: str) -> Iterator[subprocess.Popen[bytes]]:
        command = [sys.executable, "-m", "baqueano", *args]
        with subprocess.Popen(command, cwd=home, env=environment, stderr=subprocess.PIPE) as program:
            try:
                yield program
            finally:
                program.terminate()

    def run(*args: str, code: int = 0) -> subprocess.CompletedProcess[bytes]:
        result = subprocess.run(
            [sys.executable, "-m", "baqueano", *args],
            cwd=run.home,  # type: ignore[attr-defined]
            env=environment,
            capture_output=True,
            check=False,
        )
        errors = result.stderr.decode("cp1252")
        assert result.returncode == code, errors[-3000:]
        assert "Traceback" not in errors
        return result

    run.home, run.running = home, running  # type: ignore[attr-defined]
    return run


def test_the_simulated_laptop_has_no_posix_modules(laptop):
    code = "import importlib.util, os, sys; print([m for m in sys.modules if sys.modules[m] is None])"
    site = laptop.home.parent / "site"
    process = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "fcntl" in process.stdout


def test_the_commands_of_the_demo_run_without_posix_modules(laptop):
    """The commands are experiment, identify, teach, repeat, replay and report, in a new project."""

    def reply(*args: str) -> dict:
        return json.loads(laptop(*args, "--json").stdout.decode("cp1252"))

    laptop("new", "mi proyecto")
    laptop.home = laptop.home / "mi proyecto"
    reply("experiment", "--seconds", "3")
    gains = "--free", "model.actuator_matrix[0,0]", "--free", "model.actuator_matrix[2,2]"
    fit = reply("identify", "last", *gains, "--no-noise", "--update")
    assert fit["verdict"] in ("USABLE", "WARN")
    assert (
        reply("teach", "ñandú", "--driver", "circle", "--size", "0.3", "--speed", "0.4")["rows"][0]["poses"]
        > 50
    )
    repetition = reply("repeat", "ñandú")["rows"][0]
    assert repetition["across_true_rms_m"] < 0.1
    first, second = reply("replay", "last")["rows"]
    assert second["ate_m"] == first["ate_m"], "replay on the same back end is exact"
    laptop("report", "last", "-o", "página.html")
    assert "página" in next(laptop.home.glob("*.html")).name
    assert b"back end: python" in laptop("runs", "show", "last").stdout


@pytest.mark.long
def test_the_complete_demo_runs_without_posix_modules(laptop):
    reply = json.loads(laptop("demo", "--json").stdout.decode("cp1252"))
    assert reply["verdict"] == "USABLE"
    assert "https://" not in (laptop.home / "demo" / "report.html").read_text(encoding="utf-8")


def test_the_page_drives_a_simulated_vehicle_without_posix_modules(laptop):
    """The service is a child process of the page, over pipes; the test replaces the browser."""
    from websockets.sync.client import connect

    def first(line, kind, condition=lambda word: True):
        while True:
            data = line.recv(timeout=60.0)
            if isinstance(data, str) and (word := json.loads(data))["type"] == kind and condition(word):
                return word

    with laptop.running("serve", "--vehicle", "small", "--no-browser", "--runs", "corridas") as page:
        port = next(int(m[1]) for line in page.stderr if (m := re.search(rb"127\.0\.0\.1:(\d+)/", line)))
        host = f"127.0.0.1:{port}"
        with connect(
            f"ws://{host}/ws", origin=f"http://{host}", subprotocols=["baqueano.3"], compression=None
        ) as line:
            line.send(json.dumps({"type": "hello", "lang": "es"}))
            assert first(line, "hello")["vehicle"]["world"] == "simulated"
            line.send(json.dumps({"type": "take"}))
            first(line, "lease")
            line.send(json.dumps({"type": "mission", "kind": "experiment", "seconds": 60}))
            first(line, "state", lambda word: word["state"] == "MISSION")
            while not isinstance(line.recv(timeout=60.0), bytes):
                pass
            line.send(json.dumps({"type": "stop"}))
            first(line, "state", lambda word: word["state"] == "STOPPED")
    assert list((laptop.home / "corridas").glob("*.mcap"))


def test_lg11_runs_are_written_listed_and_exported_without_posix_modules(laptop):
    laptop("simulate", "--vehicle", "small", "--seconds", "5", "-o", "mi corrida.mcap")
    laptop("runs", "show", "mi corrida.mcap")
    laptop("runs", "export", "mi corrida.mcap", "--to", "csv", "-o", "exportación.csv")
    assert (laptop.home / "exportación.csv").stat().st_size > 1000


def test_errors_have_one_paragraph_without_posix_modules(laptop):
    result = laptop("identify", "no existe.mcap", "--vehicle", "small", code=3)
    errors = result.stderr.decode("cp1252").strip()
    assert "no existe.mcap" in errors
    assert "\n\n" not in errors


@pytest.mark.parametrize(
    ("word", "typed_there"),
    [
        ("runs/0001.mcap", "runs/0001.mcap"),
        (r"C:\Users\José Núñez\lap.mcap", r'"C:\Users\José Núñez\lap.mcap"'),
        ("imu[2]", '"imu[2]"'),
        ("0,0", '"0,0"'),
        ("@file", '"@file"'),
        ("$HOME;rm", "'$HOME;rm'"),
        ("O'Higgins", '"O\'Higgins"'),
        ("O'Hi$ggins", "'O''Hi$ggins'"),
    ],
)
def test_advised_command_lines_are_quoted_for_powershell(monkeypatch, word, typed_there):
    monkeypatch.setattr("baqueano.messages.printable.os.name", "nt")
    assert baqueano_command("report", word) == f"baqueano report {typed_there}"


def test_pytest_collects_the_fast_tests_without_posix_modules(laptop):
    """Only slow tests may need POSIX: Windows and macOS run the fast part."""
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", "--collect-only"],
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONPATH": str(laptop.home.parent / "site"),
            "PYTHONIOENCODING": "cp1252:replace",
        },
        capture_output=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout.decode("cp1252", "replace")[-3000:]


def test_source_files_state_encodings_and_import_no_posix_module():
    """Windows reads text as cp1252 by default; POSIX modules are imported inside the functions that use them."""
    # these run on Linux alone
    on_board = ROOT / "src/baqueano/robot/imu", ROOT / "src/baqueano/robot/service"
    for path in python_files(SOURCE):
        if path.parent in on_board:
            continue
        for node in nodes_of(path)[0].body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            posix = {name.split(".")[0] for name in names} & {*MISSING, "pty", "tty", "syslog"}
            assert not posix or "robot" in path.parts or "manual" in path.parts, f"{path}: {posix}"
        for node in nodes_of(path):
            if isinstance(node, ast.Call) and reads_text(node):
                assert "encoding" in {key.arg for key in node.keywords}, f"{path} line {node.lineno}"


def reads_text(call: ast.Call) -> bool:
    """Return True for `.read_text()`, `.write_text()`, `open` of a text, and a subprocess with text=True."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else ""
    if name in ("read_text", "write_text"):
        return True
    is_open = isinstance(call.func, ast.Name) and call.func.id == "open"
    if is_open or (name == "open" and ast.unparse(call.func) != "tarfile.open"):
        modes = [
            argument.value
            for argument in call.args
            if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
        ]
        modes += [key.value.value for key in call.keywords if key.arg == "mode"]  # type: ignore[attr-defined]
        return bool(modes) and all(set(mode) <= set("rwxat+") for mode in modes[-1:])
    return any(key.arg == "text" and ast.unparse(key.value) == "True" for key in call.keywords)


def workflow():
    """Return the file of the public service; parsed without the rule that `on` is true."""
    yaml = pytest.importorskip("yaml")
    return yaml.load(
        (ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8"), Loader=yaml.BaseLoader
    )


def test_the_public_workflow_tests_three_systems_and_two_python_versions():
    file = workflow()
    assert set(file["on"]) == {"push", "pull_request"}
    assert file["permissions"] == {"contents": "read"}
    fast = file["jobs"]["fast"]
    assert set(fast["strategy"]["matrix"]["os"]) == {"ubuntu-latest", "windows-latest", "macos-latest"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = [
        classifier.rpartition(":: ")[2]
        for classifier in project["classifiers"]
        if "Python :: 3." in classifier
    ]
    ends = [versions[0], versions[-1]]
    assert all(job["strategy"]["matrix"]["python"] == ends for job in (fast, file["jobs"]["all"]))


def test_the_public_workflow_tests_the_first_hour_of_a_user_on_each_system():
    commands = " ".join(step.get("run", "") for step in workflow()["jobs"]["fast"]["steps"]).split()
    hour = {"tests/test_any_laptop.py", "tests/test_wheel.py", "tests/test_notebooks.py", "tests/report"}
    assert hour <= set(commands)


def test_each_command_of_the_public_workflow_exists_in_this_repository():
    file = workflow()
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for job in file["jobs"].values():
        assert int(job["timeout-minutes"]) <= 120
        for step in job["steps"]:
            line = step.get("run", "")
            assert bool(line) != ("uses" in step)
            assert not line.startswith("make ") or line.split()[-1] in targets
            for path in re.findall(r"(?:tests|requirements)/[\w.]+", line):
                assert (ROOT / path).exists(), path
            for marks in re.findall(r'-m "(.*?)"', line):
                assert marks == "not slow"
