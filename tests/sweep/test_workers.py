"""Workers do the jobs of a script, and do not run the script again."""

import subprocess
import sys

from baqueano.messages import language
from baqueano.messages.language import translate
from baqueano.sweep.workers import run_in_processes

SCRIPT = """
import math
from pathlib import Path
from baqueano.sweep.workers import run_in_processes

with Path("log.txt").open("a") as log:
    log.write("begun\\n")
print(sorted(run_in_processes(math.sqrt, [1.0, 4.0, 9.0], processes=2)))
"""


def translated(words):
    return translate(words)


def test_a_worker_has_the_language_of_its_parent(monkeypatch):
    monkeypatch.setattr(language, "_language", "es")
    results = run_in_processes(translated, ["yes", "stopped"], processes=2)
    assert sorted(results) == ["detenidos", "sí"]


def test_a_script_without_a_guard_runs_once(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    result = subprocess.run([sys.executable, path], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (result.stdout, result.returncode) == ("[1.0, 2.0, 3.0]\n", 0), result.stderr
    assert (tmp_path / "log.txt").read_text() == "begun\n"
