"""Connect the page process to the service of a vehicle: lines of JSON over pipes, or over a socket.

a simulated vehicle   a child of this process (door/simulated), which ends with its pipes
HOST                  ssh HOST baqueano robot attach: the robot does not listen on the network
a path, or "here"     the socket of a service on this machine
"""

import asyncio
import json
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Protocol

from baqueano.contracts.values import JsonObject
from baqueano.door import SOCKET, wire
from baqueano.door.pipes import forward_bytes
from baqueano.door.ssh import ssh_command
from baqueano.errors import RobotUnreachable

MAX_LINE_BYTES = 4 << 20  # maximum number of bytes of a line
ATTACH_COMMAND = "exec baqueano robot attach"
END_TIMEOUT_S = 3.0  # time to close its last run
FRAME_PREFIX = b'{"type":"frame"'
MAX_UNSENT_BYTES = 256 << 10  # maximum number of bytes that wait for a service that does not read


class DoorLink(Protocol):
    """Protocol of a service, or of a player of runs, that exchanges the messages of the door."""

    def send(self, request: str, **words: object) -> None:
        """Send a message without waiting. Raise RobotUnreachable if the other side does not accept it."""
        ...

    async def receive(self, on_message: Callable[[JsonObject], None]) -> None:
        """Pass each received message to `on_message` until the connection ends."""
        ...

    async def close(self) -> None:
        """End the connection."""
        ...


class ServiceLink:
    """A connection to the service of a vehicle."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter,
        program: asyncio.subprocess.Process | None = None,
    ) -> None:  # fmt: skip
        self._reader, self._writer, self._program = reader, writer, program

    def send(self, request: str, **words: object) -> None:
        """Send a message without waiting. Raise RobotUnreachable if the service has ended or does not read."""
        transport = self._writer.transport
        if transport.is_closing() or transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            raise RobotUnreachable.of("web.service-ended")
        self._writer.write(wire.encode({"type": request, **words}))

    async def receive(self, on_message: Callable[[JsonObject], None]) -> None:
        """Pass each received message to `on_message` until the service ends."""
        with suppress(OSError, ValueError):
            while line := await self._reader.readline():
                message = json.loads(line) if line.startswith(FRAME_PREFIX) else wire.decode(line)
                if message is not None:
                    on_message(message)

    async def close(self) -> None:
        """End the connection; a simulated vehicle then stops and closes its run."""
        with suppress(OSError):
            self._writer.close()
        if self._program is None:
            return
        try:
            await asyncio.wait_for(self._program.wait(), END_TIMEOUT_S)
        except TimeoutError:
            with suppress(ProcessLookupError):
                self._program.kill()
            await self._program.wait()


async def start_simulated(vehicle: str, folder: Path, *options: str) -> ServiceLink:
    """Start the service of a simulated vehicle, and return the link to it."""
    return await _start(
        [sys.executable, "-m", "baqueano.door.simulated", vehicle, "--runs", str(folder), *options]
    )


async def pipe_link(source: BinaryIO, sink: BinaryIO) -> ServiceLink:
    """Return a link to the process that started this process, over these pipes."""
    near_end, far_end = socket.socketpair()
    threading.Thread(target=forward_bytes, args=(far_end, source, sink), name="pipes", daemon=True).start()
    return ServiceLink(*await asyncio.open_connection(sock=near_end, limit=MAX_LINE_BYTES))


async def connect(host: str) -> ServiceLink:
    """Return a link to the service at HOST. If ssh fails later, the link ends.

    Raise RobotUnreachable if the socket of the service cannot be opened, or if ssh is not installed.
    """
    if host == "here" or ("/" in host and not host.startswith("-")):
        path = SOCKET if host == "here" else Path(host)
        try:
            return ServiceLink(*await asyncio.open_unix_connection(str(path), limit=MAX_LINE_BYTES))
        except OSError as error:
            raise RobotUnreachable.of(
                "door.no-answer", "systemctl status baqueano", path=path, error=error.strerror
            ) from error
    # a page cannot request a password
    return await _start(ssh_command(host, ATTACH_COMMAND, "-o", "BatchMode=yes"))


async def _start(command: list[str]) -> ServiceLink:
    """Start a program, and return a link over its stdin and stdout; its stderr is not redirected."""
    try:
        program = await asyncio.create_subprocess_exec(
            *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=MAX_LINE_BYTES,
            start_new_session=True,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise RobotUnreachable.of("remote.no-ssh", host=command[0]) from error
    assert program.stdin is not None
    assert program.stdout is not None
    return ServiceLink(program.stdout, program.stdin, program)
