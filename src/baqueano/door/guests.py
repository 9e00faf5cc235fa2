"""One connection to the door: received bytes, cut into lines, and messages to send, complete and in order.

lines     at most BACKLOG wait to be answered, and LONG bytes in addition to one mission; further lines are dropped,
          except a stop                                                                                          (1)
messages  at most PENDING bytes wait; a guest with more is disconnected                                          (2)
frame     only one waits, the newest: it replaces an unread one                                                  (3)
"""

import re
import socket
import threading
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from baqueano.door.wire import encoded

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

LONG = 64 << 10  # bytes of a line that can only be a mission
LONGEST = 64 << 20  # bytes of a line: an hour of commands
PENDING = 1 << 20  # bytes that wait for a guest that does not read
PIECE = 16 << 10  # bytes that are read at a time
BACKLOG = 256  # lines
STOP = re.compile(rb'"do"\s*:\s*"stop"')  # each stop contains this; a line that contains it is read at once


class Guest:
    """A connection. Its lines belong to the door's thread; any thread may call `say`."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self.lines: deque[bytes] = deque()
        self.dropped = 0  # lines since one was answered
        self.answered = -1  # the number, of all lines, of the last one that was
        self.columns: tuple[int, ...] | None = None  # of the frames that it asked for; None: all
        self.names: tuple[str, ...] | None = None  # the same by name
        self.hz, self.turn = 0.0, 0  # frames a second; the last one's number in the time of the door
        self.drive, self.shown = -1, 0  # the drive that it knows; rows of it that it had
        self._coming = bytearray()  # the begin of a line
        self._backlog = 0  # bytes of the lines that wait, without the mission
        self._mission = False  # one that is longer than LONG waits: the beats behind it are not to be dropped
        self._going: deque[bytes] = deque()
        self._sent_bytes, self._waiting = 0, 0  # bytes of the first message that has gone; bytes of all
        self._lock = threading.Lock()

    @property
    def coming(self) -> int:
        """Return the number of bytes of the line whose end has not arrived."""
        return len(self._coming)

    @property
    def overloaded(self) -> bool:
        """Return True if too many bytes wait for the guest.  (2)"""
        return self._waiting > PENDING

    @property
    def waiting(self) -> int:
        """Return the number of bytes that wait for the guest."""
        return self._waiting

    @property
    def has_output(self) -> bool:
        """Return True if a message waits for the guest.  (3)"""
        return bool(self._going)

    def say(self, message: "JsonObject") -> None:
        """Put a message at the end of the queue."""
        self.send_line(encoded(message))

    def send_line(self, line: bytes) -> None:
        """Put an encoded message at the end of the queue."""
        with self._lock:
            self._going.append(line)
            self._waiting += len(line)

    def receive(self) -> Iterator[bytes]:
        """Yield the stops among the received lines; the others wait in `lines`.  (1)

        Raise OSError if the connection has ended.
        """
        try:
            data = self.line.recv(PIECE)
        except BlockingIOError:
            return
        if not data:
            raise ConnectionResetError
        head, newline, rest = data.partition(b"\n")
        self._coming += head
        if not newline:
            return
        first, (middle, more, tail) = bytes(self._coming), rest.rpartition(b"\n")
        self._coming = bytearray(tail)
        if len(self.lines) >= BACKLOG and not STOP.search(first) and not STOP.search(middle):
            self.dropped += 1 + (middle.count(b"\n") + 1 if more else 0)
            return
        for line in [first, *(middle.split(b"\n") if more else [])]:
            if STOP.search(line):
                yield line
            elif self._has_room(line):
                self.lines.append(line)
                self._count(line, 1)
            else:
                self.dropped += 1

    def next(self) -> bytes:
        """Return the line that has waited longest."""
        line = self.lines.popleft()
        self._count(line, -1)
        return line

    def _has_room(self, line: bytes) -> bool:
        if len(self.lines) >= BACKLOG:
            return False
        return self._backlog < LONG if len(line) <= LONG else not self._mission

    def _count(self, line: bytes, sign: int) -> None:
        if len(line) > LONG:
            self._mission = sign > 0
        else:
            self._backlog += sign * len(line)

    def send(self) -> None:
        """Send as many waiting bytes as the socket accepts. Raise OSError if the connection has ended."""
        with self._lock:
            while self._going:
                first = self._going[0]
                try:
                    self._sent_bytes += self.line.send(memoryview(first)[self._sent_bytes :])
                except BlockingIOError:
                    return
                if self._sent_bytes >= len(first):
                    self._going.popleft()
                    self._waiting, self._sent_bytes = self._waiting - len(first), 0
