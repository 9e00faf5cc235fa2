"""Play recorded runs like live drives: send the messages of a service, at a pace, from finished runs.

  python -m baqueano.web.lab.playback FOLDER [--pace F] [--no-browser]

stdin contains lines of JSON: {"play": path}, {"tuned": …}, {"say": diagnostic} and {"step": diagnostic}. A step of the
work is shown at once, while no run is played. stdout receives a line once the page is served. After the end of stdin
the remaining entries are played while a browser watches, then the program ends. The playback does not slow down the
simulation that records the runs.
"""

import argparse
import asyncio
import json
import sys
import time
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic
from baqueano.errors import UsageError
from baqueano.messages import text
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.web.feed import HEAD_LAYOUT
from baqueano.web.lab.worker_client import WorkerClient

DEFAULT_PACE = 4.0
MIN_PACE, MAX_PACE = 0.05, 50.0
FRAME_PERIOD_S = 0.05  # between frames
STATE_PERIOD_S = 0.2
ROWS_PER_REQUEST = 4096  # rows requested at once
CONNECT_TIMEOUT_S = 10.0  # time for an opened browser to connect
FIT_PAUSE_S = 4.0  # time of an experiment before its parameters are shown
FIT_DISPLAY_S = 4.0  # time to show the parameters after an experiment
GAINS_DISPLAY_S = 7.0  # time to show the gains


class WorkStep(NamedTuple):
    """The step of the work that records the runs."""

    message: Diagnostic


Entry = Path | Diagnostic | JsonObject | WorkStep | None


class RunPlayer:
    """A service that plays recorded runs as its drives."""

    def __init__(self, lab: WorkerClient, pace: float = DEFAULT_PACE) -> None:
        self._lab, self._pace = lab, pace
        self._requests: asyncio.Queue[Path | Diagnostic | JsonObject | None] = asyncio.Queue()
        self._on_message: Callable[[JsonObject], None] = lambda message: None
        self._is_paused, self._stop_reason = False, None
        self.viewers: Callable[[], int] = lambda: 1
        self._mission: JsonObject = {}
        self._scene: JsonObject = {"screen": "drive"}  # shown by browsers in which no screen was selected
        self._step: Diagnostic | None = None
        self._patience_s = 0.0  # time until which to wait for a browser; 0 before the first run

    def enqueue(self, item: Entry) -> None:
        """Queue a run to play, tuned gains to show, or a diagnostic to send; None ends the playback.

        A step is shown at once.
        """
        if item is None or isinstance(item, WorkStep):
            self._step = None if item is None else item.message
            self._send_state()
        if not isinstance(item, WorkStep):
            self._requests.put_nowait(item)

    def send(self, request: str, **words: object) -> None:
        """Execute a message as a service does. Raise UsageError for a message that a recorded drive cannot execute."""
        if request == "pace":
            factor = words["factor"]
            if not isinstance(factor, int | float) or not MIN_PACE <= factor <= MAX_PACE:
                raise UsageError.of("door.pace", value=str(factor), min_factor=MIN_PACE, max_factor=MAX_PACE)
            self._pace = float(factor)
        elif request in ("pause", "go"):
            self._is_paused = request == "pause"
        elif request in ("stop", "clear"):
            self._stop_reason = words.get("reason") if request == "stop" else None
        elif request in ("mission", "set", "shake"):
            raise UsageError.of("web.playback")
        self._send_state()

    async def receive(self, on_message: Callable[[JsonObject], None]) -> None:
        """Play the queued entries one after the other until the entry None."""
        self._on_message = on_message
        self._send_state()
        while (entry := await self._requests.get()) is not None:
            if isinstance(entry, Path):
                await self._play(entry)
            elif isinstance(entry, dict):
                await self._show({"screen": "tuned", **entry}, GAINS_DISPLAY_S)
            else:
                on_message({"type": "event", "level": str(entry.severity), "message": entry})

    async def close(self) -> None:
        """Do nothing, because a player does not own resources."""

    async def _play(self, path: Path) -> None:
        description, _ = await self._lab.request("open", path=str(path))
        names = [field["name"] for field in description["fields"]]
        context = {"world": "simulated", "blocks": description["blocks"], "file": str(path)}
        self._on_message({"type": "vehicle", **description["vehicle"], **context})
        self._on_message(
            {"type": "fields", "names": names, "units": [field["unit"] for field in description["fields"]]}
        )
        self._on_message({"type": "route", "x": [], "y": []} | (description["route"] or {}))
        if not await self._await_browser():
            return
        events, first_row, done_s, published_s = description["events"], 0, 0.0, float("-inf")
        previous_s = begun_s = time.monotonic()
        is_experiment = description["kind"] == "experiment"
        await self._show({"screen": "drive"})
        while first_row < description["rows"]:
            frame = (
                await self._lab.request(
                    "frame", path=str(path), number=0, first=first_row, count=ROWS_PER_REQUEST
                )
            )[1]
            rows = list(frame_rows(frame, len(names)))
            row_index = 0
            while row_index < len(rows):
                await asyncio.sleep(FRAME_PERIOD_S)
                if not self.viewers():
                    return
                now_s = time.monotonic()
                is_paused = self._is_paused or self._stop_reason is not None
                done_s += 0.0 if is_paused else (now_s - previous_s) * self._pace
                previous_s = now_s
                due = row_index
                while due < len(rows) and rows[due][0] <= done_s:
                    due += 1
                if due > row_index:
                    self._on_message({"type": "frame", "x": rows[row_index:due]})
                row_index = due
                while events and events[0]["t"] <= done_s:
                    self._send_event(events.pop(0))
                if is_experiment and now_s - begun_s > FIT_PAUSE_S:
                    is_experiment = False
                    await self._show({"screen": "identify"})
                if now_s - published_s >= STATE_PERIOD_S:
                    published_s = now_s
                    self._mission = {
                        "mission": description["kind"], "laps": None, "t_s": done_s,
                        "left_s": description["seconds"] - done_s,
                    }  # fmt: skip
                    self._send_state()
            first_row += len(rows)
        self._mission = {}
        self._send_state()
        if description["kind"] == "experiment":
            await self._show({"screen": "identify"}, FIT_DISPLAY_S)

    async def _show(self, scene: JsonObject, display_s: float = 0.0) -> None:
        """Show a screen, and wait `display_s` seconds while a browser watches, without the pauses of the player."""
        self._scene = scene
        self._send_state()
        while display_s > 0.0 and self.viewers():
            await asyncio.sleep(FRAME_PERIOD_S)
            display_s -= 0.0 if self._is_paused else FRAME_PERIOD_S

    async def _await_browser(self) -> bool:
        """Wait for a browser; return True once a browser watches, or False if none has connected within
        CONNECT_TIMEOUT_S."""
        self._patience_s = self._patience_s or time.monotonic() + CONNECT_TIMEOUT_S
        while not self.viewers() and time.monotonic() < self._patience_s:
            await asyncio.sleep(FRAME_PERIOD_S)
        return bool(self.viewers())

    def _send_event(self, event: JsonObject) -> None:
        if isinstance(event["text"], dict):
            self._on_message(
                {"type": "event", "level": event["severity"], "message": Diagnostic.from_json(event["text"])}
            )

    def _send_state(self) -> None:
        state = "STOPPED" if self._stop_reason is not None else "MISSION" if self._mission else "READY"
        self._on_message(
            {
                "type": "state",
                "state": state,
                "reason": self._stop_reason,
                "pace": self._pace,
                "paused": self._is_paused,
            }
            | {"scene": self._scene}
            | ({} if self._step is None else {"step": self._step})
            | ({} if self._stop_reason is not None else self._mission)
        )


