"""Recorded data survive killed programs, truncated files, flipped bits, full disks and hostile files."""

import errno
import os
import random
import signal
import struct
import subprocess
import sys
import textwrap
import time
import zlib

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from baqueano.errors import FileError
from baqueano.messages.printable import baqueano_command
from baqueano.runs import RunWriter, read_run, recover, write_run
from baqueano.runs.container import records as mcap_records, writer
from baqueano.runs.container.run_file import RunFile
from baqueano.signals import Estimate, Slot, Tick, sensor_slots
from tests.codes import refused
from tests.runs.conftest import make_record

WRITING = """
    import sys, time
    from types import SimpleNamespace
    import numpy as np
    from baqueano.runs import RunWriter
    from baqueano.signals import Slot, Tick, sensor_slots

    slots = sensor_slots(("imu",))
    with RunWriter(sys.argv[1], "name = 'x'", {"seed": "1"}) as writer:
        while True:
            t_ns = time.time_ns()
            tick = Tick(t_ns, np.zeros(2), slots(Slot(1.0, np.ones(3))))
            writer.record(
                SimpleNamespace(tick=tick, requested_command=None, sent_command=None, estimate=None, reference=None)
            )
            print(t_ns, flush=True)
            time.sleep(0.005)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kill -9 is of POSIX")
def test_lg1_kill_9_loses_at_most_one_second(tmp_path):
    """Four programs are killed at different moments of their half-second cycle."""
    paths = [tmp_path / f"{k}.mcap" for k in range(4)]
    command = [sys.executable, "-c", textwrap.dedent(WRITING)]
    running = [subprocess.Popen([*command, str(p)], stdout=subprocess.PIPE, text=True) for p in paths]
    for k, program in enumerate(running):
        assert program.stdout is not None
        assert program.stdout.readline()  # the writer has started
        time.sleep(0.9 if k == 0 else 0.17)
        program.kill()
    for program, path in zip(running, paths, strict=True):
        numbers = [int(line) for line in program.communicate()[0].split()]
        run = read_run(path)
        loss_s = (numbers[-1] - run.t_ns[-1]) * 1e-9
        assert loss_s <= 1.0
        assert run.notes[0].code == "run.not-closed"
        assert run.metadata["seed"] == "1"


def fewer(run, full_run):
    """Return True if all data of `run` are part of `full_run`."""
    index = np.searchsorted(full_run.t_ns, run.t_ns)
    assert np.array_equal(full_run.t_ns[index], run.t_ns)
    assert full_run.applied_commands[index].tobytes() == run.applied_commands.tobytes()
    assert set(run.sensors) <= set(full_run.sensors)
    for name, channel in run.sensors.items():
        rows = np.searchsorted(full_run.sensors[name].t_ns, channel.t_ns)
        assert all(
            a[rows].tobytes() == b.tobytes() for a, b in zip(full_run.sensors[name], channel, strict=True)
        )
    for name in ("estimate", "reference", "truth"):
        log, all_of_it = getattr(run, name), getattr(full_run, name)
        if log is not None:
            rows = np.searchsorted(all_of_it.t_ns, log.t_ns)
            assert all(a[rows].tobytes() == b.tobytes() for a, b in zip(all_of_it, log, strict=True))
    assert set(run.events) <= set(full_run.events)
    assert run.vehicle_text in ("", full_run.vehicle_text)
    assert run.metadata in ({}, full_run.metadata)


@pytest.fixture
def chunked_files(make_run, tmp_path, monkeypatch):
    """Return a run of 60 ticks in several chunks, and the bytes of its file."""
    monkeypatch.setattr("baqueano.runs.container.run_file.CHUNK_BYTES", 8000)
    run = make_run(N=60)
    return run, write_run(run, tmp_path / "0001-test.mcap").read_bytes()


def test_lg5_a_file_cut_anywhere_gives_every_complete_chunk_or_an_error(chunked_files, tmp_path):
    file, data = chunked_files
    path, run_lengths, refusals = tmp_path / "cut.mcap", [], []
    for size in [*range(0, len(data), 97), *range(len(data) - 300, len(data))]:
        path.write_bytes(data[:size])
        try:
            run = read_run(path)
        except FileError as error:
            refusals.append(str(error))
            run_lengths.append(0)
            continue
        assert run.notes
        fewer(run, file)
        run_lengths.append(len(run.t_ns))
    assert not any("\n" in text for text in refusals)
    assert run_lengths == sorted(run_lengths)
    assert run_lengths[-1] == 60
    assert len(set(run_lengths)) > 5


def test_lg4_a_flipped_bit_never_gives_a_silently_wrong_run(chunked_files, tmp_path):
    file, data = chunked_files
    path, pick = tmp_path / "flipped.mcap", random.Random(5)
    for trial in range(700):
        index, bit = pick.randrange(len(data)), 1 << pick.randrange(8)
        end = len(data) if trial % 2 else pick.randrange(index + 1, len(data) + 1)  # half of them cut as well
        flipped_data = bytearray(data[:end])
        flipped_data[index] ^= bit
        path.write_bytes(flipped_data)
        try:
            run = read_run(path)
        except FileError:
            continue
        assert run.notes, (index, bit, end)
        fewer(run, file)


def test_lg4_one_damaged_chunk_does_not_lose_other_chunks(chunked_files, tmp_path):
    file, data = chunked_files
    signs = [i - 37 for i in range(len(data)) if data.startswith(b"\x04\0\0\0zstd", i) and data[i - 37] == 6]
    path = tmp_path / "damaged.mcap"
    for place in (37 + 20, 1, 0, 30):  # contents, size, kind, checksum
        damaged_data = bytearray(data)
        damaged_data[signs[2] + place] ^= 0x40
        path.write_bytes(damaged_data)
        run = read_run(path)
        fewer(run, file)
        # the checksum still identifies a chunk of a different type
        assert 40 <= len(run.t_ns) < 60 or place == 0
        assert run.notes[-1].code == "run.damaged"


def test_recover_writes_the_recovered_data_to_a_new_file(chunked_files, tmp_path):
    file, data = chunked_files
    cut = tmp_path / "0001-test-cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    recovery = recover(cut)
    assert recovery.path == tmp_path / "0001-test-cut-recovered.mcap"
    assert recovery.notes[0].code == "run.not-closed"
    saved_run = read_run(recovery.path)
    assert saved_run.notes == ()
    assert saved_run.metadata == file.metadata | {"recovered_from": "0001-test-cut.mcap"}
    assert saved_run.applied_commands.tobytes() == file.applied_commands[: len(saved_run.t_ns)].tobytes()
    assert cut.read_bytes() == data[: len(data) // 2]


def mcap(path, chunk):
    """Return a file with one chunk record of these bytes."""
    with path.open("wb") as stream:
        w = Writer(stream)
        w.start(profile="ros2")
        stream.write(struct.pack("<BQ", 6, len(chunk)) + chunk)
        w.finish()
    return path


def chunk(records, size, compression, payload):
    head = struct.pack("<QQQI", 0, 0, size, zlib.crc32(records))
    return (
        head + struct.pack("<I", len(compression)) + compression + struct.pack("<Q", len(payload)) + payload
    )


@pytest.mark.parametrize("compression", [b"zstd", b"lz4"])
@pytest.mark.parametrize("message", ["truth", "little"])
def test_lg6_a_chunk_that_would_fill_the_memory_is_refused(tmp_path, compression, message):
    import lz4.frame
    import zstandard

    data = bytes(300 * 2**20)
    payload = zstandard.ZstdCompressor(write_content_size=message == "truth").compress(data)
    payload = payload if compression == b"zstd" else lz4.frame.compress(data)
    del data
    path = mcap(
        tmp_path / "bomb.mcap", chunk(b"", 300 * 2**20 if message == "truth" else 1000, compression, payload)
    )
    start_s = time.process_time()
    with refused("runs.nothing-saved", FileError):
        read_run(path)
    assert time.process_time() - start_s < 1.0


@pytest.mark.parametrize(
    ("records", "compression", "payload", "message"),
    [
        (b"\x05", b"", b"\x05", ("runs.nothing-saved", {})),
        (struct.pack("<BQ", 5, 99), b"", None, ("runs.nothing-saved", {})),
        (struct.pack("<BQ", 5, 3) + b"abc", b"", None, ("runs.nothing-saved", {})),
        (b"abc", b"snappy", None, ("runs.nothing-saved", {})),
        (b"abc", b"zstd", b"abc", ("runs.nothing-saved", {})),
        (b"abc", b"lz4", b"abc", ("runs.nothing-saved", {})),
        (b"abc", b"lz4", bytes(40), ("runs.nothing-saved", {})),
    ],
)
def test_an_invalid_chunk_is_named(tmp_path, records, compression, payload, message):
    data = chunk(records, len(records), compression, records if payload is None else payload)
    with refused(message[0], FileError, **message[1]):
        read_run(mcap(tmp_path / "x.mcap", data))


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.NONE])
def test_runs_rewritten_by_other_programs_are_read(run, tmp_path, compression):
    """A run that another tool has written anew."""
    from mcap.reader import make_reader

    source, path = write_run(run, tmp_path / "a.mcap"), tmp_path / "b.mcap"
    with source.open("rb") as stream, path.open("wb") as out:
        reader, w = make_reader(stream), Writer(out, compression=compression)
        w.start(profile="ros2")
        (metadata,) = reader.iter_metadata()
        w.add_metadata(metadata.name, metadata.metadata)
        (text,) = reader.iter_attachments()
        w.add_attachment(0, 0, text.name, text.media_type, text.data)
        ids = {}
        for schema, channel, m in reader.iter_messages():
            if channel.id not in ids:
                new = w.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = w.register_channel(channel.topic, "cdr", new, channel.metadata)
            w.add_message(ids[channel.id], m.log_time, m.data, m.publish_time)
        w.finish()
    read_back = read_run(path)
    assert read_back.notes == ()
    assert set(read_back.sensors) == set(run.sensors)
    fewer(read_back, run)
    assert len(read_back.t_ns) == len(run.t_ns)


def record_one(run_writer, t_ns):
    tick = Tick(t_ns, np.zeros(1), sensor_slots(("a",))(Slot(1.0, np.zeros(1))))
    run_writer.record(make_record(tick))


def test_rt16_a_full_disk_is_reported_only_at_the_end(tmp_path, monkeypatch):
    path = tmp_path / "x.mcap"
    run_writer, deadline = RunWriter(path), time.monotonic() + 10.0
    record_one(run_writer, 5)
    while run_writer._queue and time.monotonic() < deadline:
        time.sleep(0.01)
    run_writer._file.close_chunk()
    monkeypatch.setattr(RunFile, "close_chunk", raising(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    while run_writer.failure is None and time.monotonic() < deadline:
        time.sleep(0.01)
    record_one(run_writer, 10)
    with refused("runs.disk-full", FileError) as error:
        run_writer.close()
    assert error.value.diagnostic.fix == baqueano_command("runs", "recover", path), (
        "with the folder of the run"
    )
    assert read_run(path).t_ns.tolist() == [5]


@pytest.mark.skipif(os.name != "posix", reason="a limit of the size of files is of POSIX")
@pytest.mark.parametrize(
    ("code", "free_bytes", "keeps_run"),
    [("runs.disk-full", 1000, True), ("runs.disk-full-at-start", 0, False)],
)
def test_a_disk_that_is_full_at_closing_keeps_what_it_has_of_a_run(tmp_path, code, free_bytes, keeps_run):
    import resource

    path = tmp_path / "x.mcap"
    run_writer = RunWriter(path)
    record_one(run_writer, 5)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (free_bytes, hard))
    try:
        with refused(code, FileError):
            run_writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.exists() == keeps_run


def raising(error):
    def fail(*_, **__):
        raise error

    return fail


def test_lg3_a_stalled_disk_drops_estimates_first_and_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MAX_QUEUED_MESSAGES", 10)
    monkeypatch.setattr(writer, "WRITE_PERIOD_S", 60.0)  # the writer thread sleeps during this time
    path = tmp_path / "x.mcap"
    with RunWriter(path, live=True) as run_writer:
        for k in range(50):
            tick = Tick(k, np.zeros(1), sensor_slots(("a",))(Slot(1.0, np.zeros(1))))
            estimate = Estimate(k, np.zeros(3), np.zeros(3), np.eye(6))
            run_writer.record(make_record(tick, estimate=estimate))
    run = read_run(path)
    assert len(run.t_ns) == 50
    assert len(run.sensors["a"].t_ns) == 50
    assert 0 < len(run.estimate.t_ns) < 50
    slow = run.events[-1].diagnostic
    assert slow.code == "run.disk-slow"
    assert slow.figures["records"] >= 50 - len(run.estimate.t_ns), "estimates, references and poses"


def test_a_simulation_waits_for_a_slow_disk_and_loses_no_data(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MAX_QUEUED_MESSAGES", 10)
    monkeypatch.setattr(writer, "WRITE_PERIOD_S", 0.001)
    path = tmp_path / "x.mcap"
    with RunWriter(path) as run_writer:
        for k in range(500):
            record_one(run_writer, k)
    assert len(read_run(path).t_ns) == 500
    assert run_writer.dropped == 0


def test_a_system_without_fdatasync_writes_runs_too(run, tmp_path, monkeypatch):
    monkeypatch.delattr(os, "fdatasync", raising=False)
    path = tmp_path / "x.mcap"
    with RunWriter(path) as run_writer:
        record_one(run_writer, 5)
        run_writer._file.close_chunk()
    assert read_run(path).t_ns.tolist() == [5]
    assert read_run(write_run(run, tmp_path / "y.mcap")) == run


def test_a_crash_while_a_whole_run_is_written_leaves_no_file(run, tmp_path, monkeypatch):
    monkeypatch.setattr(RunFile, "finish", raising(OSError(errno.ENOSPC, "full")))
    with refused("runs.not-written", FileError):
        write_run(run, tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_record_longer_than_the_file_ends_the_reading():
    data = mcap_records.MAGIC + struct.pack("<BQ", 6, 2**60) + bytes(100)
    scan = mcap_records.scan(data)
    assert not scan.is_complete
    assert scan.messages == {}
