"""Measure the start of the command line, compared with an empty Python program."""

import subprocess
import sys
from statistics import median

from benchmarks.harness import Bench, Row, timed

ROUNDS = 15
MOST_MS = 100.0  # of --help, over bare Python


def benches(smallest: bool) -> list[Bench]:
    """Return the bench of `baqueano --help` and of its imports, minus the start of Python."""
    commands = {
        "bare Python": ["-c", "pass"],
        "import baqueano": ["-c", "import baqueano"],
        "baqueano --help": ["-m", "baqueano", "--help"],
        "import numpy": ["-c", "import numpy"],
    }
    start_times = {name: [] for name in commands}
    for _ in range(1 if smallest else ROUNDS):
        for name, arguments in commands.items():
            run = [sys.executable, *arguments]
            start_times[name].append(
                timed(lambda run=run: subprocess.run(run, check=True, capture_output=True))
            )
    medians = {name: median(times) for name, times in start_times.items()}
    python_s = medians["bare Python"]
    rows = []
    for name, seconds in medians.items():
        over = 1e3 * (seconds - python_s)
        is_missed = name == "baqueano --help" and over > MOST_MS
        limit = (
            f" (at most {MOST_MS:g}{': missed' if is_missed else ''})" if name == "baqueano --help" else ""
        )
        note = "" if name == "bare Python" else f"{over:+.0f} ms over bare Python{limit}"
        rows.append(Row(name, seconds, seconds / python_s, note=note, is_missed=is_missed))
    return [Bench("start of the command line", tuple(rows))]
