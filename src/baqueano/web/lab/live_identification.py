"""Identify parameters during a drive: send its rows to a separate worker, and the results to the browsers.

Results arrive each second, and are sent to each browser that watches, in the language of that browser.

  browser   identify {on}             begin to watch, or stop watching
  page      identify {of: "live", …}  the state of each parameter, each second while a browser watches
  browser   ask {what: "identify", run}   page   answer {to: "ask", …}: the same for a run, for all its times

The worker starts when the first browser watches. Until then the newest MAX_FRAMES frames are stored.
"""

import asyncio
from array import array
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from baqueano.contracts.values import JsonObject, Value
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import BaqueanoError
from baqueano.messages import text
from baqueano.messages.language import translate, use_language
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.visitor import Visitor

REQUEST_PERIOD_S = 1.0
FRAMES_HZ = 20.0
MAX_FRAMES = 2_400  # frames of a drive that no browser watches: two minutes
ROWS_PER_REQUEST = 2_000  # approximate number of rows in a request
NAN = float("nan")


class LiveIdentification:
    """The current or last drive, and the browsers that watch its identification."""

    def __init__(self, visitors: Callable[[], Iterable[Visitor]] = tuple) -> None:
        self._lab, self._visitors = WorkerClient(), visitors
        self.vehicle = ""  # name or path of the vehicle file, or of a run that contains it
        self._viewers: set[Visitor] = set()
        self._names: list[str] = []
        self._column_indices: list[int] = []
        self._frames: deque[array[float]] = deque(maxlen=MAX_FRAMES)  # rows not yet sent to the worker
        self._last_s = 0.0
        self._drive = 0
        self._prepared_vehicle = ""  # the vehicle for which the worker is prepared
        self._reply: JsonObject | None = None
        self._request_task: asyncio.Task[None] | None = None

    def begin(self, names: list[str], early_start: bool = False) -> None:
        """Begin a drive with these columns. If `early_start` is True, start the worker before a browser watches."""
        has_time = "t" in names
        self._column_indices = [
            k for k, name in enumerate(names) if has_time and (name == "t" or name[:2] in ("u.", "z."))
        ]
        self._names = [names[k] for k in self._column_indices]
        self._drop_rows()
        if early_start and self.vehicle and (self._request_task is None or self._request_task.done()):
            self._prepared_vehicle = self.vehicle
            self._request_task = asyncio.create_task(self._send_rows_periodically(at_start=True))

    def add_rows(self, rows: list[list[float | None]]) -> None:
        """Add ticks of the drive."""
        if not self._column_indices:
            return
        if (rows[0][self._column_indices[0]] or 0.0) < self._last_s:
            self._drop_rows()
        values = (row[k] for row in rows for k in self._column_indices)
        self._frames.append(array("f", [NAN if x is None else x for x in values]))
        self._last_s = rows[-1][self._column_indices[0]] or 0.0

    def set_subscription(self, visitor: Visitor, on: bool) -> None:
        """Begin to send the identification to this browser, or stop sending it if `on` is False."""
        if not on:
            self._viewers.discard(visitor)
            return
        self._viewers.add(visitor)
        if self._reply is not None:
            self._send_reply(visitor, self._reply)
        if self._request_task is None or self._request_task.done():
            self._request_task = asyncio.create_task(self._send_rows_periodically())

    async def identify_run(self, path: Path, visitor: Visitor) -> JsonObject:
        """Return the identification of a run, with sentences in the language of this browser."""
        reply, _ = await self._lab.request("identify run", visitor, path=str(path))
        return with_sentences(reply, visitor.language)

    async def close(self) -> None:
        """End the worker."""
        if self._request_task is not None:
            self._request_task.cancel()
            with suppress(asyncio.CancelledError):
                await self._request_task
        await self._lab.close()

    def _drop_rows(self) -> None:
        self._frames.clear()
        self._last_s = 0.0
        self._drive += 1
        self._reply = None

    async def _send_rows_periodically(self, at_start: bool = False) -> None:
        """Send rows to the worker each second while a browser watches, and forward its answers."""
        if at_start:
            await self._exchange_once()
        while self._viewers:
            self._viewers &= set(self._visitors())
            if self.vehicle and (self._frames or self._is_busy or self._prepared_vehicle != self.vehicle):
                self._prepared_vehicle = self.vehicle
                await self._exchange_once()
            await asyncio.sleep(
                0.0 if len(self._frames) > REQUEST_PERIOD_S * FRAMES_HZ * 2 else REQUEST_PERIOD_S
            )

    @property
    def _is_busy(self) -> bool:
        return self._reply is not None and bool(self._reply.get("busy"))

    async def _exchange_once(self) -> None:
        drive, width = self._drive, len(self._names)
        rows: list[list[float]] = []
        while self._frames and len(rows) < ROWS_PER_REQUEST:
            flat_row = self._frames.popleft().tolist()
            rows += [flat_row[k : k + width] for k in range(0, len(flat_row), width)]
        if rows and self._reply is None:  # the first answer can take a compilation
            self._forward(
                drive, {"parameters": [], "reason": note("web.identifying").to_json(), "busy": True}
            )
        try:
            reply, _ = await self._lab.request(
                "identify", vehicle=self.vehicle, drive=drive, names=self._names, rows=rows
            )
        except BaqueanoError as error:
            reply = {"parameters": [], "reason": error.diagnostic.to_json(), "busy": False}
        self._forward(drive, reply)

    def _forward(self, drive: int, reply: JsonObject) -> None:
        if drive == self._drive:
            self._reply = reply
            for visitor in self._viewers:
                self._send_reply(visitor, reply)

    def _send_reply(self, visitor: Visitor, reply: JsonObject) -> None:
        visitor.send({"type": "identify", "of": "live"} | with_sentences(reply, visitor.language))


def with_sentences(reply: JsonObject, language: str) -> JsonObject:
    """Return an answer of the worker with its diagnostics as sentences in this language."""
    with use_language(language):
        return {name: _as_sentences(value, name) for name, value in reply.items()}


def _as_sentences(value: Value, name: str) -> Value:
    if isinstance(value, dict):
        if "code" in value and "severity" in value:
            return text(Diagnostic.from_json(value))
        return {key: _as_sentences(item, key) for key, item in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [_as_sentences(item, "") for item in value]
    return translate(value) if name == "verdict" and isinstance(value, str) else value
