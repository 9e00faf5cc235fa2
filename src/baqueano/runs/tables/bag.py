"""Read topics of ROS 1 and ROS 2 bags as tables, with `rosbags` (laptop extra), without a ROS installation.

A column is a field by its path: `twist.linear.x`, `data[3]`, `pose.pose.orientation` (for quaternion = […]).
"""

import bz2
import io
import re
import struct
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from baqueano.diagnostics import note
from baqueano.errors import FileError, UsageError
from baqueano.runs.container import memory_limit
from baqueano.runs.container.records import CHUNK, MAX_CHUNK_BYTES, DamageError, decompress
from baqueano.runs.tables.table import LogTable

SUFFIXES = (".bag", ".db3", ".mcap")
TIME_COLUMNS = ("bag", "header.stamp")  # in ns
BROKEN_BAG_ERRORS = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    struct.error,
    AssertionError,
    TypeError,
    OverflowError,
)


def is_bag(path: Path) -> bool:
    """Return True for a ROS 1 bag, a ROS 2 bag folder or one of its files."""
    return path.suffix in SUFFIXES or (path.is_dir() and (path / "metadata.yaml").exists())


def read_topic(path: Path, topic: str | None, columns: set[str], label: str) -> LogTable:
    """Return the recorded messages of a topic. The columns `bag` and `header.stamp` are nanoseconds since 1970.
    Raise FileError if the bag or the topic cannot be read, and UsageError if `rosbags` is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.serde import SerdeError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UsageError.of("bag.no-rosbags", "pip install rosbags", file=label) from None
    for file_path in sorted(path.rglob("*.mcap")) if path.is_dir() else [path]:
        _check_chunks(file_path, label)
    bag = path.parent if path.suffix == ".db3" and (path.parent / "metadata.yaml").exists() else path
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            types = {c.topic: f"{c.topic} ({c.msgtype})" for c in reader.connections}
            connections = [c for c in reader.connections if c.topic == topic]
            if not connections:
                code = "bag.topic-unsaid" if topic is None else "bag.no-topic"
                raise FileError.of(code, file=label, value=topic, valid=types.values())
            series = {column: array("q" if column in TIME_COLUMNS else "d") for column in {*columns, "bag"}}
            for connection, t_ns, raw_message in reader.messages(connections=connections):
                message = reader.deserialize(raw_message, connection.msgtype)
                series["bag"].append(t_ns)
                for column in columns - {"bag"}:
                    series[column].append(_message_number(message, column, label, topic or ""))
    except (AnyReaderError, SerdeError, *BROKEN_BAG_ERRORS) as error:
        raise FileError.of("bag.not-read", file=label, error=error) from error
    numeric_columns = {column: np.array(values) for column, values in series.items()}
    return LogTable(label, numeric_columns, np.arange(1, len(series["bag"]) + 1))


def _check_chunks(path: Path, label: str) -> None:
    """Raise FileError for a bag with a chunk that would fill the memory, because `rosbags` unpacks each chunk
    at once."""
    try:
        chunks = {".bag": _ros1_chunks, ".mcap": _mcap_chunks}[path.suffix]
        with path.open("rb") as stream:
            for compression, payload in chunks(stream):
                if len(_unpack(compression, payload)) > MAX_CHUNK_BYTES:
                    raise FileError.of(
                        "bag.chunk",
                        file=label,
                        size=memory_limit.format_size(len(payload)),
                        largest=memory_limit.format_size(MAX_CHUNK_BYTES),
                    )
    except (DamageError, KeyError, *BROKEN_BAG_ERRORS):
        return  # rosbags reports the fault


def _unpack(compression: str, payload: bytes) -> bytes | memoryview:
    """Return the unpacked chunk, but at most MAX_CHUNK_BYTES + 1 bytes; empty if the chunk is not compressed."""
    if compression in ("", "none"):
        return b""
    if compression == "bz2":
        return bz2.BZ2File(io.BytesIO(payload)).read(MAX_CHUNK_BYTES + 1)
    return decompress(compression, memoryview(payload), MAX_CHUNK_BYTES)


def _mcap_chunks(stream: BinaryIO) -> Iterator[tuple[str, bytes]]:
    stream.seek(8)
    while len(head := stream.read(9)) == 9:
        opcode, size = struct.unpack("<BQ", head)
        end = stream.tell() + size
        if opcode == CHUNK:
            (length,) = struct.unpack_from("<I", stream.read(32), 28)
            name = stream.read(min(length, 8)).decode()
            yield name, stream.read(max(end - stream.tell(), 0))[8:]
        stream.seek(end)


def _ros1_chunks(stream: BinaryIO) -> Iterator[tuple[str, bytes]]:
    stream.readline()
    while len(size := stream.read(4)) == 4:
        head = stream.read(int.from_bytes(size, "little"))
        data = int.from_bytes(stream.read(4), "little")
        match = re.search(rb"compression=(\w+)", head)
        if match:
            yield match[1].decode(), stream.read(data)
        else:
            stream.seek(data, 1)


def _message_number(message: object, path: str, label: str, topic: str) -> int | float:
    """Return the number in a field of a message; for header.stamp, the nanoseconds since 1970.
    Raise FileError for any other content.
    """
    value = _field(message, path, label, topic)
    if path == "header.stamp":
        return value.sec * 1_000_000_000 + value.nanosec
    try:
        return float(value)
    except (TypeError, ValueError):
        type_name = type(value).__name__.replace("__", "/")
        raise FileError.of(
            "bag.field-not-number", file=label, topic=topic, field=path, value=type_name
        ) from None


def _field(message: Any, path: str, label: str, topic: str) -> Any:
    value = message
    for name, index in re.findall(r"(\w+)|\[(\d+)\]", path):
        try:
            value = value[int(index)] if index else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            fields = [f for f in getattr(value, "__dataclass_fields__", {}) if not f.startswith("__")]
            available = (
                note("bag.fields", fields=fields) if fields else note("bag.values", count=np.size(value))
            )
            raise FileError.of(
                "bag.no-field", file=label, topic=topic, field=path, path=name or index, fields=available
            ) from None
    return value
