"""The door of the service: a socket in the file system, one line of JSON for each word, any number of people.

    to the vehicle     mission {mission, attended, id, door}, hand {u}, beat, mark, end, stop {why}, clear,
                       runs, fetch {run}, ping {token}
    from the vehicle   state {door}, event {said}, done {id, run, why}, runs, file {run, data, left}, no {why, about},
                       pong {token}, heard {do}

`why`, `said` and `about` are diagnostics (wire.py). `door` is the version of the words: a mission of another one is
refused, a stop never is; the `why` of a `no` is a sentence, which each version understands.

Every connection hears of every drive; its owner recognises its `id`, a text of the owner. A new connection is told
the last state at once: while a mission is prepared there is no other. A stop is answered by `heard` when the service
has it. A mission is decoded by the service, when it is driven: what is refused costs the one who drives no tick.

Only the user of the service and its group can open the socket; from elsewhere one comes by ssh (remote.py). A line
that is too long, is no JSON or asks for what there is not, is answered by `no` and ends nothing. One who does not read
what is sent to him is let go: he holds up nobody.
"""

import base64
import json
import os
import selectors
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, Severity, StopReason, note, stop
from baqueano.door import VERSION
from baqueano.door.wire import encoded
from baqueano.errors import BaqueanoError, RobotUnreachable, UsageError, named
from baqueano.messages import text
from baqueano.runs.folder import is_name

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject
    from baqueano.door.operator import Operator

LONGEST = 64 << 20  # bytes of a line: an hour of commands
PENDING = 8 << 20  # bytes that wait for one who does not read
CHUNK = 48 << 10  # bytes of a file in a line
LONGEST_ID = 64  # letters
LONG = 64 << 10  # bytes of a line that can only be a mission
LOOK_S = 0.05


class Guest:
    """A connection."""

    def __init__(self, line: socket.socket) -> None:
        self.line = line
        self.coming, self.going = bytearray(), bytearray()
        self.lock = threading.Lock()

    def say(self, message: "JsonObject") -> None:
        """Puts a message into what waits for it."""
        with self.lock:
            self.going += encoded(message)

    @property
    def asleep(self) -> bool:
        """Return True if too much waits for it."""
        return len(self.going) > PENDING


