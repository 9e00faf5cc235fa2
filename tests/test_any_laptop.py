"""Windows and macOS laptops, as far as Linux can play them: no POSIX modules, a home folder with accents and a
space, a terminal in cp1252, no compiler."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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
    """Run `baqueano ...` as on such a laptop; gives the finished process, its text decoded from cp1252."""
    home = tmp_path / "José Núñez"
    home.mkdir()
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(LAPTOP, encoding="utf-8")
    environment = {
        "HOME": str(home),
        "USERPROFILE": str(home),
        "PATH": "",
        "PYTHONPATH": str(site),
        "PYTHONIOENCODING": "cp1252",
        "PYTHONUTF8": "0",
        "LC_ALL": "C",
        "SYSTEMROOT": os.environ.get("SYSTEMROOT", ""),
        "MPLCONFIGDIR": str(home / "mpl"),
    }

    def run(*args: str, code: int = 0) -> subprocess.CompletedProcess[bytes]:
        done = subprocess.run(
            [sys.executable, "-m", "baqueano", *args],
            cwd=run.home,  # type: ignore[attr-defined]
            env=environment,
            capture_output=True,
            check=False,
        )
        said = done.stderr.decode("cp1252")
        assert done.returncode == code, said[-3000:]
        assert "Traceback" not in said
        return done

    run.home = home  # type: ignore[attr-defined]
    return run


def test_the_modules_are_really_gone(laptop):
    code = "import importlib.util, os, sys; print([m for m in sys.modules if sys.modules[m] is None])"
    site = laptop.home.parent / "site"
    shown = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "fcntl" in shown.stdout


def test_the_verbs_of_the_demo_run_on_such_a_laptop(laptop):
    """Experiment, identify, teach, repeat, replay, report, in a project of one's own."""

    def reply(*args: str) -> dict:
        return json.loads(laptop(*args, "--json").stdout.decode("cp1252"))

    laptop("new", "mi proyecto")
    laptop.home = laptop.home / "mi proyecto"
    reply("experiment", "--seconds", "5")
    fit = reply("identify", "last", "--free", "model.actuator_matrix[0,0]", "--no-noise", "--update")
    assert fit["verdict"] in ("USABLE", "WARN")
    assert (
        reply("teach", "ñandú", "--driver", "circle", "--size", "0.3", "--speed", "0.4")["rows"][0]["poses"]
        > 50
    )
    driven = reply("repeat", "ñandú")["rows"][0]
    assert driven["across_true_rms_m"] < 0.1
    first, again = reply("replay", "last")["rows"]
    assert again["ate_m"] == first["ate_m"], "replay on the same back end is exact"
    laptop("report", "last", "-o", "página.html")
    assert "página" in next(laptop.home.glob("*.html")).name
    assert b"backend python" in laptop("runs", "show", "last").stdout


def test_the_demo_runs_whole_on_such_a_laptop(laptop):
    reply = json.loads(laptop("demo", "--json").stdout.decode("cp1252"))
    assert reply["verdict"] == "USABLE"
    assert "https://" not in (laptop.home / "demo" / "report.html").read_text(encoding="utf-8")


def test_lg11_runs_are_written_listed_and_exported_on_such_a_laptop(laptop):
    laptop("simulate", "--vehicle", "small", "--seconds", "5", "-o", "mi corrida.mcap")
    laptop("runs", "show", "mi corrida.mcap")
    laptop("runs", "export", "mi corrida.mcap", "--to", "csv", "-o", "exportación.csv")
    assert (laptop.home / "exportación.csv").stat().st_size > 1000


def test_errors_are_one_paragraph_on_such_a_laptop(laptop):
    done = laptop("identify", "no existe.mcap", "--vehicle", "small", code=3)
    said = done.stderr.decode("cp1252").strip()
    assert "no existe.mcap" in said
    assert "\n\n" not in said
