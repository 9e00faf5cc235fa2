"""Read a run: verify every checksum, recover the readable part of a cut or damaged file, and report the rest.

`read_run(path)` returns the run. `run.notes` is empty for a complete file; otherwise it contains a message per loss.
For a file of another format, or without readable data, FileError is raised, which names the kind of file.
"""

import json
from array import array
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import FileError, Invalid, error_cause
from baqueano.messages.printable import baqueano_command
from baqueano.runs.container import memory_limit, messages
from baqueano.runs.container.records import MAGIC, Contents, FileTooLarge, McapChannel, McapMessages, scan
from baqueano.runs.container.run_file import ATTACHMENT_NAME, METADATA_NAME, verified_metadata
from baqueano.runs.folder import find
from baqueano.runs.logs import LEVELS, Channel, EstimateLog, Event, ReferenceLog, TruthLog
from baqueano.runs.run import Run

VIEWER_SCHEMAS = frozenset({"geometry_msgs/msg/PoseStamped"})  # the run has these poses elsewhere
NO_MESSAGES = McapMessages(bytearray(), array("Q"), array("Q"), array("Q"))
MAX_TOPICS = 1000  # maximum number of topics of a run
EVENT_BYTES = 256  # bytes of memory of an event, in addition to its text
FOREIGN_SIGNATURES = {  # first bytes → kind of file
    b"#ROSBAG": "ros-1",
    b"SQLite format 3": "sqlite",
    b"\x89HDF": "hdf5",
    b"MATLAB": "matlab",
    b"PK\x03\x04": "zip",
    b"\x1f\x8b": "gzip",
    b"ULog": "ulog",
}


@checked_call('bq.read_run("runs/0001.mcap")')
def read_run(path: Path | str) -> Run:
    """Return the run in a file; its `notes` list the losses of a cut or damaged file.

    Parameters
    ----------
    path : path
        An MCAP file, or the number or name of a run in the folder `runs`; "last" is the newest run.

    Returns
    -------
    Run
        The run; it is equal, bit for bit, to the run that was written.

    Raises
    ------
    FileError
        If the file is not a run, or is unreadable. The message names the kind of file.

    Examples
    --------
    >>> from baqueano.runs import write_run
    >>> path = write_run(Run("still", None, np.arange(3), np.zeros((3, 1))), "still.mcap")
    >>> run = read_run(path)
    >>> run.name, run.applied_commands.shape, run.notes
    ('still', (3, 1), ())
    """
    path = Path(path)
    if path.name == str(path) and not path.suffix:
        path = Path(find(str(path)))
    try:
        contents = scan(read_bytes(path), VIEWER_SCHEMAS)
    except FileTooLarge as error:
        advice = f"mcap decompress {path.name} -o whole.mcap"
        raise FileError.of("runs.unpacks-too-much", advice, path=path, error=error) from None
    is_foreign = METADATA_NAME not in contents.metadata and not contents.problems
    if is_foreign and contents.is_complete and not contents.messages:
        raise FileError.of("runs.no-message", path=path)
    return _RunAssembly(path, contents).run()


