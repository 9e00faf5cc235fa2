"""Implement one connection to the door: cut received bytes into lines, and send messages completely and in order.

lines     at most MAX_BACKLOG lines wait, with MAX_SHORT_LINE_BYTES bytes in total, and one mission; further
          lines are dropped, except a stop                                                                       (1)
messages  at most MAX_PENDING_BYTES bytes wait; a client for which more bytes wait is disconnected                (2)
frame     a frame is sent only if no other message waits, so that each frame is recent                           (3)
"""

import re
import socket
import threading
import time
from collections import deque
from collections.abc import Iterator

from baqueano.contracts.values import JsonObject
from baqueano.door.wire import encode

MAX_SHORT_LINE_BYTES = 64 << 10  # bytes; a longer line can only be a mission
MAX_LINE_BYTES = 64 << 20  # largest number of bytes of a line: an hour of commands
MAX_PENDING_BYTES = 1 << 20  # bytes that wait for a client that does not read
MAX_PAUSE_S = 2.0  # longest pause within a long line: Wi-Fi is sometimes interrupted for half a second
MIN_RATE_BYTES_S = 8 << 10  # of a long line, apart from pauses
READ_BYTES = 16 << 10  # bytes that are read at once
MAX_BACKLOG = 256  # maximum number of lines that wait
MISSION_PATTERN = re.compile(rb'"type"\s*:\s*"mission"')  # at the beginning of each mission
STOP_PATTERN = re.compile(rb'"(?:type|do)"\s*:\s*"stop"')  # in each stop; a line with it is read at once


class DoorClient:
    """A connection. Only the door's thread is allowed to use its lines; any thread can call `enqueue`."""

    def __init__(self, connection: socket.socket) -> None:
        self.line = connection
        self.lines: deque[bytes] = deque()
        self.dropped = 0  # lines dropped since the last refusal
        self.answered = -1  # number of the last answered line, counted over all clients
        self.columns: tuple[int, ...] | None = None  # indices of the requested columns; None: all
        self.names: tuple[str, ...] | None = None  # names of the requested columns
        self.hz, self.turn = 0.0, 0  # frames per second; the period in which the last frame was sent
        # the drive that was described to the client, and the number of its rows that were sent
        self.drive, self.sent_row_count = -1, 0
        self._partial_line = bytearray()  # the beginning of a line
        self._due_s = 0.0  # time until which a long line needs no more bytes
        self._backlog = 0  # bytes of the waiting lines, without the mission
        # a line longer than MAX_SHORT_LINE_BYTES waits, after which heartbeats must not be dropped
        self._mission = False
        self._unsent_lines: deque[bytes] = deque()
        self._sent_bytes, self._queued_bytes = 0, 0  # bytes sent of the first message; bytes of all messages
        self._lock = threading.Lock()

    @property
    def partial_line_bytes(self) -> int:
        """Return the number of bytes of the last line, which is not complete yet."""
        return len(self._partial_line)

    @property
    def has_stalled(self) -> bool:
        """Return True if a long line is not complete, and arrives more slowly than MIN_RATE_BYTES_S.

        Time that is saved by faster bytes counts as a pause, up to MAX_PAUSE_S.
        """
        return self.partial_line_bytes > MAX_SHORT_LINE_BYTES and time.monotonic() > self._due_s

    @property
    def can_be_mission(self) -> bool:
        """Return False if the last line, longer than MAX_SHORT_LINE_BYTES, cannot become a mission."""
        return MISSION_PATTERN.search(self._partial_line, 0, MAX_SHORT_LINE_BYTES) is not None

    @property
    def is_overloaded(self) -> bool:
        """Return True if too many bytes wait to be sent to the client.  (2)"""
        return self._queued_bytes > MAX_PENDING_BYTES

    @property
    def pending_bytes(self) -> int:
        """Return the number of bytes that wait to be sent to the client."""
        return self._queued_bytes

    @property
    def has_output(self) -> bool:
        """Return True if a message waits to be sent to the client.  (3)"""
        return bool(self._unsent_lines)

    def enqueue(self, message: JsonObject) -> None:
        """Append a message to the queue of messages to send."""
        self.send_line(encode(message))

    def send_line(self, line: bytes) -> None:
        """Append an encoded message to the queue of messages to send."""
        with self._lock:
            self._unsent_lines.append(line)
            self._queued_bytes += len(line)

    def receive(self) -> Iterator[bytes]:
        """Receive bytes; yield each line that is a stop, and put the other lines into `lines`.  (1)

        Raise OSError if the connection has ended.
        """
        try:
            data = self.line.recv(READ_BYTES)
        except BlockingIOError:
            return
        if not data:
            raise ConnectionResetError
        now_s = time.monotonic()
        self._due_s = min(max(self._due_s, now_s) + len(data) / MIN_RATE_BYTES_S, now_s + MAX_PAUSE_S)
        head, newline, remainder = data.partition(b"\n")
        self._partial_line += head
        if not newline:
            return
        first_part, (middle_part, separator, tail) = bytes(self._partial_line), remainder.rpartition(b"\n")
        self._partial_line = bytearray(tail)
        if (
            len(self.lines) >= MAX_BACKLOG
            and not STOP_PATTERN.search(first_part)
            and not STOP_PATTERN.search(middle_part)
        ):
            self.dropped += 1 + (middle_part.count(b"\n") + 1 if separator else 0)
            return
        for line in [first_part, *(middle_part.split(b"\n") if separator else [])]:
            if STOP_PATTERN.search(line):
                yield line
            elif self._fits_queue(line):
                self.lines.append(line)
                self._count(line, 1)
            else:
                self.dropped += 1

    def pop_line(self) -> bytes:
        """Remove and return the line that has waited longest."""
        line = self.lines.popleft()
        self._count(line, -1)
        return line

    def _fits_queue(self, line: bytes) -> bool:
        if len(self.lines) >= MAX_BACKLOG:
            return False
        return (
            self._backlog < MAX_SHORT_LINE_BYTES if len(line) <= MAX_SHORT_LINE_BYTES else not self._mission
        )

    def _count(self, line: bytes, sign: int) -> None:
        if len(line) > MAX_SHORT_LINE_BYTES:
            self._mission = sign > 0
        else:
            self._backlog += sign * len(line)

    def send(self) -> None:
        """Send as many waiting bytes as the socket accepts. Raise OSError if the connection has ended."""
        with self._lock:
            while self._unsent_lines:
                first_line = self._unsent_lines[0]
                try:
                    self._sent_bytes += self.line.send(memoryview(first_line)[self._sent_bytes :])
                except BlockingIOError:
                    return
                if self._sent_bytes >= len(first_line):
                    self._unsent_lines.popleft()
                    self._queued_bytes, self._sent_bytes = self._queued_bytes - len(first_line), 0
