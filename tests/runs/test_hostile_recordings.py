"""Recordings and maps that would fill the memory or break the reader: each gives a message, and the memory is
limited.
"""

import bz2
import gzip
import struct
import tracemalloc

import pytest

from baqueano.errors import FileError
from baqueano.runs import import_run, read_run, recover, write_run
from baqueano.runs.container import memory_limit
from baqueano.runs.container.records import MAX_CHUNK_BYTES
from baqueano.runs.maps.column_map import load_map
from baqueano.runs.route_file import read_route
from baqueano.runs.tables.lines import MAX_LINE_LETTERS
from tests.codes import includes, refused
from tests.memory import memory_trace

MAP = """
format = 1
[files.log]
path = "FILE"
rate_hz = 50.0
[command]
names = ["u"]
in_force = "from"
u = [{ column = "a", unit = "1" }]
[sensors.odometer]
z = [{ column = "b", unit = "m/s" }]
"""
ROWS = b"0.10,0.25\n0.20,0.50\n0.30,0.75\n0.40,1.00\n"


LONG_LINE = "table.long-line", {"line": 1, "maximum": MAX_LINE_LETTERS}


def refusal(tmp_path, data, name="log.csv"):
    """Return the error of the import of a file, and check its memory use."""
    path = tmp_path / name
    path.write_bytes(data)
    (tmp_path / "log.toml").write_text(MAP.replace("FILE", name), encoding="utf-8")
    with memory_trace():
        with pytest.raises(FileError) as error_info:
            import_run(tmp_path / "log.toml")
        assert tracemalloc.get_traced_memory()[1] <= memory_limit.limit_bytes(len(data))
    assert "\n" not in str(error_info.value)
    assert len(str(error_info.value)) < 1000
    return error_info.value.diagnostic


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a,b\n1," + b"2" * 200_000 + b"\n", ("table.long-cell", {"line": 2, "maximum": 131072})),
        (b'a,b\n1,"2\n' + ROWS * 5000, ("table.long-cell", {"maximum": 131072})),
        (lambda: b",".join(b"%d" % k for k in range(1_000_000)) + b"\n", LONG_LINE),  # not at the import
        (b",".join(b"c%d" % k for k in range(20_000)) + b"\n", ("table.columns", {"count": 20000, "maximum": 10000})),
        (b",".join(b"c%d" % k for k in range(900)) + b"\n" + b"1," * 899 + b"1\n", ("table.no-column", {})),
        (b"1" * 3_000_000, LONG_LINE),
        (b"a,b\n" + ROWS + b"1,\0\n" + ROWS, ("table.zero-bytes-in-line", {"line": 6})),
        (b"a,b\n" + ROWS * 300 + bytes(3_000_000), ("table.zero-bytes-in-line", {"line": 1202})),
        (bytes(100_000), ("table.zero-bytes-in-line", {"line": 1})),
        (b"a,b\n" + b'"\n' * 50_000 + b'x"y\n', ("table.uneven", {"line": 3, "value": 1, "expected": 2})),
        (b"PK\x03\x04" + bytes(50), ("table.zip", {"file": "log.csv"})),
    ],
)  # fmt: skip
def test_a_malformed_csv_gives_a_message(tmp_path, data, message):
    code, figures = message
    reason = refusal(tmp_path, data() if callable(data) else data)
    assert includes(reason, code, **figures), reason
    if code == "table.no-column":
        assert reason.figures["valid"].endswith("'c29', …"), "not all 900 names are listed"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"a,b\n" + b"0,0\n" * 75_000, ("table.too-large", {"maximum": "8.39 MB"})),
        (b"a,b\n0,0\n" + b"\n" * 375_000, ("table.too-large", {"maximum": "8.39 MB"})),
        (b"0" * 20_000_000, LONG_LINE),
        (b'a,b\n"' + b"0\n" * 10_000_000, ("table.long-cell", {"maximum": 131072})),
        (bytes(20_000_000), ("table.zero-bytes-in-line", {"line": 1})),
    ],
)
def test_a_compressed_csv_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch, text, message):
    code, figures = message
    if code == "table.too-large":  # the route below has the limit of the package
        monkeypatch.setattr(memory_limit, "MIN_BYTES", 8 * 2**20)
    reason = refusal(tmp_path, gzip.compress(text), "log.csv.gz")
    assert includes(reason, code, **figures), reason
    assert reason.fix == ("gunzip -k log.csv.gz" if code == "table.too-large" else "")


