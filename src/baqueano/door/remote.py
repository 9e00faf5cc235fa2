"""Drive the vehicle from the laptop: send a mission by ssh, then heartbeats, and receive its run.

  ssh HOST baqueano robot attach       joins the two ends; only ssh listens on the network
  a heartbeat every HEARTBEAT_PERIOD_S      the vehicle stops SILENCE_S after the last one (operator.py)

HOST is an address for ssh, such as user@name:port; "here" is this computer, and a path is the socket of a service.
"""

import base64
import queue
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO
from uuid import uuid4

from baqueano.atomic_file import write_then_appear
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Severity, StopReason, fault, note, stop as because
from baqueano.door import SOCKET, VERSION
from baqueano.door.ssh import host_args, ssh_line
from baqueano.door.states import DoorState
from baqueano.door.wire import decode, encode
from baqueano.errors import AnswerNo, FileError, RobotUnreachable, SafetyStop, UsageError, exit_code_error
from baqueano.messages import text
from baqueano.messages.printable import baqueano_command, printable
from baqueano.runs import Run, read_run
from baqueano.runs.folder import is_run_name

if TYPE_CHECKING:
    from baqueano.drive.mission import Mission

# TCP resends a lost heartbeat when the next ones are acknowledged, so they are frequent
HEARTBEAT_PERIOD_S = 0.05
SET_POINT_PERIOD_S = 0.02  # between commands of a person who drives
PING_PERIOD_S = 0.5
GREETING_TIMEOUT_S = 15.0  # ssh exchanges keys, and a Pi starts Python
# from an acknowledged stop to STOPPED; the motors are off earlier, and the run is closed first
STOP_TIMEOUT_S = 10.0
MAX_LINE_BYTES = 1 << 20  # bytes of a message; a piece of a run has 64 kB
MAX_RUN_BYTES = 4 << 30  # bytes: two days of driving
MAX_WAITING = 256  # messages that wait for the reader; further states are dropped, others wait outside
LATE_CHANGE = "door.not-holder"  # a pause that arrives after the drive, whose end is reported by "done"
ATTACH_COMMAND = "exec baqueano robot attach"
STOP_REQUEST = {"type": "stop", "do": "stop"}  # `do` is for a vehicle with version 3 of the protocol


