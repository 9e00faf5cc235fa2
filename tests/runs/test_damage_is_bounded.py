"""Reading a damaged or hostile run needs no more time than an intact run, and no more memory than its size permits."""

import random
import struct
import tracemalloc
import zlib
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from mcap.writer import CompressionType, Writer

from baqueano.errors import FileError
from baqueano.runs import Channel, Run, read_run, recover, write_run
from baqueano.runs.container import memory_limit, messages, records as mcap_records
from baqueano.runs.container.records import CHUNK, MAGIC, METADATA
from tests.codes import refused
from tests.memory import memory_trace

SIZE = 200_000


class InChunks(NamedTuple):
    """The bytes of a run, and start and end of its chunks."""

    data: bytes
    chunks: list

    def __repr__(self):
        return f"{len(self.chunks)} chunks"


class CountedBytes(bytes):
    """Bytes that count how many of them were searched."""

    search_count = 0

    def find(self, sub, start=0):
        place = super().find(sub, start)
        self.search_count += (place if place >= 0 else len(self)) - start
        return place


def record(kind, body=b"", size=None):
    return struct.pack("<BQ", kind, len(body) if size is None else size) + body


def chunks_in_chunks(size):
    """Return chunks that each begin 60 bytes after their outer chunk and end with it."""
    k = range(size - size % 60, 0, -60)
    return b"".join(
        record(CHUNK, bytes(28) + b"\x04\0\0\0zstd" + struct.pack("<Q", n - 53) + bytes(7), n - 9) for n in k
    )


