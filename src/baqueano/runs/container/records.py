"""Read the bytes of an MCAP file record by record, and verify every checksum (mcap.dev/spec).

All data before a cut or around a damaged place are returned, and every lost place is reported. A message is returned
only from a chunk whose checksum is right, so wrong data never pass silently. If a record is damaged, the reader
searches for the next chunk and continues there. The search reads each byte at most once. The repeated reading inside
damaged records is limited to SEARCH_FACTOR times the size of the file. The sum of unpacked and stored bytes is limited
to `memory_limit.limit_bytes`.
"""

import re
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import Invalid
from baqueano.runs.container import memory_limit

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = 64 * 2**20
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA, DATA_END = 1, 2, 3, 4, 5, 6, 9, 12, 15
MIN_BYTES = {
    HEADER: 8, FOOTER: 20, SCHEMA: 14, CHANNEL: 16, CHUNK: 40, ATTACHMENT: 36, METADATA: 8, DATA_END: 4,
}  # fmt: skip
LAST_OPCODE, MAX_PAIRS = 15, 10_000  # the second: most entries of a map from string to string
NAME_MEMORY_FACTOR = 10  # memory of a name or a map, as a multiple of its bytes
SEARCH_FACTOR = 16  # limit of the search for chunks inside damaged ones, as a multiple of the file's size
MAX_REPORTED_DAMAGES = 8  # damaged places that are described

_CHUNK_HEAD = struct.Struct("<QQQI")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_RECORD_HEAD = struct.Struct("<BQ")
_SIGNATURE, _SIGNATURE_OFFSET = b"\x04\0\0\0zstd", 37  # 37 bytes after the start of each chunk of baqueano
_NOT_ZERO = re.compile(rb"[^\0]")


class McapChannel(NamedTuple):
    """A topic of the file with its declared schema and metadata."""

    topic: str
    schema: str
    metadata: dict[str, str]


class McapMessages(NamedTuple):
    """The messages of a topic in the order of the file, without gaps."""

    data: bytearray
    sizes: "array[int]"
    arrival_ns: "array[int]"
    t_ns: "array[int]"

    def time_and_bytes(self) -> Iterator[tuple[int, bytes]]:
        """Yield the time and the bytes of each message."""
        start = 0
        for t_ns, size in zip(self.t_ns, self.sizes, strict=True):
            yield t_ns, bytes(self.data[start : start + size])
            start += size


@dataclass
class Contents:
    """The readable records of a file, and its damage."""

    size: int
    profile: str = ""
    channels: dict[int, McapChannel] = field(default_factory=dict)
    messages: dict[int, McapMessages] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    is_complete: bool = False  # the file was closed properly
    # damage, one line for each of the first places
    problems: list[Diagnostic | str] = field(default_factory=list)
    damage_count: int = 0  # number of damaged places
    contents_bytes: int = 0  # bytes of memory of the contents


class FileTooLarge(Invalid):
    """Raised for a file that needs more memory than its size allows."""


class DamageError(Invalid):
    """Raised for bytes that do not have the expected form."""


class Cursor:
    """A reader of strings, integers and maps from a part of the file. Its methods raise DamageError beyond its end."""

    def __init__(self, data: bytes | memoryview) -> None:
        self.data, self.index = memoryview(data), 0

    def read(self, size: int) -> memoryview:
        """Return the next `size` bytes. Raise DamageError if fewer are left."""
        if size > len(self.data) - self.index:
            raise DamageError.of("damage.field", size=size, remaining_bytes=len(self.data) - self.index)
        self.index += size
        return self.data[self.index - size : self.index]

    def integer(self, size: int) -> int:
        """Return an unsigned integer of `size` bytes."""
        return int.from_bytes(self.read(size), "little")

    def text(self) -> str:
        """Return a string, which is preceded by its length. Raise DamageError if it is not UTF-8."""
        try:
            return str(self.read(self.integer(4)), "utf-8")
        except UnicodeDecodeError as error:
            raise DamageError.of("damage.not-utf8") from error

    def pairs(self) -> dict[str, str]:
        """Return a map from string to string. Raise DamageError for more than MAX_PAIRS entries."""
        cursor, pairs = Cursor(self.read(self.integer(4))), {}
        while cursor.index < len(cursor.data):
            key = cursor.text()
            pairs[key] = cursor.text()
            if len(pairs) > MAX_PAIRS:
                raise DamageError.of("damage.map-entries", maximum=MAX_PAIRS)
        return pairs


