"""Many vehicles in one room, and a network around the page: no command goes to another vehicle, no port is open."""

import asyncio
import json
import os
import subprocess
import sys
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import WAIT_S, browser

VEHICLES = 20
EACH = 12  # beats of a driver
NAMESPACE = ["unshare", "--map-root-user", "--net", "--"]
SCAN = """
import fcntl, json, os, re, socket, struct, subprocess, sys, urllib.request

def up(name, address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        at = struct.pack("16sH2s4s8s", name, socket.AF_INET, b"", socket.inet_aton(address), b"")
        fcntl.ioctl(line, 0x8916, at)  # SIOCSIFADDR
        flags = struct.pack("16sH14s", name.partition(b":")[0], 0x1 | 0x40, b"")
        fcntl.ioctl(line, 0x8914, flags)  # SIOCSIFFLAGS: up, running

up(b"lo", "127.0.0.1")
up(b"lo:1", "10.77.0.1")  # the address of this machine in a network
page = subprocess.Popen([sys.executable, "-m", "baqueano", *sys.argv[1:]], stderr=subprocess.PIPE, text=True)
port = next(int(m[1]) for line in page.stderr if (m := re.search(r"http://[\\d.]+:(\\d+)/", line)))
found = []
for k in range(1, 65536):
    with socket.socket() as line:
        if not line.connect_ex(("10.77.0.1", k)) and line.getsockname() != line.getpeername():  # else it met itself
            found.append(k)
listens = [line.split()[1] for line in open("/proc/net/tcp").readlines()[1:] if line.split()[3] == "0A"]
body = urllib.request.urlopen(f"http://127.0.0.1:{port}/").read().decode()
page.terminate(); page.wait()
print(json.dumps({"port": port, "found": found, "listens": listens, "title": "<title>" in body}))
"""


def has_namespaces():
    """Return True if this system can make a separate network."""
    if sys.platform != "linux":
        return False
    try:
        return subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


needs_namespace = pytest.mark.skipif(
    not has_namespaces(), reason="this system makes no network of its own (unshare --map-root-user --net)"
)


def scanned(tmp_path, *options):
    (tmp_path / "scan.py").write_text(SCAN)
    done = subprocess.run(
        [*NAMESPACE, sys.executable, "scan.py", "serve", "--vehicle", "small", "--no-browser", *options],
        cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False, env=os.environ,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@needs_namespace
def test_ne1_ne8_no_port_is_open_and_the_page_needs_no_network(tmp_path):
    record = scanned(tmp_path)
    assert record["found"] == []
    assert {address.partition(":")[0] for address in record["listens"]} == {"0100007F"}  # 127.0.0.1
    assert record["title"]  # this network is not connected to another network


@needs_namespace
def test_ne1_a_shared_page_opens_one_port_at_one_address(tmp_path):
    record = scanned(tmp_path, "--address", "10.77.0.1")
    assert record["found"] == [record["port"]]
    assert {address.partition(":")[0] for address in record["listens"]} == {"0100007F", "01004D0A"}


async def test_ne9_twenty_vehicles_in_one_room_obey_only_their_own_driver(tmp_path):
    async with AsyncExitStack() as room:
        pages = [await room.enter_async_context(live_page(tmp_path / str(k))) for k in range(VEHICLES)]
        drivers = [
            await room.enter_async_context(browser(server, name=f"driver {k}"))
            for k, (server, _, _) in enumerate(pages)
        ]
        robots = [driver.hello["robot"] for driver in drivers]
        assert len(set(robots)) == VEHICLES

        async def drives(k):
            """Drive a vehicle; each heartbeat follows one for the vehicle of the neighbour."""
            (_, link, live), driver, n = pages[k], drivers[k], 0
            while len(link.requests("hand")) < EACH:
                if live.lease.holder is None:  # the machine may be busy
                    await driver.send("take", robot=robots[k])
                link.frame(0.05 * n)
                for robot, u in ((robots[(k + 1) % VEHICLES], -1.0), (robots[k], k / 100.0)):
                    n += 1
                    await driver.send("beat", n=n, frame=live.feed.number, u=[u], robot=robot)
                await asyncio.sleep(0.05)

        async with asyncio.timeout(WAIT_S), asyncio.TaskGroup() as driving:
            for k in range(VEHICLES):
                driving.create_task(drives(k))
        crossed_words = [word for k, (_, link, _) in enumerate(pages) for word in link.requests("hand")
                   if word["u"] != [k / 100.0]]  # fmt: skip
        assert crossed_words == []
        await drivers[0].send("mission", kind="drive", robot=robots[1])
        assert (await drivers[0].next("refused", to="mission"))["code"] == "web.other-robot"
        await drivers[0].send("stop", robot=robots[1])  # a stop never reaches another vehicle
        await until(lambda: pages[0][1].requests("stop"))
        assert not any(link.requests("stop") for _, link, _ in pages[1:])


def test_ne7_the_documentation_explains_sharing_risk_and_ssh():
    for name, plain in (("page.md", "unencrypted"), ("es/page.md", "sin cifrar")):
        text = (Path(__file__).parents[2] / "docs" / name).read_text(encoding="utf-8")
        assert plain in text
        assert "--robot HOST" in text
        assert "12 h" in text
