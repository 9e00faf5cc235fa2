"""The page of a robot at a HOST: a shell replaces ssh, and starts the real command line at the other end.

The vehicle is a simulated service at a socket, as a robot has it.
"""

import asyncio
import os
import signal
import socket
import sys

import pytest

from baqueano.drive import drive_stop_reason
from baqueano.runs import read_run
from benchmarks.processes import before_others
from tests.web.page_client import browser
from tests.web.test_serve import (
    START_S,
    StoppedItself,
    Watcher,
    beats,
    expected,
    port_of,
    program,
    ready_again,
    simulated_vehicle,
)

pytestmark = pytest.mark.skipif(
    sys.platform == "win32" or not hasattr(socket, "AF_UNIX"), reason="sockets of the file system, a shell"
)
TRIES = 4


def put_programs(folder, door):
    """Write ssh and the robot's baqueano into a folder; return the file of the calls of ssh: process and arguments."""
    scripts = {
        "ssh": f'echo "$$ $*" >>{folder}/calls\nfor last; do :; done; exec sh -c "$last"',
        "baqueano": f'exec {sys.executable} -m baqueano "$@" --door {door}',
    }
    folder.mkdir()
    for name, text in scripts.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    return folder / "calls"


async def drives(visitor):
    """Drive manually until the pictures show the command and the motion of the vehicle."""
    await visitor.send("take")
    await visitor.send("mission", kind="drive")
    await expected(visitor, "state", lambda word: word["state"] == "MANUAL")
    names = [field["name"] for field in visitor.hello["fields"]]
    while True:
        rows = visitor.rows(0, len(names))
        if len(rows) > 50 and rows[-1, names.index("u.0")] > 0.4 and rows[-1, names.index("eta.x")] > 0.02:
            return
        word = await visitor.next("state", "hello")
        if word["type"] == "hello":  # the robot has described its first drive
            names, visitor.frames = [field["name"] for field in word["fields"]], []
        elif word["state"] == "STOPPED":
            raise StoppedItself(word["sentence"])


async def test_the_page_of_a_host_shows_stops_and_copies_a_drive_over_ssh(tmp_path):
    path, robot_folder, laptop_folder = tmp_path / "door", tmp_path / "there", tmp_path / "here"
    calls = put_programs(tmp_path / "bin", path)
    environment = {**os.environ, "PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}"}
    with before_others(), simulated_vehicle(path, robot_folder):
        Watcher(path).close()  # the service has started
        serve = ("baqueano", "serve", "--robot", "ana@r1", "--vehicle", "small", "--no-browser")
        with program(*serve, "--runs", str(laptop_folder), cwd=tmp_path, env=environment) as page:
            port = port_of(page)
            process, words = calls.read_text().split(maxsplit=1)
            assert "BatchMode=yes" in words
            assert words.endswith("-- ana@r1 exec baqueano robot attach\n")
            async with browser(port, name="ana") as visitor:
                beating = asyncio.create_task(beats(visitor, forward=0.5))
                for tries_left in reversed(range(TRIES)):
                    try:
                        await drives(visitor)
                        break
                    except StoppedItself:  # the machine stalled for longer than the lease
                        assert tries_left, "the lease was lost at each try"
                        await ready_again(visitor)
                await visitor.send("stop")
                state = await visitor.next("state", state="STOPPED")
                assert "ana" in state["sentence"]
                beating.cancel()
                await visitor.next(
                    "runs", where=lambda word: any(run["kind"] == "drive" for run in word["runs"])
                )
            last = max(laptop_folder.glob("*.mcap"))
            run = read_run(last)
            assert drive_stop_reason(run).figures["name"] == "ana"
            assert run.applied_commands[:, 0].max() > 0.4
            assert not run.applied_commands[-1].any()
            assert last.read_bytes() == (robot_folder / last.name).read_bytes()
            assert " ana@r1 " in calls.read_text().splitlines()[-1]
            os.kill(int(process), signal.SIGKILL)
            assert page.wait(START_S) == 4  # the robot cannot be reached any more
