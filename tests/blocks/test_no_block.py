"""What is no block, or is in no room, or is written as neither a kind nor a file, is told in a sentence."""

import pytest

from baqueano.blocks import check, resolve, room_of
from baqueano.errors import FileError, UsageError


def test_a_class_that_fits_no_room_is_told_what_the_rooms_ask(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Block:\n    def step(self, state, world):\n        pass\n", encoding="utf-8"
    )
    with pytest.raises(
        FileError, match=r"mine\.py line 1 Block\.step\(state, world\) fits no room: expected"
    ):
        room_of(resolve("guide", "mine.py:Block", tmp_path))


def test_a_class_without_step_is_no_block(tmp_path):
    (tmp_path / "mine.py").write_text("class Block:\n    pass\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"Block has no step\(\): every block has init\(\) and step"):
        room_of(resolve("guide", "mine.py:Block", tmp_path))


def test_a_room_that_is_not_there_is_told():
    with pytest.raises(UsageError, match=r'no room "guides".*Did you mean guide\?'):
        resolve("guides", "repeat")


def test_a_kind_that_looks_like_a_file_is_told_how_to_write_it():
    with pytest.raises(FileError, match=r'A block of your own is written "file\.py:Class"'):
        resolve("guide", "mine.py")


def test_a_function_is_no_block():
    def step(state, estimate):
        return state, None

    sentences = check("guide", step)
    assert any("has no step()" in s for s in sentences)
