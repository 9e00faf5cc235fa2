"""Write a run during a drive, or a complete run at once.

The loop packs its messages and puts them in a queue; a separate thread moves them to the file. Twice per second this
thread closes a chunk and syncs it to the disk (fdatasync, else fsync). If the program is killed, or after a power
cut, at most one second is lost. A slow disk does not delay a live run. If the queue of a live run is full, the writer
drops messages that can be computed again (estimates, references). It counts and reports them.
"""

import heapq
import platform
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.atomic_file import give_new_name, temporary_file
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import FileError, Invalid, UsageError
from baqueano.messages import english_text
from baqueano.messages.printable import baqueano_command
from baqueano.runs.container.messages import MAX_STAMP_NS
from baqueano.runs.container.packing import Packing
from baqueano.runs.container.run_file import RunFile
from baqueano.runs.logs import LEVELS, Event
from baqueano.signals import Motion, measured_ns

if TYPE_CHECKING:
    from baqueano.loop import Record
    from baqueano.runs.run import Run

SYNC_PERIOD_S = 0.5  # time after which a chunk is closed and synced
WRITE_PERIOD_S = 0.05  # time between two moves of the queue to the open chunk
MAX_QUEUED_MESSAGES = 200_000  # messages; minutes of a stalled disk

Message = tuple[int, int, bytes, int]  # topic, arrival [ns], packed message, time [ns]


def versions() -> dict[str, str]:
    """Return the versions and the machine that made a run, for its metadata."""
    return {
        "baqueano": _installed_version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
    }


@cache
def _installed_version() -> str:
    from importlib.metadata import version

    return version("baqueano")


