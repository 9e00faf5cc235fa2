"""The mistakes of a first block are answered with one finding that names the line and the remedy."""

import pytest

from baqueano.block_checks import compilation_notes
from baqueano.blocks import resolve

from .students import FROZEN, GOOD, findings_about

MISTAKES = {
    "forgets return": ("return state + 1.0, Command", "state + 1.0, Command", "check.no-return"),
    "writes into its field": (
        "        e = pose_error",
        "        self.gain = 3.0\n        e = pose_error",
        "check.assigns-field",
    ),
    "a decimal comma": ("gain: float = 2.0", "gain: float = 2,5", "outside.comma"),
    "lacks init": ("def init", "def initialise", "check.no-method"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_gives_its_finding_first(tmp_path, case):
    old, new, code = MISTAKES[case]
    findings = findings_about(tmp_path, "controller", GOOD["controller"].replace(old, new))
    assert findings[0].code == code
    assert len(findings) == 1 or code.startswith("outside.")


def test_a_write_into_a_field_names_the_line_of_the_user(tmp_path):
    """Before, it named line 4, which is a line of a method that the dataclass generates."""
    code = GOOD["controller"].replace("        e = pose", "        self.gain = 3.0\n        e = pose")
    (finding,) = findings_about(tmp_path, "controller", code)
    assert finding.figures["line"] == code.splitlines().index("        self.gain = 3.0") + 1


def test_an_inherited_step_has_the_place_of_the_class(tmp_path):
    """Before, a vehicle that cannot be compiled was named with a file of the package."""
    (tmp_path / "mine.py").write_text(
        "from baqueano.vehicles import AccelerationModel\n\n\nclass Cart(AccelerationModel):\n"
        "    commands = 1\n\n    def nu_dot(self, nu, effort, psi=0.0):\n        return nu if nu[0] > 1.0 else -nu\n"
    )
    (finding,) = compilation_notes("vehicle", resolve("vehicle", "mine.py:Cart", tmp_path)())
    assert finding.figures["place"] == "mine.py line 4"


def test_a_block_that_prints_does_not_fill_the_screen(tmp_path, capsys):
    """Before, a controller with a `print` hid the findings of its check below 300 lines."""
    code = GOOD["controller"].replace(
        "        e = pose_error", "        print(estimate)\n        e = pose_error"
    )
    assert [finding.code for finding in findings_about(tmp_path, "controller", code)] == ["outside.calls"]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("line", ["count = len(MEMORY) + 1.0", "count = np.random.normal()"])
def test_a_block_that_is_not_deterministic_gets_no_further_advice(tmp_path, line):
    """Before, it was also advised to wrap an angle and to count time from the first tick."""
    code = GOOD["controller"].replace("class Block", "MEMORY = []\n\n\nclass Block").replace(FROZEN, "")
    code = code.replace("class Block", FROZEN + "class Block")
    code = code.replace("        e = pose", f"        {line}\n        MEMORY.append(1)\n        e = pose")
    code = code.replace("0.0, e[2]]", "0.0, e[2] + count]")
    codes = {finding.code for finding in findings_about(tmp_path, "controller", code)}
    assert codes <= {"check.not-deterministic", "outside.draws"}