class Door:
    """Listen at `path` in a thread of its own, and hand the messages to `operator`."""

    def __init__(self, path: Path, operator: "Operator", folder: Path) -> None:
        self.path, self.operator, self.folder = path, operator, folder
        self._guests: set[Guest] = set()
        self._state: JsonObject = {}  # the last one sent
        self._telling = threading.Lock()  # so that a new connection misses none
        self._done = threading.Event()
        self._selector = selectors.DefaultSelector()
        self._listener = _listening(path)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._work, name="door", daemon=True)
        self._thread.start()

    def tell(self, message: "JsonObject") -> None:
        """Sends a message to everybody; never waits."""
        with self._telling:
            if message["is"] == "state":
                self._state = message = message | {"door": VERSION}
            for guest in self._guests:
                guest.say(message)

    def close(self) -> None:
        """Lets everybody go."""
        self._done.set()
        self._thread.join()
        for guest in list(self._guests):
            self._leave(guest)
        self._listener.close()
        self.path.unlink(missing_ok=True)

    def _work(self) -> None:
        while not self._done.is_set():
            for key, _ in self._selector.select(LOOK_S):
                if key.fileobj is self._listener:
                    self._welcome()
                else:
                    self._hear(key.data)
            for guest in list(self._guests):
                self._send(guest)

    def _welcome(self) -> None:
        try:
            line, _ = self._listener.accept()
        except OSError:
            return
        line.setblocking(False)
        guest = Guest(line)
        with self._telling:
            self._guests.add(guest)
            if self._state:
                guest.say(self._state)
        self._selector.register(line, selectors.EVENT_READ, guest)

    def _hear(self, guest: Guest) -> None:
        try:
            data = guest.line.recv(1 << 20)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data or len(guest.coming) + len(data) > LONGEST:
            self._leave(guest)
            return
        searched = len(guest.coming)
        guest.coming += data
        while (end := guest.coming.find(b"\n", searched)) >= 0:
            rest = guest.coming[end + 1 :]
            line, guest.coming, searched = guest.coming, rest, 0
            del line[end:]
            self._answer(guest, line)

    def _answer(self, guest: Guest, line: bytearray) -> None:
        try:
            if len(line) > LONG:  # to decode it holds up every thread: not where it would be refused
                self.operator.may_ask(guest)
            said = json.loads(line)
            self._do(guest, said, said["do"])
        except BaqueanoError as error:
            self._refuse(guest, error.diagnostic, error.exit_code)
        except Exception as error:  # any line may come, and this thread is the only reader of the service
            self._refuse(guest, note("door.not-understood", Severity.ERROR, error=named(error)), 2)

    def _refuse(self, guest: Guest, about: Diagnostic, code: int) -> None:
        """`why` is for ends of another version, which know no codes."""
        guest.say({"is": "no", "why": text(about), "about": about, "code": code})

    def _do(self, guest: Guest, said: "JsonObject", what: str) -> None:
        words: dict[str, Callable[[], object]] = {
            "mission": lambda: self._ask(guest, said),
            "hand": lambda: self.operator.want(guest, said["u"]),
            "beat": lambda: self.operator.sign_of_life(guest),
            "mark": lambda: self.operator.mark(guest),
            "ping": lambda: guest.say({"is": "pong", "token": said.get("token")}),
            "end": lambda: self.operator.end(guest),
            "stop": lambda: self._stop(guest, _reason(said.get("why"))),
            "clear": lambda: setattr(self.operator, "clear_asked", True),
            "runs": lambda: guest.say({"is": "runs", "runs": self._runs()}),
            "fetch": lambda: self._fetch(guest, str(said["run"])),
        }
        if what not in words:
            raise ValueError(f"{what!r} is none of {', '.join(words)}")
        words[what]()

    def _ask(self, guest: Guest, said: "JsonObject") -> None:
        """A mission of another version would end with words that nobody there understands."""
        if (theirs := said.get("door", 1)) != VERSION:
            fix = "baqueano robot setup HOST"
            raise UsageError(note("door.version", Severity.ERROR, fix, theirs=str(theirs), ours=VERSION))
        name = str(said.get("id", ""))[:LONGEST_ID]
        self.operator.ask(guest, str(said["mission"]), bool(said.get("attended", True)), name)

    def _stop(self, guest: Guest, why: Diagnostic) -> None:
        self.operator.stop(why)
        guest.say({"is": "heard", "do": "stop"})

    def _runs(self) -> list[str]:
        """The runs that are whole, or will never be: not the one that is written just now."""
        names = (p.name for p in self.folder.glob("*.mcap") if not p.is_symlink())
        return sorted(name for name in names if is_name(name) and name != self._state.get("run"))

    def _fetch(self, guest: Guest, name: str) -> None:
        """A run in pieces, the next when the one before has gone; the last has `left` 0, of an empty run too."""
        path = self.folder / name
        if not is_name(name) or path.is_symlink() or not path.is_file():
            raise ValueError(f"run {name!r} does not exist")
        file = path.open("rb")

        def pieces() -> None:
            with file:
                left, last = path.stat().st_size, False
                while not last and guest in self._guests and not self._done.is_set():
                    if len(guest.going) > 4 * CHUNK:
                        self._done.wait(0.01)
                        continue
                    data = file.read(min(CHUNK, left))
                    left = left - len(data) if data else 0
                    last = left == 0
                    guest.say(
                        {"is": "file", "run": name, "data": base64.b64encode(data).decode(), "left": left}
                    )

        threading.Thread(target=pieces, name="fetch", daemon=True).start()

    def _send(self, guest: Guest) -> None:
        with guest.lock:
            if not guest.going:
                return
            try:
                sent = guest.line.send(guest.going)
                del guest.going[:sent]
            except BlockingIOError:
                pass
            except OSError:
                guest.going.clear()
        if guest.asleep:
            self._leave(guest)

    def _leave(self, guest: Guest) -> None:
        if guest not in self._guests:
            return
        with self._telling:
            self._guests.discard(guest)
        self.operator.release(guest)
        with suppress(KeyError, ValueError):
            self._selector.unregister(guest.line)
        guest.line.close()


def _listening(path: Path) -> socket.socket:
    """RobotUnreachable where another service listens there already."""
    probe = socket.socket(socket.AF_UNIX)
    try:
        probe.connect(str(path))
    except OSError:
        path.unlink(missing_ok=True)  # of a service that was killed
    else:
        raise RobotUnreachable(
            f"{path}: a service runs already on this vehicle. Type: systemctl status baqueano"
        )
    finally:
        probe.close()
    listener = socket.socket(socket.AF_UNIX)
    path.parent.mkdir(parents=True, exist_ok=True)
    before = os.umask(0o117)
    try:
        listener.bind(str(path))
    finally:
        os.umask(before)
    listener.listen(8)
    listener.setblocking(False)
    return listener


def _reason(why: object) -> Diagnostic:
    """Return why somebody stops the vehicle. Whatever it is, it is a stop."""
    try:
        return Diagnostic.of_json(why)
    except (ValueError, RecursionError):
        return stop(StopReason.STOPPED_BY, words=str(why or "stopped from outside")[:200])
