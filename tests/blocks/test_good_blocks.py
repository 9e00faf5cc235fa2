"""Good blocks pass the check without findings, fit their package and are compiled; a note names a block that cannot be
compiled."""

import pytest

import baqueano as bq
from baqueano.block_checks import compilation_notes
from baqueano.blocks import infer_role, resolve
from baqueano.messages import text as sentence

from .students import CONTROLLER, GOOD, findings_about

PROPERTY = "    @cached_property\n    def gains(self):\n        return [2.0] * 500\n\n    def init"


@pytest.mark.parametrize("room", GOOD)
def test_a_good_block_passes_the_check_without_findings(tmp_path, room):
    assert findings_about(tmp_path, room, GOOD[room]) == []


@pytest.mark.parametrize("room", GOOD)
def test_the_kind_of_a_block_is_detected_from_its_class(tmp_path, room):
    (tmp_path / "mine.py").write_text(GOOD[room], encoding="utf-8")
    assert infer_role(resolve(room, "mine.py:Block", tmp_path)) == room


@pytest.mark.parametrize("room", GOOD)
def test_a_block_of_plain_numpy_code_can_be_compiled(tmp_path, room):
    (tmp_path / "mine.py").write_text(GOOD[room], encoding="utf-8")
    assert compilation_notes(room, resolve(room, "mine.py:Block", tmp_path)()) == []


def test_a_block_with_an_if_statement_works_with_a_speed_note(tmp_path):
    text = CONTROLLER.replace(
        "        u = np", "        if e[0] > 0.5:\n            e = 0.5 * e\n        u = np"
    )
    assert findings_about(tmp_path, "controller", text) == []
    (note,) = compilation_notes("controller", resolve("controller", "mine.py:Block", tmp_path)())
    assert (note.code, note.subject) == ("check.slow", "Block.step()")
    check = bq.check(f"{tmp_path / 'mine.py'}:Block")
    assert (check.verdict, [entry.code for entry in check.notes]) == ("USABLE", ["check.slow"])
    assert sentence(check.notes[0]) in check.table()
    assert note.figures["place"] == "mine.py line 19"
    assert note.figures["cause"].code == "trace.decides"


def test_a_block_whose_compiled_output_differs_is_reported(tmp_path):
    text = CONTROLLER.replace("return state + 1.0,", "return str(e[0]),")
    assert findings_about(tmp_path, "controller", text) == []
    (note,) = compilation_notes("controller", resolve("controller", "mine.py:Block", tmp_path)())
    assert note.code == "check.compiled-output"


@pytest.mark.parametrize(("use", "codes"), [("gains[0]", []), ("gains.pop()", ["check.block-changed"])])
def test_a_block_may_cache_a_value_but_not_change_it(tmp_path, use, codes):
    text = CONTROLLER.replace("slots=True, ", "").replace("    def init", PROPERTY, 1)
    text = text.replace("self.gain", f"self.{use}").replace(
        "import numpy", "from functools import cached_property\n\nimport numpy"
    )
    findings = findings_about(tmp_path, "controller", text)
    assert [finding.code for finding in findings if finding.code == "check.block-changed"] == codes
