"""A test that judges milliseconds runs while no other process of the test run is active."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from tests.turns import turn

pytestmark = pytest.mark.skipif(os.name == "nt", reason="locks of POSIX")
RUN = """
import sys, time
from pathlib import Path
from tests.turns import turn
with turn(sys.argv[2] == "alone", sys.argv[1]) as alone:
    print(time.monotonic_ns(), flush=True)
    sys.stdin.readline()
    if sys.argv[2] == "again":
        alone()
    print(time.monotonic_ns(), flush=True)
"""


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Start a process that takes its turn until it receives a line."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    running = []

    def start(mode):
        running.append(
            subprocess.Popen(
                [sys.executable, "-c", RUN, "a-run", mode], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                cwd=Path(__file__).parents[1],
            )
        )  # fmt: skip
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.communicate()


def waiting(process):
    """Return the thread that waits for its turn after a second without one, and the text that it will read."""
    line = []
    reading = threading.Thread(target=lambda: line.append(process.stdout.readline()), daemon=True)
    reading.start()
    reading.join(1.0)
    assert reading.is_alive()
    return reading, line


def test_an_exclusive_test_waits_for_running_tests_and_blocks_new_tests(start):
    first, second = start("beside"), start("beside")
    assert int(first.stdout.readline())
    assert int(second.stdout.readline())  # both at once
    exclusive = start("alone")
    waits, _ = waiting(exclusive)
    kept_out, came = waiting(start("beside"))  # although the running tests would let it in
    for process in (first, second):
        end(process)
    waits.join(20.0)
    assert not waits.is_alive()
    assert kept_out.is_alive()
    exclusive.kill()  # a killed process releases its turn
    kept_out.join(20.0)
    assert int(came[0])


def end(process):
    process.stdin.write("end\n")
    process.stdin.flush()


def test_a_repeated_exclusive_test_waits_for_the_other_tests(start):
    shared_again, neighbour = start("again"), start("beside")
    assert int(shared_again.stdout.readline())
    assert int(neighbour.stdout.readline())
    end(shared_again)
    waits, came = waiting(shared_again)
    end(neighbour)
    waits.join(20.0)
    assert int(came[0])


def test_without_other_processes_a_test_does_not_wait():
    start_s = time.monotonic()
    with turn(True, ""), turn(True, ""):
        assert time.monotonic() - start_s < 20.0