class RunWriter:
    """A writer of a run, tick by tick, for a `with` statement. While the vehicle moves, its methods do not raise:
    `failure` and `dropped` report problems, and `close` raises FileError. `live` is for a real vehicle, which must not
    wait: messages are dropped if the disk stalls for minutes.

    >>> with RunWriter("note.mcap", metadata={"kind": "none"}) as writer:
    ...     writer.event(0, "info", "me", "a line for the reader")
    >>> writer.failure is None, writer.dropped
    (True, 0)
    """

    def __init__(
        self,
        path: Path | str,
        vehicle_text: str = "",
        metadata: Mapping[str, str] | None = None,
        live: bool = False,
    ) -> None:
        self.path = Path(path)
        self.failure: OSError | None = None  # the reason why writing stopped
        self.dropped = 0  # messages dropped because the disk was too slow
        self._is_live = live
        self._file = RunFile(self.path, vehicle_text, versions() | dict(metadata or {}))
        self._packing = Packing(self._file, self._append)
        self._queue: deque[tuple[int, int, bytes, int]] = deque()
        self._closing, self._is_closed = threading.Event(), False
        self._reported_subjects: set[str] = set()
        self._t_ns = 0  # of the newest message
        self._topics: set[str] = set()
        self._thread = threading.Thread(target=self._write_until_closed, name="run writer", daemon=True)
        self._thread.start()

    def record(self, record: "Record") -> None:
        """Write a record of the loop: commands, new measurements, estimate and reference."""
        tick = record.tick
        self._pack_and_append("command applied", self._packing.command, "applied", tick.t_ns, tick.u)
        for name, slot in zip(tick.sensors._fields, tick.sensors, strict=True):
            if slot.is_new > 0.5:
                t_ns = measured_ns(tick.t_ns, slot)
                self._pack_and_append(
                    f"measurement of {name}", self._packing.sensor, name, t_ns, tick.t_ns, slot.z
                )
            elif name not in self._topics:
                self._pack_and_append(f"sensor {name}", self._file.sensor, name, len(slot.z))
            self._topics.add(name)
        for stage, command in (("requested", record.requested_command), ("sent", record.sent_command)):
            if command is not None:
                self._pack_and_append(f"command {stage}", self._packing.command, stage, tick.t_ns, command.u)
        if record.estimate is not None:
            self._pack_and_append("estimate", self._packing.estimate, *record.estimate[:6])
        if record.reference is not None:
            self._pack_and_append("reference", self._packing.reference, *record.reference)

    def truth(self, t_ns: int, motion: Motion) -> None:
        """Write the true pose, velocity and acceleration."""
        self._pack_and_append("truth", self._packing.truth, t_ns, motion.eta, motion.nu, motion.nu_dot)

    def channel(self, name: str, t_ns: int, z: object) -> None:
        """Write a measurement (m,) of a sensor outside the vehicle file: the battery, a temperature."""
        self._pack_and_append(f"channel {name}", self._packing.sensor, name, t_ns, t_ns, z)

    def event(self, t_ns: int, level: str, source: str, message: Diagnostic | str) -> None:
        """Write an event: a message for the user; `level` is one of LEVELS."""
        data = message if isinstance(message, Diagnostic) else None
        level = level if level in LEVELS else "warning"
        self._pack_and_append(
            "event", self._packing.event, Event(t_ns, level, source, english_text(message), data)
        )

    def close(self) -> None:
        """Write the remaining buffer and the index. If the disk refused, raise FileError, which names the
        saved part."""
        if self._is_closed:
            return
        self._is_closed = True
        if self.dropped:
            self.event(self._t_ns, "warning", "run writer", note("run.disk-slow", records=self.dropped))
        self._closing.set()
        self._thread.join()
        try:
            if self.failure is None:
                self._write_queue()
                self._file.finish()
        except OSError as error:
            self.failure = error
        if self.failure is not None:
            self._file.abandon()
            figures = {"path": self.path, "error": self.failure.strerror or self.failure}
            if self.path.stat().st_size == 0:  # it would only be in the way of the newest run
                self.path.unlink()
                raise FileError.of("runs.disk-full-at-start", **figures)
            raise FileError.of("runs.disk-full", baqueano_command("runs", "recover", self.path), **figures)

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if error is not None:
            self.event(self._t_ns, "error", "run writer", f"ended by {type(error).__name__}: {error}")
        try:
            self.close()
        except FileError:
            if error is None:
                raise

    def _pack_and_append(self, subject: str, pack: Callable[..., Any], *args: object) -> None:
        """Pack a message. If the packing fails, report the failure once per subject and run, and continue."""
        try:
            pack(*args)
        except (struct.error, ValueError, TypeError, AttributeError, OverflowError) as error:
            if subject not in self._reported_subjects:
                self._reported_subjects.add(subject)
                self.event(
                    self._t_ns, "error", "run writer", note("run.not-packed", topic=subject, error=str(error))
                )

    def _append(self, topic: int, arrival_ns: int, data: bytes, t_ns: int, is_spare: bool) -> None:
        if self.failure is not None:
            return
        if not (0 <= arrival_ns < MAX_STAMP_NS and 0 <= t_ns < MAX_STAMP_NS):
            time_ns = t_ns if 0 <= arrival_ns < MAX_STAMP_NS else arrival_ns
            raise Invalid.of("run.time-range", time_ns=time_ns)
        if len(self._queue) >= MAX_QUEUED_MESSAGES:
            if self._is_live and is_spare:
                self.dropped += 1
                return
            while not self._is_live and len(self._queue) >= MAX_QUEUED_MESSAGES and self.failure is None:
                time.sleep(WRITE_PERIOD_S)
        self._t_ns = arrival_ns
        self._queue.append((topic, arrival_ns, data, t_ns))

    def _write_until_closed(self) -> None:
        sync_s = time.monotonic()
        try:
            while not self._closing.wait(WRITE_PERIOD_S):
                self._write_queue()
                if time.monotonic() - sync_s >= SYNC_PERIOD_S - WRITE_PERIOD_S:
                    sync_s = time.monotonic()
                    self._file.close_chunk()
        except OSError as error:
            self.failure = error

    def _write_queue(self) -> None:
        """Move all messages from the queue to the open chunk."""
        queue, add = self._queue, self._file.add
        for _ in range(len(queue)):
            add(*queue.popleft())


