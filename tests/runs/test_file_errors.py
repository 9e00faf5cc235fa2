"""Files that are not runs: one paragraph each, with the file, its type and a remedy."""

import pytest
from mcap.writer import Writer

from baqueano.errors import FileError
from baqueano.runs import read_run, write_run
from baqueano.runs.container.records import MAGIC
from tests.codes import refused


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (b"", "runs.empty"),
        (MAGIC[:5], "runs.cut-at-once"),
        (b"#ROSBAG V2.0\n", "runs.is-ros-1"),
        (b"SQLite format 3\0", "runs.is-sqlite"),
        (b"\x89HDF\r\n", "runs.is-hdf5"),
        (b"MATLAB 5.0", "runs.is-matlab"),
        (b"PK\x03\x04", "runs.is-zip"),
        (b"\x1f\x8b\x08", "runs.is-gzip"),
        (b"ULog\x01", "runs.is-ulog"),
        (b"t,u\n0,1\n", "runs.is-text"),
        (b" \n", "runs.is-text"),
        (bytes(100), "runs.is-bytes"),
    ],
)
def test_a_file_of_another_format_is_reported_with_its_format(tmp_path, data, code):
    path = tmp_path / "x.mcap"
    path.write_bytes(data)
    with refused(code, FileError, path=str(path)) as error_info:
        read_run(path)
    assert error_info.value.exit_code == 3


def test_a_missing_file_or_a_folder_is_reported(tmp_path):
    with refused("runs.absent", FileError):
        read_run(tmp_path / "x.mcap")
    with refused("runs.folder", FileError):
        read_run(tmp_path)


def test_an_unreadable_file_is_reported(tmp_path, monkeypatch):
    from pathlib import Path

    def refuse(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with refused("runs.not-read", FileError):
        read_run(tmp_path / "x.mcap")


def foreign(path, topic="/scan", data=None, size=None):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        if data is not None:
            schema = writer.register_schema("baqueano_msgs/msg/Command", "ros2msg", b"")
            channel = writer.register_channel(topic, "cdr", schema, {"size": size} if size else {})
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    return path


def test_an_mcap_file_of_another_program_is_reported(tmp_path):
    with refused("runs.not-ours", FileError, topics="/scan"):
        read_run(foreign(tmp_path / "a.mcap", data=b"abc"))
    with refused("runs.no-message", FileError):
        read_run(foreign(tmp_path / "b.mcap"))


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (None, ("damage.channel-size", {})),
        ("x", ("damage.channel-size", {})),
        ("2", ("damage.message-bytes", {"bytes": 52})),
    ],
)
def test_an_invalid_baqueano_topic_of_another_program_is_reported(tmp_path, size, message):
    with refused(message[0], FileError, **message[1]):
        read_run(foreign(tmp_path / "a.mcap", "/command/applied", b"abc", size))


def test_a_run_cut_before_its_first_chunk_is_an_error(run, tmp_path):
    path = write_run(run, tmp_path / "x.mcap")
    path.write_bytes(path.read_bytes()[:600])
    with refused("runs.nothing-saved", FileError):
        read_run(path)
