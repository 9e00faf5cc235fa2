"""Measure the cost of the page: its process with viewers, the loop beside it, and the time to a first picture.

The service of a simulated vehicle drives at 100 Hz in a separate process. The page process connects to its socket, as
on a robot. Processor time is of the page process only; a waiting time also depends on other work of the machine. The
two cases of a comparison are measured in turn, so that other work slows both.
"""

import asyncio
import json
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any

from baqueano.door import VERSION
from baqueano.web import SUBPROTOCOL
from benchmarks.harness import Bench, LeftOut, Row
from benchmarks.processes import before_others, first_of_all, p99, quantile, resident_mb, spread

VIEWERS = 5
MOST_PERCENT, MOST_MB = 2.0, 35.0
MOST_LATER_MS = 0.2  # growth of a tick's p99 by a visitor who requests history, or by tabs that do not read
TABS, MOST_GROWN_MB = 50, 5.0  # tabs that do not read, and the growth of the page process by them
MOST_PICTURE_MS, MOST_KEY_MS, MOST_FRAME_MS = 500.0, 60.0, 8.0
STARTS_S = 120.0


def benches(smallest: bool) -> list[Bench | LeftOut]:
    """Return the costs of viewers, of a visitor who requests history, and of stalled tabs, and the browser's times."""
    if not hasattr(socket, "AF_UNIX"):
        return [LeftOut("the page", "it speaks to a service through a socket of Unix")]
    with ExitStack() as open_things:
        open_things.enter_context(before_others())
        folder = Path(open_things.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        service, door = open_things.enter_context(_service(folder))
        page, port = open_things.enter_context(_page(folder, door))
        guest = open_things.enter_context(_Guest(door))
        rounds, seconds = (1, 0.5) if smallest else (6, 4.0)
        benches_of_room: list[Bench | LeftOut] = [
            asyncio.run(_viewers(page, port, rounds, seconds)),
            asyncio.run(_history(service, guest, port, rounds, seconds)),
            asyncio.run(_stalled(service, page, guest, port, rounds, seconds)),
        ]
        guest.send("end")
        return [*benches_of_room, *_browser(smallest)]


async def _viewers(page: int, port: int, rounds: int, seconds: float) -> Bench:
    """Return processor time and memory of the page process without and with viewers, in turn."""
    without_viewers, with_viewers = [], []
    for _ in range(rounds):
        without_viewers.append(await _share(page, seconds))
        async with _viewers(port, VIEWERS):
            with_viewers.append(await _share(page, seconds))
    resident = resident_mb(page)
    none, five = median(without_viewers), median(with_viewers)
    rows = (
        Row("nobody looks", none / 100.0, 1.0, note=f"{none:.2f} % of a core"),
        Row(
            f"{VIEWERS} browsers at 20 Hz", five / 100.0, five / max(none, 1e-9), is_missed=five > MOST_PERCENT,
            note=f"{five:.2f} % of a core (at most {MOST_PERCENT:g}); {spread(with_viewers)}",
        ),
        Row(
            "memory", 0.0, 1.0, is_missed=resident > MOST_MB,
            note=f"{resident:.1f} MB resident (at most {MOST_MB:g})",
        ),
    )  # fmt: skip
    return Bench("the page process in a second of driving at 100 Hz", rows)


async def _history(service: int, guest: "_Guest", port: int, rounds: int, seconds: float) -> Bench:
    """Return the delay of ticks in the service while a visitor of the page requests the last 60 s twice a second."""
    first = "with SCHED_FIFO" if first_of_all(service) else "without SCHED_FIFO"
    plain, with_history = [], []
    await asyncio.sleep(0.5 if rounds == 1 else 10.0)  # the ring of the page fills
    for _ in range(rounds):
        plain.append(await asyncio.to_thread(guest.late_ms, seconds))
        async with _viewers(port, 1) as lines:
            asking = asyncio.create_task(_ask_again(lines[0]))
            with_history.append(await asyncio.to_thread(guest.late_ms, seconds))
            asking.cancel()
    without, busy = (p99([x for times in histories for x in times]) for histories in (plain, with_history))
    later = median(p99(b) - p99(a) for a, b in zip(plain, with_history, strict=True))
    rows = (
        Row("p99 without a visitor", 1e-3 * without, 1.0, note=f"of {sum(map(len, plain))} ticks, {first}"),
        Row(
            "with one who takes history", 1e-3 * busy, busy / max(without, 1e-9), is_missed=later > MOST_LATER_MS,
            note=f"{later:+.3f} ms, median of {rounds} pairs (at most {MOST_LATER_MS:g})",
        ),
    )  # fmt: skip
    return Bench("how late a tick of the loop begins", rows)


async def _stalled(service: int, page: int, guest: "_Guest", port: int, rounds: int, seconds: float) -> Bench:
    """Return the memory of the page process, and the delay of ticks, while tabs do not read."""
    first = "with SCHED_FIFO" if first_of_all(service) else "without SCHED_FIFO"
    plain, stalled_times, growth_mb, visitors = [], [], [], 0
    for _ in range(rounds):
        plain.append(await asyncio.to_thread(guest.late_ms, seconds))
        before = resident_mb(page)
        async with _connect_guests(port, TABS) as lines:
            visitors = len(lines)
            for line in lines:
                line.transport.pause_reading()
            stalled_times.append(await asyncio.to_thread(guest.late_ms, seconds))
            growth_mb.append(resident_mb(page) - before)
    later = median(p99(b) - p99(a) for a, b in zip(plain, stalled_times, strict=True))
    without, busy = (p99([x for times in histories for x in times]) for histories in (plain, stalled_times))
    rows = (
        Row("p99 without them", 1e-3 * without, 1.0, note=f"of {sum(map(len, plain))} ticks, {first}"),
        Row(f"with the {visitors} that are let in", 1e-3 * busy, busy / max(without, 1e-9),
            is_missed=later > MOST_LATER_MS or max(growth_mb) > MOST_GROWN_MB,
            note=f"{later:+.3f} ms, median of {rounds} pairs (at most {MOST_LATER_MS:g}); "
                 f"{max(growth_mb):+.1f} MB resident (at most {MOST_GROWN_MB:g})"),
    )  # fmt: skip
    return Bench(f"{TABS} tabs that read nothing", rows)


def _browser(smallest: bool) -> list[Bench | LeftOut]:
    """Return the times to the first picture and from key to command, and the cost of drawing, in headless Chromium."""
    from tests.web.chromium import CHROMIUM, Chromium

    if CHROMIUM is None:
        return [LeftOut("the page in a browser", "sudo apt-get install chromium")]
    pictures, keys, drawings, strips = [], [], [], 0
    with ExitStack() as open_things:
        folder = Path(open_things.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        _, door = open_things.enter_context(_service(folder))
        _, port = open_things.enter_context(_page(folder, door))
        chromium = open_things.enter_context(Chromium())
        tab = chromium.tab()
        tab.size(1280, 800)
        tab.do("Page.addScriptToEvaluateOnNewDocument", source=FIRST)
        tab.goto(f"http://127.0.0.1:{port}/")
        tab.wait("globalThis.baqueano?.page.hello", STARTS_S)
        _drive(tab)
        with _Guest(door, begin=False) as guest:
            for _ in range(2 if smallest else 15):
                keys.append(_key_to_command(tab, guest))
        drawings = tab.js("drawings_ms.slice(-240)")
        strips = tab.js("document.querySelectorAll('.strip canvas, canvas.strip').length")
        for _ in range(1 if smallest else 5):
            second = chromium.tab()
            second.size(1280, 800)
            second.do("Page.addScriptToEvaluateOnNewDocument", source=FIRST)
            second.goto(f"http://127.0.0.1:{port}/")
            second.wait("globalThis.first_ms", STARTS_S)
            pictures.append(second.js("first_ms"))
            second.close()
        tab.close()
    picture, key, drawing = median(pictures), median(keys), quantile(drawings, 0.95)
    rows = (
        Row("from open to the first picture", 1e-3 * picture, 1.0, is_missed=picture > MOST_PICTURE_MS,
            note=f"median of {len(pictures)} (at most {MOST_PICTURE_MS:g} ms); {spread(pictures)}"),
        Row("from a key to the command of a tick", 1e-3 * key, key / picture, is_missed=key > MOST_KEY_MS,
            note=f"median of {len(keys)} (at most {MOST_KEY_MS:g} ms); {spread(keys)}"),
        Row(f"a drawing of the map and {strips} strips", 1e-3 * drawing, drawing / picture,
            is_missed=drawing > MOST_FRAME_MS,
            note=f"p95 of {len(drawings)}, median {median(drawings):.1f} ms (at most {MOST_FRAME_MS:g})"),
    )  # fmt: skip
    return [Bench("the page in a browser on this machine", rows)]


def _drive(tab: Any) -> None:
    """Take control and drive by hand; repeat this if a slow machine lost the control."""
    end = time.monotonic() + STARTS_S
    while not tab.js("baqueano.page.state.state === 'MANUAL' && baqueano.page.record.length > 20"):
        assert time.monotonic() < end, tab.js("baqueano.page.state.sentence")
        if not tab.js("baqueano.page.hand.mine"):
            tab.js("baqueano.page.hand.toggle()")
        elif tab.js("baqueano.page.state.state") in ("READY", "STOPPED"):
            tab.js("baqueano.page.link.send({type: 'clear'})")
            tab.js("baqueano.page.link.send({type: 'mission', kind: 'drive'})")
        time.sleep(0.2)


FIRST = """
globalThis.drawings_ms = [];
const next = requestAnimationFrame;
globalThis.requestAnimationFrame = (draw) => next((now_ms) => {
  const began_ms = performance.now();
  draw(now_ms);
  if (globalThis.baqueano?.page.screen) drawings_ms.push(performance.now() - began_ms);
});
const looked = () => {
  if (globalThis.baqueano?.page.record?.length > 0 && drawings_ms.length > 0) globalThis.first_ms = performance.now();
  else next(looked);
};
next(looked);
"""


def _key_to_command(tab: Any, guest: "_Guest") -> float:
    """Return the time [ms] from a key in the browser to the first tick with its command."""
    offset_s = guest.offset_s(1.0)
    start_s = time.monotonic()
    tab.down("w", "KeyW")
    moved_s = guest.first_s("u.0", lambda u: u > 0.01)
    tab.up("w", "KeyW")
    guest.first_s("u.0", lambda u: abs(u) < 1e-6)
    return 1e3 * (moved_s + offset_s - start_s)


class _Guest:
    """A client of the service that drives it and reads its ticks; `begin` starts an experiment of an hour."""

    def __init__(self, door: Path, begin: bool = True) -> None:
        self._begin = begin
        self._line = socket.socket(socket.AF_UNIX)
        self._line.connect(str(door))
        self._line.settimeout(STARTS_S)
        self._file = self._line.makefile("rb")
        self._at: dict[str, int] = {}

    def __enter__(self) -> "_Guest":
        if self._begin:
            self.send("mission", id="bench", kind="experiment", seconds=3600, attended=False, door=VERSION)
            while (word := self._word("state", "refused")).get("state") != "MISSION":
                if word["type"] == "refused":
                    raise RuntimeError(word["reason"])
        self.send("watch", hz=50)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._file.close()
            self._line.close()

    def send(self, request: str, **words: object) -> None:
        """Send the request with these words to the service."""
        self._line.sendall(json.dumps({"type": request, **words}).encode() + b"\n")

    def late_ms(self, seconds: float) -> list[float]:
        """Return the delay [ms] of each tick in the next `seconds`."""
        end, times_ms = time.monotonic() + seconds, []
        for rows in self._frames(end):
            times_ms += [row[self._at["late_ms"]] for row in rows]
        return times_ms

    def offset_s(self, seconds: float) -> float:
        """Return the monotonic clock [s] at 0 s of the drive, estimated from the frame with the shortest delay."""
        end = time.monotonic() + seconds
        return min(time.monotonic() - rows[-1][self._at["t"]] for rows in self._frames(end))

    def first_s(self, column: str, condition: Any) -> float:
        """Return the time [s] in the drive of the next tick in which the column satisfies the condition `condition`."""
        for rows in self._frames(time.monotonic() + STARTS_S):
            for row in rows:
                if condition(row[self._at[column]]):
                    return row[self._at["t"]]
        raise TimeoutError(column)

    def _frames(self, end_s: float) -> Iterator[list[list[float]]]:
        while time.monotonic() < end_s:
            word = self._word("frame", "fields")
            if word["type"] == "fields":
                self._at = {name: k for k, name in enumerate(word["names"])}
            elif self._at:
                yield word["x"]

    def _word(self, *kinds: str) -> dict[str, Any]:
        for line in self._file:
            word = json.loads(line)
            if word["type"] in (kinds or ("state",)):
                return word
        raise EOFError


@contextmanager
def _service(folder: Path) -> Iterator[tuple[int, Path]]:
    """Run the service of a simulated vehicle; yield its process and its socket."""
    door = folder / "door"
    words = ["-m", "baqueano.door.simulated", "small", "--socket", str(door), "--runs", str(folder / "runs")]
    program = subprocess.Popen([sys.executable, *words, "--routes", str(folder)])
    try:
        end = time.monotonic() + STARTS_S
        while not door.exists():
            assert program.poll() is None, "the service did not start"
            assert time.monotonic() < end, "the service did not start"
            time.sleep(0.05)
        yield program.pid, door
    finally:
        program.terminate()
        program.wait()


@contextmanager
def _page(folder: Path, door: Path) -> Iterator[tuple[int, int]]:
    """Run the page process of that service; yield its process and its port."""
    words = ["-m", "baqueano", "serve", "--vehicle", "small", "--robot", str(door), "--no-browser"]
    command = [sys.executable, *words, "--runs", str(folder / "runs")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as program:
        assert program.stderr is not None
        try:
            match = next(m for line in program.stderr if (m := re.search(r"127\.0\.0\.1:(\d+)/", line)))
            yield program.pid, int(match[1])
        finally:
            program.send_signal(signal.SIGTERM)


@asynccontextmanager
async def _connect_guests(port: int, number: int) -> Any:
    """Connect browsers that send hello; yield as many as the page admits."""
    from websockets.asyncio.client import connect
    from websockets.exceptions import InvalidStatus

    host, lines = f"127.0.0.1:{port}", []
    async with asyncio.timeout(STARTS_S):
        for _ in range(number):
            with suppress(InvalidStatus):
                lines.append(await connect(
                    f"ws://{host}/ws", origin=f"http://{host}", subprotocols=[SUBPROTOCOL], compression=None,
                    max_size=None,
                ))  # fmt: skip
        for line in lines:
            await line.send('{"type":"hello","lang":"en"}')
    try:
        yield lines
    finally:
        for line in lines:
            line.transport.abort()


@asynccontextmanager
async def _viewers(port: int, number: int) -> Any:
    """Connect browsers that read all messages."""
    async with _connect_guests(port, number) as lines:
        reading = [asyncio.create_task(_read_all(line)) for line in lines]
        await asyncio.sleep(1.0)  # until hello, history and list of runs are received
        try:
            yield lines
        finally:
            for task in reading:
                task.cancel()


async def _read_all(line: Any) -> None:
    async for _ in line:
        pass


async def _ask_again(line: Any) -> None:
    while True:
        await line.send('{"type":"history","from":0}')
        await asyncio.sleep(0.5)


async def _share(process: int, seconds: float) -> float:
    """Return the processor time of a process [% of a core]."""
    before, start_s = _used_s(process), time.monotonic()
    await asyncio.sleep(seconds)
    return 100.0 * (_used_s(process) - before) / (time.monotonic() - start_s)


def _used_s(process: int) -> float:
    """Return the processor time of all threads of a process until now [s]."""
    tasks = Path(f"/proc/{process}/task").glob("*/schedstat")
    return 1e-9 * sum(float(task.read_text().split()[0]) for task in tasks)