def write_run(run: "Run", path: Path | str) -> Path:
    """Write the whole run to a new file, which appears complete or not at all.

    Parameters
    ----------
    run : Run
        The run.
    path : path
        The file to write.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileError
        If the file exists, or cannot be written.
    UsageError
        For times that are not between 1970 and 2038.

    Examples
    --------
    >>> from baqueano.runs.run import Run
    >>> write_run(Run("still", None, np.arange(3), np.zeros((3, 1))), "three_ticks.mcap").name
    'three_ticks.mcap'
    """
    path = Path(path)
    if path.exists():
        raise FileError.of("runs.run-there", path=path)
    with temporary_file(path) as temporary_path:
        run_file = RunFile(temporary_path, run.vehicle_text, run.metadata)
        try:
            for message in _messages(run, run_file):
                run_file.add(*message)
            run_file.finish()
            give_new_name(temporary_path, path)
        except BaseException as error:
            run_file.abandon()
            if isinstance(error, OSError):
                raise FileError.of("runs.not-written", path=path, error=error.strerror or error) from error
            raise
    return path


def _messages(run: "Run", run_file: RunFile) -> Iterator[Message]:
    """Return an iterator over all messages of a run by arrival, each packed when it is needed.
    Raise UsageError for times out of range.
    Every topic is declared, even one without messages.
    """
    messages_: list[Message] = []

    def collect(topic: int, arrival_ns: int, data: bytes, t_ns: int, is_spare: bool) -> None:
        if not (0 <= arrival_ns < MAX_STAMP_NS and 0 <= t_ns < MAX_STAMP_NS):
            raise UsageError.of("runs.times", run=run.name, t_ns=min(arrival_ns, t_ns))
        messages_.append((topic, arrival_ns, data, t_ns))

    def row_messages(arrival_ns: np.ndarray, pack: Callable[[int], None]) -> Iterator[Message]:
        for k in np.argsort(arrival_ns, kind="stable"):
            pack(int(k))
            row_message = messages_.copy()
            messages_.clear()  # other signals pack into the same list before this one continues
            yield from row_message

    _name_topics(run, run_file)
    signal_messages = [row_messages(*signal) for signal in _signals(run, Packing(run_file, collect))]
    return heapq.merge(*signal_messages, key=lambda message: message[1])


def _signals(run: "Run", packing: Packing) -> Iterator[tuple[np.ndarray, Callable[[int], None]]]:
    """Yield, for each signal, the arrival times of its rows [ns], and the function that packs a row."""
    for stage, rows in run.commands.items():
        yield run.t_ns, lambda k, w=stage, u=rows: packing.command(w, int(run.t_ns[k]), u[k])
    for name, c in run.sensors.items():
        yield (
            c.arrival_ns,
            lambda k, n=name, c=c: packing.sensor(n, int(c.t_ns[k]), int(c.arrival_ns[k]), c.z[k]),
        )
    logs: list[tuple[Any, Any]] = [
        (run.estimate, packing.estimate),
        (run.reference, packing.reference),
        (run.truth, packing.truth),
    ]
    for log, pack in logs:
        if log is not None:
            yield (
                log.t_ns,
                lambda k, log=log, pack=pack: pack(
                    int(log.t_ns[k]), *(None if column is None else column[k] for column in log[1:])
                ),
            )
    yield np.array([event.t_ns for event in run.events]), lambda k: packing.event(run.events[k])


def _name_topics(run: "Run", run_file: RunFile) -> None:
    for stage, rows in run.commands.items():
        run_file.command(stage, rows.shape[1])
    for name, channel in run.sensors.items():
        run_file.sensor(name, channel.z.shape[1])
    if run.estimate is not None:
        innovation, cov = run.estimate.innovation, run.estimate.innovation_cov
        run_file.estimate(
            None if innovation is None else innovation.shape[1], has_cov=innovation is None or cov is not None
        )
    for name, log in (("/reference", run.reference), ("/truth", run.truth)):
        if log is not None:
            run_file.fixed_topic(name)