class Remote:
    """A connection to a vehicle."""

    def __init__(self, sink: BinaryIO, source: BinaryIO, name: str) -> None:
        self.name, self.inbox = name, queue.SimpleQueue()
        self.state: JsonObject = {}
        self.acknowledged = ""  # the last acknowledged message
        self.on_message: Callable[[JsonObject], object] = lambda message: None  # receives each message
        self.link_ms, self._pinged_s = float("nan"), float("-inf")
        self._sink, self._source, self._lock = sink, source, threading.Lock()
        self._reader_thread = threading.Thread(target=self._read_messages, name="vehicle", daemon=True)
        self._reader_thread.start()

    def send(self, **words: Any) -> None:
        """Send a message to the vehicle. Raise RobotUnreachable if the connection does not accept it."""
        with self._lock:
            try:
                self._sink.write(encode(words))
                self._sink.flush()
            except (OSError, ValueError) as error:
                raise RobotUnreachable.of("remote.connection-lost", host=self.name, error=error) from error

    def receive(self, kinds: tuple[str, ...], within_s: float) -> JsonObject:
        """Return the next message of these kinds; store each "state", and raise the error that a "refused" reports.

        Raise RobotUnreachable if no such message arrives within `within_s`, or if the connection ends.
        """
        end_s = time.monotonic() + within_s
        while True:
            try:
                message = self.inbox.get(timeout=max(0.0, end_s - time.monotonic()))
            except queue.Empty:
                raise RobotUnreachable.of("remote.silent", host=self.name, limit_s=within_s) from None
            if message is None:
                self.inbox.put(None)  # for the next reader
                raise RobotUnreachable.of(
                    "remote.closed", baqueano_command("robot", "status", self.name), host=self.name
                )
            self.on_message(message)
            match message["type"]:
                case "state":
                    self.state = message
                case "received":
                    self.acknowledged = message["request"]
            if message["type"] in kinds:
                return message
            if message["type"] == "refused" and getattr(message.get("diagnostic"), "code", "") != LATE_CHANGE:
                raise exit_code_error(
                    int(message.get("code", 1)), message.get("diagnostic") or message["reason"]
                )

    def wait(self, condition: Callable[[], bool], within_s: float) -> bool:
        """Receive states and acknowledgements until `condition` returns True; return False after `within_s`."""
        end_s = time.monotonic() + within_s
        while not condition():
            try:
                self.receive(("state", "received"), end_s - time.monotonic())
            except RobotUnreachable:
                if not self._reader_thread.is_alive():
                    raise
                return False
        return True

    def perform(
        self,
        mission: "Mission",
        path: Path,
        *,
        hand: Callable[[], Any] | None = None,
        progress: Callable[[float], None] = lambda seconds: None,
        on_event: Callable[[str], object] = lambda text: None,
        words: Callable[[], list[TableRow]] = list,
        on_state: Callable[[JsonObject], Any] = lambda state: None,
    ) -> Run:
        """Execute a mission on the vehicle, store its run at `path`, and return the run.

        `hand` returns the present command, and ends the drive by KeyboardInterrupt, as Ctrl-C does. `words` returns
        further messages to send. `on_state` receives the vehicle's state with "link_ms", the round-trip time [ms].
        Raise SafetyStop if the vehicle was stopped before it drove. If the mission ended with an error, raise that
        error; a run that exists is stored even then. Raise UsageError for another version of the protocol.
        """
        self._drop_old_messages()
        name = uuid4().hex
        self._check_version()
        self.send(type="mission", id=name, mission=mission.to_json(), attended=True, door=VERSION)
        outcome = self._await_end(name, hand, progress, on_event, words, on_state)
        if outcome["run"] is not None:
            self.fetch(outcome["run"], path)
        reason, code = outcome["reason"], int(outcome.get("code", 0))
        if outcome["run"] is None or code:
            raise exit_code_error(code or SafetyStop.exit_code, reason or "")
        return read_run(path)

    def _await_end(
        self,
        name: str,
        hand: Callable[[], Any] | None,
        progress: Callable[[float], None],
        on_event: Callable[[str], object],
        words: Callable[[], list[TableRow]],
        on_state: Callable[[JsonObject], Any],
    ) -> JsonObject:
        """Send commands or heartbeats until the drive with the id `name` ends, and return its message "done".

        The first Ctrl-C requests the end of the drive, a second Ctrl-C stops the vehicle.
        """
        start_s, is_ending = time.monotonic(), False
        while True:
            try:
                if hand is not None and not is_ending:
                    self.send(type="hand", u=[float(x) for x in hand()])
                else:
                    self.send(type="beat")
                for request in words():
                    self.send(**request)
                self._ping()
                message = self._next_message(
                    HEARTBEAT_PERIOD_S if hand is None or is_ending else SET_POINT_PERIOD_S
                )
                on_state(self.state | {"link_ms": self.link_ms})
                if message is None:
                    progress(time.monotonic() - start_s)
                elif message["type"] == "event":
                    on_event(text(message["message"]))
                elif message["type"] == "done" and message.get("id") == name:
                    return message
            except KeyboardInterrupt:
                if is_ending:
                    self.send(**STOP_REQUEST, reason=because(StopReason.STOPPED_FROM_LAPTOP))
                is_ending = True
                self.send(type="end")

    def _check_version(self) -> None:
        """Raise UsageError if the vehicle uses another version of the protocol, which this program cannot read."""
        if (robot_version := self.state.get("door", 1)) != VERSION:
            values = {"host": self.name, "robot_protocol": str(robot_version), "laptop_protocol": VERSION}
            fix = baqueano_command("robot", "setup", self.name)
            raise UsageError(note("door.version-of-robot", Severity.ERROR, fix, **values))

    def _drop_old_messages(self) -> None:
        """Drop the received messages, which belong to other drives, and store the newest state."""
        while not self.inbox.empty():
            message = self.inbox.get()
            if message is None:  # the connection is closed; keep this for the next reader
                self.inbox.put(None)
                return
            if message["type"] == "state":
                self.state = message

    def _ping(self) -> None:
        """Send a ping if one is due."""
        if time.monotonic() - self._pinged_s >= PING_PERIOD_S:
            self._pinged_s = time.monotonic()
            self.send(type="ping", token=self._pinged_s)

    def _next_message(self, within_s: float) -> JsonObject | None:
        try:
            message = self.receive(("event", "done", "pong"), within_s)
            if message["type"] != "pong":
                return message
            if message["token"] == self._pinged_s:
                self.link_ms = 1e3 * (time.monotonic() - self._pinged_s)
            return None
        except RobotUnreachable:
            if not self._reader_thread.is_alive():
                raise
            return None

    def fetch(self, run: str, path: Path) -> Path:
        """Store the run with the name `run` as the new file `path`, which appears only once it is complete.

        Return `path`. Raise FileError for an invalid run name, for an existing file, or for a run that is too large for
        this disk.
        """
        if not is_run_name(run):
            raise FileError.of("remote.run-name", host=self.name, run=run)
        path.parent.mkdir(parents=True, exist_ok=True)
        with write_then_appear(path) as run_file:
            self.send(type="fetch", run=run)
            for piece in self._run_chunks(run, shutil.disk_usage(path.parent).free):
                run_file.write(piece)
        return path

    def _run_chunks(self, run: str, max_bytes: int) -> Iterator[bytes]:
        """Yield a run in chunks.

        Raise FileError if it has more than `max_bytes` bytes, and RobotUnreachable if its chunks are not consistent.
        """
        size, received_bytes = None, 0
        while size is None or received_bytes < size:
            message = self.receive(("file",), 10.0)
            try:
                piece = base64.b64decode(message["data"], validate=True)
            except ValueError:
                piece, message["left"] = b"", -1
            received_bytes += len(piece)
            size = received_bytes + message["left"] if size is None else size
            if size > min(max_bytes, MAX_RUN_BYTES):
                raise FileError.of(
                    "remote.run-too-long",
                    run=run,
                    host=self.name,
                    size_mb=size / 1000000.0,
                    free_mb=max_bytes / 1000000.0,
                    longest_gb=MAX_RUN_BYTES >> 30,
                )
            if received_bytes + message["left"] != size or size < 0 or (received_bytes < size and not piece):
                raise RobotUnreachable.of("remote.run-otherwise", host=self.name, run=run)
            yield piece

    def run_names(self) -> list[str]:
        """Return the names of the runs on the vehicle."""
        self.send(type="runs")
        return self.receive(("runs",), 10.0)["runs"]

    def _read_messages(self) -> None:
        address = "" if self.name == str(SOCKET) else self.name  # the default of the commands
        with suppress(OSError, ValueError):
            while (line := self._source.readline(MAX_LINE_BYTES)).endswith(b"\n"):
                if (message := decode(line, address)) is None:
                    continue
                while message["type"] != "state" and self.inbox.qsize() >= MAX_WAITING:  # the reader is busy
                    time.sleep(SET_POINT_PERIOD_S)
                if self.inbox.qsize() < MAX_WAITING:
                    self.inbox.put(message)
        self.inbox.put(None)


