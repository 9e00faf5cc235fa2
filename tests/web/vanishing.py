"""A connection whose packets are lost: nothing arrives after `unplug`, and neither end is notified."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress


class Vanishing:
    """Forward bytes both ways until `unplug`."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._plugged = asyncio.Event()
        self._plugged.set()
        self._tasks: list[asyncio.Task[None]] = []
        self._writers: list[asyncio.StreamWriter] = []
        self.port = 0

    def unplug(self) -> None:
        """Discard everything that arrives from now on; both ends stay open."""
        self._plugged.clear()

    async def joined(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Connect a new client to the other end."""
        upstream, upstream_writer = await asyncio.open_connection("127.0.0.1", self._to)
        self._writers += [writer, upstream_writer]
        self._tasks += [
            asyncio.create_task(self._carry(*pair))
            for pair in ((reader, upstream_writer), (upstream, writer))
        ]

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while data := await reader.read(1 << 16):
                if not self._plugged.is_set():
                    await asyncio.Event().wait()  # the read data are lost, and nothing more is read
                writer.write(data)
                await writer.drain()

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for writer in self._writers:
            writer.transport.abort()


@asynccontextmanager
async def vanishing(port: int) -> AsyncIterator[Vanishing]:
    """Listen for clients and connect them to a port through such a connection."""
    line = Vanishing(port)
    server = await asyncio.start_server(line.joined, "127.0.0.1", 0)
    line.port = server.sockets[0].getsockname()[1]
    try:
        yield line
    finally:
        server.close()
        await line.close()
