"""Write the MCAP file of a run: topics, chunks and attachments, without threads, queues or clocks.

The file has the profile `ros2`, messages in CDR, and all definitions, so that Foxglove, PlotJuggler, rerun, rosbags and
`ros2 bag` can open it. The topics:

    /command/applied | requested | sent    baqueano_msgs/Command       the ticks are the times of `applied`
    /sensors/NAME                          sensor_msgs/Imu, or baqueano_msgs/Measurement
    /estimate, /reference, /truth          baqueano_msgs/Estimate | Reference | Motion
    …/pose of these three                  geometry_msgs/PoseStamped, only for viewers
    /events                                rcl_interfaces/Log
"""

import json
import os
import threading
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from baqueano.errors import FileError, UsageError
from baqueano.runs.container import messages
from baqueano.vehicle_file.text.toml_text import parse_toml

CHUNK_BYTES = 2**18  # largest size of a chunk before compression
ATTACHMENT_NAME = "vehicle.toml"  # name of the attachment
METADATA_NAME = "baqueano"  # name of the metadata record
FORMAT_VERSION = "1"


class Topic(NamedTuple):
    """A channel of the file, with the function that packs its messages."""

    id: int
    pack: Callable[..., bytes]


def imu_names(vehicle_text: str) -> Callable[[str, int], bool]:
    """Return a test for IMU sensors: 3 values, and a kind in the vehicle file that begins with imu.
    For a sensor that is not in the vehicle file, its name is used as its kind.
    """
    try:
        tables = parse_toml(vehicle_text, "vehicle.toml").get("sensors", {})
    except (FileError, ValueError):
        tables = {}

    def is_imu(name: str, size: int) -> bool:
        table = tables.get(name) if isinstance(tables, dict) else None
        sensor_kind = table.get("kind", "") if isinstance(table, dict) else name
        return size == 3 and str(sensor_kind).startswith("imu")

    return is_imu


class RunFile:
    """An open file that receives packed messages."""

    def __init__(self, path: Path, vehicle_text: str, metadata: dict[str, str]) -> None:
        from mcap.writer import Writer

        for key, value in metadata.items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise UsageError.of("runs.metadata", path=path, key=key, value=repr(value))
        self.path = path
        self._lock = threading.Lock()  # one thread packs and names topics, another moves messages
        self._topics: dict[tuple[object, ...], Topic] = {}
        self._schemas: dict[str, int] = {}
        self._is_imu = cache(imu_names(vehicle_text))
        self._stream = _open_new(path)
        self._mcap = Writer(self._stream, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        self._mcap.start(profile="ros2", library="baqueano")
        self._mcap.add_metadata(METADATA_NAME, add_checksum(metadata))
        self._mcap.add_attachment(0, 0, ATTACHMENT_NAME, "application/toml", vehicle_text.encode())

    def topic(self, name: str, schema: str, size: int | str, pack: Callable[..., bytes]) -> Topic:
        """Return the channel `name` for messages of this size; create it at the first call."""
        key = (name, size)
        with self._lock:
            if key not in self._topics:
                if schema not in self._schemas:
                    text = messages.SCHEMAS[schema].encode()
                    self._schemas[schema] = self._mcap.register_schema(schema, "ros2msg", text)
                metadata = {"offered_qos_profiles": "", "size": str(size)}
                channel = self._mcap.register_channel(name, "cdr", self._schemas[schema], metadata)
                self._topics[key] = Topic(channel, pack)
            return self._topics[key]

    def command(self, stage: str, size: int) -> Topic:
        """Return the topic /command/applied, requested or sent."""
        key = (f"/command/{stage}", size)
        return self._topics.get(key) or self.topic(
            key[0], "baqueano_msgs/msg/Command", size, messages.command_layout(size).pack
        )

    def sensor(self, name: str, size: int) -> tuple[Topic, bool]:
        """Return the topic /sensors/NAME, and True if it is written as an IMU."""
        imu, key = self._is_imu(name, size), (f"/sensors/{name}", size)
        if key not in self._topics:
            schema = "sensor_msgs/msg/Imu" if imu else "baqueano_msgs/msg/Measurement"
            layout = messages.imu_layout(name) if imu else messages.measurement_layout(size, name)
            self.topic(key[0], schema, size, layout.pack)
        return self._topics[key], imu

    def estimate(self, size: int | None, *, has_cov: bool) -> Topic:
        """Return the topic /estimate with an innovation of this size, None for an estimate without innovation."""
        size_text = "none" if size is None else f"{size}" if has_cov else f"{size} without covariance"
        key = ("/estimate", size_text)
        return self._topics.get(key) or self.topic(
            key[0], "baqueano_msgs/msg/Estimate", size_text, messages.estimate_layout(size, has_cov).pack
        )

    def fixed_topic(self, name: str) -> Topic:
        """Return the topic /reference, /truth or /events, or one of the poses for viewers."""
        key = (name, "")
        if key not in self._topics:
            schema, pack = FIXED_TOPICS[name]
            self.topic(name, schema, "", pack)
        return self._topics[key]

    def add(self, topic: int, arrival_ns: int, data: bytes, t_ns: int) -> None:
        """Add a packed message to the open chunk."""
        with self._lock:
            self._mcap.add_message(topic, arrival_ns, data, t_ns)

    def close_chunk(self) -> None:
        """Close the chunk, and sync it to the disk."""
        with self._lock:
            self._mcap.flush()
        getattr(os, "fdatasync", os.fsync)(self._stream.fileno())

    def finish(self) -> None:
        """Write the index and close the file."""
        self._mcap.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()

    def abandon(self) -> None:
        """Close the file without an index, even if the rest cannot be written."""
        with suppress(OSError):
            self._stream.close()


FIXED_TOPICS = {
    "/reference": ("baqueano_msgs/msg/Reference", messages.REFERENCE.pack),
    "/truth": ("baqueano_msgs/msg/Motion", messages.MOTION.pack),
    "/events": ("rcl_interfaces/msg/Log", messages.pack_log),
    "/estimate/pose": ("geometry_msgs/msg/PoseStamped", messages.POSE.pack),
    "/reference/pose": ("geometry_msgs/msg/PoseStamped", messages.POSE.pack),
    "/truth/pose": ("geometry_msgs/msg/PoseStamped", messages.POSE.pack),
}


def add_checksum(metadata: dict[str, str]) -> dict[str, str]:
    """Return the metadata with the format and a checksum, which MCAP does not add."""
    content = metadata | {"format": FORMAT_VERSION}
    return content | {"crc32": f"{zlib.crc32(json.dumps(content, sort_keys=True).encode()):08x}"}


def verified_metadata(record: dict[str, str]) -> dict[str, str] | None:
    """Return the metadata without format and checksum; None if the checksum is wrong."""
    metadata = {key: value for key, value in record.items() if key not in ("format", "crc32")}
    return metadata if record == add_checksum(metadata) else None


def _open_new(path: Path) -> Any:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("xb")
    except FileExistsError:
        raise FileError.of("runs.run-there", path=path) from None
    except OSError as error:
        raise FileError.of("runs.no-place", path=path, error=error.strerror or error) from error
    _sync_folder(path.parent)
    return stream


def _sync_folder(folder: Path) -> None:
    """Write the folder to the disk, if the system can, so that a power cut does not lose the name of a new file."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    with suppress(OSError):
        os.fsync(handle)
    os.close(handle)
