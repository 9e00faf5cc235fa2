"""A file appears completely or not at all and a new one replaces no other file, also on a file system without links."""

import errno
import os

import numpy as np
import pytest

from baqueano.atomic_file import replace_file, write_then_appear
from baqueano.errors import FileError
from baqueano.guides import shapes
from baqueano.report.page import save_text
from baqueano.report.tables import save_table
from baqueano.runs import Run, read_run, write_run
from baqueano.runs.route_file import write_route
from tests.codes import refused


def no_links(*paths, **options):
    raise PermissionError("links are not supported")


@pytest.mark.parametrize("links", [True, False])
def test_a_file_appears_in_its_folder_only_after_it_is_complete(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    with write_then_appear(tmp_path / "a") as file:
        file.write(b"whole")
        assert not (tmp_path / "a").exists()
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"whole")]


def test_an_error_contains_the_name_that_the_user_knows(tmp_path):
    with pytest.raises(OSError, match="absent") as error_info, write_then_appear(tmp_path / "absent" / "a"):
        pass
    assert error_info.value.filename == str(tmp_path / "absent" / "a")


def test_a_full_disk_is_reported_with_the_name_of_the_file(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space") as error_info:
        replace_file(tmp_path / "table.csv", "1,2")
    assert error_info.value.filename == str(tmp_path / "table.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("meanwhile", [True, False])
def test_an_existing_file_is_not_replaced(tmp_path, monkeypatch, links, meanwhile):
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    if not meanwhile:
        (tmp_path / "a").write_bytes(b"mine")

    def write():
        with write_then_appear(tmp_path / "a") as file:
            file.write(b"theirs")
            (tmp_path / "a").write_bytes(b"mine")

    with refused("runs.file-there", FileError):
        write()
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"mine")]


def test_lg10_an_incomplete_file_is_removed(tmp_path):
    def write():
        with write_then_appear(tmp_path / "a") as file:
            file.write(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "write",
    [
        lambda path, number: save_text(path, str(number)),
        lambda path, number: save_table([{"number": number}], path),
        lambda path, number: write_route(shapes.circle(number, 0.2), path),
    ],
    ids=["text", "table", "route"],
)
def test_two_writers_of_one_file_do_not_share_a_temporary_file(tmp_path, monkeypatch, write):
    """The second writer finishes before the first one gives its file its name."""
    path, replace = tmp_path / "a.csv", os.replace

    def write_another_first(old, new):
        monkeypatch.setattr(os, "replace", replace)
        write(path, 0.75)
        replace(old, new)

    write(path, 0.5)
    content = path.read_bytes()
    monkeypatch.setattr(os, "replace", write_another_first)
    write(path, 0.5)
    assert path.read_bytes() == content  # the last writer prevails, with its complete content
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_two_writers_of_one_run_do_not_share_a_temporary_file(tmp_path, monkeypatch):
    run, link = Run("still", None, np.arange(3), np.zeros((3, 1))), os.link
    longer = Run("still", None, np.arange(5), np.zeros((5, 1)))

    def write_another_first(old, new):
        monkeypatch.setattr(os, "link", link)
        write_run(longer, new)
        link(old, new)

    monkeypatch.setattr(os, "link", write_another_first)
    with refused("runs.file-there", FileError):
        write_run(run, tmp_path / "a.mcap")
    assert len(read_run(tmp_path / "a.mcap").t_ns) == 5
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_a_replaced_file_keeps_its_permissions(tmp_path):
    (tmp_path / "a").write_text("old")
    (tmp_path / "a").chmod(0o600)
    replace_file(tmp_path / "a", "new")
    assert ((tmp_path / "a").read_text(), (tmp_path / "a").stat().st_mode & 0o777) == ("new", 0o600)
