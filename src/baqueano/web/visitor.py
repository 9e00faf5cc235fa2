"""Represent a connected browser: its messages, and the queues of messages, pieces and pictures to send.

  words     a queue of MAX_MESSAGES messages, which are never dropped; if it is full, the browser is disconnected (1)
  history   frames of the drive so far, each made only after the previous one has been sent, before the picture (2)
  picture   one place: the newest frame replaces a frame that has not been sent                                 (3)
  pieces    parts of a run, each made only after the previous piece has been sent                               (4)

The I/O-free protocol of `websockets` encodes the bytes. The socket's buffer is small, so that pictures are recent.
"""

import asyncio
import json
import math
import socket
import struct
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress

from websockets.frames import Opcode
from websockets.protocol import State
from websockets.server import ServerProtocol

from baqueano.contracts.values import JsonObject, Value
from baqueano.web.guard import RateLimit, Role

Piece = bytes | JsonObject | tuple[bytes, ...]  # a binary message, a word, the parts of a binary message

MAX_MESSAGES = 64
MAX_MESSAGE_BYTES = 16 << 10  # maximum number of bytes of a message from a browser
MAX_MESSAGE_RATE_HZ = 50.0  # messages per second from a browser, and frames of any kind
MAX_LEVELS = 8  # maximum number of levels of lists and objects in a message; hundreds exhaust the stack
MAX_UNREAD_BYTES = 4 << 20  # maximum number of bytes that wait for the kernel: more than the largest piece
FRAGMENT_BYTES = 16 << 10  # bytes of a long message that are encoded at once
SEND_BUFFER_BYTES = 64 << 10  # bytes in the socket's buffer
PING_PERIOD_S = 2.0
MAX_ROUND_TRIP_S = 0.2  # largest round trip allowed for a picture
MAX_SILENCE_S = 20.0  # time limit without a received byte
BINARY_OPCODE = 0x82  # the first byte of a whole binary message
POLICY, UNSUPPORTED, TOO_SLOW = 1008, 1003, 1013


