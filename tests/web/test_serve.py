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
from contextlib import contextmanager

import pytest

from baqueano.web.feed import HEAD
from tests.web.page_client import WAIT_S, Browser, run_page

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="sockets of the file system, signals")
START_S = 90.0  # of two Pythons on a busy machine


@contextmanager
def program(*words, **how):
    """Run a program of ours until the test is over."""
    running = subprocess.Popen([sys.executable, "-m", *words], stderr=subprocess.PIPE, text=True, **how)
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
        if found := re.search(r"http://127\.0\.0\.1:(\d+)/", line):
            return int(found[1])
    raise AssertionError("it ended before it listened")


class Watcher:
    """A guest of the door beside the page."""

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

    def state(self, *wanted):
        """Return the first state of these names, and when it came."""
        for data in self.file:
            word = json.loads(data)
            if word["is"] == "state" and word["state"] in wanted:
                return word, time.monotonic()
        raise AssertionError("the service has ended")

    def close(self):
        self.file.close()
        self.line.close()


async def driving(port, moves):
    """Drive by hand as a browser does, a beat for each picture, until the page has gone; `moves` is set meanwhile."""
    from websockets.asyncio.client import connect

    host = f"127.0.0.1:{port}"
    async with connect(
        f"ws://{host}/ws", origin=f"http://{host}", subprotocols=["baqueano.1"], compression=None
    ) as line:
        one, n, seen = Browser(line), 0, 0
        await one.say("hello", lang="en", name="ana")
        await one.next("hello")
        await one.say("take")
        await one.say("mission", kind="drive")
        hearing = asyncio.ensure_future(line.recv())
        while True:
            done, _ = await asyncio.wait({hearing}, timeout=0.05)
            if done:
                data = hearing.result()
                seen = HEAD.unpack(data[:16])[0] if isinstance(data, bytes) else seen
                if seen > 20:
                    moves.set()
                hearing = asyncio.ensure_future(line.recv())
                if not isinstance(data, bytes):
                    continue
            n += 1
            await one.say("beat", n=n, seen=seen, u=[0.5, 0.0, 0.0])
            await asyncio.sleep(0.03)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_rt13_a_page_that_is_killed_or_frozen_stops_the_vehicle(tmp_path, how):
    path = tmp_path / "door"
    with program(
        "baqueano.door.simulated", "small", "--socket", str(path), "--runs", str(tmp_path), "--backend", "python",
        "--routes", str(tmp_path),
    ):  # fmt: skip
        watcher = Watcher(path)
        with program(
            "baqueano", "serve", "--robot", str(path), "--no-browser", "--runs", str(tmp_path)
        ) as page:
            port = port_of(page)

            async def job():
                moves = asyncio.Event()
                drives = asyncio.create_task(driving(port, moves))
                moving = asyncio.create_task(moves.wait())
                await asyncio.wait({drives, moving}, return_when=asyncio.FIRST_COMPLETED)
                assert moves.is_set()
                await asyncio.to_thread(watcher.state, "MANUAL")
                os.kill(page.pid, how)
                begun = time.monotonic()
                state, came = await asyncio.to_thread(watcher.state, "STOPPED")
                assert came - begun < 2.0  # 0.3 s and the door; the machine may be busy
                assert state["why"]["code"] == "operator.silent"
                drives.cancel()
                await asyncio.gather(drives, return_exceptions=True)

            run_page(job)
        watcher.close()


def test_a_route_is_taught_repeated_and_stopped_from_the_browser(tmp_path):
    with program(
        "baqueano", "serve", "--vehicle", "small", "--no-browser", "--pace", "20", "--runs", "runs", cwd=tmp_path,
        env={**os.environ, "BAQUEANO_BACKEND": "python"},
    ) as page:  # fmt: skip
        port = port_of(page)

        async def job():
            from websockets.asyncio.client import connect

            host = f"127.0.0.1:{port}"
            async with connect(
                f"ws://{host}/ws", origin=f"http://{host}", subprotocols=["baqueano.1"], compression=None
            ) as line:
                one = Browser(line)
                await one.say("hello", lang="en")
                await one.next("hello")
                beating = asyncio.create_task(beats(one))
                await one.say("take")
                await one.say("mission", kind="teach", name="ring", shape="circle", size_m=0.3, speed_m_s=0.3)
                assert (await one.next("route", where=lambda word: word["x"]))["closed"]
                routes = await one.next("routes", where=lambda word: word["routes"])
                assert routes["routes"][0]["name"] == "ring"
                assert one.frames
                await one.say("mission", kind="repeat", route="ring", laps=0)
                state = await one.next(
                    "state", where=lambda w: w["mission"] == {"kind": "repeat", "route": "ring"}
                )
                assert state["state"] == "MISSION"
                await one.next("state", where=lambda word: (word["lap"] or 0) >= 2)
                await one.say("stop")
                await one.next("state", where=lambda word: word["state"] == "STOPPED")
                runs = await one.next("runs", where=lambda word: len(word["runs"]) == 2)
                assert {run["kind"] for run in runs["runs"]} == {"teach", "repeat"}
                await one.say("clear")
                await one.next("state", where=lambda word: word["state"] == "READY")
                beating.cancel()

        run_page(job)


async def beats(one):
    """Beat before each newest picture, as a browser that draws does."""
    n = 0
    while True:
        n += 1
        seen = HEAD.unpack(one.frames[-1][:16])[0] if one.frames else 0
        await one.say("beat", n=n, seen=seen, u=[0.0, 0.0, 0.0])
        await asyncio.sleep(0.05)
