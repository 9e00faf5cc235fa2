"""Run the page process from start to end: listen, print the address, and end with Ctrl-C."""

import asyncio
import signal
import time
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from baqueano.contracts.names import STORED_ROUTES
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import RobotUnreachable
from baqueano.web.guard import TOKEN_LIFETIME_S, Role, url_host
from baqueano.web.lab.local_files import LocalFiles
from baqueano.web.lab.run_list import RunList
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.live import Live
from baqueano.web.page import BrowserPage
from baqueano.web.server import LOOPBACK, Server
from baqueano.web.service import DoorLink
from baqueano.web.share import network_names, open_tab, own_address, qr_code, url

GREETING_TIMEOUT_S = 60.0  # a busy laptop starts Python slowly
ROBOT_GREETING_TIMEOUT_S = 2.0
BROWSER_TIMEOUT_S, NO_BROWSER_S, POLL_PERIOD_S = 60.0, 3.0, 0.1  # waiting times for browsers


@dataclass(frozen=True, slots=True)
class PageOptions:
    """The options of a served page."""

    folder: Path  # of the runs
    port: int = 0
    share: bool = False
    address: str = ""  # address in the network; found automatically if ""
    browser: bool = True  # a tab is opened
    routes: Path = STORED_ROUTES
    greeting_s: float = GREETING_TIMEOUT_S  # longest wait for the description of a simulated vehicle


async def show_runs(
    names: tuple[str, ...],
    options: PageOptions,
    notify: Callable[[Diagnostic | str], object],
    lasting: bool = True,
) -> None:
    """Serve recorded runs, the second as a ghost of the first, until a signal ends the process.

    If `lasting` is False, the process also ends when the last browser has disconnected.
    """
    lab = WorkerClient()
    try:
        reply, _ = await lab.request("find", names=names, folder=str(options.folder))
        paths = tuple(map(Path, reply["paths"]))
        run_list = RunList(options.folder, paths)
        page = BrowserPage(lab, run_list, lambda: server.guard, paths)
        server = _server(page, run_list, options)
        try:
            async with server:
                show_addresses(server, options, notify)
                await (wait_for_end() if lasting else _wait_for_first(wait_for_end(), _wait_empty(server)))
        finally:
            await page.close()
            await run_list.close()
    finally:
        await lab.close()


async def show_vehicle(
    start: Callable[[], Awaitable[DoorLink]],
    options: PageOptions,
    notify: Callable[[Diagnostic | str], object],
    robot: LocalFiles | None = None,
    lasting: bool = True,
    meet: Callable[[Callable[[], int]], object] = lambda viewers: None,
    vehicle: str = "",
) -> None:
    """Serve a vehicle until a signal ends the process, or the service of the vehicle ends.

    `robot` contains the local files of a real robot. `vehicle` is the file whose parameters are identified. `meet`
    receives a function that returns the number of connected browsers. Raise RobotUnreachable if the service ends before
    it describes the vehicle. If `lasting` is True, raise RobotUnreachable even for a later end of the service.
    """
    lab, run_list = WorkerClient(), RunList(options.folder)
    link = await start()
    live = Live(link, lambda: server.visitors)
    page = BrowserPage(lab, run_list, lambda: server.guard, live=live)
    page.source = lambda: question_subject(live.identifying.vehicle, options.routes)
    live.send_hello = lambda visitor: page.send_hello(visitor, live.hello(visitor))
    live.on_done = lambda: page.send_run_list(server.visitors)
    server = _server(page, run_list, options)
    server.foxglove = live.foxglove
    live.identifying.vehicle = robot.vehicle if robot is not None else vehicle
    if robot is not None:
        live.use_local_files(robot, await robot.describe())
    meet(lambda: len(server.visitors))
    live.begin()
    hearing_task = asyncio.create_task(live.run())
    description, end_event = (
        asyncio.create_task(event.wait()) for event in (live.description_event, live.over)
    )
    end_task: asyncio.Task[None] | None = None
    try:
        # a robot sends its description only with its first drive
        greeting_s = options.greeting_s if robot is None else ROBOT_GREETING_TIMEOUT_S
        await asyncio.wait(
            {hearing_task, description}, timeout=greeting_s, return_when=asyncio.FIRST_COMPLETED
        )
        if hearing_task.done() and not description.done():
            raise RobotUnreachable.of("web.service-ended")
        async with server:
            show_addresses(server, options, notify)
            end_task = asyncio.create_task(wait_for_end())
            await asyncio.wait({end_task, hearing_task, end_event}, return_when=asyncio.FIRST_COMPLETED)
            if live.over.is_set():
                await server.disconnect_all()
            elif lasting and hearing_task.done():
                raise RobotUnreachable.of("web.service-ended")
    finally:
        await link.close()
        for task in (hearing_task, description, end_event, *([end_task] if end_task else [])):
            task.cancel()
        await live.identifying.close()
        if robot is not None:
            await robot.close()
        await page.close()
        await run_list.close()
        await lab.close()