class Visitor:
    """A connection. `role` is None until its `hello` is accepted; `kind` is the field that names a message."""

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, protocol: ServerProtocol, address: str,
        from_page: bool, kind: str = "type",
    ) -> None:  # fmt: skip
        self.address, self.from_page, self._kind = address, from_page, kind
        self.role: Role | None = None
        self.name, self.language = "", "en"
        self.has_sent_message = False
        self._reader, self._writer, self._protocol = reader, writer, protocol
        self._messages: deque[JsonObject] = deque()
        self._history: AsyncIterator[Piece] | None = None
        self._pieces: AsyncIterator[Piece] | None = None
        self._picture: bytes | None = None
        self._send_event, self._last_message_s = asyncio.Event(), time.monotonic()
        self._parts: list[bytes] = []
        self._close_code: int | None = None  # close code to send after the waiting messages
        self._rate = RateLimit(MAX_MESSAGE_RATE_HZ)
        self.round_trip_s, self._pinged_s = 0.0, 0.0  # round-trip time, time of the last ping
        writer.transport.set_write_buffer_limits(high=0)  # `drain` waits until the kernel has all bytes
        line = writer.get_extra_info("socket")
        if line is not None:
            with suppress(OSError):
                line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def is_open(self) -> bool:
        """Return True while messages can be sent."""
        return self._protocol.state is State.OPEN and not self._writer.is_closing()

    def send(self, message: JsonObject) -> None:
        """Append a message to the queue; disconnect the browser if the queue is full.  (1)"""
        if len(self._messages) >= MAX_MESSAGES:
            self.disconnect(TOO_SLOW)
            return
        self._messages.append(message)
        self._send_event.set()

    def send_latest(self, picture: bytes) -> None:
        """Send a picture at once if the queues are empty; otherwise replace the waiting picture.  (3)

        The picture is a message encoded by `binary_frame`.
        """
        next_parts = (self._picture, self._history, self._pieces, self._close_code)
        has_message = self._messages or any(item is not None for item in next_parts)
        if self.is_open and not has_message and not self._writer.transport.get_write_buffer_size():
            self._writer.write(picture)
            return
        self._picture = picture
        self._send_event.set()

    def send_history(self, history: AsyncIterator[Piece]) -> None:
        """Send these frames one by one before the next picture; each contains all rows until it is made.  (2)"""
        self._history = history
        self._send_event.set()

    def send_pieces(self, pieces: AsyncIterator[Piece]) -> None:
        """Send these pieces one by one, instead of pieces that have not been sent.  (4)"""
        self._pieces = pieces
        self._send_event.set()

    def disconnect(self, code: int = 1000) -> None:
        """Close the connection with this code, and drop the unsent messages."""
        if self._protocol.state is State.OPEN:
            self._protocol.send_close(code)
            self._flush()
        if code == TOO_SLOW:  # a browser that does not read would not read the close frame either
            self._writer.transport.abort()
        else:
            self._writer.close()
        self._send_event.set()

    def disconnect_after_sending(self, code: int) -> None:
        """Close the connection with this code after the waiting messages have been sent."""
        self._close_code = code
        self._send_event.set()

    async def exchange_messages(self, on_message: "Callable[[Visitor, JsonObject], Awaitable[None]]") -> None:
        """Receive messages and pass each to `on_message`, and send the queues, until the connection ends."""
        tasks = [asyncio.create_task(job) for job in (self._send_messages(), self._keep_alive())]
        try:
            await self._receive_messages(on_message)
        except (OSError, EOFError):
            pass
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._writer.transport.abort() if not self._writer.is_closing() else self._writer.close()

    async def _receive_messages(self, on_message: "Callable[[Visitor, JsonObject], Awaitable[None]]") -> None:
        while self._protocol.state is State.OPEN:
            data = await self._reader.read(1 << 16)
            if not data:
                return
            self._last_message_s = time.monotonic()
            self._protocol.receive_data(data)
            self._flush()
            for frame in self._protocol.events_received():
                for message in self._parse_frame(frame):
                    self.has_sent_message = True
                    await on_message(self, message)
                    await asyncio.sleep(0)  # let the answer be sent before the next message is read

    def _parse_frame(self, frame: object) -> list[JsonObject]:
        """Return the message that this frame completes, [] without one.

        Close the connection if the message is binary or malformed, or if the frames exceed the rate. Each frame counts:
        an empty frame or a ping costs as much time as a message, which a browser sends in one frame.
        """
        opcode = getattr(frame, "opcode", None)
        data = getattr(frame, "data", b"")
        is_last = getattr(frame, "fin", True)
        if self.is_open and not self._rate.allows_message():
            self.disconnect(POLICY)
        if opcode is Opcode.PONG:
            self.round_trip_s = min(MAX_ROUND_TRIP_S, time.monotonic() - self._pinged_s)
        if opcode is Opcode.BINARY:
            self.disconnect(UNSUPPORTED)
        if opcode not in (Opcode.TEXT, Opcode.CONT) or not self.is_open:
            return []
        self._parts = [data] if opcode is Opcode.TEXT else [*self._parts, data]
        if not is_last:
            return []
        try:
            message = json.loads(b"".join(self._parts))
        except (ValueError, RecursionError):
            message = None
        if not _has_few_levels(message, MAX_LEVELS):
            message = None
        if not isinstance(message, dict) or not isinstance(message.get(self._kind), str):
            self.disconnect(POLICY)
            return []
        return [message]

    async def _send_messages(self) -> None:
        with suppress(OSError):
            while self.is_open:
                await self._send_event.wait()
                self._send_event.clear()
                await self._drain()  # for a picture that was sent at once
                while self.is_open and (await self._send_next()):
                    pass

    async def _send_next(self) -> bool:
        """Send the next waiting item: messages, then the history, a picture, and a piece.

        Return False if no item waits.
        """
        if self._messages:
            await self._write(self._messages.popleft())
        elif self._close_code is not None:
            self.disconnect(self._close_code)
        elif (history := self._history) is not None:
            if (frame := await anext(history, None)) is not None:
                self._picture = None  # its rows are in the frame
                await self._write(frame)
            elif self._history is history:
                self._history = None
        elif self._picture is not None:
            picture, self._picture = self._picture, None
            self._writer.write(picture)
            await self._drain()
        elif self._pieces is not None:
            pieces = self._pieces
            if (piece := await anext(pieces, None)) is not None:
                await self._write(piece)
            elif self._pieces is pieces:
                self._pieces = None
        else:
            return False
        return True

    async def _write(self, piece: Piece) -> None:
        if isinstance(piece, tuple):
            return await self._write_parts(deque(piece))
        if isinstance(piece, bytes):
            self._protocol.send_binary(piece)
        else:
            self._protocol.send_text(encode_json(piece))
        self._flush()
        await self._drain()

    async def _write_parts(self, parts: deque[bytes]) -> None:
        """Send one message in fragments, each after the kernel has accepted the previous fragment.

        A long message is thus in memory only once, even if several browsers do not read it.
        """
        send = self._protocol.send_binary
        while parts and self.is_open:
            data = bytearray()
            while parts and len(data) < FRAGMENT_BYTES:
                data += parts.popleft()
            send(bytes(data), fin=not parts)
            send = self._protocol.send_continuation
            self._flush()
            await self._drain()

    async def _drain(self) -> None:
        """Wait until the kernel has accepted all written bytes."""
        if not self._writer.is_closing():
            await self._writer.drain()

    def _flush(self) -> None:
        """Write the bytes of the protocol to the socket; abort the connection if the browser does not read."""
        for data in self._protocol.data_to_send():
            if data and not self._writer.is_closing():
                self._writer.write(data)
            elif not data:
                self._writer.close()
        if self._writer.transport.get_write_buffer_size() > MAX_UNREAD_BYTES:
            self._writer.transport.abort()

    async def _keep_alive(self) -> None:
        while self.is_open:
            await asyncio.sleep(PING_PERIOD_S)
            if time.monotonic() - self._last_message_s > MAX_SILENCE_S:
                self._writer.transport.abort()
                return
            self._pinged_s = time.monotonic()
            self._protocol.send_ping(b"")
            self._flush()


def binary_frame(data: bytes) -> bytes:
    """Return data as a binary WebSocket message (RFC 6455, 5.2). The bytes are the same for all browsers."""
    size = len(data)
    if size < 126:
        return bytes((BINARY_OPCODE, size)) + data
    if size < 1 << 16:
        return struct.pack("!BBH", BINARY_OPCODE, 126, size) + data
    return struct.pack("!BBQ", BINARY_OPCODE, 127, size) + data


def encode_json(message: JsonObject) -> bytes:
    """Return a message as JSON. Infinite numbers and NaN become null, because JSON does not have them."""
    return json.dumps(
        _finite_json(message), ensure_ascii=False, separators=(",", ":"), allow_nan=False
    ).encode()


def _has_few_levels(value: Value, levels: int) -> bool:
    """Return True if a value from JSON has at most so many levels of lists and objects."""
    if not isinstance(value, dict | list):
        return True
    items = value.values() if isinstance(value, dict) else value
    return levels > 0 and all(_has_few_levels(item, levels - 1) for item in items)


def _finite_json(value: Value) -> Value:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite_json(item) for name, item in value.items()}
    return [_finite_json(item) for item in value] if isinstance(value, list | tuple) else value
