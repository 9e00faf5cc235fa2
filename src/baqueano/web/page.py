"""Handle the messages of browsers that do not drive: hello, runs and questions. live.py handles the others.

All texts are made here, in the language of each browser. Text from a browser is never used as a path or a file name.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from pathlib import Path
from typing import Protocol

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, fault, note
from baqueano.errors import BaqueanoError, UsageError
from baqueano.messages import text
from baqueano.messages.language import LANGUAGES, use_language
from baqueano.messages.printable import one_line
from baqueano.web import PROTOCOL
from baqueano.web.guard import Guard
from baqueano.web.lab.live_identification import LiveIdentification
from baqueano.web.lab.questions import Questions
from baqueano.web.lab.run_list import RunList
from baqueano.web.lab.worker_client import WorkerClient
from baqueano.web.visitor import POLICY, Visitor

ROWS_PER_FRAME = 4096  # maximum number of rows in a frame of a run
STREAM_RUNS = {1: "run", 2: "ghost"}  # streams of the opened runs
STREAM_SHIFT_BITS = 24  # bits of the number of a frame, below its stream: 0 live, 1 the run, 2 its ghost
IMU_LABELS = {"imu[0]": "web.imu-ahead", "imu[1]": "web.imu-left", "imu[2]": "web.imu-turning"}
LABELS = {
    "t": "web.label-time", "eta.x": "web.label-x", "eta.y": "web.label-y", "eta.psi": "web.label-heading",
    "P.xx": "web.label-var-x", "P.xy": "web.label-cov-xy", "P.yy": "web.label-var-y", "P.psi": "web.label-var-heading",
    "nu.u": "web.label-speed", "nu.v": "web.label-sideways", "nu.r": "web.label-yaw-rate",
    "ref.x": "web.label-ref-x", "ref.y": "web.label-ref-y", "ref.psi": "web.label-ref-heading",
    "ref.u": "web.label-ref-speed", "truth.x": "web.label-true-x", "truth.y": "web.label-true-y",
    "truth.psi": "web.label-true-heading", "nis": "web.label-nis", "progress": "web.label-progress",
    "cross": "web.label-cross", "battery": "web.label-battery", "late_ms": "web.label-late",
}  # fmt: skip
SLOW_MESSAGES = ("mission", "swap", "write", "ask")  # messages that a worker may have to answer
MAX_NAME_LETTERS = 40  # maximum number of characters of a name
MAX_FILTER_LETTERS = 200
MAX_QUESTIONS = 32  # maximum number of open questions of a browser; the page itself sends a few at once
SEVERITIES = {"fatal": Severity.ERROR, "debug": Severity.INFO}  # of a run's events


class VehicleSide(Protocol):
    """Protocol of the part of a page that is connected to a vehicle."""

    def hello(self, visitor: Visitor) -> JsonObject:
        """Return the part of `hello` that describes the vehicle."""
        ...

    def send_backlog(self, visitor: Visitor) -> None:
        """Send a browser, after its `hello`, the events and the rows of the drive so far."""
        ...

    async def receive(self, visitor: Visitor, message: JsonObject) -> None:
        """Execute a message of a browser; the caller answers a BaqueanoError with `refused`."""
        ...

    def on_disconnect(self, visitor: Visitor) -> None:
        """Release what belongs to a browser that has disconnected."""
        ...

    def check_may_change(self, visitor: Visitor) -> None:
        """Raise SafetyStop if a browser is not allowed to change the next mission."""
        ...

    def announce_swap(self, role: str, kind: str, blocks: dict[str, str]) -> None:
        """Announce that a block of this kind is used for a role from the next mission on.

        `blocks` contains all swapped blocks, role → kind.
        """
        ...


class BrowserPage:
    """The handler of all browsers of a page, with a vehicle (`live`) or with the recorded runs `open_files`."""

    def __init__(
        self, lab: WorkerClient, run_list: RunList, guard: Callable[[], Guard], open_files: tuple[Path, ...] = (),
        live: VehicleSide | None = None,
    ) -> None:  # fmt: skip
        self._lab, self._run_list, self._guard, self._start_paths, self.live = (
            lab,
            run_list,
            guard,
            open_files,
            live,
        )
        self._live_identification = LiveIdentification()  # for finished runs
        first = {"path": str(open_files[0])} if open_files else None
        self.source: Callable[[], JsonObject | None] = lambda: first  # the subject of questions
        self.questions = Questions(run_list, lambda: self.source())
        self._count = 0
        self._question_tasks: dict[Visitor, set[asyncio.Task[None]]] = {}  # questions that wait for an answer
        self._reading: set[asyncio.Task[None]] = set()

    async def receive(self, visitor: Visitor, message: JsonObject) -> None:
        """Execute a message of a browser. A slow message runs as a task, because the next message can be a stop."""
        if message["type"] in SLOW_MESSAGES:
            self._start_task(self._execute(visitor, message))
        else:
            await self._execute(visitor, message)

    async def _execute(self, visitor: Visitor, message: JsonObject) -> None:
        words: dict[str, Callable[[Visitor, JsonObject], Awaitable[None]]] = {
            "hello": self._hello, "open": self._open, "runs": self._runs, "ask": self._ask,
            "swap": self._swap, "write": self._write,
        }  # fmt: skip
        try:
            if visitor.role is None and message["type"] != "hello":
                raise UsageError.of("web.no-hello")
            if (handler := words.get(message["type"])) is not None:
                await handler(visitor, message)
            elif self.live is not None:
                await self.live.receive(visitor, message)
            else:
                raise UsageError.of("web.no-vehicle", request=one_line(message["type"])[:MAX_NAME_LETTERS])
        except BaqueanoError as error:
            self.refuse(visitor, message, error.diagnostic)
        except (KeyError, TypeError, ValueError, OverflowError) as error:  # a browser can send anything
            self.refuse(visitor, message, fault("web.not-understood", error=type(error).__name__))

    def refuse(self, visitor: Visitor, message: JsonObject, reason: Diagnostic) -> None:
        """Answer a message with `refused` and the reason, and disconnect a browser without a role."""
        with use_language(visitor.language):
            visitor.send(
                {
                    "type": "refused",
                    "reason": text(reason),
                    "code": str(reason.code),
                    "to": message["type"][:MAX_NAME_LETTERS],
                }
            )
        if visitor.role is None:
            visitor.disconnect_after_sending(POLICY)

    async def close(self) -> None:
        """End the workers of the page."""
        await self._live_identification.close()
        await self.questions.close()

    def on_disconnect(self, visitor: Visitor) -> None:
        """Release what belongs to a browser that has disconnected, and drop its questions."""
        for task in self._question_tasks.pop(visitor, ()):
            task.cancel()
        if self.live is not None and visitor.role is not None:
            self.live.on_disconnect(visitor)

    async def _hello(self, visitor: Visitor, message: JsonObject) -> None:
        if visitor.role is not None:
            raise UsageError.of("web.hello-repeated")
        if message.get("lang") in LANGUAGES:
            visitor.language = message["lang"]
        role = self._guard().browser_role(visitor.address, str(message.get("token") or ""), visitor.from_page)
        if role is None:
            raise UsageError.of("web.token")
        self._count += 1
        visitor_name = one_line(str(message.get("name") or ""))[:MAX_NAME_LETTERS].strip()
        with use_language(visitor.language):
            visitor.name = visitor_name or text(note("web.visitor", number=self._count))
        description = await self._replayed_description() if self.live is None else self.live.hello(visitor)
        visitor.role = role
        self.send_hello(visitor, description)
        if self.live is not None:
            self.live.send_backlog(visitor)
        self._start_task(self._send_list(visitor))

    def send_hello(self, visitor: Visitor, description: JsonObject) -> None:
        """Send a browser the description of this page, completed by `about`."""
        hello = {
            "type": "hello", "protocol": PROTOCOL, "role": visitor.role.protocol_name if visitor.role else "",
            "mode": "live" if self.live else "replay", "vehicle": None, "blocks": {}, "fields": [], "driver": None,
            "you": visitor.name, "state": None, "route": None, "routes": [],
            "runs": self._run_list.entries(), "open": self._start_run_keys(), "shared": self._guard().shared,
        } | description  # fmt: skip
        visitor.send(hello | {"fields": label_fields(hello["fields"], visitor.language)})

    def send_run_list(self, visitors: Iterable[Visitor]) -> None:
        """Read the list of runs again, and send it to these browsers."""
        for visitor in visitors:
            self._start_task(self._send_list(visitor))

    def _start_run_keys(self) -> JsonObject | None:
        """Return the keys of the runs with which the page was started, None without such runs."""
        words = [self._run_list.run_key(path) for path in self._start_paths]
        return {"run": words[0], "ghost": words[1] if len(words) > 1 else None} if words else None

    async def _replayed_description(self) -> JsonObject:
        if not self._start_paths:
            return {}
        description, _ = await self._lab.request("open", path=str(self._start_paths[0]))
        return {name: description[name] for name in ("vehicle", "blocks", "fields", "route")}

    async def _ask(self, visitor: Visitor, message: JsonObject) -> None:
        """Answer "ping" at once, and another question within the limit of the browser."""
        if message["question"] == "ping":
            visitor.send({"type": "answer", "to": "ask", "id": message.get("id")})
        elif message["question"] == "identify":
            await self._limit_questions(visitor, self._identify_run(visitor, message))
        else:
            await self._limit_questions(visitor, self.questions.answer(visitor, message))

    async def _limit_questions(self, visitor: Visitor, job: Coroutine[None, None, None]) -> None:
        """Wait for an answer to a browser; disconnect the browser instead if MAX_QUESTIONS of its questions wait."""
        if not visitor.is_open or len(self._question_tasks.setdefault(visitor, set())) >= MAX_QUESTIONS:
            job.close()
            visitor.disconnect(POLICY)
            return
        tasks = self._question_tasks[visitor]
        tasks.add(task := asyncio.create_task(job))
        try:
            await task
        finally:
            tasks.discard(task)

    async def _identify_run(self, visitor: Visitor, message: JsonObject) -> None:
        """Answer the question "identify" for a run of the list."""
        path = self._run_list.paths().get(message["run"])
        if path is None:
            raise UsageError.of("web.no-run")
        reply = await self._live_identification.identify_run(path, visitor)
        visitor.send({"type": "answer", "to": "ask", "id": message.get("id")} | reply)

    async def _swap(self, visitor: Visitor, message: JsonObject) -> None:
        """Use another block for a role from the next mission on, if the browser is allowed to change the mission."""
        if self.live is None:
            raise UsageError.of("web.no-vehicle", request="swap")
        self.live.check_may_change(visitor)
        kind = await self.questions.swap_block(str(message["room"]), str(message.get("kind") or ""))
        self.live.announce_swap(str(message["room"]), kind, self.questions.blocks)

    async def _write(self, visitor: Visitor, message: JsonObject) -> None:
        """Write gains or a gyro scale into the vehicle file, if the browser is allowed to change the next mission."""
        if self.live is None:
            raise UsageError.of("web.no-vehicle", request="write")
        self.live.check_may_change(visitor)
        confirmation = await self.questions.write_gains(visitor, message)
        with use_language(visitor.language):
            visitor.send({"type": "event", "t": 0.0, "severity": "warning", "text": text(confirmation)})

    async def _open(self, visitor: Visitor, message: JsonObject) -> None:
        """Send the run with this key, and its ghost: a second run, or this run replayed through another estimator."""
        paths, filter_name = self._run_list.paths(), str(message.get("filter") or "")[:MAX_FILTER_LETTERS]
        selection: list[tuple[Path, str]] = []
        for run_name in filter(
            None, (message["run"], message["run"] if filter_name else message.get("ghost"))
        ):
            if run_name not in paths:
                raise UsageError.of("web.no-run")
            selection.append((paths[run_name], filter_name if selection else ""))
        visitor.send_pieces(self._run_pieces(visitor, selection))

    async def _runs(self, visitor: Visitor, message: JsonObject) -> None:
        self._start_task(self._limit_questions(visitor, self._send_list(visitor)))

    async def _send_list(self, visitor: Visitor) -> None:
        """Let the worker read the list of runs, and send it to a browser."""
        try:
            visitor.send({"type": "runs", "runs": await self._run_list.read_entries()})
        except BaqueanoError as error:
            self.refuse(visitor, {"type": "runs"}, error.diagnostic)

    async def _run_pieces(
        self, visitor: Visitor, paths: list[tuple[Path, str]]
    ) -> AsyncIterator[bytes | JsonObject]:
        """Yield the description and the frames of each run in `paths`: (path, estimator for a replay, or "")."""
        for stream, (path, through) in enumerate(paths, 1):
            lab = self.questions.slow_client if through else self._lab
            request = {"path": str(path), "filter": through}
            try:
                description, _ = await lab.request("open", **request)
                start = {"type": "answer", "to": "open", "stream": stream, "of": STREAM_RUNS[stream]}
                yield (
                    start
                    | self._run_description(visitor, path, description)
                    | {"done": False, "filter": through or None}
                )
                for number, first in enumerate(range(0, description["rows"], ROWS_PER_FRAME), 1):
                    _, frame = await lab.request(
                        "frame",
                        number=stream << STREAM_SHIFT_BITS | number,
                        first=first,
                        count=ROWS_PER_FRAME,
                        **request,
                    )
                    yield frame
                yield start | {"done": True, "seconds": description["seconds"]}
            except BaqueanoError as error:
                with use_language(visitor.language):
                    yield {
                        "type": "refused",
                        "reason": text(error.diagnostic),
                        "code": error.diagnostic.code,
                        "to": "open",
                    }

    def _run_description(self, visitor: Visitor, path: Path, metadata: JsonObject) -> JsonObject:
        """Return the description of a run for a browser, in the language of the browser."""
        description = {name: metadata[name] for name in ("vehicle", "blocks", "route", "rows", "seconds")}
        with use_language(visitor.language):
            figures = {name: metadata[name] for name in ("kind", "seconds")}
            sentence = text(note("web.recorded", events=len(metadata["events"]), **figures))
        brief = {name: metadata[name] for name in ("name", "kind", "seconds")}
        return description | {
            "id": self._run_list.run_key(path), "name": metadata["name"],
            "run": self._run_list.list_entry(path) | brief,
            "fields": label_fields(metadata["fields"], visitor.language), "sentence": sentence,
            "events": [with_sentence(event, visitor.language) for event in metadata["events"]],
        }  # fmt: skip

    def _start_task(self, job: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(job)
        self._reading.add(task)
        task.add_done_callback(self._reading.discard)


def with_sentence(event: JsonObject, language: str) -> JsonObject:
    """Return an event of a run, with its text as a sentence in this language."""
    severity = SEVERITIES.get(event["severity"], event["severity"])
    message = event["text"]
    with use_language(language):
        return event | {
            "severity": severity,
            "text": text(Diagnostic.from_json(message) if isinstance(message, dict) else message),
        }


def label_fields(fields: list[JsonObject], language: str) -> list[JsonObject]:
    """Return the fields, each with a label in this language: the name of the quantity or of the channel."""
    with use_language(language):
        return [field | {"label": _label(field["name"], field["group"])} for field in fields]


def _label(name: str, group: str) -> str:
    first, _, rest = name.partition(".")
    if first in ("u", "requested"):
        return text(note("web.label-command", name=group))
    if first in ("z", "model", "innov", "S"):
        return text(note(IMU_LABELS[rest])) if rest in IMU_LABELS else rest
    return text(note(LABELS[name])) if name in LABELS else name
