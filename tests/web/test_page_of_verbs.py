"""The --page option of the driving commands: a browser shows the drive, may stop it, and may steer `drive`.

The command ends as without a page, and no process remains.
"""

import asyncio
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive.session import drive_stop_reason
from baqueano.guides.shapes import circle
from baqueano.runs import read_run
from baqueano.runs.route_file import read_route, write_route
from tests.emulated.rig import missing
from tests.web.chromium import CHROMIUM
from tests.web.page_client import WAIT_S, browser
from tests.web.screens import until
from tests.web.test_in_browser import PRESS, START_S, show_text
from tests.web.test_serve import Watcher, beats, port_of, program, simulated_vehicle

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
PLAIN = {**os.environ, "BAQUEANO_BACKEND": "python"}
PLAIN.pop("DISPLAY", None)
TWO_S = ("--vehicle", "small", "--seconds", "2", "-o", "run.mcap")
DRIVE = ("drive", "--vehicle", "small", "-o", "run.mcap")
DRIVING_BYTES = 20_000  # of a run: more than its head
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="Debian's package chromium is not installed")


@contextmanager
def with_page(folder, *words):
    """Run a command with --page in a folder, and yield its process and the port of its page."""
    with program("baqueano", *words, "--page", cwd=folder, env=PLAIN) as verb:
        yield verb, port_of(verb)


def repeat_ring(folder):
    """Store a route in a folder, and return the command that repeats it without end."""
    (folder / "routes").mkdir()
    write_route(circle(0.4, 0.25), folder / "routes" / "ring.csv")
    return "repeat", "ring", "--vehicle", "small", "--laps", "0"


def exit_code_of(verb, within_s=WAIT_S):
    """Return the exit code of a command."""
    assert verb.stderr is not None
    verb.stderr.read()
    return verb.wait(within_s)


def processes_of(group):
    """Return the ids of the child processes of this process, and of their child processes."""
    group_ids, is_growing = {group}, True
    while is_growing:
        is_growing = False
        for status in Path("/proc").glob("[0-9]*/stat"):
            try:
                words = status.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(words[1]) in group_ids and int(status.parent.name) not in group_ids and words[0] != "Z":
                group_ids.add(int(status.parent.name))
                is_growing = True
    return group_ids - {group}


def size_of(path):
    """Return the size of a file, 0 if it does not exist."""
    return path.stat().st_size if path.exists() else 0


def all_gone(pids, within_s=10.0):
    """Return True when none of these processes runs."""
    end = time.monotonic() + within_s
    while any(is_alive(pid) for pid in pids):
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_the_page_of_a_command_opens_in_the_language_of_the_command(tmp_path):
    words = "--lang", "es", "drive", "--vehicle", "small", "--page"
    with program("baqueano", *words, cwd=tmp_path, env=PLAIN) as verb:
        assert next(line for line in verb.stderr if "http" in line).partition("/?")[2].startswith("lang=es")


async def test_the_run_of_a_drive_is_the_same_with_a_page(tmp_path):
    for folder in ("with", "without"):
        (tmp_path / folder).mkdir()
    with with_page(tmp_path / "with", "experiment", *TWO_S) as (verb, port):
        async with browser(port) as visitor:
            assert visitor.hello["vehicle"]["world"] == "simulated"
            state = await visitor.next("state", state="OVER")
            assert "runs" in state["sentence"]
            with pytest.raises(Exception, match="1000"):
                await visitor.next("never")
            rows = visitor.rows(0, len(visitor.hello["fields"]))
            assert 0.0 < rows[-1, 0] < 2.02  # the last frame may show the stop
            assert np.isfinite(rows[-1, [f["name"] for f in visitor.hello["fields"]].index("truth.x")])
        assert exit_code_of(verb) == 0
    subprocess.run(
        [sys.executable, "-m", "baqueano", "experiment", *TWO_S], cwd=tmp_path / "without", env=PLAIN, check=True,
        capture_output=True,
    )  # fmt: skip
    assert read_run(tmp_path / "with" / "run.mcap") == read_run(tmp_path / "without" / "run.mcap")


