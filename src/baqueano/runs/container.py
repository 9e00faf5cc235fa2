"""The bytes of an MCAP file, walked record by record, with every checksum verified (mcap.dev/spec).

Whatever was recorded before a cut or around a damaged place is returned, and every place that was lost is
named. A message is returned only out of a chunk whose checksum holds, so none is ever silently wrong. No
chunk is unpacked beyond 64 MiB, whatever its header says. When the walk loses its step it looks for the next
chunk and goes on there.
"""

import struct
import zlib
from dataclasses import dataclass, field
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"
LARGEST_CHUNK = 64 * 2**20
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA, DATA_END = 1, 2, 3, 4, 5, 6, 9, 12, 15
LAST_KNOWN = 15

_CHUNK_HEAD = struct.Struct("<QQQI")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_RECORD_HEAD = struct.Struct("<BQ")
_SIGNATURE = b"\x04\0\0\0zstd"  # stands 37 bytes after the start of each chunk that baqueano writes
_SIGNATURE_AT = 37


class McapChannel(NamedTuple):
    """A topic of the file and what it says about itself."""

    topic: str
    schema: str
    metadata: dict[str, str]


class McapMessage(NamedTuple):
    """One message as it stands in the file."""

    arrival_ns: int
    t_ns: int
    data: bytes


