"""Serve up to MAX_CLIENTS clients of the service at a socket, with one line of JSON for each message.

  to the vehicle     mission {mission, attended, id, door}, hand {u}, beat, mark, end, stop {reason}, clear, runs,
                     head {run}, fetch {run}, ping {token}, watch {hz, fields}, set {path, value}, and the service's own
  from the vehicle   state {door}, event {message}, done {id, run, reason}, runs, file {run, data, left}, vehicle,
                     fields, refused {reason, diagnostic}, pong {token}, received {request}, route, frame {t_ns, n, x}

`reason`, `message` and `diagnostic` are diagnostics (wire.py), except the `reason` of `refused`, a sentence. `door` is
the version of the protocol: missions of other versions are refused, but stops are always accepted. A new connection
receives the last state at once. All connections receive the events of each drive, recognised by its `id`.
Only the user of the service and its group can open the socket; others need ssh (remote.py). In each turn the door reads
all connections, handles the stops, sends the queued messages, and answers the other lines in equal shares.
"""

import errno
import json
import os
import selectors
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.door import VERSION
from baqueano.door.clients import MAX_LINE_BYTES, MAX_SHORT_LINE_BYTES, DoorClient
from baqueano.door.files import RunFiles
from baqueano.door.frames.rows import MAX_FRAME_RATE_HZ, MAX_STORED_TICKS, TICKS_PER_TURN, Frames
from baqueano.door.wire import REFUSED, encode
from baqueano.errors import BaqueanoError, Invalid, RobotUnreachable, UsageError, error_text
from baqueano.messages import text

if TYPE_CHECKING:
    from baqueano.door.operator import Operator

MAX_CLIENTS = 32
STOP_CONNECTIONS = 4  # extra connections, for SHORT_S each, for a stop when all places are occupied
SHORT_S, STOPPED_S = 1.0, 15.0  # time of an extra connection before a stop, and after it, to report STOPPED
MAX_LINES = 128  # maximum number of lines answered in a turn, of all clients together
MAX_ROUND_S = 0.002  # time limit of a turn; then stops and messages of the loop are handled first
LONGEST_ID, LOOK_S = 64, 5.0  # characters of an id; seconds of a wait: a message to send ends it
SWITCH_INTERVAL_S = 5e-4  # the door and a computing loop wait at most this time for each other, not 5 ms
ROUND_PAUSE_S = 0.001  # pause after a turn with many lines, so that the loop's thread runs
SEND_BUFFER_BYTES = 16 << 10  # bytes buffered by the system for a slow reader; more would delay its frames
Handler = Callable[[object, JsonObject], JsonObject | None]  # client and request → answer


