"""Serve up to MAX_GUESTS clients of the service at a socket, with one line of JSON for each message.

  to the vehicle     mission {mission, attended, id, door, by}, hand {u}, beat, mark, end, stop {why}, clear,
                     runs, fetch {run}, ping {token}, watch {hz, fields}, set {path, value}, and the service's own
  from the vehicle   state {door}, event {said}, done {id, run, why}, runs, file {run, data, left}, no {why, about},
                     pong {token}, heard {do}, vehicle, fields, route, frame {t_ns, n, x}

`why`, `said` and `about` are diagnostics (wire.py), except the `why` of a `no`, which is a sentence. `door` is the
version of the protocol: missions of other versions are refused, but stops are always accepted. A new connection
receives the last state at once. All connections receive the events of each drive, which its client recognises by `id`.
Only the user of the service and its group can open the socket; others need ssh (remote.py). In each turn the door reads
all connections, handles the stops, sends the queued messages, and answers the other lines in equal shares. A malformed
line is answered by `no`. A client that does not read is disconnected.
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

from baqueano.diagnostics import Diagnostic, Severity, StopReason, fault, note, stop
from baqueano.door import VERSION
from baqueano.door.files import RunFiles
from baqueano.door.frames.rows import MAX_FRAME_RATE_HZ, RING_TICKS, TICKS_PER_TURN, Frames
from baqueano.door.guests import LONG_BYTES, MAX_BYTES, Guest
from baqueano.door.wire import encode
from baqueano.errors import BaqueanoError, Invalid, RobotUnreachable, UsageError, error_text
from baqueano.messages import text

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.door.operator import Operator

MAX_GUESTS = 32
STOP_CONNECTIONS = 4  # extra connections, for SHORT_S each, for a stop when all places are occupied
SHORT_S, STOPPED_S = 1.0, 15.0  # time of an extra connection before a stop, and after it, to report STOPPED
MAX_LINES = 128  # most lines answered in a turn, of all guests together
MAX_TURN_S = 0.002  # time limit of a turn; then stops and messages of the loop are handled first
LONGEST_ID, LOOK_S = 64, 5.0  # most characters of an id; longest wait, since a message to send wakes the door
SWITCH_INTERVAL_S = 5e-4  # the door and a computing loop wait at most this time for each other, not 5 ms
TURN_PAUSE_S = 0.001  # pause after a turn with many lines, so that the loop's thread runs
SEND_BUFFER_BYTES = 16 << 10  # bytes buffered by the system for a slow reader; more would delay its frames
MAX_HIDDEN_S = 0.3  # silence of a page that drives, which stops the vehicle
Handler = Callable[[object, "JsonObject"], "JsonObject | None"]  # client and request → answer


class Door:
    """A thread that serves clients at the socket `path`, if any. `handlers` contains those of further messages."""

    def __init__(
        self, path: Path | None, operator: "Operator", folder: Path, handlers: Mapping[str, Handler] | None = None,
    ) -> None:  # fmt: skip
        self.path, self.operator, self.frames = path, operator, Frames()
        self._handlers, self._files = dict(handlers or {}), RunFiles(folder, self._ring)
        self._guests: set[Guest] = set()
        self._until: dict[Guest, float] = {}  # end of the connection of guests in extra places
        self._state: JsonObject = {}  # the last state sent
        self._outbox: deque[JsonObject] = deque()
        self._coming: deque[socket.socket] = deque()
        self._behind = False  # some ticks are not yet converted to rows
        self._busy, self._number = 0, 0  # lines answered in the last turn, and in total
        self._end_event = threading.Event()
        self._listener = None if path is None else _listening(path)
        self._bell, self._ear = socket.socketpair()
        self._selector = selectors.DefaultSelector()
        for socket_end in (self._bell, self._ear):
            socket_end.setblocking(False)
        for socket_end in (self._ear, *([] if self._listener is None else [self._listener])):
            self._selector.register(socket_end, selectors.EVENT_READ)
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._thread = threading.Thread(target=self._work, name="door", daemon=True)
        self._thread.start()

    def broadcast(self, message: "JsonObject") -> None:
        """Send a message to all clients without waiting; the door's thread encodes it."""
        self._outbox.append(message)
        self._ring()

    def welcome(self, connection: socket.socket) -> None:
        """Add a connected socket as a client."""
        self._coming.append(connection)
        self._ring()

    def close(self) -> None:
        """Disconnect all clients and end the thread."""
        self._end_event.set()
        self._ring()
        self._thread.join()
        for guest in list(self._guests):
            self._leave(guest)
        for socket_end in (self._bell, self._ear):
            socket_end.close()
        if self._listener is not None and self.path is not None:
            self._listener.close()
            self.path.unlink(missing_ok=True)
        self._selector.close()

    def _ring(self) -> None:
        with suppress(OSError):  # the buffer is full: the door wakes in any case
            self._bell.send(b".")

    def _work(self) -> None:
        while not self._end_event.is_set():
            ready = self._selector.select(self._patience())
            if self._tell_all():
                self._send_all()
            for key, _ in ready:
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj is self._ear:
                    with suppress(OSError):
                        self._ear.recv(4096)
                else:
                    self._receive_from(key.data)
            while self._coming:
                self._seat(self._coming.popleft())
            self._answer_all()
            self._show_all()
            self._send_all()
            for guest in [guest for guest, until in self._until.items() if time.monotonic() > until]:
                self._turn_away(guest)
        self._tell_all()
        self._send_all()

    def _patience(self) -> float:
        """Return the longest time [s] for which the door waits for an event."""
        if self._busy >= MAX_LINES // 2:
            time.sleep(TURN_PAUSE_S)
        if self._behind or self._coming or self._outbox or any(guest.lines for guest in self._guests):
            return 0.0
        fastest = max((guest.hz for guest in self._guests), default=0.0)
        if fastest <= 0.0:
            return SHORT_S if self._until else LOOK_S
        now_s = time.monotonic()
        return max(0.0, (int(now_s * fastest) + 1) / fastest - now_s)

    def _tell_all(self) -> bool:
        """Queue the outgoing messages for all clients; return True if there were any."""
        outbox_size = len(self._outbox)
        while self._outbox:
            message = self._outbox.popleft()
            if message["is"] in ("state", "done"):
                self._files.invalidate(message.get("run") if message["is"] == "state" else None)
            if message["is"] == "done":
                self._show_all(at_once=True)  # the last ticks are sent before the end
            if message["is"] == "state":
                self._state = message = message | {"door": VERSION}
            line = encode(message)
            for guest in self._guests:
                guest.send_line(line)
        return outbox_size > 0

    def _accept(self) -> None:
        assert self._listener is not None
        with suppress(OSError):
            self._seat(self._listener.accept()[0])

    def _seat(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        with suppress(OSError):
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        guest = Guest(connection)
        if len(self._guests) - len(self._until) >= MAX_GUESTS:
            if len(self._until) >= STOP_CONNECTIONS:
                self._leave(min(self._until, key=self._until.__getitem__))
            self._until[guest] = time.monotonic() + SHORT_S
        elif self._state:
            guest.enqueue(self._state)
        self._guests.add(guest)
        self._selector.register(connection, selectors.EVENT_READ, guest)

    def _turn_away(self, guest: Guest) -> None:
        """Refuse and disconnect a client that connected when all places were occupied; only its stops are accepted."""
        self._refuse(guest, note("door.full", Severity.ERROR, most=MAX_GUESTS), 1)
        self._last_words(guest)

    def _last_words(self, guest: Guest) -> None:
        with suppress(OSError):
            guest.send()
        self._leave(guest)

    def _receive_from(self, guest: Guest) -> None:
        """Read the received bytes, and handle the stops in them."""
        if guest not in self._guests:
            return
        try:
            for line in guest.receive():
                self._answer(guest, line)
            if guest.coming > LONG_BYTES:
                self._may_be_long(guest)
        except OSError:
            self._leave(guest)

    def _may_be_long(self, guest: Guest) -> None:
        """Refuse a line longer than LONG_BYTES, except one mission at a time, up to MAX_BYTES, if it is accepted."""
        try:
            self.operator.check_admission(guest)
            is_busy = any(peer.coming > LONG_BYTES for peer in self._guests if peer is not guest)
            if is_busy or guest.coming > MAX_BYTES or not guest.may_be_a_mission:
                raise Invalid(fault("door.too-long", most_kb=LONG_BYTES >> 10))
        except (BaqueanoError, Invalid) as error:
            self._refuse(guest, error.diagnostic, getattr(error, "exit_code", 2))
            self._last_words(guest)

    def _answer_all(self) -> None:
        """Answer the waiting lines of all clients in turn, at most MAX_LINES lines or MAX_TURN_S."""
        for guest in [peer for peer in self._until if peer.lines]:
            self._turn_away(guest)
        self._busy, end_s = 0, time.monotonic() + MAX_TURN_S
        queue = deque(sorted((peer for peer in self._guests if peer.lines), key=lambda peer: peer.answered))
        while queue and self._busy < MAX_LINES and (time.monotonic() < end_s or not self._busy):
            guest = queue.popleft()
            self._busy, guest.answered = self._busy + 1, self._number
            self._number += 1
            self._answer(guest, guest.next())
            if guest.lines:
                queue.append(guest)
            elif guest.dropped:
                self._refuse(guest, note("door.too-many", Severity.ERROR, dropped=guest.dropped), 1)
                guest.dropped = 0

    def _answer(self, guest: Guest, line: bytes) -> None:
        try:
            if len(line) > LONG_BYTES:  # decoding blocks every thread, so check first if it is allowed
                self.operator.check_admission(guest)
            request = json.loads(line)
            if len(line) > LONG_BYTES and request["do"] not in ("mission", "stop"):
                raise Invalid(fault("door.too-long", most_kb=LONG_BYTES >> 10))
            self._do(guest, request, request["do"])
        except (BaqueanoError, Invalid) as error:
            self._refuse(guest, error.diagnostic, getattr(error, "exit_code", UsageError.exit_code))
        except Exception as error:  # a line can cause any error, and this thread is the only reader
            self._refuse(guest, note("door.not-understood", Severity.ERROR, error=error_text(error)), 2)

    def _refuse(self, guest: Guest, about: Diagnostic, code: int) -> None:
        """Send a refusal. Its sentence `why` is for clients of another version, which cannot read diagnostics."""
        guest.enqueue({"is": "no", "why": text(about), "about": about, "code": code})

    def _do(self, guest: Guest, request: "JsonObject", verb: str) -> None:
        actions: dict[str, Callable[[], object]] = {
            "mission": lambda: self._ask(guest, request),
            "hand": lambda: self.operator.set_command(guest, request["u"]),
            "beat": lambda: self.operator.sign_of_life(guest),
            "mark": lambda: self.operator.mark(guest),
            "ping": lambda: guest.enqueue({"is": "pong", "token": request.get("token")}),
            "end": lambda: self.operator.end(guest),
            "stop": lambda: self._stop(guest, _reason(request.get("why"))),
            "clear": lambda: setattr(self.operator, "clear_requested", True),
            "runs": lambda: guest.send_line(self._files.list()),
            "fetch": lambda: self._files.fetch(guest, str(request["run"]), self._stays),
            "watch": lambda: self._watch(guest, request),
            "set": lambda: self._set(guest, request),
        }
        if verb in self._handlers:
            if (answer := self._handlers[verb](guest, request)) is not None:
                guest.enqueue(answer)
        elif verb in actions:
            actions[verb]()
        else:
            raise Invalid(fault("door.unknown-word", found=repr(verb), known=[*actions, *self._handlers]))

    def _ask(self, guest: Guest, request: "JsonObject") -> None:
        """Queue a mission. Raise UsageError for another version of the protocol, SafetyStop if it is refused."""
        if (version := request.get("door", 1)) != VERSION:
            fix = "baqueano robot setup HOST"
            raise UsageError(note("door.version", Severity.ERROR, fix, theirs=str(version), ours=VERSION))
        name, attended = str(request.get("id", ""))[:LONGEST_ID], bool(request.get("attended", True))
        mission = str(request["mission"]) if "mission" in request else json.dumps(request)
        silence_s = MAX_HIDDEN_S if request.get("by") == "page" else None
        self.operator.queue_mission(guest, mission, attended, name, silence_s)

    def _set(self, guest: Guest, request: "JsonObject") -> None:
        self.operator.change(guest, str(request["path"]), request["value"])
        guest.enqueue({"is": "heard", "do": "set"})

    def _stop(self, guest: Guest, reason: Diagnostic) -> None:
        self.operator.stop(reason)
        guest.enqueue({"is": "heard", "do": "stop"})
        if guest in self._until:
            self._until[guest] = time.monotonic() + STOPPED_S

    def _watch(self, guest: Guest, request: "JsonObject") -> None:
        """Begin to send frames of the next ticks to a client, at `hz`, at most MAX_FRAME_RATE_HZ; 0 ends this."""
        hz, names = float(request["hz"]), request.get("fields")
        guest.hz, guest.drive = (min(hz, MAX_FRAME_RATE_HZ) if hz > 0.0 else 0.0), -1
        guest.names = None if names is None else tuple(map(str, names))
        drive, _ = self.frames.drive()
        if drive is not None and not any(peer.hz > 0.0 for peer in self._guests if peer is not guest):
            drive.skip()
        self._introduce(guest)

    def _introduce(self, guest: Guest) -> None:
        """Send a client the description and the columns of the present drive, once per drive."""
        drive, descriptions = self.frames.drive()
        if drive is None or drive.number == guest.drive or guest.hz <= 0.0:
            return
        guest.shown = drive.tick_count if guest.drive < 0 else 0
        guest.drive = drive.number
        names = [column.name for column in drive.columns]
        guest.columns = (
            None if guest.names is None else tuple(names.index(n) for n in guest.names if n in names)
        )
        for message in descriptions:
            if message["is"] == "fields" and guest.columns is not None:
                for name in ("names", "units", "kinds"):
                    message = message | {name: [message[name][c] for c in guest.columns]}
            guest.enqueue(message)

    def _show_all(self, at_once: bool = False) -> None:
        """Send new rows to the clients for which they are due, or to all if `at_once`; equal rows are encoded once."""
        watching = [guest for guest in self._guests if guest.hz > 0.0]
        (drive, _), frames_by_columns, self._behind = self.frames.drive(), {}, False
        if drive is None or not watching:
            return
        self._behind = drive.make(RING_TICKS if at_once else TICKS_PER_TURN)
        now_s = time.monotonic()
        for guest in watching:
            self._introduce(guest)
            reads = guest.waiting <= SEND_BUFFER_BYTES if at_once else not guest.has_output
            if not reads or (int(now_s * guest.hz) == guest.turn and not at_once):
                continue
            guest.turn = int(now_s * guest.hz)
            key = (guest.shown, guest.columns)
            if key not in frames_by_columns:
                frames_by_columns[key] = drive.frame(guest.shown, guest.columns)
            guest.shown = drive.row_count
            if frames_by_columns[key] is not None:
                guest.send_line(frames_by_columns[key])

    def _stays(self, guest: Guest) -> bool:
        """Return True while the client is connected and the service is open."""
        return guest in self._guests and not self._end_event.is_set()

    def _send_all(self) -> None:
        for guest in list(self._guests):
            self._send(guest)

    def _send(self, guest: Guest) -> None:
        try:
            guest.send()
        except OSError:
            self._leave(guest)
            return
        if guest.is_overloaded:
            self._leave(guest)
            return
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if guest.has_output else 0)
        if self._selector.get_key(guest.line).events != events:
            self._selector.modify(guest.line, events, guest)

    def _leave(self, guest: Guest) -> None:
        if guest not in self._guests:
            return
        self._guests.discard(guest)
        self._until.pop(guest, None)
        self.operator.release(guest)
        with suppress(KeyError, ValueError):
            self._selector.unregister(guest.line)
        guest.line.close()


def _listening(path: Path) -> socket.socket:
    """Return a socket that listens at `path`. Raise RobotUnreachable or FileExistsError if it is not free."""
    probe = socket.socket(socket.AF_UNIX)
    try:
        probe.connect(str(path))
    except OSError:
        if path.exists() and not path.is_socket():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        path.unlink(missing_ok=True)  # left by a service that was killed
    else:
        raise RobotUnreachable(fault("door.runs-already", "systemctl status baqueano", path=path))
    finally:
        probe.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    listener, previous_mask = socket.socket(socket.AF_UNIX), os.umask(0o117)
    try:
        listener.bind(str(path))
    finally:
        os.umask(previous_mask)
    listener.listen(8)
    listener.setblocking(False)
    return listener


def _reason(cause: object) -> Diagnostic:
    """Return the reason in a stop request as a diagnostic, even if the reason is malformed."""
    try:
        return Diagnostic.of_json(cause)
    except (ValueError, RecursionError):
        return stop(StopReason.STOPPED_BY, words=str(cause or "stopped from outside")[:200])