@contextmanager
def connect(host: str, **first: Any) -> Iterator[Remote]:
    """Connect to the vehicle at HOST: an address for ssh, "here", or the path of its service's socket.

    The message `first`, if given, is sent before any message is received. Raise RobotUnreachable, with the message of
    ssh, if the vehicle does not answer within GREETING_TIMEOUT_S.

    >>> with connect("here") as robot:
    ...     print(robot.state["state"], robot.run_names())
    READY ['0001-experiment.mcap']
    """
    if host == "here" or ("/" in host and not host.startswith("-")):
        with _local_remote(SOCKET if host == "here" else Path(host), first) as remote:
            yield remote
        return
    command = _attach_command(host)
    if shutil.which("ssh") is None:
        raise RobotUnreachable.of("remote.no-ssh", host=host)
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as ssh:
        assert ssh.stdin is not None
        assert ssh.stdout is not None
        remote = Remote(ssh.stdin, ssh.stdout, host)  # pyright: ignore[reportArgumentType]
        try:
            _greet_ssh(remote, ssh, first)
            yield remote
        finally:
            with suppress(OSError):
                ssh.stdin.close()
            try:
                ssh.wait(2.0)
            except subprocess.TimeoutExpired:
                ssh.kill()


@contextmanager
def _local_remote(path: Path, first: JsonObject) -> Iterator[Remote]:
    if not hasattr(socket, "AF_UNIX"):
        raise UsageError.of("remote.no-sockets", path=path)
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(str(path))
    except OSError as error:
        connection.close()
        raise RobotUnreachable(unreachable_service(path, error)) from error
    with connection, connection.makefile("wb") as sink, connection.makefile("rb") as source:
        remote = Remote(sink, source, str(path))  # pyright: ignore[reportArgumentType]
        try:
            _greet(remote, first)
            yield remote
        finally:  # otherwise its thread would wait for a message without end
            with suppress(OSError):
                sink.close()  # a message that is no longer accepted is dropped
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)


