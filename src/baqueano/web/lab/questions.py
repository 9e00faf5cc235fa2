"""Answer questions of browsers with workers: laps and cost landscapes of gains, blocks, comparisons.

A question for a lap or a landscape that is no longer the newest of its browser is answered by `stale`; other questions
are always answered. Laps have priority over longer jobs: a landscape is computed in parts, and descents, checks and
comparisons have a separate worker.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.errors import BaqueanoError, UsageError
from baqueano.messages import text
from baqueano.messages.language import translate, use_language
from baqueano.messages.printable import one_line
from baqueano.web.lab.run_list import RunList
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.visitor import Visitor

MAX_GRID_SIDE = 24  # laps along an axis of a landscape, at most
LAPS_PER_REQUEST = 10  # laps of a landscape in one request
MAX_COMPARED_RUNS = 6  # maximum number of runs in a comparison
MAX_NAME_LETTERS = 200  # maximum number of characters of a name from a browser


class Questions:
    """The workers of a page, and the questions that they answer.

    `source` returns the vehicle of the page: {vehicle, routes}, {path, routes}, or None without a vehicle file.
    """

    def __init__(self, run_list: RunList, source: Callable[[], JsonObject | None]) -> None:
        self._run_list, self._source = run_list, source
        self._tuning_client, self.slow_client = WorkerClient(), WorkerClient()
        self._newest: dict[tuple[Visitor, str], object] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self.blocks: dict[str, str] = {}  # role → kind that the next mission uses instead of the file's kind
        self.words: dict[str, Callable[[Visitor, JsonObject], Awaitable[JsonObject]]] = {
            "tune": self._tune, "route": self._route, "lap": self._lap, "landscape": self._landscape,
            "downhill": self._descent, "block": self._block, "check": self._check, "compare": self._compare,
        }  # fmt: skip

    async def answer(self, visitor: Visitor, message: JsonObject) -> None:
        """Answer a question. Raise UsageError for an unknown question."""
        question = str(message["question"])
        if question not in self.words:
            raise UsageError.of("web.no-question", request=one_line(question)[:MAX_NAME_LETTERS])
        key = visitor, question
        self._newest[key] = message.get("id")
        task = asyncio.create_task(self._answer(visitor, message))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        await task

    async def close(self) -> None:
        """Cancel the waiting questions, and end the workers."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._tuning_client.close()
        await self.slow_client.close()

    async def _answer(self, visitor: Visitor, message: JsonObject) -> None:
        reply: JsonObject
        try:
            reply = await self.words[message["question"]](visitor, message)
        except BaqueanoError as error:
            reply = self._refusal(visitor, error.diagnostic)
        except (KeyError, TypeError, ValueError, OverflowError) as error:  # a browser can send anything
            reply = self._refusal(visitor, fault("web.not-understood", error=type(error).__name__))
        if self._is_newest(visitor, message):
            self._newest.pop((visitor, message["question"]), None)
        if visitor.is_open:
            visitor.send({"type": "answer", "to": "ask", "id": message.get("id")} | reply)

    def _refusal(self, visitor: Visitor, reason: Diagnostic) -> JsonObject:
        with use_language(visitor.language):
            return {"refusal": text(reason), "code": str(reason.code)}

    def _is_newest(self, visitor: Visitor, message: JsonObject) -> bool:
        return visitor.is_open and self._newest.get((visitor, message["question"])) == message.get("id")

    def find_subject(self, message: JsonObject) -> JsonObject:
        """Return the subject of a question: a run of the list, or the page's vehicle.

        Raise UsageError if the run does not exist, or if the page does not have a vehicle file.
        """
        if message.get("run"):
            paths = self._run_list.paths()
            if message["run"] not in paths:
                raise UsageError.of("web.no-run")
            return {"path": str(paths[message["run"]])}
        source = self._source()
        if source is None:
            raise UsageError.of("web.no-vehicle-file")
        return source

    def _tuning_request(self, message: JsonObject) -> JsonObject:
        kind = "" if message.get("run") else self.blocks.get("controller", "")
        return self.find_subject(message) | {
            "route": str(message.get("route") or "")[:MAX_NAME_LETTERS],
            "kind": kind,
        }

    async def _tune(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        reply, _ = await self._tuning_client.request("tune", visitor, **self._tuning_request(message))
        return reply | {"gains": _with_meanings(reply["gains"], visitor.language)}

    async def _route(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        reply, _ = await self._tuning_client.request("route", visitor, **self._tuning_request(message))
        return reply

    async def _lap(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        if not self._is_newest(visitor, message):
            return {"stale": True}
        reply, _ = await self._tuning_client.request(
            "lap", visitor, gains=message["gains"], **self._tuning_request(message)
        )
        return reply

    async def _landscape(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        """Return the costs of a square grid of laps, row by row from the bottom, or `stale`."""
        side = max(2, min(MAX_GRID_SIDE, int(message["side"])))
        positions = [(i / (side - 1), j / (side - 1)) for j in range(side) for i in range(side)]
        arguments = {name: message[name] for name in ("gains", "a", "b")} | self._tuning_request(message)
        start_s, costs = time.monotonic(), []
        for first in range(0, len(positions), LAPS_PER_REQUEST):
            if not self._is_newest(visitor, message):
                return {"stale": True}
            reply, _ = await self._tuning_client.request(
                "costs", visitor, positions=positions[first : first + LAPS_PER_REQUEST], **arguments
            )
            costs += reply["costs"]
        return {"side": side, "costs": costs, "seconds": time.monotonic() - start_s}

    async def _descent(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        arguments = {name: message[name] for name in ("gains", "price")} | self._tuning_request(message)
        reply, _ = await self.slow_client.request("downhill", visitor, **arguments)
        return reply

    async def write_gains(self, visitor: Visitor, message: JsonObject) -> Diagnostic:
        """Write gains, or the gyro scale of a `lap`, into the vehicle file, and return the message that confirms it."""
        if lap := message.get("lap"):
            lap, route = str(self.find_run(lap)), str(message.get("route") or "")[:MAX_NAME_LETTERS]
            reply, _ = await self.slow_client.request(
                "lap closure", **(self.find_subject({}) | {"run": lap, "route": route})
            )
            return Diagnostic.from_json(reply["message"])
        arguments = {"gains": message["gains"]} | self._tuning_request({"route": message.get("route")})
        reply, _ = await self._tuning_client.request("write", visitor, **arguments)
        return note("web.tuned", file=reply["file"])

    async def _block(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        reply, _ = await self.slow_client.request("block", visitor, **self._block_request(message))
        rows = _with_meanings(reply["parameters"], visitor.language)
        return reply | {"parameters": rows, "swapped": self.blocks.get(str(message["room"]))}

    async def _check(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        reply, _ = await self.slow_client.request("check", visitor, **self._block_request(message))
        with use_language(visitor.language):
            return {"findings": [text(Diagnostic.from_json(finding)) for finding in reply["findings"]]}

    def _block_request(self, message: JsonObject) -> JsonObject:
        role = str(message["room"])[:MAX_NAME_LETTERS]
        own_kind = "" if message.get("run") else self.blocks.get(role, "")
        return self.find_subject(message) | {
            "room": role,
            "kind": str(message.get("kind") or own_kind)[:MAX_NAME_LETTERS],
        }

    async def _compare(self, visitor: Visitor, message: JsonObject) -> JsonObject:
        paths = self._run_list.paths()
        run_paths = [paths[name] for name in list(message["runs"])[:MAX_COMPARED_RUNS] if name in paths]
        if not run_paths:
            raise UsageError.of("web.no-run")
        reply, _ = await self.slow_client.request(
            "compare", visitor, paths=[str(path) for path in run_paths], language=visitor.language
        )
        return reply

    async def swap_block(self, role: str, kind: str) -> str:
        """Use a block of this kind for a role from the next mission on, "" for the file's block; return its kind.

        Raise UsageError if a block of this role cannot be swapped, or if the kind is not in the list of the role.
        """
        reply, _ = await self.slow_client.request(
            "block", **self.find_subject({}), room=role[:MAX_NAME_LETTERS], kind=kind[:MAX_NAME_LETTERS]
        )
        if not reply["kinds"]:
            raise UsageError.of("web.no-swap", role=one_line(role)[:MAX_NAME_LETTERS])
        if reply["kind"] == reply["of_file"]:
            self.blocks.pop(role, None)
        else:
            self.blocks[role] = reply["kind"]
        return reply["kind"]

    def find_run(self, message: str) -> Path:
        """Return the path of the run with this key in the list. Raise UsageError if the run does not exist."""
        return Path(self.find_subject({"run": message})["path"])


def _with_meanings(rows: list[JsonObject], language: str) -> list[JsonObject]:
    """Return the rows of gains or parameters with their meanings in this language."""
    with use_language(language):
        return [row | {"meaning": translate(row["meaning"])} for row in rows]
