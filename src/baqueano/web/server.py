"""Serve static files from a table made at the start, runs and reports by their keys, and WebSockets.

The server listens on loopback, and on one more address if the page is shared. HTTP requests do not change any state.
"""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path

from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from baqueano.contracts.values import JsonObject
from baqueano.errors import UsageError
from baqueano.web import SUBPROTOCOL
from baqueano.web.foxglove.bridge import SUBPROTOCOLS, FoxgloveServer
from baqueano.web.guard import LOOPBACK as LOOPBACK_ADDRESSES, Guard
from baqueano.web.http import (
    MAX_HEAD_BYTES,
    Content,
    RefusedRequest,
    RequestHead,
    parse_head,
    read_head,
    refuse,
    reply,
    static_files,
)
from baqueano.web.visitor import MAX_MESSAGE_BYTES, POLICY, Visitor

STATIC = Path(__file__).with_name("static")
MAX_VISITORS = 32
MAX_CONNECTIONS = 96  # maximum number of connections, including those that fetch files
MAX_ADDRESS_CONNECTIONS = 24  # of one machine of the network, so that it leaves places for the others
HANDSHAKE_TIMEOUT_S = 5.0
DONE, GOODBYE_S = 1000, 1.0
LOOPBACK = "127.0.0.1"


class Server:
    """A server that listens while its context is entered: `async with Server(…) as server`."""

    def __init__(
        self,
        on_message: Callable[[Visitor, JsonObject], Awaitable[None]],
        on_leave: Callable[[Visitor], None],
        read_content: Callable[[str], Awaitable[Content | None]],
        *,
        port: int = 0,
        shared_address: str = "",
        names: tuple[str, ...] = (),
    ) -> None:
        self._on_message, self._on_leave, self._content_of = on_message, on_leave, read_content
        self._addresses = tuple(filter(None, (LOOPBACK, shared_address)))
        self._names, self.shared_address, self.port = names, shared_address, port
        self._files = static_files(STATIC)
        self._servers: list[asyncio.Server] = []
        self._connections = Counter[str]()  # by address
        self.visitors, self.foxglove_viewers = set[Visitor](), set[Visitor]()
        self.foxglove: FoxgloveServer | None = None  # set for a page with a vehicle
        self._tasks: set[asyncio.Task[None] | None] = set()
        self.guard = Guard((), 0)

    async def __aenter__(self) -> "Server":
        """Begin to listen. Raise UsageError if the port is taken."""
        for address in self._addresses:
            try:
                server = await asyncio.start_server(
                    self._accept, address, self.port, limit=MAX_HEAD_BYTES, start_serving=False
                )
            except OSError as error:
                await self._close()
                raise UsageError.of(
                    "web.port-taken", "--port 0", address=address, port=self.port, error=error.strerror
                ) from error
            self._servers.append(server)
            self.port = server.sockets[0].getsockname()[1]
        self.guard = Guard(
            (*self._addresses, "localhost", *self._names), self.port, bool(self.shared_address)
        )
        for server in self._servers:
            await server.start_serving()
        return self

    async def __aexit__(self, *error: object) -> None:
        """Disconnect all browsers and stop listening."""
        for visitor in [*self.visitors, *self.foxglove_viewers]:
            visitor.disconnect(1001)
        await self._close()
        for running_task in list(self._tasks):
            if running_task is not None:
                running_task.cancel()
        await asyncio.gather(*filter(None, self._tasks), return_exceptions=True)

    async def disconnect_all(self) -> None:
        """Disconnect each browser after its waiting messages, and wait for this up to GOODBYE_S.

        After the code DONE a browser does not connect again.
        """
        for visitor in list(self.visitors):
            visitor.disconnect_after_sending(DONE)
        with suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                while self.visitors:
                    await asyncio.sleep(GOODBYE_S / 50)

    async def _close(self) -> None:
        for server in self._servers:
            server.close()
            with suppress(OSError):
                await asyncio.wait_for(server.wait_closed(), 1.0)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task, peer = asyncio.current_task(), writer.get_extra_info("peername")
        address = peer[0] if peer else ""  # "": it has left
        self._connections[address] += 1
        self._tasks.add(task)
        own_places = MAX_CONNECTIONS if address in LOOPBACK_ADDRESSES else MAX_ADDRESS_CONNECTIONS
        try:
            if self._connections[address] <= own_places and self._connections.total() <= MAX_CONNECTIONS:
                await self._answer(reader, writer)
        except (OSError, EOFError, asyncio.CancelledError):  # cancelled when the server ends
            pass
        finally:
            self._connections[address] -= 1
            self._connections += Counter()  # removes addresses without a connection
            self._tasks.discard(task)
            with suppress(OSError):
                writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            async with asyncio.timeout(HANDSHAKE_TIMEOUT_S):
                data = await read_head(reader)
            head = parse_head(data)
            if not self.guard.is_served_host(head.values("host")):
                raise RefusedRequest(HTTPStatus.FORBIDDEN)
            if head.path == "/ws":
                await self._upgrade(reader, writer, head, data)
                return
            if self.foxglove is not None and head.path.partition("/foxglove")[0] == "":
                await self._serve_foxglove(reader, writer, head, data)
                return
            content = self._files.get(head.path) or await self._content_of(head.path)
            if content is None:
                raise RefusedRequest(HTTPStatus.NOT_FOUND)
            await reply(writer, content, head)
        except RefusedRequest as refusal:
            await refuse(writer, refusal)

    async def _upgrade(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, head: RequestHead, data: bytes
    ) -> None:
        origins = head.values("origin")
        if not self.guard.is_allowed_origin(origins):
            raise RefusedRequest(HTTPStatus.FORBIDDEN)
        protocol = self._protocol(head, data, (SUBPROTOCOL,))
        writer.write(b"".join(protocol.data_to_send()))
        visitor = Visitor(reader, writer, protocol, writer.get_extra_info("peername")[0], bool(origins))
        self.visitors.add(visitor)
        greeting_timer = asyncio.get_running_loop().call_later(
            HANDSHAKE_TIMEOUT_S, self._check_greeting, visitor
        )
        try:
            await visitor.exchange_messages(self._on_message)
        finally:
            greeting_timer.cancel()
            self.visitors.discard(visitor)
            self._on_leave(visitor)

    async def _serve_foxglove(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, head: RequestHead, data: bytes
    ) -> None:
        """Serve a program that uses Foxglove's protocol, if its URL contains a valid token.

        On a page that is not shared, a program on this machine does not need a token. Raise RefusedRequest otherwise.
        """
        address, foxglove = writer.get_extra_info("peername")[0], self.foxglove
        assert foxglove is not None
        token = head.path.removeprefix("/foxglove").removeprefix("/")
        is_local = (
            not token
            and not head.values("origin")
            and not self.guard.shared
            and address in LOOPBACK_ADDRESSES
        )
        if not is_local and self.guard.browser_role(address, token, from_page=False) is None:
            raise RefusedRequest(HTTPStatus.FORBIDDEN)
        protocol = self._protocol(head, data, SUBPROTOCOLS)
        if protocol.subprotocol is None:
            raise RefusedRequest(HTTPStatus.BAD_REQUEST)
        writer.write(b"".join(protocol.data_to_send()))
        line = Visitor(reader, writer, protocol, address, from_page=False, kind="op")
        self.foxglove_viewers.add(line)
        foxglove.add_client(line)
        try:
            await line.exchange_messages(foxglove.receive)
        finally:
            self.foxglove_viewers.discard(line)
            foxglove.on_disconnect(line)

    def _protocol(self, head: RequestHead, data: bytes, names: tuple[str, ...]) -> ServerProtocol:
        """Return the WebSocket protocol of a connection, with the answer to its upgrade ready to be sent.

        Raise RefusedRequest if the request is not a valid upgrade, or if too many browsers are connected.
        """
        if head.method != "GET" or not head.values("upgrade"):
            raise RefusedRequest(HTTPStatus.UPGRADE_REQUIRED, Upgrade="websocket")
        if len(self.visitors) + len(self.foxglove_viewers) >= MAX_VISITORS:
            raise RefusedRequest(HTTPStatus.SERVICE_UNAVAILABLE)
        protocol = ServerProtocol(
            subprotocols=[Subprotocol(name) for name in names], max_size=MAX_MESSAGE_BYTES
        )
        protocol.receive_data(data)
        requests = protocol.events_received()
        response = protocol.accept(requests[0]) if requests else None  # pyright: ignore[reportArgumentType]
        if response is None or response.status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            raise RefusedRequest(HTTPStatus.BAD_REQUEST)
        protocol.send_response(response)
        return protocol

    def _check_greeting(self, visitor: Visitor) -> None:
        """Disconnect a browser that has not sent a message in time."""
        if not visitor.has_sent_message:
            visitor.disconnect(POLICY)