def frame_rows(frame: bytes, columns: int) -> Iterator[list[float]]:
    """Yield the rows of a frame as lists of values."""
    values = array("f", frame[HEAD_LAYOUT.size :])
    if sys.byteorder == "big":
        values.byteswap()
    for k in range(0, len(values), columns):
        yield values[k : k + columns].tolist()


async def play(folder: Path, pace: float, browser: bool) -> None:
    """Serve a page that plays the entries from stdin, until all of them have been shown."""
    from baqueano.web.run import PageOptions, show_vehicle

    lab = WorkerClient()
    playback = RunPlayer(lab, pace)
    loop = asyncio.get_running_loop()
    reading = loop.run_in_executor(
        None, read_entries, sys.stdin.buffer, partial(loop.call_soon_threadsafe, playback.enqueue)
    )

    async def start() -> RunPlayer:
        return playback

    def notify(message: Diagnostic | str) -> None:
        print(text(message), file=sys.stderr, flush=True)
        if isinstance(message, Diagnostic) and message.code == "web.address":
            print(flush=True)  # for the process that records the runs

    def meet(viewers: Callable[[], int]) -> None:
        playback.viewers = viewers

    try:
        await show_vehicle(
            start, PageOptions(folder, browser=browser, greeting_s=0.0), notify, lasting=False, meet=meet
        )
    finally:
        await lab.close()
    await reading


def read_entries(source: BinaryIO, write: Callable[[Entry], object]) -> None:
    """Pass the entry in each line of stdin to `write`, and None at its end; skip malformed lines."""
    for line in source:
        try:
            entry = json.loads(line)
            if "tuned" in entry:
                write(dict(entry["tuned"]))
            elif "step" in entry:
                write(WorkStep(Diagnostic.from_json(entry["step"])))
            else:
                write(Path(entry["play"]) if "play" in entry else Diagnostic.from_json(entry["say"]))
        except (ValueError, KeyError, TypeError):
            continue
    write(None)


def main() -> None:
    """Parse the command line, and run the playback."""
    parser = argparse.ArgumentParser(prog="python -m baqueano.web.lab.playback", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pace", type=float, default=DEFAULT_PACE)
    parser.add_argument("--no-browser", dest="browser", action="store_false")
    arguments = parser.parse_args()
    with use_notation(COMMAND_LINE):
        asyncio.run(play(arguments.folder, arguments.pace, arguments.browser))


if __name__ == "__main__":
    main()
