"""Topics of ROS 1 and ROS 2 bags as tables, through `rosbags` (laptop extra), without any ROS.

A column is a field by its path: `twist.linear.x`, `data[3]`, `pose.pose.orientation` (for quaternion = […]).
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from baqueano.errors import FileError, UsageError
from baqueano.runs.table import Table

SUFFIXES = (".bag", ".db3", ".mcap")


def is_bag(path: Path) -> bool:
    """A ROS 1 bag, a ROS 2 bag folder or one of its files."""
    return path.suffix in SUFFIXES or (path.is_dir() and (path / "metadata.yaml").exists())


def read_topic(path: Path, topic: str | None, columns: set[str], label: str) -> Table:
    """The messages of a topic as they were recorded; columns `bag` and `header.stamp` are ns since 1970."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UsageError(f'{label}: ROS bags need the laptop extra: pip install "baqueano[lab]"') from None
    bag = path.parent if path.suffix == ".db3" and (path.parent / "metadata.yaml").exists() else path
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            held = {c.topic: f"{c.topic} ({c.msgtype})" for c in reader.connections}
            wanted = [c for c in reader.connections if c.topic == topic]
            if not wanted:
                said = "topic is missing" if topic is None else f"has no topic {topic!r}"
                raise FileError(
                    f'{label} {said}; write topic = "…" in its [files.…] table, one of: '
                    f"{', '.join(held.values())}."
                )
            rows = [
                (t_ns, reader.deserialize(raw, connection.msgtype))
                for connection, t_ns, raw in reader.messages(connections=wanted)
            ]
    except AnyReaderError as error:
        raise FileError(
            f"{label} is no bag that can be read: {error}. A cut ROS 1 bag: rosbag reindex FILE"
        ) from error
    made: dict[str, Any] = {"bag": np.array([t_ns for t_ns, _ in rows], dtype=np.int64)}
    messages = [message for _, message in rows]
    for column in sorted(columns - {"bag"}):
        made[column] = _column(messages, column, label, topic or "")
    return Table(label, made, np.arange(1, len(rows) + 1))


def _column(messages: list[Any], path: str, label: str, topic: str) -> np.ndarray:
    if path == "header.stamp":
        stamps = [_field(message, path, label, topic) for message in messages]
        return np.array([s.sec * 1_000_000_000 + s.nanosec for s in stamps], dtype=np.int64)
    values = [_field(message, path, label, topic) for message in messages]
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        shown = type(values[0]).__name__.replace("__", "/")
        raise FileError(
            f"{label} {topic}: field {path!r} is no number but {shown}; go on to one of its parts."
        ) from None


def _field(message: Any, path: str, label: str, topic: str) -> Any:
    value = message
    for name, index in re.findall(r"(\w+)|\[(\d+)\]", path):
        try:
            value = value[int(index)] if index else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            fields = [f for f in getattr(value, "__dataclass_fields__", {}) if not f.startswith("__")]
            has = f"there are {', '.join(fields)}" if fields else f"it holds {np.size(value)} values"
            raise FileError(f"{label} {topic}: no field {path!r}: at {name or index!r} {has}.") from None
    return value
