"""The page over the simulated service: it drives, and the end of the page is the end of the drive."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import AsyncExitStack, contextmanager
from itertools import count

import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive import drive_stop_reason
from baqueano.runs import read_run
from baqueano.web.feed import HEAD_LAYOUT
from benchmarks.page import MOST_MB, VIEWERS
from benchmarks.processes import before_others, resident_mb
from tests.web.page_client import WAIT_S, Browser, browser, line_to
from tests.web.vanishing import vanishing

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="sockets of the file system, signals")
START_S = 90.0  # of two Pythons on a busy machine
TRIES = 4


@contextmanager
def program(*words, **options):
    """Run a program of baqueano until the end of the test."""
    running = subprocess.Popen([sys.executable, "-m", *words], stderr=subprocess.PIPE, text=True, **options)
    assert running.stderr is not None
    try:
        yield running
    finally:
        if running.poll() is None:
            running.send_signal(signal.SIGCONT)
            running.send_signal(signal.SIGTERM)
        try:
            running.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()
        running.stderr.close()


def port_of(page):
    """Return the port that a page prints."""
    for line in page.stderr:
        if match := re.search(r"http://127\.0\.0\.1:(\d+)/", line):
            return int(match[1])
    raise AssertionError("it ended before it listened")


@contextmanager
def simulated_vehicle(path, folder):
    """Run the service of a simulated vehicle at the socket `path`, with its runs and routes in a folder."""
    with program(
        "baqueano.door.simulated", "small", "--socket", str(path), "--runs", str(folder), "--backend", "python",
        "--routes", str(folder),
    ):  # fmt: skip
        yield


@contextmanager
def served_vehicle(folder):
    """Serve the page of a simulated vehicle, and yield a watcher of its door, the process and the port of the page."""
    path = folder / "door"
    with before_others(), simulated_vehicle(path, folder):
        watcher = Watcher(path)
        with program(
            "baqueano", "serve", "--robot", str(path), "--no-browser", "--runs", str(folder)
        ) as page:
            yield watcher, page, port_of(page)
        watcher.close()


class Watcher:
    """A guest of the door in addition to the page."""

    def __init__(self, path):
        end = time.monotonic() + START_S
        while True:
            try:
                self.line = socket.socket(socket.AF_UNIX)
                self.line.connect(str(path))
                break
            except OSError:
                self.line.close()
                assert time.monotonic() < end, "the service did not start"
                time.sleep(0.05)
        self.line.settimeout(START_S)
        self.file = self.line.makefile("rb")

    def state(self, *states):
        """Return the first state of these names, and its time."""
        for data in self.file:
            word = json.loads(data)
            if word["type"] == "state" and word["state"] in states:
                return word, time.monotonic()
        raise AssertionError("the service has ended")

    def close(self):
        self.file.close()
        self.line.close()


async def driving(port, moves, via=None):
    """Drive manually as a browser does, a heartbeat for each picture, until the page has ended; `moves` is set
    meanwhile. The packets pass `via` another port."""
    async with line_to(port, host="127.0.0.1", port=via or port) as line:
        visitor, n, frame = Browser(line), 0, 0
        await visitor.send("hello", lang="en", name="ana")
        await visitor.next("hello")
        await visitor.send("take")
        await visitor.send("mission", kind="drive")
        hearing = asyncio.ensure_future(line.recv())
        while True:
            done, _ = await asyncio.wait({hearing}, timeout=0.05)
            if done:
                data = hearing.result()
                frame = HEAD_LAYOUT.unpack(data[:16])[0] if isinstance(data, bytes) else frame
                if frame > 20:
                    moves.set()
                hearing = asyncio.ensure_future(line.recv())
                if not isinstance(data, bytes):
                    # the machine stalled
                    if json.loads(data).get("state") == "STOPPED" and not moves.is_set():
                        await visitor.send("clear")
                        await visitor.send("take")
                        await visitor.send("mission", kind="drive")
                    continue
            n += 1
            await visitor.send("beat", n=n, frame=frame, u=[0.5, 0.0, 0.0])
            await asyncio.sleep(0.03)


@pytest.mark.parametrize("signal_number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
async def test_rt13_a_page_that_is_killed_or_frozen_stops_the_vehicle(tmp_path, signal_number):
    with served_vehicle(tmp_path) as (watcher, page, port):
        moves = asyncio.Event()
        drives = asyncio.create_task(driving(port, moves))
        moving = asyncio.create_task(moves.wait())
        await asyncio.wait({drives, moving}, return_when=asyncio.FIRST_COMPLETED)
        assert moves.is_set()
        await asyncio.to_thread(watcher.state, "MANUAL")
        os.kill(page.pid, signal_number)
        start_s = time.monotonic()
        state, came = await asyncio.to_thread(watcher.state, "STOPPED")
        assert came - start_s < 2.0  # on a busy machine the message may arrive late
        assert state["reason"]["code"] == "operator.silent"
        assert 300.0 <= state["reason"]["figures"]["silent_ms"] <= 500.0
        drives.cancel()
        await asyncio.gather(drives, return_exceptions=True)


async def test_rt13_a_browser_without_network_loses_the_vehicle_within_half_a_second(tmp_path):
    """Neither end is notified: no end of the connection, no error. A viewer on another connection continues."""
    with served_vehicle(tmp_path) as (watcher, _, port):
        moves = asyncio.Event()
        async with vanishing(port) as line:
            drives = asyncio.create_task(driving(port, moves, line.port))
            await asyncio.wait_for(moves.wait(), WAIT_S)
            await asyncio.to_thread(watcher.state, "MANUAL")
            line.unplug()
            state, _ = await asyncio.to_thread(watcher.state, "STOPPED")
            assert state["reason"]["code"] == "operator.silent"
            assert 300.0 <= state["reason"]["figures"]["silent_ms"] <= 500.0
            assert not drives.done()  # the browser was not notified
            drives.cancel()
            await asyncio.gather(drives, return_exceptions=True)
    run = read_run(max(tmp_path.glob("*.mcap")))
    assert drive_stop_reason(run).code == StopReason.HOLDER_SILENT
    assert run.applied_commands[:, 0].max() > 0.4
    assert not run.applied_commands[-1].any()


class StoppedItself(Exception):
    """The vehicle stopped although no client sent a stop."""


async def expected(visitor, kind, matches):
    """Return the next message of a kind that satisfies the condition; raise StoppedItself if the vehicle stops
    before."""

    def ends(word):
        return (word["type"] == kind and matches(word)) or word.get("state") == "STOPPED"

    word = await visitor.next(kind, "state", where=ends)
    if word.get("state") == "STOPPED":
        raise StoppedItself(word["sentence"])
    return word


async def lesson(visitor):
    """Take control, teach a ring and drive along it until the third lap."""
    await visitor.send("take")
    await visitor.send("mission", kind="teach", name="ring", shape="circle", size_m=0.3, speed_m_s=0.3)
    assert (await expected(visitor, "route", lambda word: word["x"]))["closed"]
    routes = await expected(visitor, "routes", lambda word: word["routes"])
    assert routes["routes"][0]["name"] == "ring"
    assert visitor.frames
    await expected(visitor, "state", lambda word: word["state"] == "READY")
    await visitor.send("mission", kind="repeat", route="ring", laps=0)
    state = await expected(visitor, "state", lambda w: w["mission"] == {"kind": "repeat", "route": "ring"})
    assert state["state"] == "MISSION"
    await expected(visitor, "state", lambda word: (word["lap"] or 0) >= 2)


async def ready_again(visitor):
    await visitor.send("clear")
    await visitor.next("state", state="READY")


async def test_a_route_is_taught_repeated_and_stopped_from_the_browser(tmp_path):
    with program(
        "baqueano", "serve", "--vehicle", "small", "--no-browser", "--pace", "20", "--runs", "runs", cwd=tmp_path,
        env={**os.environ, "BAQUEANO_BACKEND": "python"},
    ) as page:  # fmt: skip
        port = port_of(page)
        async with AsyncExitStack() as room:
            visitor, *others = [await room.enter_async_context(browser(port)) for _ in range(VIEWERS)]
            looking = [asyncio.create_task(pictures(tab)) for tab in others]
            beating = asyncio.create_task(beats(visitor))
            for tries_left in reversed(range(TRIES)):
                try:
                    await lesson(visitor)
                    break
                except StoppedItself:  # the machine stalled for longer than the lease
                    last = max((tmp_path / "runs").glob("*.mcap"), key=lambda path: path.name)
                    assert drive_stop_reason(read_run(last)).code == StopReason.HOLDER_SILENT
                    assert tries_left, "the lease was lost at each try"
                    await ready_again(visitor)
            await visitor.send("stop")
            await visitor.next("state", state="STOPPED")
            runs = await visitor.next("runs", where=lambda word: word["runs"][0]["kind"] == "repeat")
            assert {run["kind"] for run in runs["runs"]} == {"teach", "repeat"}
            await ready_again(visitor)
            if sys.platform == "linux":
                assert resident_mb(page.pid) <= MOST_MB
            assert all(tab.frames for tab in others)
            for task in (beating, *looking):
                task.cancel()


async def pictures(visitor):
    """Receive the pictures, as a browser of a viewer does."""
    while True:
        await visitor.next("frame")  # no message has this name: each picture is stored


async def beats(visitor, forward=0.0):
    """Send a heartbeat with a command for the newest picture, as a browser that draws does."""
    for n in count(1):
        frame = HEAD_LAYOUT.unpack(visitor.frames[-1][:16])[0] if visitor.frames else 0
        await visitor.send("beat", n=n, frame=frame, u=[forward, 0.0, 0.0])
        await asyncio.sleep(0.03)
