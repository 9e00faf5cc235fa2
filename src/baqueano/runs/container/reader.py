"""Read a run: verify every checksum, recover the readable part of a cut or damaged file, and report the rest.

`read_run(path)` returns the run. `run.notes` is empty for a complete file, else it contains a sentence per loss. A
foreign file, or a file without readable data, raises a FileError that names the kind of file.
"""

import json
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, fault, note
from baqueano.errors import FileError, Invalid, cause_of
from baqueano.messages.printable import baqueano_command
from baqueano.runs.container import memory_limit, messages
from baqueano.runs.container.records import MAGIC, Contents, McapChannel, McapMessages, TooLarge, scan
from baqueano.runs.container.run_file import METADATA, VEHICLE_FILE, unseal
from baqueano.runs.logs import LEVELS, Channel, EstimateLog, Event, ReferenceLog, TruthLog
from baqueano.runs.run import Run

VIEWERS = frozenset({"geometry_msgs/msg/PoseStamped"})  # for viewers; the run has these poses elsewhere
NOTHING = McapMessages(bytearray(), array("Q"), array("Q"), array("Q"))
TOPICS = 1000  # of a run
EVENT = 256  # bytes of memory of an event, in addition to its text
IMPORT = "baqueano runs import MAP.toml FILE"
FOREIGN = {  # first bytes → what it is
    b"#ROSBAG": "ros-1",
    b"SQLite format 3": "sqlite",
    b"\x89HDF": "hdf5",
    b"MATLAB": "matlab",
    b"PK\x03\x04": "zip",
    b"\x1f\x8b": "gzip",
    b"ULog": "ulog",
}


def read_run(path: Path | str) -> Run:
    """Return the run in a file; its `notes` list the losses of a cut or damaged file.

    Parameters
    ----------
    path : path
        An MCAP file.

    Returns
    -------
    Run
        Equal, bit by bit, to the run that was written.

    Raises
    ------
    FileError
        If the file is not a run, or if it is unreadable. The message names the kind of file.

    Examples
    --------
    >>> from baqueano.runs import write_run
    >>> path = write_run(Run("still", None, np.arange(3), np.zeros((3, 1))), "still.mcap")
    >>> run = read_run(path)
    >>> run.name, run.applied.shape, run.notes
    ('still', (3, 1), ())
    """
    path = Path(path)
    try:
        contents = scan(read_bytes(path), VIEWERS)
    except TooLarge as error:
        raise FileError(
            fault(
                "runs.unpacks-too-much", f"mcap decompress {path.name} -o whole.mcap", path=path, error=error
            )
        ) from None
    foreign = METADATA not in contents.metadata and not contents.problems
    if foreign and contents.complete and not contents.messages:
        raise FileError(fault("runs.no-message", path=path))
    return _RunAssembly(path, contents).run()


