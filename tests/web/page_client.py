"""A page process inside a test, with recorded runs, and browsers that are connected to it."""

import asyncio
import json
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import ClientConnection, connect

from baqueano.runs import Channel, EstimateLog, Event, ReferenceLog, Run, write_run
from baqueano.vehicle_file import load
from baqueano.web import SUBPROTOCOL
from baqueano.web.lab.run_list import RunList
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.page import BrowserPage
from baqueano.web.server import Server

TICK_NS = 10_000_000
WAIT_S = 60.0  # the machine may be busy
CLOSE_S = 0.1  # of a goodbye; a browser that does not read would wait for it for 10 s


def drive(name: str = "circle", ticks: int = 300) -> Run:
    """Return a run of a circle, driven 1 cm to the left of its reference."""
    t_ns = TICK_NS * np.arange(1, ticks + 1)
    psi = 0.01 * np.arange(ticks)
    on = np.column_stack([np.sin(psi), 1.0 - np.cos(psi), psi])
    shifted_path = on + 0.01 * np.column_stack([-np.sin(psi), np.cos(psi), 0.0 * psi])
    nu = np.tile([1.0, 0.0, 1.0], (ticks, 1))
    z = np.column_stack([np.arange(ticks), -np.ones(ticks), np.ones(ticks)])
    y, S = np.tile([0.1, np.nan, 0.2], (ticks, 1)), np.tile(np.diag([0.01, 1.0, 0.04]), (ticks, 1, 1))
    cov = np.tile(np.diag([4.0, 9.0, 1.0, 1.0, 1.0, 1.0]), (ticks, 1, 1))
    return Run(
        name, None, t_ns, np.tile([0.5, 0.0, 0.1], (ticks, 1)), requested_commands=np.tile([0.6, 0.0, 0.1], (ticks, 1)),
        sensors={"imu": Channel(t_ns, t_ns, z)}, estimate=EstimateLog(t_ns, shifted_path, nu, cov, y, S),
        reference=ReferenceLog(t_ns, on, nu, np.zeros(ticks)), vehicle_text=load("small").text,
        events=(Event(int(t_ns[3]), "warning", "test", "a stone"),), metadata={"kind": "repeat"},
    )  # fmt: skip


def folder_of(path: Path, **runs: Run) -> Path:
    """Write runs into a folder, and return it."""
    path.mkdir(exist_ok=True)
    for name, run in runs.items():
        write_run(run, path / f"{name}.mcap")
    return path


@asynccontextmanager
async def recorded_page(folder: Path, *runs_open: str, **options: Any) -> AsyncIterator[Server]:
    """Serve the runs of a folder."""
    lab = WorkerClient()
    paths = tuple((folder / f"{name}.mcap").resolve() for name in runs_open)
    run_list = RunList(folder, paths)
    page = BrowserPage(lab, run_list, lambda: server.guard, paths)
    server = Server(page.receive, page.on_disconnect, run_list.content_at, **options)
    try:
        async with server:
            yield server
    finally:
        await page.close()
        await run_list.close()
        await lab.close()


class Browser:
    """One browser: the messages that it sent and received."""

    def __init__(self, line: ClientConnection) -> None:
        self.line, self.frames = line, []
        self.hello: dict[str, Any] = {}
        self.question_id = 0

    async def send(self, word: str, **fields: Any) -> None:
        """Send a message."""
        await self.line.send(json.dumps({"type": word, **fields}))

    async def request(self, question: str, **fields: Any) -> dict[str, Any]:
        """Send a request and return the answer."""
        self.question_id += 1
        await self.send("ask", id=self.question_id, question=question, **fields)
        return await self.next("answer", id=self.question_id)

    async def next(
        self, *kinds: str, where: Callable[[dict[str, Any]], bool] = lambda word: True, **values: object
    ) -> dict[str, Any]:
        """Return the next message of these kinds with these values; frames received before it are stored."""
        while True:
            data = await asyncio.wait_for(self.line.recv(), WAIT_S)
            if isinstance(data, bytes):
                self.frames.append(data)
                continue
            word = json.loads(data)
            if word["type"] in kinds and values.items() <= word.items() and where(word):
                return word

    def rows(self, stream: int, columns: int) -> np.ndarray:
        """Return the rows (N, F) of a stream that were received so far."""
        tables = [np.zeros((0, columns), "f4")]
        for frame in self.frames:
            number, count, _ = struct.unpack("<IId", frame[:16])
            if number >> 24 == stream:
                tables.append(np.frombuffer(frame, "<f4", offset=16).reshape(count, columns))
        return np.concatenate(tables)


def address(server: Server) -> str:
    """Return the host of a page."""
    return f"127.0.0.1:{server.port}"


@asynccontextmanager
async def line_to(page: Server | int, **options: Any) -> AsyncIterator[ClientConnection]:
    """Connect as a browser does to the page of a server, or to the page at a port of this machine."""
    host = f"127.0.0.1:{page}" if isinstance(page, int) else address(page)
    defaults = {"origin": f"http://{host}", "subprotocols": [SUBPROTOCOL], "compression": None}
    async with connect(f"ws://{host}/ws", close_timeout=CLOSE_S, **defaults | options) as line:
        yield line


@asynccontextmanager
async def browser(page: Server | int, lang: str = "en", **hello: Any) -> AsyncIterator[Browser]:
    """Open a page and send the hello message."""
    async with line_to(page) as line:
        visitor = Browser(line)
        await visitor.send("hello", lang=lang, **hello)
        visitor.hello = await visitor.next("hello")
        yield visitor


async def request(
    server: Server, head: str, *, host: str | None = "own"
) -> tuple[int, dict[str, str], bytes]:
    """Send a request of these lines, and return status, headers and body."""
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    lines = head if host is None else f"{head}\r\nHost: {address(server) if host == 'own' else host}"
    writer.write((lines + "\r\n\r\n").encode("latin-1"))
    data = await asyncio.wait_for(reader.read(), WAIT_S)
    writer.close()
    top, _, body = data.partition(b"\r\n\r\n")
    status, *rest = top.decode("latin-1").split("\r\n")
    if not status:
        return 0, {}, b""
    return int(status.split()[1]), dict(line.split(": ", 1) for line in rest), body
