"""An object that is not a block is refused, and so is an unknown name."""

import pytest

from baqueano.block_checks import check
from baqueano.blocks import check_role, infer_role, resolve
from baqueano.contracts.blocks import STEP_INPUTS
from baqueano.errors import FileError, UsageError
from baqueano.vehicle_file import load
from tests.codes import includes, refused

from .students import GUIDE, findings_about


def test_a_class_with_unknown_step_arguments_is_not_a_block(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Block:\n    def step(self, state, world):\n        pass\n", encoding="utf-8"
    )
    with refused("block.no-role", FileError, block="Block", names="world"):
        infer_role(resolve("guide", "mine.py:Block", tmp_path))


def test_a_class_without_step_is_not_a_block(tmp_path):
    (tmp_path / "mine.py").write_text("class Block:\n    pass\n", encoding="utf-8")
    with refused("block.no-step", FileError, block="Block"):
        infer_role(resolve("guide", "mine.py:Block", tmp_path))


@pytest.mark.parametrize(("decorator", "inputs"), [("", "reference, estimate"), ("@staticmethod", "tick")])
def test_a_step_without_self_is_not_taken_for_another_block(tmp_path, decorator, inputs):
    """Before, a controller without self was checked as a guide."""
    step = f"    {decorator}\n    def step(state, {inputs}):\n        pass\n"
    (tmp_path / "mine.py").write_text(f"class Block:\n{step}", encoding="utf-8")
    with refused("block.step-without-self", FileError, block="Block", names=f"state, {inputs}"):
        infer_role(resolve("guide", "mine.py:Block", tmp_path))


def test_the_source_of_a_block_is_searched_only_for_an_error(monkeypatch):
    monkeypatch.setattr("baqueano.blocks.place_of", None)
    assert load("small").name == "small"


def test_an_unknown_kind_of_block_is_refused():
    with refused("block.role-unknown", UsageError, value="guides"):
        resolve("guides", "repeat")


def test_a_block_that_is_named_for_another_role_is_refused_with_its_own_role():
    with refused("block.in-other-role", FileError, role="controller", actual_role="estimator"):
        resolve("controller", "ekf")


def test_a_block_file_without_a_class_is_refused_with_advice():
    with refused("block.unknown", FileError):
        resolve("guide", "mine.py")


def test_a_block_without_the_ending_of_its_file_is_answered_with_it(tmp_path):
    (tmp_path / "mine.py").write_text("class Block:\n    pass\n", encoding="utf-8")
    with refused("block.unknown", FileError) as error:
        resolve("guide", "mine:Block", tmp_path)
    assert includes(error.value.diagnostic, "name.near", match="mine.py:Block")


def test_a_function_is_not_a_block():
    def step(state, estimate):
        return state, None

    assert ("check.no-method", "step") in [
        (finding.code, finding.figures.get("name")) for finding in check("guide", step)
    ]


@pytest.mark.parametrize("role", STEP_INPUTS)
@pytest.mark.parametrize("change", [-1, 1])
def test_a_step_with_one_input_too_few_or_too_many_is_refused_with_its_line(tmp_path, role, change):
    """Before, a controller without the reference was advised to be a guide, and the others failed in the drive."""
    inputs = (*STEP_INPUTS[role], "more")[: len(STEP_INPUTS[role]) + change]
    names = ", ".join(("state", *inputs))
    text = f"class Block:\n    def init(self):\n        pass\n\n    def step(self, {names}):\n        pass\n"
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    block_class = resolve(role, "mine.py:Block", tmp_path)
    is_guide = inputs == STEP_INPUTS["guide"]
    code = "block.of-other-role" if is_guide else "block.step-arguments"
    expected = ", ".join(("state", *STEP_INPUTS[role]))
    with refused(code, UsageError, place="mine.py line 5", names=names, expected=expected):
        check_role(role, block_class)


def test_a_controller_without_the_reference_is_told_the_inputs_of_a_controller(tmp_path):
    output = "Reference(estimate.t_ns, np.array([0.0, 0.0, psi]), np.zeros(3), 0.0)"
    text = GUIDE.replace(output, "Command(estimate.t_ns, np.zeros(3))")
    findings = findings_about(tmp_path, "guide", text)
    assert [(x.code, x.figures.get("role"), x.figures.get("expected")) for x in findings][1:] == [
        ("check.returns-of", "controller", "reference, estimate")
    ]
