"""Use the worker from the page process: send a request and await the answer. The first request starts the worker."""

import asyncio
import json
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import error_of_exit_code

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

MAX_ANSWER_BYTES = 64 << 20  # bytes of an answer
MAX_LINE_BYTES = 16 << 20


class WorkerClient:
    """Client of the worker process of the page. The worker answers requests in the order in which they are sent."""

    def __init__(self) -> None:
        self._program: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()
        self._tasks: set[asyncio.Task[tuple[JsonObject, bytes]]] = set()

    async def request(self, do: str, **words: object) -> tuple["JsonObject", bytes]:
        """Return the answer to a request, and the bytes that follow it. Raise the error that the worker reports.

        The answer is read even if the caller is cancelled; otherwise the next request would receive it.
        """
        task = asyncio.create_task(self._exchange({"do": do, **words}))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        reply, payload = await asyncio.shield(task)
        if "no" in reply:
            raise error_of_exit_code(reply["code"], Diagnostic.of_json(reply["no"]))
        return reply, payload

    async def _exchange(self, request: "JsonObject") -> tuple["JsonObject", bytes]:
        async with self._turn:
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
                return {"no": fault("web.lab-ended").to_json(), "code": 1}, b""

    async def close(self) -> None:
        """Cancel the requests that wait, and end the worker."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._end_process()

    async def _running_process(self) -> asyncio.subprocess.Process:
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