@dataclass
class Contents:
    """All that could be read, and what could not."""

    size: int
    profile: str = ""
    channels: dict[int, McapChannel] = field(default_factory=dict)
    messages: dict[int, list[McapMessage]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False  # the file was closed properly
    problems: list[str] = field(default_factory=list)  # damage, one line each
    read_to: int = 0  # bytes of the file that were understood


class Damage(ValueError):
    """Bytes that are not what they should be."""


class Cursor:
    """Reads strings, numbers and maps from a piece of the file, never beyond its end."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        if size > len(self.data) - self.at:
            raise Damage(f"a field of {size} bytes in a record with {len(self.data) - self.at} left")
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, size: int) -> int:
        """An unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """A string with its length before it."""
        try:
            return self.take(self.number(4)).decode()
        except UnicodeDecodeError as error:
            raise Damage("a text that is not UTF-8") from error

    def pairs(self) -> dict[str, str]:
        """A map from string to string."""
        inside, pairs = Cursor(self.take(self.number(4))), {}
        while inside.at < len(inside.data):
            key = inside.text()
            pairs[key] = inside.text()
        return pairs


def scan(data: bytes) -> Contents:
    """Everything that can be trusted in the bytes of a file that begins with MAGIC."""
    walk = _Walk(data)
    walk.run()
    return walk.found


class _Walk:
    def __init__(self, data: bytes) -> None:
        self.data, self.found = data, Contents(len(data))
        self.schemas: dict[int, str] = {}
        self.ended = False  # behind the record that ends the messages
        self.repeated: dict[int, McapChannel] = {}  # as the summary behind the messages tells them

    def run(self) -> None:
        at: int | None = len(MAGIC)
        while at is not None and at < len(self.data) and not self.found.complete:
            self.found.read_to = at
            at = self.record(at)
        unknown = [k for k in self.found.messages if k not in self.found.channels]
        if unknown:
            self.found.problems.append(f"{len(unknown)} topics lost their names")

    def record(self, at: int) -> int | None:
        """Reads the record at `at`; returns where the next one starts, None where nothing can be read."""
        if len(self.data) - at < 9:
            return None
        kind, size = _RECORD_HEAD.unpack_from(self.data, at)
        end = at + 9 + size
        hidden = self.data.find(_SIGNATURE, at + _SIGNATURE_AT, min(end, len(self.data)))
        if (
            hidden >= 0 and not self.ended and kind not in (CHUNK, ATTACHMENT)
        ):  # a chunk inside another record: a lost step
            return self.resume(hidden - _SIGNATURE_AT, f"no record of kind {kind} was expected at byte {at}")
        if end > len(self.data):
            start = self.next_chunk(at + 1)
            if start is None:
                return None
            return self.resume(start, f"a record at byte {at} claims {size} bytes")
        try:
            self.content(kind, self.data[at + 9 : end], at, end)
        except Damage as damage:
            self.found.problems.append(f"bytes {at} to {end}: {damage}")
            start = self.next_chunk(at + 1)
            if start is not None and start < end:
                return start
        return end

    def resume(self, start: int, why: str) -> int:
        self.found.problems.append(f"{why}; went on at byte {start}")
        return start if self.data[start] == CHUNK else self.relabelled(start)

    def relabelled(self, start: int) -> int:
        """A chunk whose first byte is not that of a chunk: its checksum decides."""
        (size,) = struct.unpack_from("<Q", self.data, start + 1)
        end = start + 9 + size
        if end > len(self.data):
            return start + _SIGNATURE_AT + len(_SIGNATURE)
        try:
            self.content(CHUNK, self.data[start + 9 : end], start, end)
        except Damage as damage:
            self.found.problems.append(f"bytes {start} to {end}: {damage}")
            return start + _SIGNATURE_AT + len(_SIGNATURE)
        return end

    def next_chunk(self, at: int) -> int | None:
        """Where the next chunk after `at` begins, by its signature."""
        sign = self.data.find(_SIGNATURE, at + _SIGNATURE_AT)
        return None if sign < 0 else sign - _SIGNATURE_AT

    def content(self, kind: int, body: bytes, at: int, end: int) -> None:
        if kind == CHUNK:
            self.chunk(body)
        elif kind in (SCHEMA, CHANNEL) and self.ended:
            self.named(kind, Cursor(body), self.repeated)
        elif kind == HEADER:
            self.found.profile = Cursor(body).text()
        elif kind == ATTACHMENT:
            self.attachment(body)
        elif kind == METADATA:
            cursor = Cursor(body)
            name = cursor.text()
            self.found.metadata[name] = cursor.pairs()
        elif kind == DATA_END:
            if len(body) != 4:
                raise Damage("an end of the data that is none")
            self.ended = True
            said = Cursor(body).number(4)
            if said and said != zlib.crc32(self.data[:at]) and not self.found.problems:
                self.found.problems.append("the checksum over all data does not hold")
        elif kind == FOOTER:
            self.footer(Cursor(body), at)
            self.found.complete = self.data[end : end + 8] == MAGIC
        elif kind == MESSAGE:
            raise Damage("a message without a checksum")
        elif not 0 < kind <= LAST_KNOWN:
            raise Damage(f"a record of unknown kind {kind}")

    def chunk(self, body: bytes) -> None:
        records = _unpacked(body)
        at, messages = 0, self.found.messages
        while at < len(records):
            if len(records) - at < 9:
                raise Damage("a chunk that ends inside a record")
            kind, size = _RECORD_HEAD.unpack_from(records, at)
            at += 9
            if size > len(records) - at:
                raise Damage("a record that reaches beyond its chunk")
            if kind == MESSAGE:
                if size < 22:
                    raise Damage("a message without times")
                channel, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(records, at)
                message = McapMessage(log_time, publish_time, records[at + 22 : at + size])
                messages.setdefault(channel, []).append(message)
            elif kind in (SCHEMA, CHANNEL):
                self.named(kind, Cursor(records[at : at + size]), self.found.channels)
            at += size

    def footer(self, cursor: Cursor, at: int) -> None:
        start, _, said = (cursor.number(size) for size in (8, 8, 4))
        if start and said and said != zlib.crc32(self.data[start : at + 25]):
            raise Damage("the checksum of the summary does not hold")
        self.found.channels = self.repeated | self.found.channels

    def named(self, kind: int, cursor: Cursor, channels: dict[int, McapChannel]) -> None:
        if kind == SCHEMA:
            schema = cursor.number(2)
            self.schemas[schema] = cursor.text()
            return
        channel, schema = cursor.number(2), cursor.number(2)
        topic, _ = cursor.text(), cursor.text()
        channels[channel] = McapChannel(topic, self.schemas.get(schema, ""), cursor.pairs())

    def attachment(self, body: bytes) -> None:
        cursor = Cursor(body)
        cursor.take(16)
        name, _ = cursor.text(), cursor.text()
        data = cursor.take(cursor.number(8))
        said = cursor.number(4)
        if said and said != zlib.crc32(body[: len(body) - 4]):
            raise Damage(f"the checksum of the attachment '{name}' does not hold")
        self.found.attachments[name] = data


def _unpacked(body: bytes) -> bytes:
    if len(body) < _CHUNK_HEAD.size:
        raise Damage("a chunk without a head")
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(body)
    cursor = Cursor(body)
    cursor.take(_CHUNK_HEAD.size)
    compression = cursor.text()
    packed = cursor.take(cursor.number(8))
    if cursor.at != len(body):
        raise Damage("a chunk longer than its contents")
    if size > LARGEST_CHUNK:
        raise Damage(f"a chunk that would unpack to {size / 2**20:.0f} MiB; at most 64 MiB are taken")
    records = _decompressed(compression, packed, size)
    if len(records) != size:
        raise Damage(f"a chunk of {len(records)} bytes that says it has {size}")
    if checksum and checksum != zlib.crc32(records):
        raise Damage("the checksum of a chunk does not hold")
    return records


def _decompressed(compression: str, packed: bytes, size: int) -> bytes:
    """At most `size` bytes and one more."""
    if compression == "":
        return packed
    if compression == "zstd":
        import zstandard

        try:
            if zstandard.frame_content_size(packed) not in (-1, size):
                raise Damage("a chunk whose compressed data say another size")
            with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
                return stream.read(size + 1)
        except zstandard.ZstdError as error:
            raise Damage(f"a chunk that does not unpack ({error})") from error
    if compression == "lz4":
        import lz4.frame

        try:
            return lz4.frame.LZ4FrameDecompressor().decompress(packed, size + 1)
        except (RuntimeError, EOFError) as error:
            raise Damage(f"a chunk that does not unpack ({error})") from error
    raise Damage(f"a chunk packed with '{compression[:20]}'")