def scan(data: bytes, skipped_schemas: frozenset[str] = frozenset()) -> Contents:
    """Return the verified records of the file with the bytes `data`, which begin with MAGIC.

    Skip the messages of the `skipped_schemas`. Raise FileTooLarge above the limit of `memory_limit.limit_bytes`."""
    walk = _RecordReader(data, skipped_schemas)
    walk.run()
    return walk.contents


class _RecordReader:
    """A reader of the records of a file, one after the other."""

    def __init__(self, data: bytes, skipped_schemas: frozenset[str]) -> None:
        self.data, self.contents, self.skipped_schemas = data, Contents(len(data)), skipped_schemas
        self.view = memoryview(data)
        self.schemas: dict[int, str] = {}
        self.ended = False  # the record that ends the messages was read
        self.closed = False  # the last record was read
        self.skipped_channels: set[int] = set()  # channels for viewers, whose messages are skipped
        self.repeated: dict[int, McapChannel] = {}  # channels as the summary after the messages repeats them
        self.sign = -1  # position of the next chunk, as far as the search went
        self.last_damage_end = -1  # end of the last damaged place
        self.reread_bytes = 0  # bytes of damaged records that are read again
        self.unpacked = 0  # bytes of all chunks

    def run(self) -> None:
        offset: int | None = len(MAGIC)
        while offset is not None and offset < len(self.data) and not self.contents.is_complete:
            offset = self.record(offset)
        unnamed_channels = [k for k in self.contents.messages if k not in self.contents.channels]
        if unnamed_channels:
            self.report_damage(-1, -1, note("damage.names", topics=len(unnamed_channels)))
        topics = Counter[str]()
        for key, messages in self.contents.messages.items():
            topic = self.contents.channels[key].topic if key in self.contents.channels else ""
            topics[topic] += len(messages.data) + 24 * len(messages.sizes)
        self.check_memory(self.contents.contents_bytes + max(topics.values(), default=0))

    def record(self, offset: int) -> int | None:
        """Read the record at `offset`; return the position of the next record, or None if it cannot be read."""
        if len(self.data) - offset < 9:
            return None
        opcode, size = _RECORD_HEAD.unpack_from(self.data, offset)
        end, chunk = offset + 9 + size, self.next_chunk(offset)
        lost_step = chunk < min(end, len(self.data)) and not self.ended
        if lost_step and opcode not in (CHUNK, ATTACHMENT):  # or a chunk with a damaged kind
            self.report_damage(offset, chunk, note("damage.unexpected", kind=opcode))
            if chunk > offset:
                return chunk
            opcode = CHUNK  # its checksum decides
        if end > len(self.data):
            chunk = self.next_chunk(offset + 1)
            if chunk == len(self.data):
                return None
            self.report_damage(offset, chunk, note("damage.record-size", size=size))
            return chunk
        if opcode == 0 and size == 0:  # the tail that a power cut leaves: all of it at once
            next_nonzero = _NOT_ZERO.search(self.data, offset)
            end += ((next_nonzero.start() if next_nonzero else len(self.data)) - end) // 9 * 9
            cause = note("damage.zeros")
        elif not 0 < opcode <= LAST_OPCODE:
            cause = note("damage.unknown-kind", kind=opcode)
        elif size < MIN_BYTES.get(opcode, 0):
            cause = note("damage.short-record", kind=opcode, size=size)
        else:
            try:
                self.read_content(opcode, offset + 9, end)
                return end
            except DamageError as damage:
                cause = damage.diagnostic
        self.report_damage(offset, end, cause)
        return self.damage_end(offset, end)

    def damage_end(self, offset: int, end: int) -> int:
        """Return the position after a damaged record: the first chunk inside the record, else the end of the record."""
        chunk = self.next_chunk(offset + 1)
        if chunk >= end or self.reread_bytes + end - offset > SEARCH_FACTOR * len(self.data):
            return end
        self.reread_bytes += end - offset
        return chunk

    def report_damage(self, offset: int, to: int, cause: Diagnostic | str) -> None:
        """Report a damaged place. Damage that follows it without a gap is not reported again."""
        if offset < 0 or offset != self.last_damage_end:
            self.contents.damage_count += 1
            if self.contents.damage_count <= MAX_REPORTED_DAMAGES:
                self.contents.problems.append(
                    cause if offset < 0 else note("damage.place", first=offset, last=to, cause=cause)
                )
        self.last_damage_end = to

    def next_chunk(self, offset: int) -> int:
        """Return the position of the first chunk at or after `offset`, found by its signature.
        Return the size of the file if no chunk follows.
        """
        if offset > self.sign:
            sign = self.data.find(_SIGNATURE, offset + _SIGNATURE_OFFSET)
            self.sign = len(self.data) if sign < 0 else sign - _SIGNATURE_OFFSET
        return self.sign

    def read_content(self, opcode: int, offset: int, end: int) -> None:
        """Read the bytes `offset` to `end` of a record. Raise DamageError if they do not have the expected form."""
        body = self.view[offset:end]
        if opcode == CHUNK:
            self.read_chunk(body)
        elif opcode in (SCHEMA, CHANNEL) and self.ended:
            self.read_name(opcode, Cursor(body), self.repeated)
        elif opcode == HEADER:
            self.contents.profile = Cursor(body).text()
        elif opcode == ATTACHMENT:
            self.attachment(body)
        elif opcode == METADATA:
            cursor = Cursor(body)
            name = cursor.text()
            self.contents.metadata[name] = cursor.pairs()
            self.reserve(NAME_MEMORY_FACTOR * len(body))
        elif opcode == DATA_END:
            if len(body) != 4 or self.ended:
                raise DamageError.of("damage.end")
            self.ended = True
            checksum, is_intact = Cursor(body).integer(4), not self.contents.damage_count
            if checksum and is_intact and checksum != zlib.crc32(self.view[: offset - 9]):
                self.report_damage(-1, -1, note("damage.data-checksum"))
        elif opcode == FOOTER:
            self.read_footer(Cursor(body), offset + 16)
            self.contents.is_complete = self.data[end : end + 8] == MAGIC
        elif opcode == MESSAGE:
            raise DamageError.of("damage.no-checksum")

    def read_chunk(self, content: memoryview) -> None:
        records = self.unpack_chunk(content)
        offset, skipped_bytes, messages, drawn_channels = 0, 0, self.contents.messages, self.skipped_channels
        while offset < len(records):
            if len(records) - offset < 9:
                raise DamageError.of("damage.chunk-ends")
            opcode, size = _RECORD_HEAD.unpack_from(records, offset)
            offset += 9
            if size > len(records) - offset:
                raise DamageError.of("damage.record-beyond")
            if opcode == MESSAGE:
                if size < 22:
                    raise DamageError.of("damage.no-times")
                channel, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(records, offset)
                if channel in drawn_channels:
                    skipped_bytes += 9 + size
                else:
                    series = messages.get(channel)
                    if series is None:
                        series = messages[channel] = McapMessages(
                            bytearray(), array("Q"), array("Q"), array("Q")
                        )
                    series.data.extend(records[offset + 22 : offset + size])
                    series.sizes.append(size - 22)
                    series.arrival_ns.append(log_time)
                    series.t_ns.append(publish_time)
            elif opcode in (SCHEMA, CHANNEL):
                self.read_name(opcode, Cursor(records[offset : offset + size]), self.contents.channels)
            offset += size
        self.contents.contents_bytes += (len(records) - skipped_bytes) * 9 // 8  # growing arrays reserve more

    def read_footer(self, cursor: Cursor, crc_offset: int) -> None:
        if self.closed:
            raise DamageError.of("damage.second-end")
        self.closed = True
        start, _, checksum = (cursor.integer(size) for size in (8, 8, 4))
        if start and checksum and checksum != zlib.crc32(self.view[start:crc_offset]):
            raise DamageError.of("damage.summary-checksum")
        self.contents.channels = self.repeated | self.contents.channels

    def read_name(self, opcode: int, cursor: Cursor, channels: dict[int, McapChannel]) -> None:
        if opcode == SCHEMA:
            schema = cursor.integer(2)
            name = cursor.text()
            if self.schemas.get(schema) != name:
                self.schemas[schema] = name
                self.reserve(NAME_MEMORY_FACTOR * len(name))
            return
        channel, schema = cursor.integer(2), cursor.integer(2)
        topic, _ = cursor.text(), cursor.text()
        description = McapChannel(topic, self.schemas.get(schema, ""), cursor.pairs())
        if channels.get(channel) != description:
            channels[channel] = description
            self.reserve(NAME_MEMORY_FACTOR * len(cursor.data))
        if description.schema in self.skipped_schemas:
            self.skipped_channels.add(channel)

    def attachment(self, content: memoryview) -> None:
        cursor = Cursor(content)
        cursor.read(16)
        name, _ = cursor.text(), cursor.text()
        data = cursor.read(cursor.integer(8))
        checksum = cursor.integer(4)
        if checksum != zlib.crc32(content[: len(content) - 4]):  # 0, which MCAP allows, is refused too
            raise DamageError.of("damage.attachment-checksum", name=name[:80])
        self.contents.attachments[name] = bytes(data)
        self.reserve(NAME_MEMORY_FACTOR * len(name) + 4 * len(data))

    def reserve(self, size: int) -> None:
        """Add `size` bytes of memory, and raise FileTooLarge if the sum exceeds the limit."""
        self.contents.contents_bytes += size
        self.check_memory(len(self.data) + self.contents.contents_bytes)

    def check_memory(self, need: int) -> None:
        """Raise FileTooLarge if `need` bytes of memory exceed the limit of the file."""
        if need > memory_limit.limit_bytes(len(self.data)):
            raise FileTooLarge.of(
                "damage.too-large",
                size=memory_limit.format_size(len(self.data)),
                memory=memory_limit.format_size(need),
                maximum=memory_limit.format_size(memory_limit.limit_bytes(len(self.data))),
            )

    def unpack_chunk(self, content: memoryview) -> bytes | memoryview:
        """Return the records in a chunk. Raise DamageError if it is damaged, and FileTooLarge if it is too large."""
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
        cursor = Cursor(content)
        cursor.read(_CHUNK_HEAD.size)
        compression = cursor.text()
        payload = cursor.read(cursor.integer(8))
        if cursor.index != len(content):
            raise DamageError.of("damage.chunk-longer")
        if size > MAX_CHUNK_BYTES:
            raise DamageError.of("damage.chunk-unpacks", unpacked_mib=size / 2**20)
        _check_size(compression, payload, size)
        memory_bytes = len(self.data) + self.contents.contents_bytes
        # for the records, and for their stored parts
        allowed_bytes = max((memory_limit.limit_bytes(len(self.data)) - memory_bytes) // 2, 0)
        records = decompress(compression, payload, min(size, allowed_bytes))
        self.unpacked += len(records)
        used_bytes = size if len(records) > allowed_bytes else len(records)
        self.check_memory(max(self.unpacked, memory_bytes + 2 * used_bytes))
        if len(records) != size:
            raise DamageError.of("damage.chunk-size", bytes=len(records), header_bytes=size)
        if checksum and checksum != zlib.crc32(records):
            raise DamageError.of("damage.chunk-checksum")
        return records


def _check_size(compression: str, payload: memoryview, size: int) -> None:
    """Raise DamageError if the compressed data declare another size than their chunk."""
    if compression == "zstd":
        import zstandard

        try:
            frame_size = zstandard.frame_content_size(payload)
        except zstandard.ZstdError as error:
            raise DamageError.of("damage.chunk-not-unpacked", error=error) from error
        if frame_size not in (-1, size):
            raise DamageError.of("damage.chunk-other-size")


def decompress(compression: str, payload: memoryview, size: int) -> bytes | memoryview:
    """Return the unpacked data, at most `size` + 1 bytes. The extra byte shows that they are longer than `size`.
    Raise DamageError for data that cannot be unpacked.
    """
    if compression == "":
        return payload
    if compression == "zstd":
        import zstandard

        try:
            with zstandard.ZstdDecompressor().stream_reader(payload, read_across_frames=True) as stream:
                return stream.read(size + 1)
        except zstandard.ZstdError as error:
            raise DamageError.of("damage.chunk-not-unpacked", error=error) from error
    if compression == "lz4":
        import lz4.frame

        try:
            return lz4.frame.LZ4FrameDecompressor().decompress(payload, size + 1)
        except (RuntimeError, EOFError) as error:
            raise DamageError.of("damage.chunk-not-unpacked", error=error) from error
    raise DamageError.of("damage.chunk-packed", packing=compression[:20])
