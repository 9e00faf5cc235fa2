"""A file appears completely or not at all and replaces no other file, also on a file system without links."""

import os

import pytest

from baqueano.errors import FileError
from baqueano.runs.appearing import write_then_appear
from tests.codes import refused


def no_links(*paths, **options):
    raise PermissionError("this file system has no links")


@pytest.mark.parametrize("links", [True, False])
def test_a_file_appears_in_its_folder_only_after_it_is_complete(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr(os, "link", no_links)
    with write_then_appear(tmp_path / "a") as file:
        file.write(b"whole")
        assert not (tmp_path / "a").exists()
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"whole")]


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