FILLINGS = {
    "zeros": lambda n: bytes(n),
    "ones": lambda n: b"\xff" * n,
    "random": lambda n: random.Random(3).randbytes(n),
    "unknown records": lambda n: record(200) * (n // 9),
    "records that are too short": lambda n: record(METADATA) * (n // 9),
    "records of nonsense": lambda n: record(METADATA, b"\xff" * 8) * (n // 17),
    "a good one, a bad one": lambda n: (record(7) + record(77)) * (n // 18),
    "ends of the data": lambda n: record(15, b"\1\0\0\0") * (n // 13),
    "ends of the file": lambda n: record(2, struct.pack("<QQI", 20, 1, 1)) * (n // 29),
    "signatures": lambda n: b"\x04\0\0\0zstd" * (n // 8),
    "heads of chunks": lambda n: (record(CHUNK, b"", n) + bytes(28) + b"\x04\0\0\0zstd") * (n // 45),
    "chunks in chunks": chunks_in_chunks,
}


@pytest.fixture(scope="module")
def chunked_file(tmp_path_factory):
    """Return the bytes of a run of 60 ticks, and start and end of its chunks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("baqueano.runs.container.run_file.CHUNK_BYTES", 2000)
        t_ns = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(60)
        u = np.random.default_rng(4).normal(size=(60, 30))
        path = write_run(Run("x", None, t_ns, u), tmp_path_factory.mktemp("x") / "x.mcap")
    data, place, chunks = path.read_bytes(), len(MAGIC), []
    while place < len(data) - len(MAGIC):
        kind, size = struct.unpack_from("<BQ", data, place)
        if kind == CHUNK:
            chunks.append((place, place + 9 + size))
        place += 9 + size
    return InChunks(data, chunks)


@pytest.mark.parametrize("place", ["end", "middle", "alone"])
@pytest.mark.parametrize("fill", FILLINGS)
def test_the_reading_time_grows_linearly_with_the_damaged_bytes(chunked_file, monkeypatch, fill, place):
    data, chunks = chunked_file
    cut = chunks[len(chunks) // 2][1]
    records, checked_sizes, crc32 = [], [], zlib.crc32
    step = mcap_records._RecordReader.record
    monkeypatch.setattr(
        mcap_records._RecordReader,
        "record",
        lambda walk, position: records.append(position) or step(walk, position),
    )
    monkeypatch.setattr(
        mcap_records, "zlib", type("_", (), {"crc32": lambda b: checked_sizes.append(len(b)) or crc32(b)})
    )
    before, after = {"end": (data[:cut], b""), "middle": (data[:cut], data[cut:]), "alone": (MAGIC, b"")}[
        place
    ]
    damaged_bytes = CountedBytes(before + FILLINGS[fill](SIZE) + after)
    scan = mcap_records.scan(damaged_bytes)
    assert damaged_bytes.search_count <= 2 * len(damaged_bytes)
    assert len(records) <= len(damaged_bytes) // 8 + 1
    assert sum(checked_sizes) <= 4 * mcap_records.SEARCH_FACTOR * len(damaged_bytes)
    assert len(scan.problems) <= mcap_records.MAX_REPORTED_DAMAGES
    assert (place != "alone") == bool(scan.messages)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    position=st.floats(0.0, 1.0),
    size=st.integers(1, 5000),
    fill=st.sampled_from(["zeros", "ones", "random", "put between", "taken out"]),
)
def test_damage_loses_only_the_damaged_chunks(chunked_file, position, size, fill):
    data, chunks = chunked_file
    position = chunks[0][1] + int(position * (len(data) - chunks[0][1]))  # the first chunk names the topics
    if fill == "put between":
        end, damaged_bytes = position, data[:position] + random.Random(size).randbytes(size) + data[position:]
    elif fill == "taken out":
        end, damaged_bytes = position + size, data[:position] + data[position + size :]
    else:
        end = min(position + size, len(data))
        damaged_bytes = data[:position] + FILLINGS[fill](end - position) + data[end:]
    scan, expected = mcap_records.scan(damaged_bytes), mcap_records.scan(data)
    (key,) = expected.messages
    times = set(scan.messages[key].t_ns)
    for start, stop in chunks:
        if stop <= position or start >= end:
            original = mcap_records.scan(MAGIC + data[start:stop]).messages[key]
            assert set(original.t_ns) <= times
    assert list(scan.messages[key].t_ns) == sorted(times)
    assert times <= set(expected.messages[key].t_ns)


def test_zeros_at_the_file_end_are_reported_as_one_damaged_place(chunked_file, tmp_path):
    data, chunks = chunked_file
    path = tmp_path / "0001-cut.mcap"
    path.write_bytes(data[: chunks[-1][1]] + bytes(300_000))
    recovery = recover(path)
    assert len(recovery.run.t_ns) == 60
    cut = chunks[-1][1]
    (place,) = (note.figures["places"].figures for note in recovery.notes if note.code == "run.damaged")
    assert (place["first"], place["last"]) == (cut, cut + 300_000 // 9 * 9)
    assert read_run(recovery.path).notes == ()


def written_file(path, fill, chunk_size=2**18, compression=CompressionType.ZSTD):
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=chunk_size)
        writer.start(profile="ros2")
        schema = writer.register_schema("baqueano_msgs/msg/Command", "ros2msg", b"")
        fill(writer, lambda topic, size: writer.register_channel(topic, "cdr", schema, {"size": str(size)}))
        writer.finish()
    return path


def commands(count, size):
    """Return a function that writes commands with equal timestamps, which are compressed to a thousandth."""
    data = messages.command_layout(size).pack(1, size, *[0.0] * size)

    def fill(writer, channel):
        applied_channel = channel("/command/applied", size)
        for _ in range(count):
            writer.add_message(applied_channel, 1, data, 1)

    return fill


def events(count, text):
    data = messages.pack_log(1, 10, text, text)

    def fill(writer, channel):
        commands(3, 1)(writer, channel)
        log = channel("/events", "")
        for _ in range(count):
            writer.add_message(log, 1, data, 1)

    return fill


def estimates(writer, channel):
    commands(3, 1)(writer, channel)
    channel("/estimate", 2000)
    estimate_topic, data = (
        channel("/estimate", "none"),
        messages.estimate_layout(None).pack(1, *[0.0] * 42, 0, 0, 0),
    )
    for k in range(100):
        writer.add_message(estimate_topic, k, data, k)


def topics(writer, channel):
    commands(3, 1)(writer, channel)
    for k in range(1500):
        channel(f"/sensors/s{k}", 1)


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
@pytest.mark.parametrize(
    ("fill", "chunk_size", "message"),
    [
        (commands(9000, 1000), 2**18, ("runs.unpacks-too-much", {})),
        (commands(6000, 1000), 2**26, ("runs.unpacks-too-much", {})),
        (events(30_000, "a" * 300 + "\N{GRINNING FACE}"), 2**18, ("damage.memory", {})),
        (estimates, 2**18, ("damage.memory", {"size": "3.2 GB"})),
        (topics, 2**18, ("runs.topics", {"count": 1501, "maximum": 1000})),
    ],
)
def test_lg6_a_file_that_unpacks_to_too_much_is_refused(tmp_path, fill, chunk_size, message, compression):
    path = written_file(tmp_path / "bomb.mcap", fill, chunk_size, compression)
    with memory_trace():
        with refused(message[0], FileError, **message[1]) as error_info:
            read_run(path)
        peak = tracemalloc.get_traced_memory()[1]
    assert peak <= 1.1 * memory_limit.limit_bytes(path.stat().st_size)
    assert "\n" not in str(error_info.value)
    assert "mcap decompress" in str(error_info.value) or "draft_map(" in str(error_info.value)


def test_a_long_run_at_rest_is_read_and_recovered_within_its_memory(tmp_path, monkeypatch):
    """All its signals are zero, so it is compressed more than the run of a moving vehicle."""
    monkeypatch.setattr(memory_limit, "MIN_BYTES", 0)
    t_ns, zeros = 1 + 10_000_000 * np.arange(3000), np.zeros((3000, 3))
    sensors = {"imu": Channel(t_ns, t_ns, zeros), "odometer": Channel(t_ns, t_ns, zeros[:, :1])}
    run = Run("rest", None, t_ns, zeros, requested_commands=zeros, sensors=sensors, sent_commands=zeros)
    path = write_run(run, tmp_path / "rest.mcap")
    with memory_trace():
        assert recover(path).run == run
        peak = tracemalloc.get_traced_memory()[1]
    assert peak <= memory_limit.BYTES_PER_FILE_BYTE * path.stat().st_size
    assert recover(path, tmp_path / "again.mcap").run == run


def test_a_file_larger_than_the_limit_is_not_read(tmp_path):
    path = tmp_path / "large.mcap"
    with path.open("wb") as stream:
        stream.truncate(2**30)
    with refused("runs.too-large", FileError, largest="537 MB", size="1.07 GB"):
        read_run(path)


@pytest.mark.parametrize("size", ["", "x", "-1", "+3", "1" * 5000, "99999"])
def test_a_channel_with_an_invalid_size_is_reported(tmp_path, size):
    def fill(writer, channel):
        commands(3, 1)(writer, channel)
        channel("/estimate", size)

    with refused("damage.channel-size", FileError):
        read_run(written_file(tmp_path / "x.mcap", fill))


def test_a_time_beyond_64_bits_is_reported(tmp_path):
    def fill(writer, channel):
        data = messages.command_layout(1).pack(1, 1, 0.0)
        writer.add_message(channel("/command/applied", 1), 2**64 - 1, data, 1)

    with refused("damage.times", FileError):
        read_run(written_file(tmp_path / "x.mcap", fill))
