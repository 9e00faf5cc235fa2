"""An object that is not a block is refused, and so is an unknown name."""

from baqueano.block_checks import check
from baqueano.blocks import resolve, role_of
from baqueano.errors import FileError, UsageError
from tests.codes import refused


def test_a_class_with_unknown_step_arguments_is_not_a_block(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Block:\n    def step(self, state, world):\n        pass\n", encoding="utf-8"
    )
    with refused("block.no-role", FileError, block="Block", names="world"):
        role_of(resolve("guide", "mine.py:Block", tmp_path))


def test_a_class_without_step_is_not_a_block(tmp_path):
    (tmp_path / "mine.py").write_text("class Block:\n    pass\n", encoding="utf-8")
    with refused("block.no-step", FileError, block="Block"):
        role_of(resolve("guide", "mine.py:Block", tmp_path))


def test_an_unknown_kind_of_block_is_refused():
    with refused("block.role-unknown", UsageError, value="guides"):
        resolve("guides", "repeat")


def test_a_block_file_without_a_class_is_refused_with_advice():
    with refused("block.unknown", FileError):
        resolve("guide", "mine.py")


def test_a_function_is_not_a_block():
    def step(state, estimate):
        return state, None

    assert ("check.no-method", "step") in [
        (finding.code, finding.figures.get("name")) for finding in check("guide", step)
    ]
