"""Run the page process from start to end: it listens, prints its address, and ends with Ctrl-C."""

import asyncio
import signal
import time
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import RobotUnreachable
from baqueano.web.guard import HOLDS_S, Role, bracketed
from baqueano.web.lab.handle import Lab
from baqueano.web.lab.shelf import Shelf
from baqueano.web.live import Live
from baqueano.web.page import BrowserPage
from baqueano.web.server import LOOPBACK, Server
from baqueano.web.service import DoorLink
from baqueano.web.share import open_tab, own_address, own_names, qr_code, url

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

GREETING_S = 60.0  # a busy laptop starts Python
QUIET_S = 2.0
COMES_S, GONE_S, LOOK_S = 60.0, 3.0, 0.1  # of browsers


@dataclass(frozen=True, slots=True)
class PageOptions:
    """The options of serving a page."""

    folder: Path  # of the runs
    port: int = 0
    share: bool = False
    address: str = ""  # of the network; found where none is given
    browser: bool = True  # a tab is opened
    routes: Path = Path("routes")  # the folder of the stored routes


async def show_runs(
    names: tuple[str, ...],
    options: PageOptions,
    say: Callable[[Diagnostic | str], object],
    lasting: bool = True,
) -> None:
    """Serve recorded runs, the second as a ghost of the first, until a signal ends the process.

    If it is not `lasting`, it ends also when the last browser has disconnected.
    """
    lab = Lab()
    try:
        reply, _ = await lab.ask("find", names=names, folder=str(options.folder))
        paths = tuple(map(Path, reply["paths"]))
        shelf = Shelf(options.folder, paths)
        page = BrowserPage(lab, shelf, lambda: server.guard, paths)
        server = _server(page, shelf, options)
        try:
            async with server:
                announce(server, options, say)
                await (interrupted() if lasting else _first(interrupted(), _until_empty(server)))
        finally:
            await page.close()
            await shelf.close()
    finally:
        await lab.close()


async def show_vehicle(
    start: Callable[[], Awaitable[DoorLink]],
    options: PageOptions,
    say: Callable[[Diagnostic | str], object],
    robot: "tuple[str, Path] | None" = None,
    lasting: bool = True,
    meet: Callable[[Callable[[], int]], object] = lambda viewers: None,
    vehicle: str = "",
) -> None:
    """Serve a vehicle until a signal ends the process, or the service of the vehicle ends.

    Raise RobotUnreachable if the service ends before it describes the vehicle, or ends although it should be
    `lasting`. `robot` gives the local vehicle file and the folder of routes. `vehicle` is the file whose parameters
    are identified. `meet` receives a function that returns the number of connected browsers.
    """
    lab, shelf = Lab(), Shelf(options.folder)
    link = await start()
    live = Live(link, lambda: server.visitors)
    page = BrowserPage(lab, shelf, lambda: server.guard, live=live)
    page.source = lambda: source_of(live.identifying.vehicle, options.routes)
    live.say_hello = lambda visitor: page.say_hello(visitor, live.hello(visitor))
    live.on_done = lambda: page.list_to(server.visitors)
    server = _server(page, shelf, options)
    server.foxglove = live.foxglove
    live.identifying.vehicle = robot[0] if robot is not None else vehicle
    if robot is not None:
        await _presume(live, lab, *robot)
    meet(lambda: len(server.visitors))
    live.begin()
    hearing = asyncio.create_task(live.run())
    description, over = (asyncio.create_task(event.wait()) for event in (live.described, live.over))
    ending: asyncio.Task[None] | None = None
    try:
        # a robot describes itself only with its first drive
        greeting_s = GREETING_S if robot is None else QUIET_S
        await asyncio.wait({hearing, description}, timeout=greeting_s, return_when=asyncio.FIRST_COMPLETED)
        if hearing.done() and not description.done():
            raise RobotUnreachable(fault("web.service-gone"))
        async with server:
            announce(server, options, say)
            ending = asyncio.create_task(interrupted())
            await asyncio.wait({ending, hearing, over}, return_when=asyncio.FIRST_COMPLETED)
            if live.over.is_set():
                await server.say_goodbye()
            elif lasting and hearing.done():
                raise RobotUnreachable(fault("web.service-gone"))
    finally:
        await link.close()
        for task in (hearing, description, over, *([ending] if ending else [])):
            task.cancel()
        await live.identifying.close()
        await page.close()
        await shelf.close()
        await lab.close()