def read_bytes(path: Path) -> bytes:
    """Return the bytes of an MCAP file. Raise FileError if it is absent, empty, too large, or not an MCAP file."""
    try:
        if path.is_file() and path.stat().st_size > memory_limit.MAX_EXTRA_BYTES // 2:
            raise FileError.of(
                "runs.too-large",
                f"mcap filter {path.name} -o part.mcap",
                path=path,
                size=memory_limit.format_size(path.stat().st_size),
                largest=memory_limit.format_size(memory_limit.MAX_EXTRA_BYTES // 2),
            )
        data = path.read_bytes()
    except IsADirectoryError:
        fix = baqueano_command("runs", "ls", "--runs", path)
        raise FileError.of("runs.folder", fix, path=path) from None
    except FileNotFoundError:
        is_default = path.parent == Path() and Path("runs").is_dir()
        fix = baqueano_command("runs", "ls", *([] if is_default else ["--runs", path.parent]))
        raise FileError.of("runs.absent", fix, absent_path=path) from None
    except OSError as error:
        raise FileError.of("runs.not-read", path=path, error=error.strerror or error) from error
    if not data:
        raise FileError.of("runs.empty", path=path)
    if data[: len(MAGIC)] != MAGIC:
        raise _foreign_file_error(path, data)
    return data


def _foreign_file_error(path: Path, data: bytes) -> FileError:
    """Return the error for a file that is not an MCAP file, with the format that its first bytes show."""
    format_name = next((name for start, name in FOREIGN_SIGNATURES.items() if data.startswith(start)), None)
    if format_name is None and len(data) < len(MAGIC) and MAGIC.startswith(data):
        return FileError.of("runs.cut-at-once", path=path, size=len(data))
    text_format = "toml" if path.suffix == ".toml" else "text"
    format_name = format_name or ("bytes" if b"\0" in data[:1000] else text_format)
    fix = "" if format_name in ("zip", "bytes", "toml") else _draft_command(path)
    line = data[:40].decode(errors="replace").strip().partition("\n")[0]
    first = line if format_name == "text" else data[:8]
    return FileError.of(f"runs.is-{format_name}", fix, path=path, value=repr(first))


def _draft_command(path: Path) -> str:
    return baqueano_command("runs", "import", path, "--draft", "MAP.toml")


class _RunAssembly:
    """A builder of a run from the messages of a file."""

    def __init__(self, path: Path, contents: Contents) -> None:
        self.path, self.contents = path, contents
        self.notes: list[Diagnostic] = []
        self.reserved_bytes = 0  # bytes of memory in addition to the messages
        self.topics: dict[str, list[tuple[McapChannel, int]]] = {}  # in the order in which they were named
        for key, channel in sorted(contents.channels.items()):
            self.topics.setdefault(channel.topic, []).append((channel, key))
        if (count := len(contents.channels)) > MAX_TOPICS:
            raise FileError.of(
                "runs.topics", _draft_command(path), path=path, count=count, maximum=MAX_TOPICS
            )

    def run(self) -> Run:
        ticks = self.ticks()
        run = Run(
            name=self.path.stem,
            path=self.path,
            t_ns=ticks.t_ns,
            applied_commands=ticks.z,
            requested_commands=self.tick_commands("/command/requested", ticks),
            sensors=self.sensors(),
            estimate=self.estimate(),
            reference=self.fixed_log("/reference", messages.REFERENCE, ReferenceLog),
            truth=self.fixed_log("/truth", messages.MOTION, TruthLog),
            events=tuple(self.events()),
            vehicle_text=self.vehicle_text(),
            metadata=self.metadata(),
            sent_commands=self.tick_commands("/command/sent", ticks),
        )
        object.__setattr__(run, "notes", (*self.losses(run), *self.notes))
        return run

    def ticks(self) -> Channel:
        rows = self.commands("/command/applied")
        if rows is None:
            topics = ", ".join(sorted(self.topics)[:8])[:400] or "no topics"
            cause = _join_causes(self.contents.problems[:2])
            if self.contents.metadata.get(METADATA_NAME) is None and self.topics:
                raise FileError.of("runs.not-ours", _draft_command(self.path), path=self.path, topics=topics)
            raise FileError.of(
                "runs.nothing-saved",
                path=self.path,
                size=self.contents.size,
                error=cause or note("runs.ends-early"),
            )
        is_new_reading = np.diff(rows.arrival_ns, prepend=-1) > 0
        if not is_new_reading.all():
            self.notes.append(_warning("run.repeated-ticks", count=np.count_nonzero(~is_new_reading)))
        return Channel(rows.t_ns[is_new_reading], rows.arrival_ns[is_new_reading], rows.z[is_new_reading])

    def sensors(self) -> dict[str, Channel]:
        def layout(topic: str, schema: str, size: int) -> messages.MessageLayout:
            name = topic.removeprefix("/sensors/")
            imu = schema == "sensor_msgs/msg/Imu"
            return messages.imu_layout(name) if imu else messages.measurement_layout(size, name)

        read = {t: self.read(t, "z", layout) for t in self.topics if t.startswith("/sensors/")}
        return {
            topic.removeprefix("/sensors/"): channel for topic, channel in read.items() if channel is not None
        }

    def tick_commands(self, topic: str, ticks: Channel) -> np.ndarray | None:
        commands = self.commands(topic)
        if commands is None:
            return None
        if commands.z.shape[1] != ticks.z.shape[1]:
            sizes = {"value": commands.z.shape[1], "expected": ticks.z.shape[1]}
            self.notes.append(_warning("run.other-size", topic=topic, **sizes))
            return None
        self.reserve_missing_rows(topic, len(ticks.t_ns) - len(commands.t_ns), ticks.z.shape[1])
        rows = np.full(ticks.z.shape, np.nan)
        indices = np.searchsorted(ticks.arrival_ns, commands.arrival_ns)
        is_within = indices < len(rows)
        is_within[is_within] = ticks.arrival_ns[indices[is_within]] == commands.arrival_ns[is_within]
        rows[indices[is_within]] = commands.z[is_within]
        return rows

    def estimate(self) -> EstimateLog | None:
        segments = []
        for channel, key in self.topics.get("/estimate", []):
            size_text = channel.metadata.get("size", "none")
            size = None if size_text == "none" else self.number_count("/estimate", size_text.split(" ")[0])
            layout = messages.estimate_layout(size, "without" not in size_text)
            t_ns, _, fields = self.unpack("/estimate", layout, key)
            segments.append((size, "without" not in size_text, t_ns, fields))
        if not segments:
            return None
        sizes = [size for size, *_ in segments if size is not None]
        m, has_cov = (max(sizes) if sizes else None), all(cov for size, cov, *_ in segments)
        missing_count = sum(len(t_ns) for size, _, t_ns, _ in segments if size != m)
        self.reserve_missing_rows("/estimate", missing_count, (m or 0) * (1 + (m or 0) * has_cov))
        return _concatenate([_estimate_columns(m, has_cov, *segment) for segment in segments], EstimateLog)

    def fixed_log(self, topic: str, layout: messages.MessageLayout, log_class: Tree) -> Tree:
        """Return the log in a topic whose messages have a fixed size; None if the file does not have the topic."""
        if topic not in self.topics:
            return None
        t_ns, _, fields = self.unpack(topic, layout, self.topics[topic][0][1])
        columns = (x[:, 0] if x.shape[1] == 1 else x for x in fields.values())
        return _concatenate([(t_ns, *columns)], log_class)

    def events(self) -> Iterable[Event]:
        unread, cause = 0, None
        for _, key in self.topics.get("/events", []):
            for t_ns, message in self.contents.messages.pop(key, NO_MESSAGES).time_and_bytes():
                self.reserve("/events", EVENT_BYTES + 4 * len(message))
                try:
                    level, source, text, data = messages.unpack_log(message)
                except ValueError as error:
                    unread, cause = unread + 1, cause or error_cause(error)
                    continue
                yield Event(t_ns, LEVELS[min(max(level // 10 - 1, 0), 4)], source, text, _diagnostic(data))
        if unread:
            self.notes.append(_warning("run.unread-events", count=unread, cause=cause))

    def vehicle_text(self) -> str:
        text = self.contents.attachments.get(ATTACHMENT_NAME)
        if text is None:
            self.notes.append(_warning("run.vehicle-file-lost"))
        return "" if text is None else text.decode("utf-8", "replace")

    def metadata(self) -> dict[str, str]:
        metadata = verified_metadata(self.contents.metadata.get(METADATA_NAME, {}))
        if metadata is None:
            self.notes.append(_warning("run.metadata-lost"))
        return metadata or {}

    def losses(self, run: Run) -> list[Diagnostic]:
        """Return warnings if the file was not closed or is damaged."""
        figures, warnings = {"file": self.path.name, "ticks": len(run.t_ns)}, []
        if not self.contents.is_complete:
            warnings.append(_warning("run.not-closed", **figures, duration_s=run.duration_s))
        if self.contents.problems:
            unlisted_count = max(self.contents.damage_count - 3, 0)
            problems = _join_causes(self.contents.problems[:3])
            code = "run.damaged-often" if unlisted_count else "run.damaged"
            warnings.append(_warning(code, **figures, places=problems, count=unlisted_count))
        return warnings

    def commands(self, topic: str) -> Channel | None:
        return self.read(topic, "u", lambda topic, schema, size: messages.command_layout(size))

    def read(self, topic: str, values: str, layout: Any) -> Channel | None:
        """Return the first channel of a topic, in order of arrival. Return None if the file does not have the topic."""
        if topic not in self.topics:
            return None
        channel, key = self.topics[topic][0]
        count = self.number_count(topic, channel.metadata.get("size", ""))
        message_layout = layout(topic, channel.schema, count)
        t_ns, arrival_ns, fields = self.unpack(topic, message_layout, key)
        z = messages.imu_z(fields) if channel.schema == "sensor_msgs/msg/Imu" else fields[values]
        order = np.argsort(arrival_ns, kind="stable")
        return Channel(t_ns[order], arrival_ns[order], np.ascontiguousarray(z[order]))

    def unpack(
        self, topic: str, layout: messages.MessageLayout, key: int
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return times and arrival times (N,) [ns] of a channel's messages, and their fields.
        Remove the messages from `contents`. Raise FileError for malformed messages.
        """
        key_messages = self.contents.messages.pop(key, NO_MESSAGES)
        try:
            fields = layout.unpack(key_messages.data, key_messages.sizes)
            t_ns, arrival_ns = np.array(key_messages.t_ns), np.array(key_messages.arrival_ns)
            if max(t_ns.max(initial=0), arrival_ns.max(initial=0)) >= 2**63:
                raise Invalid.of("damage.times")
        except ValueError as error:
            raise self.damage_error(topic, error_cause(error)) from None
        return t_ns.astype(np.int64), arrival_ns.astype(np.int64), fields

    def number_count(self, topic: str, text: str) -> int:
        """Return the number of values per message, which a channel declares as `text`.
        Raise FileError if `text` is not a decimal number of at most 4 digits.
        """
        if not text.isascii() or not text.isdecimal() or len(text) > 4:
            raise self.damage_error(topic, note("damage.channel-size"))
        return int(text)

    def reserve_missing_rows(self, topic: str, row_count: int, column_count: int) -> None:
        """Add the memory of rows that are not in the file and become NaN. Raise FileError as `reserve` does."""
        self.reserve(topic, 8 * max(row_count, 0) * column_count)

    def reserve(self, topic: str, size: int) -> None:
        """Add `size` bytes of additional memory. Raise FileError if the sum exceeds half of the file's limit."""
        self.reserved_bytes += size
        if self.reserved_bytes > memory_limit.limit_bytes(self.contents.size) // 2:
            raise self.damage_error(
                topic, note("damage.memory", size=memory_limit.format_size(self.reserved_bytes))
            )

    def damage_error(self, topic: str, cause: Diagnostic | str) -> FileError:
        fix = _draft_command(self.path)
        return FileError.of("runs.foreign-topic", fix, path=self.path, topic=topic, error=cause)


def _warning(code: str, **figures: Any) -> Diagnostic:
    return note(code, Severity.WARNING, **figures)


def _join_causes(causes: list[Diagnostic | str]) -> Diagnostic | str | None:
    """Return one cause that joins all `causes`; None for an empty list."""
    first = causes[0] if causes else None
    for cause in causes[1:]:
        first = note("run.pair", first=first, second=cause)
    return first


def _estimate_columns(
    m: int | None, has_cov: bool, size: int | None, _: bool, t_ns: np.ndarray, f: dict[str, np.ndarray]
) -> tuple[np.ndarray | None, ...]:
    """Return the columns of an EstimateLog from one channel. Innovations of another size than `m` become NaN."""
    k = len(t_ns)
    innovation = innovation_cov = None
    if m is not None:
        is_missing = size != m
        innovation = np.full((k, m), np.nan) if is_missing else f["innovation"]
        if has_cov:
            empty_cov = np.full((k, m, m), np.nan)
            innovation_cov = empty_cov if is_missing else f["innovation_cov"].reshape(k, m, m)
    return t_ns, f["eta"], f["nu"], f["cov"].reshape(k, 6, 6), innovation, innovation_cov


def _concatenate(segments: list[Any], tuple_class: Any) -> Any:
    """Return the segments of a log joined into one, in order of time."""
    order = np.argsort(np.concatenate([segment[0] for segment in segments]), kind="stable")
    positions = np.argsort(order)  # the inverse permutation
    return tuple_class(*(_joined_column(parts, positions) for parts in zip(*segments, strict=True)))


def _joined_column(columns: tuple[Any, ...], positions: np.ndarray) -> np.ndarray | None:
    """Return `columns` joined into one, with row k moved to positions[k]. The data are copied only once, because they
    can be large.
    """
    if columns[0] is None:
        return None
    column, start = np.empty((len(positions), *columns[0].shape[1:]), dtype=columns[0].dtype), 0
    for column_part in columns:
        column[positions[start : start + len(column_part)]] = column_part
        start += len(column_part)
    return column


def _diagnostic(data: str) -> Diagnostic | None:
    """Return the diagnostic of an event; None if the event has only text, or data of another version."""
    try:
        return Diagnostic.from_json(json.loads(data)) if data else None
    except (ValueError, RecursionError):
        return None