async def test_teaching_with_a_page_is_displayed_and_the_route_is_stored(tmp_path):
    ring = ("--vehicle", "small", "--driver", "circle", "--size", "0.3", "--speed", "0.4")
    with with_page(tmp_path, "teach", "ring", *ring) as (verb, port):
        async with browser(port) as visitor:
            state = await visitor.next("state", where=lambda word: word["state"] in ("MISSION", "MANUAL"))
            assert state["mission"]["kind"] == "teach"
            await visitor.next("state", state="OVER")
            assert visitor.frames
        assert exit_code_of(verb) == 0
    assert read_route(tmp_path / "routes" / "ring.csv").closed


async def test_a_stop_on_the_page_ends_the_command_like_any_stop(tmp_path):
    with with_page(tmp_path, "experiment", "--vehicle", "small", "-o", "run.mcap") as (verb, port):
        async with browser(port, name="eva") as visitor:
            await visitor.next(
                "state", where=lambda word: word["state"] == "MISSION" and (word["t_s"] or 0) > 0.5
            )
            await visitor.send("mission", kind="drive")
            assert (await visitor.next("refused"))["to"] == "mission"
            await visitor.send("stop")
            await visitor.next("state", where=lambda word: word["state"] in ("STOPPED", "OVER"))
        assert exit_code_of(verb) == 5
    reason = drive_stop_reason(read_run(tmp_path / "run.mcap"))
    assert reason.code == StopReason.STOPPED_ON_PAGE
    assert reason.figures["name"] == "eva"


async def test_after_ctrl_c_or_a_killed_command_no_process_remains(tmp_path):
    for signal_number, code in ((signal.SIGINT, None), (signal.SIGKILL, -signal.SIGKILL)):
        with with_page(tmp_path, "experiment", "--vehicle", "small") as (verb, port):
            async with browser(port) as visitor:
                await visitor.next("state", state="MISSION")
                await visitor.send("take")
                beating = asyncio.create_task(beats(visitor))
                await visitor.send("pause")
                await visitor.next("state", paused=True)  # Ctrl-C still ends the drive
                beating.cancel()
            children = processes_of(verb.pid)
            assert children
            verb.send_signal(signal_number)
            code_of_end = exit_code_of(verb)
            assert code_of_end == (code if code is not None else code_of_end)
            assert all_gone(children)
            if signal_number == signal.SIGINT:
                plain = subprocess.Popen(
                    [sys.executable, "-m", "baqueano", "experiment", *TWO_S[:2], "-o", "plain.mcap"],
                    cwd=tmp_path, env=PLAIN, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL,
                )  # fmt: skip
                until(lambda: size_of(tmp_path / "plain.mcap") > DRIVING_BYTES, WAIT_S)
                plain.send_signal(signal.SIGINT)
                plain.communicate()
                assert code_of_end == plain.returncode


async def at_the_wheel(port, action):
    """Take control on the page of `drive`, drive ahead for a while, then do `action`."""
    async with browser(port, name="ana") as visitor:
        await visitor.send("take")
        beating = asyncio.create_task(beats(visitor, forward=0.6))
        try:
            await visitor.send("mission", kind="drive")
            await visitor.next(
                "state", where=lambda word: word["state"] == "MANUAL" and (word["t_s"] or 0) > 1.0
            )
            await action(visitor)
        finally:
            beating.cancel()