def test_a_compressed_recording_of_normal_size_is_read_within_its_memory(tmp_path):
    text = b"a,b\n" + b"".join(b"%.5f,%.5f\n" % (k % 97 / 100, k % 89 / 50) for k in range(40_000))
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(text))
    (tmp_path / "log.toml").write_text(MAP.replace("FILE", "log.csv.gz"), encoding="utf-8")
    with memory_trace():
        assert len(import_run(tmp_path / "log.toml").run.t_ns) == 39_999
        assert tracemalloc.get_traced_memory()[1] < 16 * len(text)


def test_cells_with_line_breaks_or_unicode_are_read_unchanged(tmp_path):
    rows = 'a,b,note\n0.1,1.0,"two\nlines"\n0.2,2.0,ñ€😀\n0.3,3.0,\n0.4,4.0,x\n'
    (tmp_path / "log.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "log.toml").write_text(
        MAP.replace("FILE", "log.csv") + '[files.log.where]\nnote = { not = "" }\n', encoding="utf-8"
    )
    assert import_run(tmp_path / "log.toml").run.sensors["odometer"].z.ravel().tolist() == [1.0, 2.0, 4.0]


def test_a_route_that_would_fill_the_memory_is_refused(tmp_path):
    path = tmp_path / "route.csv"
    path.write_bytes(gzip.compress(b"# closed = true\nt_s,x_m\n" + b"0,0\n" * 600_000))
    with refused("table.too-large", FileError):
        read_route(path)
    path.write_bytes(b"# closed = true\n" + bytes(2_000_000))
    with refused("table.zero-bytes-in-line", FileError, line=2):
        read_route(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format = " + "[" * 100_000 + "]" * 100_000, "nests its values too deeply"),
        ("a = " + "{a = " * 100_000 + "1" + "}" * 100_000, "nests its values too deeply"),
        (".".join("a" * 100_000) + " = 1", "line 1: this key has more than 32 parts"),
        ("[" + ".".join("a" * 100_000) + "]", "line 1: this key has more than 32 parts"),
        ("format = " + "1" * 5000, "contains a number that cannot be read"),
        ('format = "' + "x" * 500_000 + '"', "map.toml format = 'xxx"),
    ],
)
def test_a_malformed_map_gives_a_message(tmp_path, text, message):
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    with pytest.raises(FileError) as error_info:
        load_map(tmp_path / "map.toml")
    assert message in str(error_info.value)
    assert len(str(error_info.value)) < 1000


def test_a_recording_of_numbers_and_spaces_is_not_accepted_as_a_map(tmp_path):
    (tmp_path / "log.txt").write_text("0.1 0.2 " * 5000, encoding="utf-8")
    with refused("map.recording", FileError):
        load_map(tmp_path / "log.txt")


def test_a_run_with_a_deeply_nested_vehicle_file_is_recovered(run, tmp_path):
    object.__setattr__(run, "vehicle_text", "a = " + "[" * 100_000)
    path = write_run(run, tmp_path / "x.mcap")
    assert read_run(recover(path).path) == run


def ros1(compression, payload):
    def part(name, value):
        return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value

    head = (
        part(b"op", b"\5") + part(b"compression", compression) + part(b"size", struct.pack("<I", 2**31 - 1))
    )
    return b"#ROSBAG V2.0\n" + struct.pack("<I", len(head)) + head + struct.pack("<I", len(payload)) + payload


def mcap(compression, payload):
    body = (
        struct.pack("<QQQII", 0, 0, 2**31, 0, len(compression))
        + compression
        + struct.pack("<Q", len(payload))
    )
    return b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(body) + len(payload)) + body + payload


@pytest.mark.parametrize(
    ("name", "write", "compression"),
    [("x.bag", ros1, b"bz2"), ("x.bag", ros1, b"lz4"), ("x.mcap", mcap, b"lz4"), ("x.mcap", mcap, b"zstd")],
)
def test_a_chunk_of_a_bag_that_would_fill_the_memory_is_refused(tmp_path, name, write, compression):
    import lz4.frame
    import zstandard

    pack = {b"bz2": bz2.compress, b"lz4": lz4.frame.compress, b"zstd": zstandard.ZstdCompressor().compress}
    data = write(compression, pack[compression](bytes(MAX_CHUNK_BYTES + 2**20)))
    path = tmp_path / name
    path.write_bytes(data)
    text = MAP.replace('path = "FILE"\nrate_hz = 50.0', f'path = "{name}"\ntopic = "/x"\ntime = "bag"')
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    with refused("bag.chunk", FileError, file=name, largest="67.1 MB"):
        import_run(tmp_path / "x.toml")
