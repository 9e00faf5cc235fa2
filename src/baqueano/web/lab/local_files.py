"""Manage the files of a robot on this computer: its vehicle file, the folder of routes, and the folder of its runs.

A robot cannot read these files, so each mission is sent whole. When the mission ends, its run is copied to this
computer, and a taught route is made from the run. A worker reads and writes the files.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, note
from baqueano.errors import BaqueanoError
from baqueano.web.lab.worker_client import WorkerClient

MAX_EXPECTED = 16  # missions whose end is awaited; a robot executes one at a time


class LocalFiles:
    """The files of the robot at `host`, an address for ssh or the socket of its service.

    `vehicle` is the path or the name of its vehicle file.
    """

    def __init__(self, host: str, vehicle: str, routes: Path, runs: Path) -> None:
        self.host, self.vehicle, self.routes, self.runs = host, vehicle, routes, runs
        self._lab = WorkerClient()
        # id of a mission → its kind, and the name of the route to teach
        self._requests: dict[str, tuple[str, str]] = {}
        self._fetch_tasks: set[asyncio.Task[None]] = set()

    async def describe(self) -> JsonObject:
        """Return {vehicle, routes}: the description of the vehicle in its file, and a row for each stored route."""
        reply, _ = await self._lab.request("vehicle", vehicle=self.vehicle, routes=str(self.routes))
        return reply

    async def pack(self, kind: str, order: JsonObject) -> str:
        """Return a mission as JSON. Raise FileError for an unknown route, or an invalid name of a new route."""
        files = {"vehicle": self.vehicle, "routes": str(self.routes)}
        reply, _ = await self._lab.request("mission", kind=kind, order=order, **files)
        return reply["mission"]

    def expect(self, number: str, kind: str, order: JsonObject) -> None:
        """Record that a mission with the id `number` was sent to the robot, so that `fetch` copies its run."""
        while len(self._requests) >= MAX_EXPECTED:  # a refused mission does not report its end
            del self._requests[next(iter(self._requests))]
        self._requests[number] = kind, str(order.get("name", "")) if kind == "teach" else ""

    def fetch(self, event: JsonObject, report: Callable[[Diagnostic, list[JsonObject] | None], None]) -> None:
        """Copy the run of an expected mission after its message "done", and store the route that it taught.

        `report` receives a message, and a row for each stored route, or None instead of the rows if the copy failed.
        """
        kind, route = self._requests.pop(str(event.get("id")), ("", ""))
        if kind and event.get("run"):
            reason = event["reason"]
            regular_end = not event.get("code") and (reason is None or reason.code == StopReason.INTERRUPTED)
            task = asyncio.create_task(self._fetch(event["run"], kind, route if regular_end else "", report))
            self._fetch_tasks.add(task)
            task.add_done_callback(self._fetch_tasks.discard)

    async def _fetch(
        self, run: str, kind: str, route: str, report: Callable[[Diagnostic, list[JsonObject] | None], None]
    ) -> None:
        folders = {"folder": str(self.runs), "routes": str(self.routes)}
        try:
            reply, _ = await self._lab.request(
                "fetch", host=self.host, run=run, kind=kind, route=route, **folders
            )
        except BaqueanoError as error:
            report(error.diagnostic, None)
            return
        message = note("web.taught", route=route) if route else note("web.fetched", run=reply["run"])
        if reply["no_route"] is not None:
            reason = Diagnostic.from_json(reply["no_route"])
            message = note("web.not-taught", Severity.ERROR, run=reply["run"], route=route, reason=reason)
        report(message, reply["routes"])

    async def close(self) -> None:
        """End the worker."""
        for task in self._fetch_tasks:
            task.cancel()
        await self._lab.close()
