"""Use the worker from the page process: send a request and await the answer. The first request starts the worker."""

import asyncio
import json
import sys
from contextlib import nullcontext, suppress
from weakref import WeakKeyDictionary

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import exit_code_error

MAX_ANSWER_BYTES = 64 << 20  # bytes of an answer
MAX_LINE_BYTES = 16 << 20


class WorkerClient:
    """Client of the worker process of the page. The worker answers requests in the order in which they are sent.

    The requests of one browser wait for each other, so a request of another browser waits for one of them at most.
    """

    def __init__(self) -> None:
        self._program: asyncio.subprocess.Process | None = None
        self._turn, self._ended = asyncio.Lock(), False
        self._turns: WeakKeyDictionary[object, asyncio.Lock] = WeakKeyDictionary()  # of the browsers
        self._task: asyncio.Task[tuple[JsonObject, bytes]] | None = None  # of the present request

    async def request(
        self, request: str, browser: object = None, **words: object
    ) -> tuple[JsonObject, bytes]:
        """Return the answer to a request, and the bytes that follow it. Raise the error that the worker reports.

        If the caller is cancelled, a waiting request is not sent. The answer to a request that was sent is read;
        otherwise the next request would receive it.
        """
        own_turn = nullcontext() if browser is None else self._turns.setdefault(browser, asyncio.Lock())
        async with own_turn:
            await self._turn.acquire()
            self._task = asyncio.create_task(self._exchange({"type": request, **words}))
            self._task.add_done_callback(lambda _: self._turn.release())
            reply, payload = await asyncio.shield(self._task)
        if "refusal" in reply:
            raise exit_code_error(reply["code"], Diagnostic.from_json(reply["refusal"]))
        return reply, payload

    async def _exchange(self, request: JsonObject) -> tuple[JsonObject, bytes]:
        try:
            program = await self._running_process()
            assert program.stdin is not None
            assert program.stdout is not None
            program.stdin.write(json.dumps(request).encode() + b"\n")
            await program.stdin.drain()
            reply = json.loads(await program.stdout.readline())
            return reply, await program.stdout.readexactly(min(reply["bytes"], MAX_ANSWER_BYTES))
        except (OSError, ValueError, asyncio.IncompleteReadError):
            await self._end_process()
            return {"refusal": fault("web.lab-ended").to_json(), "code": 1}, b""

    async def close(self) -> None:
        """Cancel the present request, and end the worker; it does not start again."""
        self._ended = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await self._end_process()

    async def _running_process(self) -> asyncio.subprocess.Process:
        if self._ended:
            raise OSError
        if self._program is None or self._program.returncode is not None:
            self._program = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "baqueano.web.lab.worker",
                stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=MAX_LINE_BYTES,
            )  # fmt: skip
        return self._program

    async def _end_process(self) -> None:
        program, self._program = self._program, None
        if program is None:
            return
        if program.stdin is not None:
            program.stdin.close()
        with suppress(ProcessLookupError):
            program.kill()
        await program.wait()
