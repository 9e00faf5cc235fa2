"""A block of the user's that is broken stops the vehicle, is named by file and line, and costs no data."""

import shutil

import pytest

from baqueano.runs import read_run

CONTROLLER = """import numpy as np
from baqueano.signals import Command

class Mine:
    def init(self):
        return None

    def step(self, state, reference, estimate):
        {line}
        return state, Command(estimate.t_ns, {u})
"""
GUIDE = """import numpy as np
from baqueano.signals import Reference

class Mine:
    def init(self):
        return None

    def step(self, state, estimate):
        {line}
        return state, Reference(estimate.t_ns, {u}, np.zeros(3), 1.0 * (estimate.t_ns > 200_000_000))
"""
ESTIMATOR = """import numpy as np
from baqueano.signals import Estimate

class Mine:
    def init(self):
        return None

    def step(self, state, tick):
        {line}
        return state, Estimate(tick.t_ns, {u}, np.zeros(3), np.eye(6))
"""
ROOMS = {"controller": CONTROLLER, "guide": GUIDE, "estimator": ESTIMATOR}
SMALL = ("--vehicle", "small")


@pytest.fixture
def project(baqueano, lab, tmp_path):
    shutil.copytree(lab / "routes", tmp_path / "routes")
    return baqueano


def test_a_file_without_its_class_is_answered_with_the_classes_in_it(project, tmp_path):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(3)"))
    for line in ("blocks check mine.py", "repeat lab --vehicle small --controller mine.py"):
        end = project(*line.split())
        assert end.code in (2, 3)
        assert "mine.py holds mine.py:Mine." in end.paragraph


@pytest.mark.parametrize(
    ("typed", "right"), [("min.py:Mine", "mine.py:Mine"), ("mine.py:Mina", "mine.py:Mine")]
)
def test_a_mistyped_half_of_a_block_is_put_right_and_the_other_kept(project, tmp_path, typed, right):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(3)"))
    end = project("repeat", "lab", "--vehicle", "small", "--controller", typed)
    assert end.paragraph.endswith(f"Type: baqueano repeat lab --vehicle small --controller {right}")


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize(
    ("line", "u", "said"),
    [
        ('raise ValueError("boom")', "np.zeros(3)", "mine.py:9) raised ValueError: boom."),
        ("stat", "np.zeros(3)", "mine.py:9) raised NameError: name 'stat' is not defined"),
        ("pass", "np.zeros(2)", "with shape (2,), expected (3,)"),
        ("pass", "np.full(3, np.nan)", "= [nan, nan, nan], expected finite numbers"),
        ("return None", "np.zeros(3)", "returned nothing, expected (state, output)"),
    ],
)
def test_a_broken_block_stops_the_vehicle_and_the_run_is_whole(project, tmp_path, room, line, u, said):
    (tmp_path / "mine.py").write_text(ROOMS[room].format(line=line, u=u), encoding="utf-8")
    end = project("repeat", "lab", f"--{room}", "mine.py:Mine", *SMALL, "--json")
    assert end.code == 5, end.err
    assert f"the vehicle was stopped: {room} Mine (" in end.paragraph
    assert said in end.paragraph
    assert "baqueano runs show" in end.paragraph
    assert len(end.reply["rows"]) == 1
    run = read_run(tmp_path / "runs" / "0001-repeat.mcap")
    assert run.notes == ()
    assert run.duration_s == pytest.approx(1.0, abs=0.05)  # it is recorded how it rolls out
    assert run.sent is not None
    assert not run.sent[1:].any()


def test_a_block_that_fails_later_keeps_what_was_recorded_before(project, tmp_path):
    line = "assert estimate.t_ns < 1_000_000_000, 'late'"
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line=line, u="np.zeros(3)"), encoding="utf-8")
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL)
    assert end.code == 5
    assert "raised AssertionError: late" in end.paragraph
    assert read_run(tmp_path / "runs" / "0001-repeat.mcap").duration_s == pytest.approx(2.0, abs=0.05)


def test_a_block_whose_init_raises_makes_no_run(project, tmp_path):
    text = CONTROLLER.format(line="pass", u="np.zeros(3)").replace(
        "return None", 'raise OSError("no port")', 1
    )
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL)
    assert end.code == 5
    assert "mine.py:6) raised OSError: no port" in end.paragraph
    assert "nothing moved" in end.paragraph
    assert not list(tmp_path.rglob("*.mcap*"))


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("import nothere\n", "Mine", "mine.py line 1 raised ModuleNotFoundError while it was read: No module"),
        ("class Mine:\n    def step step(self):\n", "Mine", "mine.py line 2 is not Python"),
        ("class Mine: ...\n", "Myne", "has no class \"Myne\": it has Mine. Did you mean Mine?"),
        ("Mine = 3\n", "Mine", "expected a class"),
        (None, "Mine", "mine.py: no such file"),
    ],
)  # fmt: skip
def test_a_block_that_cannot_be_loaded_is_told_before_anything_moves(
    project, tmp_path, room, text, name, said
):
    if text is not None:
        (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("repeat", "lab", f"--{room}", f"mine.py:{name}", *SMALL)
    assert end.code == 3
    assert f"--{room} mine.py:{name}: " in end.paragraph
    assert said in end.paragraph
    assert f"baqueano blocks check mine.py:{name}" in end.paragraph
    assert not list(tmp_path.rglob("*.mcap*"))


def test_a_replay_through_a_broken_estimator_says_so(project, lab, tmp_path):
    text = ESTIMATOR.format(line='raise ValueError("boom")', u="np.zeros(3)")
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    run = str(lab / "runs" / "0001-experiment.mcap")
    end = project("replay", run, "--estimator", "mine.py:Mine", "--backend", "numpy")
    assert end.code == 5
    assert "estimator Mine (" in end.paragraph
    assert "raised ValueError: boom" in end.paragraph


def test_the_check_says_in_words_what_is_wrong_with_a_block(project, tmp_path):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(2)"), encoding="utf-8")
    end = project("blocks", "check", "mine.py:Mine", "--json")
    assert end.code == 1
    assert end.reply["verdict"] == "REFUSED"
    assert any(
        "mine.py line" in row["finding"] and "shape (2,)" in row["finding"] for row in end.reply["rows"]
    )
    assert "breaks" in end.paragraph