def source_of(vehicle: str, routes: Path) -> "JsonObject | None":
    """Return the subject of questions about the vehicle: its file, or a run with that file; and its routes."""
    if not vehicle:
        return None
    return {"path" if vehicle.endswith(".mcap") else "vehicle": vehicle, "routes": str(routes)}


async def _presume(live: Live, lab: Lab, vehicle: str, routes: Path) -> None:
    """Describe a robot from its local vehicle file, and pack its missions here."""

    async def pack(kind: str, order: "JsonObject") -> str:
        reply, _ = await lab.ask("mission", vehicle=vehicle, routes=str(routes), kind=kind, said=order)
        return reply["mission"]

    about, _ = await lab.ask("vehicle", vehicle=vehicle, routes=str(routes))
    live.presume(about["vehicle"], about["routes"])
    live.pack = pack


def _server(page: BrowserPage, shelf: Shelf, options: PageOptions) -> Server:
    shared_at = (options.address or own_address()) if options.share else ""
    names = own_names() if options.share else ()
    return Server(
        page.receive, page.on_disconnect, shelf.body, port=options.port, shared_at=shared_at, names=names
    )


def announce(server: Server, options: PageOptions, say: Callable[[Diagnostic | str], object]) -> None:
    """Print the addresses, and open a tab."""
    tokens = server.guard.tokens
    if not options.share:
        own = url(LOOPBACK, server.port, tokens)
    else:
        address = server.shared_at
        own = url(address, server.port, tokens, Role.DRIVE)
        say(qr_code(own))
        say(note("web.to-stop", url=url(address, server.port, tokens, Role.STOP)))
        say(note("web.to-view", url=url(address, server.port, tokens, Role.VIEW)))
        say(note("web.plain", hours=HOLDS_S / 3600.0))
    say(note("web.at", url=own))
    if server.foxglove is not None:
        say(note("web.foxglove", url=foxglove_url(server, tokens)))
    if options.browser:
        asyncio.get_running_loop().run_in_executor(None, open_tab, own)


def foxglove_url(server: Server, tokens: dict[Role, str]) -> str:
    """Return the address for programs that use Foxglove's protocol, with the token that a browser needs."""
    host = bracketed(server.shared_at or LOOPBACK)
    return f"ws://{host}:{server.port}/foxglove/{tokens[Role.VIEW]}"


async def _first(*jobs: Coroutine[None, None, None]) -> None:
    """Wait until the first of several jobs has finished, and cancel the others."""
    tasks = [asyncio.create_task(job) for job in jobs]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _until_empty(server: Server) -> None:
    """Wait until all browsers have left: COMES_S for the first one, GONE_S for one that reloads."""
    empty_s, had_visitors = time.monotonic(), False
    while True:
        await asyncio.sleep(LOOK_S)
        if server.visitors:
            empty_s, had_visitors = time.monotonic(), True
        if time.monotonic() - empty_s > (GONE_S if had_visitors else COMES_S):
            return


async def interrupted() -> None:
    """Wait for Ctrl-C, or the end of the terminal or of the system."""
    end_event, loop = asyncio.Event(), asyncio.get_running_loop()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        with suppress(NotImplementedError, AttributeError, RuntimeError):  # Windows, or not the main thread
            loop.add_signal_handler(getattr(signal, name), end_event.set)
    await end_event.wait()