def read_bytes(path: Path) -> bytes:
    """Return the bytes of an MCAP file. Raise FileError if it is absent, empty, too large, or not an MCAP file."""
    try:
        if path.is_file() and path.stat().st_size > memory_limit.MOST // 2:
            raise FileError(
                fault(
                    "runs.too-large",
                    f"mcap filter {path.name} -o part.mcap",
                    path=path,
                    size=memory_limit.text_of_size(path.stat().st_size),
                    largest=memory_limit.text_of_size(memory_limit.MOST // 2),
                )
            )
        data = path.read_bytes()
    except IsADirectoryError:
        raise FileError(
            fault("runs.folder", baqueano_command("runs", "ls", "--runs", path), path=path)
        ) from None
    except FileNotFoundError:
        raise FileError(
            fault("runs.absent", baqueano_command("runs", "ls", "--runs", path.parent), missing=path)
        ) from None
    except OSError as error:
        raise FileError(fault("runs.not-read", path=path, error=error.strerror or error)) from error
    if not data:
        raise FileError(fault("runs.empty", path=path))
    if data[: len(MAGIC)] != MAGIC:
        kind = next((name for start, name in FOREIGN.items() if data.startswith(start)), None)
        if kind is None and len(data) < len(MAGIC) and MAGIC.startswith(data):
            raise FileError(fault("runs.cut-at-once", path=path, size=len(data)))
        kind = kind or ("bytes" if b"\0" in data[:1000] else "text")
        fix = "" if kind in ("zip", "bytes") else IMPORT
        begins, expected = repr(data[:8]), repr(MAGIC)
        raise FileError(fault(f"runs.is-{kind}", fix, path=path, found=begins, expected=expected))
    return data


class _RunAssembly:
    """A builder of a run from the messages of a file."""

    def __init__(self, path: Path, contents: Contents) -> None:
        self.path, self.contents = path, contents
        self.notes: list[Diagnostic] = []
        self.taken = 0  # bytes of memory in addition to the messages
        self.topics: dict[str, list[tuple[McapChannel, int]]] = {}  # in the order in which they were named
        for key, channel in sorted(contents.channels.items()):
            self.topics.setdefault(channel.topic, []).append((channel, key))
        if len(contents.channels) > TOPICS:
            raise FileError(
                fault("runs.topics", IMPORT, path=path, count=len(contents.channels), most=TOPICS)
            )

    def run(self) -> Run:
        applied = self.ticks()
        run = Run(
            name=self.path.stem,
            path=self.path,
            t_ns=applied.t_ns,
            applied=applied.z,
            requested=self.on_ticks("/command/requested", applied),
            sensors=self.sensors(),
            estimate=self.estimate(),
            reference=self.reference(),
            truth=self.truth(),
            events=tuple(self.events()),
            vehicle_text=self.vehicle_text(),
            metadata=self.metadata(),
            sent=self.on_ticks("/command/sent", applied),
        )
        object.__setattr__(run, "notes", (*self.losses(run), *self.notes))
        return run

    def ticks(self) -> Channel:
        rows = self.read("/command/applied", "u", self.of_size(messages.command_layout))
        if rows is None:
            topics = ", ".join(sorted(self.topics)[:8])[:400] or "no topics"
            cause = _join_causes(self.contents.problems[:2])
            if self.contents.metadata.get(METADATA) is None and self.topics:
                raise FileError(
                    fault(
                        "runs.not-ours",
                        baqueano_command("runs", "import", "MAP.toml", self.path),
                        path=self.path,
                        held=topics,
                    )
                )
            raise FileError(
                fault(
                    "runs.nothing-saved",
                    path=self.path,
                    size=self.contents.size,
                    error=cause or note("runs.ends-early"),
                )
            )
        newer = np.diff(rows.arrival_ns, prepend=-1) > 0
        if not newer.all():
            self.notes.append(_warning("run.repeated-ticks", count=np.count_nonzero(~newer)))
        return Channel(rows.t_ns[newer], rows.arrival_ns[newer], rows.z[newer])

    def sensors(self) -> dict[str, Channel]:
        def layout(topic: str, schema: str, size: int) -> messages.MessageLayout:
            name = topic.removeprefix("/sensors/")
            imu = schema == "sensor_msgs/msg/Imu"
            return messages.imu_layout(name) if imu else messages.measurement_layout(size, name)

        read = {t: self.read(t, "z", layout) for t in self.topics if t.startswith("/sensors/")}
        return {
            topic.removeprefix("/sensors/"): channel for topic, channel in read.items() if channel is not None
        }

    def on_ticks(self, topic: str, applied: Channel) -> np.ndarray | None:
        commands = self.read(topic, "u", self.of_size(messages.command_layout))
        if commands is None:
            return None
        if commands.z.shape[1] != applied.z.shape[1]:
            sizes = {"found": commands.z.shape[1], "expected": applied.z.shape[1]}
            self.notes.append(_warning("run.other-size", topic=topic, **sizes))
            return None
        self.fill(topic, len(applied.t_ns) - len(commands.t_ns), applied.z.shape[1])
        rows = np.full(applied.z.shape, np.nan)
        at = np.searchsorted(applied.arrival_ns, commands.arrival_ns)
        inside = at < len(rows)
        inside[inside] = applied.arrival_ns[at[inside]] == commands.arrival_ns[inside]
        rows[at[inside]] = commands.z[inside]
        return rows

    def estimate(self) -> EstimateLog | None:
        pieces = []
        for channel, key in self.topics.get("/estimate", []):
            size_text = channel.metadata.get("size", "none")
            size = None if size_text == "none" else self.number("/estimate", size_text.split(" ")[0])
            layout = messages.estimate_layout(size, "without" not in size_text)
            t_ns, _, fields = self.unpack("/estimate", layout, key)
            pieces.append((size, "without" not in size_text, t_ns, fields))
        if not pieces:
            return None
        sizes = [size for size, *_ in pieces if size is not None]
        m, with_cov = (max(sizes) if sizes else None), all(cov for size, cov, *_ in pieces)
        silent = sum(len(t_ns) for size, _, t_ns, _ in pieces if size != m)
        self.fill("/estimate", silent, (m or 0) * (1 + (m or 0) * with_cov))
        return _concatenate([_estimate_piece(m, with_cov, *piece) for piece in pieces], EstimateLog)

    def reference(self) -> ReferenceLog | None:
        rows = self.read_fixed("/reference", messages.reference_layout())
        if rows is None:
            return None
        t_ns, f = rows
        return _concatenate([(t_ns, f["eta"], f["nu"], f["done"][:, 0])], ReferenceLog)

    def truth(self) -> TruthLog | None:
        rows = self.read_fixed("/truth", messages.motion_layout())
        if rows is None:
            return None
        t_ns, f = rows
        return _concatenate([(t_ns, f["eta"], f["nu"], f["nu_dot"])], TruthLog)

    def events(self) -> Iterable[Event]:
        unread, cause = 0, None
        for _, key in self.topics.get("/events", []):
            for t_ns, message in self.contents.messages.pop(key, NOTHING).each():
                self.take("/events", EVENT + 4 * len(message))
                try:
                    level, source, text, data = messages.unpack_log(message)
                except ValueError as error:
                    unread, cause = unread + 1, cause or cause_of(error)
                    continue
                yield Event(t_ns, LEVELS[min(max(level // 10 - 1, 0), 4)], source, text, _diagnostic(data))
        if unread:
            self.notes.append(_warning("run.unread-events", count=unread, cause=cause))

    def vehicle_text(self) -> str:
        text = self.contents.attachments.get(VEHICLE_FILE)
        if text is None:
            self.notes.append(_warning("run.vehicle-file-lost"))
        return "" if text is None else text.decode("utf-8", "replace")

    def metadata(self) -> dict[str, str]:
        metadata = unseal(self.contents.metadata.get(METADATA, {}))
        if metadata is None:
            self.notes.append(_warning("run.metadata-lost"))
        return metadata or {}

    def losses(self, run: Run) -> list[Diagnostic]:
        """Return warnings if the file was not closed or is damaged."""
        of, warnings = {"file": self.path.name, "ticks": len(run.t_ns)}, []
        if not self.contents.complete:
            warnings.append(_warning("run.not-closed", **of, duration_s=run.duration_s))
        if self.contents.problems:
            more = max(self.contents.places - 3, 0)
            problems, code = (
                _join_causes(self.contents.problems[:3]),
                "run.damaged-often" if more else "run.damaged",
            )
            warnings.append(_warning(code, **of, places=problems, more=more))
        return warnings

    def of_size(self, layout: Any) -> Any:
        return lambda topic, schema, size: layout(size)

    def read_fixed(
        self, topic: str, layout: messages.MessageLayout
    ) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
        if topic not in self.topics:
            return None
        t_ns, _, fields = self.unpack(topic, layout, self.topics[topic][0][1])
        return t_ns, fields

    def read(self, topic: str, values: str, layout: Any) -> Channel | None:
        """Return the first channel of a topic, in order of arrival. Return None if the file does not have the topic."""
        if topic not in self.topics:
            return None
        channel, key = self.topics[topic][0]
        message_layout = layout(topic, channel.schema, self.number(topic, channel.metadata.get("size", "")))
        t_ns, arrival_ns, fields = self.unpack(topic, message_layout, key)
        z = messages.imu_z(fields) if channel.schema == "sensor_msgs/msg/Imu" else fields[values]
        order = np.argsort(arrival_ns, kind="stable")
        return Channel(t_ns[order], arrival_ns[order], np.ascontiguousarray(z[order]))

    def unpack(
        self, topic: str, layout: messages.MessageLayout, key: int
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return times and arrival times (N,) [ns] of a channel's messages, and their fields.
        Removes the messages from `contents`.
        """
        messages_of_key = self.contents.messages.pop(key, NOTHING)
        try:
            fields = layout.unpack(messages_of_key.data, messages_of_key.sizes)
            t_ns, arrival_ns = np.array(messages_of_key.t_ns), np.array(messages_of_key.arrival_ns)
            if max(t_ns.max(initial=0), arrival_ns.max(initial=0)) >= 2**63:
                raise Invalid(fault("damage.times"))
        except ValueError as error:
            raise self.strange(topic, cause_of(error)) from None
        return t_ns.astype(np.int64), arrival_ns.astype(np.int64), fields

    def number(self, topic: str, text: str) -> int:
        """Return the count of numbers per message, which a channel declares as `text`.
        Raise FileError if `text` is not a decimal number of at most 4 digits.
        """
        if not text.isascii() or not text.isdecimal() or len(text) > 4:
            raise self.strange(topic, note("damage.channel-size"))
        return int(text)

    def fill(self, topic: str, rows: int, numbers: int) -> None:
        """Count the memory of rows that are not in the file and become NaN."""
        self.take(topic, 8 * max(rows, 0) * numbers)

    def take(self, topic: str, size: int) -> None:
        """Count `size` bytes of additional memory. Raise FileError if the sum exceeds half of the file's limit."""
        self.taken += size
        if self.taken > memory_limit.limit_bytes(self.contents.size) // 2:
            raise self.strange(topic, note("damage.memory", size=memory_limit.text_of_size(self.taken)))

    def strange(self, topic: str, cause: Diagnostic | str) -> FileError:
        return FileError(
            fault(
                "runs.foreign-topic",
                baqueano_command("runs", "import", "MAP.toml", self.path),
                path=self.path,
                topic=topic,
                error=cause,
            )
        )


def _warning(code: str, **figures: Any) -> Diagnostic:
    return note(code, Severity.WARNING, **figures)


def _join_causes(causes: list[Diagnostic | str]) -> Diagnostic | str | None:
    """Return one cause that joins all `causes`; None for an empty list."""
    first = causes[0] if causes else None
    for then in causes[1:]:
        first = note("run.and", first=first, then=then)
    return first


def _estimate_piece(
    m: int | None, with_cov: bool, size: int | None, _: bool, t_ns: np.ndarray, f: dict[str, np.ndarray]
) -> tuple[np.ndarray | None, ...]:
    """Return the columns of an EstimateLog from one channel. Innovations of another size than `m` become NaN."""
    k = len(t_ns)
    innovation = innovation_cov = None
    if m is not None:
        silent = size != m
        innovation = np.full((k, m), np.nan) if silent else f["innovation"]
        if with_cov:
            innovation_cov = np.full((k, m, m), np.nan) if silent else f["innovation_cov"].reshape(k, m, m)
    return t_ns, f["eta"], f["nu"], f["cov"].reshape(k, 6, 6), innovation, innovation_cov


def _concatenate(pieces: list[Any], kind: Any) -> Any:
    """Return the segments of a log joined into one, in order of time."""
    order = np.argsort(np.concatenate([piece[0] for piece in pieces]), kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return kind(*(_in_place(parts, place) for parts in zip(*pieces, strict=True)))


def _in_place(parts: tuple[Any, ...], place: np.ndarray) -> np.ndarray | None:
    """Return the columns `parts` joined into one, with row k moved to position place[k]. The data are copied only once,
    because they may be large.
    """
    if parts[0] is None:
        return None
    column, at = np.empty((len(place), *parts[0].shape[1:]), dtype=parts[0].dtype), 0
    for part in parts:
        column[place[at : at + len(part)]] = part
        at += len(part)
    return column


def _diagnostic(data: str) -> Diagnostic | None:
    """Return the diagnostic of an event; None if the event has only text, or data of another version."""
    try:
        return Diagnostic.of_json(json.loads(data)) if data else None
    except (ValueError, RecursionError):
        return None