def question_subject(vehicle: str, routes: Path) -> JsonObject | None:
    """Return the subject of questions about the vehicle: its file, or a run with this file, and the folder of routes.

    Return None if `vehicle` is "".
    """
    if not vehicle:
        return None
    return {"path" if vehicle.endswith(".mcap") else "vehicle": vehicle, "routes": str(routes)}


def _server(page: BrowserPage, run_list: RunList, options: PageOptions) -> Server:
    shared_address = (options.address or own_address()) if options.share else ""
    names = network_names() if options.share else ()
    return Server(
        page.receive,
        page.on_disconnect,
        run_list.content_at,
        port=options.port,
        shared_address=shared_address,
        names=names,
    )


def show_addresses(
    server: Server, options: PageOptions, notify: Callable[[Diagnostic | str], object]
) -> None:
    """Pass the addresses to `notify`, with a QR code if the page is shared, and open a tab."""
    tokens = server.guard.tokens
    if not options.share:
        own_url = url(LOOPBACK, server.port, tokens)
    else:
        address = server.shared_address
        own_url = url(address, server.port, tokens, Role.DRIVE)
        notify(qr_code(own_url))
        notify(note("web.to-stop", url=url(address, server.port, tokens, Role.STOP)))
        notify(note("web.to-view", url=url(address, server.port, tokens, Role.VIEW)))
        notify(note("web.unencrypted", hours=TOKEN_LIFETIME_S / 3600.0))
    notify(note("web.address", url=own_url))
    if server.foxglove is not None:
        notify(note("web.foxglove", url=foxglove_url(server, tokens)))
    if options.browser:
        asyncio.get_running_loop().run_in_executor(None, open_tab, own_url)


def foxglove_url(server: Server, tokens: dict[Role, str]) -> str:
    """Return the address for programs that use Foxglove's protocol, with the token to view."""
    host = url_host(server.shared_address or LOOPBACK)
    return f"ws://{host}:{server.port}/foxglove/{tokens[Role.VIEW]}"


async def _wait_for_first(*jobs: Coroutine[None, None, None]) -> None:
    """Wait until one of several jobs has finished, and cancel the others."""
    tasks = [asyncio.create_task(job) for job in jobs]
    await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _wait_empty(server: Server) -> None:
    """Wait until all browsers have left.

    Wait BROWSER_TIMEOUT_S for the first browser, and later NO_BROWSER_S, so that a browser can reload the page.
    """
    last_visitor_s, had_visitors = time.monotonic(), False
    while True:
        await asyncio.sleep(POLL_PERIOD_S)
        if server.visitors:
            last_visitor_s, had_visitors = time.monotonic(), True
        if time.monotonic() - last_visitor_s > (NO_BROWSER_S if had_visitors else BROWSER_TIMEOUT_S):
            return


async def wait_for_end() -> None:
    """Wait for Ctrl-C, or the end of the terminal or of the system."""
    end_event, loop = asyncio.Event(), asyncio.get_running_loop()
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        with suppress(NotImplementedError, AttributeError, RuntimeError):  # Windows, or not the main thread
            loop.add_signal_handler(getattr(signal, name), end_event.set)
    await end_event.wait()