async def test_the_page_of_the_drive_command_steers_and_ends_the_drive(tmp_path):
    with with_page(tmp_path, *DRIVE) as (verb, port):

        async def end(visitor):
            await visitor.send("mark")
            await asyncio.sleep(0.3)
            await visitor.send("end")
            await visitor.next("state", state="OVER")

        await at_the_wheel(port, end)
        assert exit_code_of(verb) == 0
    run = read_run(tmp_path / "run.mcap")
    assert run.truth.eta[-1, 0] > 0.2
    assert len([event for event in run.events if event.source == "mark"]) == 1


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
async def test_rt13_a_killed_page_of_the_drive_command_stops_the_drive(tmp_path, signal_number):
    with with_page(tmp_path, *DRIVE) as (verb, port):
        children = processes_of(verb.pid)

        async def dies(visitor):
            for pid in children:
                os.kill(pid, signal_number)

        await at_the_wheel(port, dies)
        assert exit_code_of(verb) == 5
        assert all_gone(children)
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.HOLDER_SILENT
    assert drive_stop_reason(run).figures["silent_ms"] <= 500.0
    assert not run.applied_commands[-1].any()


async def test_a_robot_is_shown_paused_and_stopped_on_the_page_of_a_command(tmp_path):
    path = tmp_path / "door"
    with simulated_vehicle(path, tmp_path):
        watcher = Watcher(path)
        words = ("--rest", "0", "--robot", str(path), "-o", "run.mcap")
        with with_page(tmp_path, *repeat_ring(tmp_path), *words) as (verb, port):
            async with browser(port) as visitor:
                await visitor.next("state", where=lambda word: word["state"] == "MISSION" and visitor.frames)
                for do, pauses in (("pause", True), ("go", False)):
                    await visitor.send("take")
                    await visitor.send(do)
                    await visitor.next("state", paused=pauses)
                start_s = time.monotonic()
                await visitor.send("stop")
                _, came = await asyncio.to_thread(watcher.state, "STOPPED")
                assert came - start_s < 2.0  # the machine may be busy
            assert exit_code_of(verb) == 5
        watcher.close()
    assert drive_stop_reason(read_run(tmp_path / "run.mcap")).code == StopReason.STOPPED_ON_PAGE


async def test_the_page_of_the_drive_command_drives_a_robot(tmp_path):
    path = tmp_path / "door"
    with simulated_vehicle(path, tmp_path), with_page(tmp_path, *DRIVE, "--robot", str(path)) as (verb, port):

        async def silent(visitor):
            """Stay connected and send nothing, like a hidden tab: the caller ends the heartbeats."""

        await at_the_wheel(port, silent)
        assert exit_code_of(verb) == 5
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.HOLDER_SILENT
    assert run.truth.eta[-1, 0] > 0.2


@pytest.mark.skipif(bool(missing()), reason=f"Debian's packages {' '.join(missing())} are not installed")
async def test_the_emulated_vehicle_is_driven_manually_on_the_page(tmp_path):
    with with_page(tmp_path, *DRIVE, "--robot", "emulated") as (verb, port):

        async def end(visitor):
            assert visitor.hello["vehicle"]["world"] == "emulated"
            await visitor.send("stop")
            await visitor.next("state", where=lambda word: word["state"] in ("STOPPED", "OVER"))

        await at_the_wheel(port, end)
        assert exit_code_of(verb) == 5
    run = read_run(tmp_path / "run.mcap")
    assert np.max(run.truth.eta[:, 0]) > 0.1
    assert not run.applied_commands[-1].any()


@needs_browser
def test_a_repetition_is_shown_stopped_and_replayed_in_a_browser(browser, tmp_path):
    with with_page(tmp_path, *repeat_ring(tmp_path)) as (verb, port):
        tab = browser.tab()
        tab.goto(f"http://127.0.0.1:{port}/")
        show_text(tab, "REPEATING")
        show_text(tab, "from its route")
        tab.js(PRESS.format(name="STOP"))
        assert exit_code_of(verb) == 5
        tab.wait("baqueano.page.state.state === 'OVER'", START_S)
        time.sleep(1.0)
        assert not tab.js("baqueano.page.link.tries")  # no client connects to a closed door
        assert not tab.errors
        tab.close()
    with with_page(tmp_path, "replay", "last") as (verb, port):
        tab = browser.tab()
        tab.goto(f"http://127.0.0.1:{port}/")
        show_text(tab, "(ghost)")
        assert not tab.errors
        tab.close()
        assert exit_code_of(verb) == 0
