"""Terminals, pipes and keys: progress bars only on a terminal, any encoding, early ends, Ctrl-C."""

import contextlib
import errno
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from baqueano.cli import terminal
from baqueano.cli.terminal import show_activity, show_steps
from baqueano.compare import compare
from baqueano.diagnostics import StopReason, note
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.runs import read_run

COMMAND = [sys.executable, "-m", "baqueano"]


@pytest.fixture
def project(lab, tmp_path) -> Path:
    for name in ("runs", "routes"):
        shutil.copytree(lab / name, tmp_path / name)
    return tmp_path


def run(folder: Path, *args: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    settings = os.environ | environment
    return subprocess.run([*COMMAND, *args], cwd=folder, env=settings, capture_output=True, timeout=60)


def test_a_terminal_wraps_sentences_but_neither_tables_nor_commands(monkeypatch):
    screen = io.StringIO()
    sentence = "the run is shorter than the drive. " * 4 + "Type: baqueano identify last"
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdout", screen)
    monkeypatch.setenv("COLUMNS", "40")
    table, data = "speed" + 50 * " " + "m/s", '{"rows": [' + "1, " * 30 + "1]}"
    for line in (sentence, table, data):
        terminal.print_result(line)
    *wrapped_lines, last_table, last_data = screen.getvalue().splitlines()
    assert (last_table, last_data) == (table, data)
    assert max(map(len, wrapped_lines)) <= 40
    assert " ".join(part.strip() for part in wrapped_lines) == sentence
    assert wrapped_lines[-1].strip().endswith("baqueano identify last")


def test_no_progress_bar_is_drawn_if_stderr_is_not_a_terminal(project):
    result = run(project, "repeat", "lab", "--vehicle", "small", "--json")
    assert result.returncode == 0
    rest, path = result.stderr.decode().splitlines()
    assert rest == text(note("drive.rest", rest_s=2.0))
    assert path == "run: runs/0003-repeat.mcap"


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_results_are_printed_in_any_terminal_encoding(project, encoding):
    result = run(project, "compare", "1", PYTHONIOENCODING=encoding)
    assert result.returncode == 0, result.stderr
    assert "position (ATE)" in result.stdout.decode(encoding)


def test_a_closed_pipe_does_not_end_the_work(project):
    command = [*COMMAND, "runs", "cut", "1", "--to", "1", "-o", "part.mcap"]
    process = subprocess.Popen(command, cwd=project, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    with process.stderr:
        assert process.stderr.read() == b""
    assert process.wait(60) == 0
    assert read_run(project / "part.mcap").notes == ()


def test_a_disconnected_terminal_does_not_end_the_work(monkeypatch):
    pty = pytest.importorskip("pty")
    master, slave = pty.openpty()
    with open(slave, "w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        terminal.print_message("somebody reads this")
        os.close(master)
        terminal.print_message("nobody reads this")
        assert os.path.samestat(os.fstat(stream.fileno()), os.stat(os.devnull))


def test_a_disk_error_is_not_mistaken_for_a_closed_pipe(monkeypatch, tmp_path):
    def fails(text, file):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(terminal.click, "echo", fails)
    with (tmp_path / "out").open("w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        with pytest.raises(OSError, match="Input/output error"):
            terminal.print_result("a result")


def test_an_endless_simulation_waits_for_the_clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(terminal.time, "sleep", lambda wait_s: now.append(now.pop() + wait_s))
    paces: list[float] = []
    show = terminal.real_time_display(paces.append)
    for t_s in (0.5, 2.0, 1.0):
        show(t_s)
    assert (paces, now) == ([0.5, 2.0, 1.0], [102.0])


@pytest.mark.skipif(os.name == "nt", reason="SIGINT is sent to a process in another way there")
def test_ctrl_c_ends_an_endless_repeat_with_a_complete_run(project):
    command = [*COMMAND, "repeat", "lab", "--vehicle", "small", "--laps", "0", "-o", "forever.mcap"]
    process = subprocess.Popen(
        command, cwd=project, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    path = project / "forever.mcap"
    end_s = time.monotonic() + 60  # the rest of 2 s before the drive is 200 kB
    while (not path.exists() or path.stat().st_size < 400_000) and time.monotonic() < end_s:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    try:
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, err
    assert "Stopped from the keyboard. The run is complete: forever.mcap" in err
    assert "Traceback" not in err
    assert "true cross-track error of the vehicle" in out
    run = read_run(path)
    assert run.notes == ()
    assert run.estimate is not None
    assert len(run.estimate.t_ns) == len(run.t_ns), "every tick is complete"
    reasons = [event.diagnostic for event in run.events if event.source != "refused"]
    assert [reason.code for reason in reasons if reason is not None] == ["drive.rest", StopReason.INTERRUPTED]


def test_a_killed_program_leaves_a_readable_run(project):
    command = [*COMMAND, "repeat", "lab", "--vehicle", "small", "--laps", "0", "-o", "killed.mcap"]
    process = subprocess.Popen(command, cwd=project, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    path = project / "killed.mcap"
    end_s = time.monotonic() + 30
    while (not path.exists() or path.stat().st_size < 100_000) and time.monotonic() < end_s:
        time.sleep(0.1)
    process.kill()
    process.wait(60)
    assert read_run(path).notes[0].code == "run.not-closed"
    assert run(project, "runs", "show", "killed.mcap").returncode == 0


def in_terminal(folder: Path, *args: str) -> tuple[int, str]:
    """Return the exit code and the text of a command in a pseudo terminal."""
    pty = pytest.importorskip("pty")
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execv(COMMAND[0], [*COMMAND, *args])
    text = b""
    with contextlib.suppress(OSError):  # the other side is closed
        while data := os.read(terminal, 65_536):
            text += data
    os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), text.decode(errors="replace")


def test_a_terminal_shows_progress_bars_and_elapsed_time(project):
    code, text = in_terminal(project, "repeat", "lab", "--vehicle", "small")
    assert code == 0
    assert "100%" in text
    code, text = in_terminal(project, "report", "1")
    assert code == 0
    assert "drawing the figures  " in text
    assert text.rstrip().endswith("0001-experiment.html")


def test_ctrl_c_ends_work_at_once_or_at_its_next_progress_report():
    with pytest.raises(KeyboardInterrupt), show_activity("thinking"):
        signal.raise_signal(signal.SIGINT)
    with show_activity("thinking") as status:
        assert status("round 1") is False
        signal.raise_signal(signal.SIGINT)
        assert status("round 2") is True
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def progress_lines(capsys, pattern, times=1):
    """Return the text of stderr when it contains the pattern `times` times."""
    err, end_s = "", time.monotonic() + 60
    while len(re.findall(pattern, err)) < times:
        assert time.monotonic() < end_s, err
        time.sleep(0.05)
        err += capsys.readouterr().err
    return err


def test_progress_is_shown_on_one_line(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "is_terminal", lambda: True)
    with show_steps() as begin:
        status = begin("fitting")
        status("round 3: 20 evaluations")
        err = progress_lines(capsys, r"fitting  \d+ s  round 3: 20 evaluations")
        begin("drawing")
    err += capsys.readouterr().err
    assert err.count("\n") == 2
    assert all(len(line) <= 100 for line in err.replace("\n", "\r").split("\r"))


def test_the_remaining_time_does_not_contain_the_preparation(monkeypatch):
    clock_s, bars = [0.0], []
    bar_of = click.progressbar
    monkeypatch.setattr(terminal, "is_terminal", lambda: True)
    monkeypatch.setattr(time, "time", lambda: clock_s[0])
    monkeypatch.setattr(click, "progressbar", lambda **options: bars.append(bar_of(**options)) or bars[-1])
    with terminal.show_progress("drive", 10) as advance:
        for t_s in (60.0, 61.0, 62.0, 63.0):  # the filter is compiled for a minute
            clock_s[0] = t_s
            advance(1)
        assert bars[0].eta < 10.0


def test_the_time_of_a_step_is_shown_as_the_language_writes_numbers(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "is_terminal", lambda: True)
    with use_language("es"), show_activity("ajuste"):
        pass
    assert re.search(r"ajuste  \d,\d s", capsys.readouterr().err)


def test_without_a_terminal_progress_lines_are_rare(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "PROGRESS_PERIOD_S", 0.2)
    start_s = time.monotonic()
    with show_steps() as begin:
        status = begin("fitting")
        status("round 3")
        err = progress_lines(capsys, "round 3", times=2)
    took_s = time.monotonic() - start_s
    err += capsys.readouterr().err
    lines = err.splitlines()
    assert lines[0] == "fitting"
    assert 2 <= len(lines) - 1 <= took_s / 0.2
    assert all(line.startswith("fitting  ") and line.endswith(" s  round 3") for line in lines[1:])
    assert "\r" not in err


def test_short_work_without_a_terminal_prints_one_line(capsys):
    with show_activity("reading"):
        pass
    assert capsys.readouterr().err == "reading\n"


def test_the_comparison_of_a_long_run_shows_its_progress_and_that_of_a_short_run_does_not(
    baqueano, monkeypatch
):
    assert baqueano("experiment", "--vehicle", "small", "--seconds", "1").code == 0
    for command in ("compare last", "replay last"):
        assert "comparison" not in baqueano(*command.split()).err
    monkeypatch.setattr(terminal, "PROGRESS_PERIOD_S", 0.05)
    module = sys.modules["baqueano.compare"]
    monkeypatch.setattr(module, "compare", lambda *a, **o: time.sleep(0.5) or compare(*a, **o))
    for command in ("compare last", "replay last"):
        assert re.search(r"^comparison  0 s$", baqueano(*command.split()).err, re.MULTILINE)
