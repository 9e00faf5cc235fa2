"""A page with a vehicle that the test simulates."""

import asyncio
from contextlib import asynccontextmanager

from baqueano.diagnostics import Severity, note
from baqueano.errors import RobotUnreachable
from baqueano.web.lab.run_list import RunList
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.live import Live
from baqueano.web.page import BrowserPage
from baqueano.web.server import Server
from tests.web.page_client import WAIT_S

COLUMNS = ["t", "eta.x", "u.0", "z.imu[2]", "nis", "progress", "cross"]
VEHICLE = {
    "type": "vehicle",
    "name": "small",
    "world": "simulated",
    "command": [{"name": "u_x", "low": -1, "high": 1}],
}


class FakeLink:
    """A service that records the requests and sends the messages that the test needs."""

    def __init__(self):
        self.messages, self.gone = [], False
        self.on_word = lambda word: None

    def send(self, request, **words):
        if self.gone:
            raise RobotUnreachable(note("web.service-ended", Severity.ERROR))
        self.messages.append({"type": request} | words)

    async def receive(self, on_word):
        self.on_word = on_word
        await asyncio.Event().wait()

    def requests(self, *kinds):
        return [word for word in self.messages if word["type"] in kinds]

    def frame(self, t, rows=1, **values):
        row = {"t": t} | values
        x = [[row.get(name) if name != "t" else t + 0.01 * k for name in COLUMNS] for k in range(rows)]
        self.on_word({"type": "frame", "t_ns": 0, "n": 1, "x": x})

    def state(self, state="READY", **fields):
        self.on_word({"type": "state", "state": state} | fields)


@asynccontextmanager
async def live_page(tmp_path, **options):
    """Serve a fake vehicle."""
    link, lab, run_list = FakeLink(), WorkerClient(), RunList(tmp_path)
    live = Live(link, lambda: server.visitors)
    page = BrowserPage(lab, run_list, lambda: server.guard, live=live)
    server = Server(page.receive, page.on_disconnect, run_list.content_at, **options)
    live.send_hello = lambda visitor: page.send_hello(visitor, live.hello(visitor))
    server.foxglove = live.foxglove
    live.begin()
    hearing = asyncio.create_task(live.run())
    await asyncio.sleep(0)
    link.on_word(VEHICLE)
    link.on_word({"type": "fields", "names": COLUMNS, "units": ["s", "m", "duty", "rad/s", "1", "m", "m"]})
    link.state()
    try:
        async with server:
            yield server, link, live
    finally:
        hearing.cancel()
        await asyncio.gather(hearing, return_exceptions=True)
        await live.identifying.close()
        await page.close()
        await run_list.close()
        await lab.close()


async def until(true):
    """Wait until something is true."""
    async with asyncio.timeout(WAIT_S):
        while not true():
            await asyncio.sleep(0.005)