def stop(host: str, reason: Diagnostic) -> JsonObject:
    """Stop the vehicle at HOST, and return its state once it is STOPPED.

    Raise AnswerNo if the vehicle acknowledged the stop but was not STOPPED within STOP_TIMEOUT_S. That can happen while
    a drive is being prepared: the drive then ends later, before the vehicle moves. Raise RobotUnreachable if the
    vehicle did not acknowledge the stop.
    """
    with connect(host, **STOP_REQUEST, reason=reason) as remote:
        if not remote.wait(lambda: remote.acknowledged == "stop" or _is_stopped(remote), GREETING_TIMEOUT_S):
            raise RobotUnreachable.of("remote.stop-unconfirmed", host=host)
        if not remote.wait(lambda: _is_stopped(remote), STOP_TIMEOUT_S):
            raise AnswerNo.of(
                "remote.stop-not-reached",
                host=host,
                limit_s=STOP_TIMEOUT_S,
                state=remote.state.get("state", "none"),
            )
        return remote.state


def unreachable_service(path: Path, error: OSError) -> Diagnostic:
    """Return the diagnostic for a socket at which no service listens."""
    return fault("door.no-answer", "systemctl status baqueano", path=path, error=error.strerror)


def _is_stopped(remote: Remote) -> bool:
    return remote.state.get("state") == DoorState.STOPPED


def _greet(remote: Remote, first: JsonObject) -> None:
    if first:
        remote.send(**first)
    remote.receive(("state", "received"), GREETING_TIMEOUT_S)


def _greet_ssh(remote: Remote, ssh: Any, first: JsonObject) -> None:
    try:
        _greet(remote, first)
    except RobotUnreachable as error:
        ssh.kill()
        output = printable(ssh.stderr.read(MAX_LINE_BYTES).decode(errors="replace").strip())
        raise RobotUnreachable.of(
            "remote.unreachable",
            host=remote.name,
            cause=(output.splitlines()[-1] if output else str(error)).rstrip("."),
            command=ssh_line(remote.name, "baqueano", "robot", "status"),
        ) from error


def _attach_command(host: str) -> list[str]:
    """Return the ssh command to the service at HOST, with options that end it if the network is lost."""
    options = ("BatchMode=yes", "ConnectTimeout=8", "ServerAliveInterval=1", "ServerAliveCountMax=3")
    return ["ssh", "-T", *(x for option in options for x in ("-o", option)), *host_args(host), ATTACH_COMMAND]