class Door:
    """A thread that serves clients at the socket `path`, if any, with more `handlers`; a stop calls `halt` at once."""

    def __init__(
        self, path: Path | None, operator: "Operator", folder: Path, handlers: Mapping[str, Handler] | None = None,
        halt: Callable[[], object] = lambda: None,
    ) -> None:  # fmt: skip
        self.path, self.operator, self.frames = path, operator, Frames()
        self._halt, self._handlers, self._files = halt, dict(handlers or {}), RunFiles(folder, self._wake)
        self._clients: set[DoorClient] = set()
        self._ends_s: dict[DoorClient, float] = {}  # end of the connection of clients in extra places
        self._state: JsonObject = {}  # the last state sent
        self._outbox: deque[JsonObject] = deque()
        self._coming: deque[socket.socket] = deque()
        self._is_behind = False  # some ticks are not yet converted to rows
        self._busy, self._number = 0, 0  # lines answered in the last turn, and in total
        self._end_event = threading.Event()
        self._listener = None if path is None else _listening_socket(path)
        self._bell, self._ear = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        for socket_end in (self._bell, self._ear):
            socket_end.setblocking(False)
        for socket_end in (self._ear, *([] if self._listener is None else [self._listener])):
            self._selector.register(socket_end, selectors.EVENT_READ)
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._thread = threading.Thread(target=self._serve, name="door", daemon=True)
        self._thread.start()

    def broadcast(self, message: JsonObject) -> None:
        """Send a message to all clients without waiting; the door's thread encodes it."""
        self._outbox.append(message)
        self._wake()

    def add_client(self, connection: socket.socket) -> None:
        """Add a connected socket as a client."""
        self._coming.append(connection)
        self._wake()

    def close(self) -> None:
        """Disconnect all clients and end the thread."""
        self._end_event.set()
        self._wake()
        self._thread.join()
        for client in list(self._clients):
            self._disconnect(client)
        for socket_end in (self._bell, self._ear):
            socket_end.close()
        if self._listener is not None and self.path is not None:
            self._listener.close()
            self.path.unlink(missing_ok=True)
        self._selector.close()

    def _wake(self) -> None:
        with suppress(OSError):  # the buffer is full: the door wakes in any case
            self._bell.send(b".")

    def _serve(self) -> None:
        while not self._end_event.is_set():
            ready_sockets = self._selector.select(self._max_wait_s())
            if self._queue_broadcasts():
                self._send_all()
            for key, _ in ready_sockets:
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is self._ear:
                    with suppress(OSError):
                        self._ear.recv(4096)
                else:
                    self._receive_from(key.data)
            while self._coming:
                self._admit(self._coming.popleft())
            self._answer_all()
            self._send_new_rows()
            self._send_all()
            for client in [client for client, end_s in self._ends_s.items() if time.monotonic() > end_s]:
                self._refuse_client(client)
        self._queue_broadcasts()
        self._send_all()

    def _max_wait_s(self) -> float:
        """Return the longest time [s] for which the door waits for an event."""
        if self._busy >= MAX_LINES // 2:
            time.sleep(ROUND_PAUSE_S)
        if self._is_behind or self._coming or self._outbox or any(client.lines for client in self._clients):
            return 0.0
        max_hz = max((client.hz for client in self._clients), default=0.0)
        if max_hz <= 0.0:
            return SHORT_S if self._ends_s else LOOK_S
        now_s = time.monotonic()
        return max(0.0, (int(now_s * max_hz) + 1) / max_hz - now_s)

    def _queue_broadcasts(self) -> bool:
        """Queue the outgoing messages for all clients; return True if there were any."""
        outbox_size = len(self._outbox)
        while self._outbox:
            message = self._outbox.popleft()
            if message["type"] == "done":
                self._files.invalidate(None)
                self._send_new_rows(at_once=True)  # the last ticks are sent before the end
            elif message["type"] == "state":
                self._files.invalidate(message.get("run"))
                self._state = message = message | {"door": VERSION}
            line = encode(message)
            for client in self._clients:
                client.send_line(line)
        return outbox_size > 0

    def _accept(self) -> None:
        assert self._listener is not None
        with suppress(OSError):
            self._admit(self._listener.accept()[0])

    def _admit(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        with suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        client = DoorClient(connection)
        if len(self._clients) - len(self._ends_s) >= MAX_CLIENTS:
            if len(self._ends_s) >= STOP_CONNECTIONS:
                self._disconnect(min(self._ends_s, key=self._ends_s.__getitem__))
            self._ends_s[client] = time.monotonic() + SHORT_S
        elif self._state:
            client.enqueue(self._state)
        self._clients.add(client)
        self._selector.register(connection, selectors.EVENT_READ, client)

    def _refuse_client(self, client: DoorClient) -> None:
        """Refuse and disconnect a client that connected when all places were occupied; only its stops are accepted."""
        self._refuse(client, note("door.full", Severity.ERROR, maximum=MAX_CLIENTS), 1)
        self._disconnect_after_sending(client)

    def _disconnect_after_sending(self, client: DoorClient) -> None:
        with suppress(OSError):
            client.send()
        self._disconnect(client)

    def _receive_from(self, client: DoorClient) -> None:
        """Read the received bytes, and handle the stops in them."""
        try:
            for line in client.receive():
                self._answer(client, line)
            if client.partial_line_bytes > MAX_SHORT_LINE_BYTES:
                self._refuse_long_line(client)
        except OSError:
            self._disconnect(client)

    def _refuse_long_line(self, client: DoorClient) -> None:
        """Refuse a line longer than MAX_SHORT_LINE_BYTES; accept one mission at a time, up to MAX_LINE_BYTES."""
        try:
            self.operator.check_admission(client)
            for peer in [peer for peer in self._clients - {client} if peer.has_stalled]:
                self._disconnect(peer)
            is_busy = any(c.partial_line_bytes > MAX_SHORT_LINE_BYTES for c in self._clients - {client})
            if is_busy or client.partial_line_bytes > MAX_LINE_BYTES or not client.can_be_mission:
                raise Invalid.of("door.too-long", max_kb=MAX_SHORT_LINE_BYTES >> 10)
        except (BaqueanoError, Invalid) as error:
            self._refuse(client, error.diagnostic, getattr(error, "exit_code", 2))
            self._disconnect_after_sending(client)

    def _answer_all(self) -> None:
        """Answer one line of each client, and then more, until MAX_LINES, MAX_ROUND_S or a message of the loop."""
        for client in [peer for peer in self._ends_s if peer.lines]:
            self._refuse_client(client)
        self._busy, end_s = 0, time.monotonic() + MAX_ROUND_S
        queue = deque(sorted((peer for peer in self._clients if peer.lines), key=lambda peer: peer.answered))
        while queue and self._busy < MAX_LINES and (time.monotonic() < end_s or not self._busy):
            client = queue.popleft()
            client.answered, self._busy, self._number = self._number, self._busy + 1, self._number + 1
            self._answer(client, client.pop_line())
            if client.lines:
                queue.append(client)
            elif client.dropped:
                self._refuse(client, note("door.too-many", Severity.ERROR, count=client.dropped), 1)
                client.dropped = 0
            if self._outbox:
                return

    def _answer(self, client: DoorClient, line: bytes) -> None:
        try:
            if len(line) > MAX_SHORT_LINE_BYTES:  # decoding blocks all threads, so check admission first
                self.operator.check_admission(client)
            request = json.loads(line)
            request.setdefault("type", request.get("do"))  # do: a stop of an earlier version
            if len(line) > MAX_SHORT_LINE_BYTES and request["type"] not in ("mission", "stop"):
                raise Invalid.of("door.too-long", max_kb=MAX_SHORT_LINE_BYTES >> 10)
            self._execute(client, request)
        except (BaqueanoError, Invalid) as error:
            self._refuse(client, error.diagnostic, getattr(error, "exit_code", UsageError.exit_code))
        except Exception as error:  # a line can cause any error, and only this thread reads
            self._refuse(client, note("door.not-understood", Severity.ERROR, error=error_text(error)), 2)

    def _refuse(self, client: DoorClient, diagnostic: Diagnostic, code: int) -> None:
        """Send a refusal. Its `is` and its sentence `reason` are for clients of another version."""
        client.enqueue(REFUSED | {"reason": text(diagnostic), "diagnostic": diagnostic, "code": code})

    def _execute(self, client: DoorClient, request: JsonObject) -> None:
        actions: dict[str, Callable[[], object]] = {
            "mission": lambda: self._queue_mission(client, request),
            "hand": lambda: self.operator.set_command(client, request["u"]),
            "beat": lambda: self.operator.record_heartbeat(client),
            "mark": lambda: self.operator.record_mark(client),
            "ping": lambda: client.enqueue({"type": "pong", "token": request.get("token")}),
            "end": lambda: self.operator.request_end(client),
            "stop": lambda: self._stop(client, _stop_reason(request.get("reason"))),
            "clear": lambda: setattr(self.operator, "is_clear_requested", True),
            "runs": lambda: client.send_line(self._files.list()),
            "head": lambda: client.enqueue(self._files.head(str(request["run"]))),
            "fetch": lambda: self._files.fetch(client, str(request["run"]), self._is_connected),
            "watch": lambda: self._subscribe(client, request),
            "set": lambda: self._set_gain(client, request),
        }
        if (verb := request["type"]) in self._handlers:
            if (answer := self._handlers[verb](client, request)) is not None:
                client.enqueue(answer)
        elif verb in actions:
            actions[verb]()
        else:
            raise Invalid.of("door.unknown-word", value=repr(verb), valid=[*actions, *self._handlers])

    def _queue_mission(self, client: DoorClient, request: JsonObject) -> None:
        """Queue a mission. Raise UsageError for another version of the protocol, SafetyStop if it is refused."""
        if (version := request.get("door", 1)) != VERSION:
            versions = {"laptop_protocol": str(version), "robot_protocol": VERSION}
            raise UsageError(note("door.version", Severity.ERROR, "baqueano robot setup HOST", **versions))
        name, is_attended = str(request.get("id", ""))[:LONGEST_ID], bool(request.get("attended", True))
        mission = str(request["mission"]) if "mission" in request else json.dumps(request)
        self.operator.queue_mission(client, mission, attended=is_attended, name=name)

    def _set_gain(self, client: DoorClient, request: JsonObject) -> None:
        self.operator.set_gain(client, str(request["path"]), request["value"])
        client.enqueue({"type": "received", "request": "set"})

    def _stop(self, client: DoorClient, reason: Diagnostic) -> None:
        self.operator.stop(reason)
        self._halt()
        client.enqueue({"type": "received", "request": "stop"})
        if client in self._ends_s:
            self._ends_s[client] = time.monotonic() + STOPPED_S

    def _subscribe(self, client: DoorClient, request: JsonObject) -> None:
        """Begin to send frames of the next ticks to a client, at `hz`, at most MAX_FRAME_RATE_HZ; 0 ends this."""
        hz, names = float(request["hz"]), request.get("fields")
        client.hz, client.drive = (min(hz, MAX_FRAME_RATE_HZ) if hz > 0.0 else 0.0), -1
        client.names = None if names is None else tuple(map(str, names))
        drive, _ = self.frames.drive()
        if drive is not None and not any(peer.hz > 0.0 for peer in self._clients if peer is not client):
            drive.drop_ticks()
        self._send_description(client)

    def _send_description(self, client: DoorClient) -> None:
        """Send a client the description and the columns of the present drive, once per drive."""
        drive, descriptions = self.frames.drive()
        if drive is None or drive.number == client.drive or client.hz <= 0.0:
            return
        client.sent_row_count = drive.tick_count if client.drive < 0 else 0
        client.drive = drive.number
        names = [column.name for column in drive.columns]
        client.columns = (
            None if client.names is None else tuple(names.index(n) for n in client.names if n in names)
        )
        for message in descriptions:
            if message["type"] == "fields" and client.columns is not None:
                for name in ("names", "units", "kinds"):
                    message = message | {name: [message[name][c] for c in client.columns]}
            client.enqueue(message)

    def _send_new_rows(self, *, at_once: bool = False) -> None:
        """Send new rows to the clients for which they are due, or to all if `at_once`; equal rows are encoded once."""
        watchers = [client for client in self._clients if client.hz > 0.0]
        (drive, _), frames_by_columns, self._is_behind = self.frames.drive(), {}, False
        if drive is None or not watchers:
            return
        self._is_behind = drive.convert(MAX_STORED_TICKS if at_once else TICKS_PER_TURN)
        now_s = time.monotonic()
        for client in watchers:
            self._send_description(client)
            reads = client.pending_bytes <= SEND_BUFFER_BYTES if at_once else not client.has_output
            if not reads or (int(now_s * client.hz) == client.turn and not at_once):
                continue
            client.turn = int(now_s * client.hz)
            key = (client.sent_row_count, client.columns)
            if key not in frames_by_columns:
                frames_by_columns[key] = drive.frame(client.sent_row_count, client.columns)
            client.sent_row_count = drive.row_count
            if frames_by_columns[key] is not None:
                client.send_line(frames_by_columns[key])

    def _is_connected(self, client: DoorClient) -> bool:
        """Return True while the client is connected and the service is open."""
        return client in self._clients and not self._end_event.is_set()

    def _send_all(self) -> None:
        for client in list(self._clients):
            self._send(client)

    def _send(self, client: DoorClient) -> None:
        try:
            client.send()
        except OSError:
            self._disconnect(client)
            return
        if client.is_overloaded:
            self._disconnect(client)
            return
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.has_output else 0)
        if self._selector.get_key(client.line).events != events:
            self._selector.modify(client.line, events, client)

    def _disconnect(self, client: DoorClient) -> None:
        if client not in self._clients:
            return
        self._clients.discard(client)
        self._ends_s.pop(client, None)
        self.operator.revoke_holder(client)
        with suppress(KeyError, ValueError):
            self._selector.unregister(client.line)
        client.line.close()


def _listening_socket(path: Path) -> socket.socket:
    """Return a socket that listens at `path`. Raise RobotUnreachable or FileExistsError if it is not free."""
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            if path.exists() and not path.is_socket():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
            path.unlink(missing_ok=True)  # left by a service that was killed
        else:
            raise RobotUnreachable.of("door.runs-already", "systemctl status baqueano", path=path)
    path.parent.mkdir(parents=True, exist_ok=True)
    listener, previous_mask = socket.socket(socket.AF_UNIX), os.umask(0o117)
    try:
        listener.bind(str(path))
    finally:
        os.umask(previous_mask)
    listener.listen(8)
    listener.setblocking(False)
    return listener


def _stop_reason(cause: object) -> Diagnostic:
    """Return the reason in a stop request as a diagnostic, even if the reason is malformed."""
    with suppress(ValueError):
        return Diagnostic.from_json(cause)
    words = cause[:200] if cause and isinstance(cause, str) else "stopped from outside"
    return stop(StopReason.STOPPED_BY, words=words)
