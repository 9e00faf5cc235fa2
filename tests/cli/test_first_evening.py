"""What the newcomer meets on the way from `make demo` to a drive, and what leads on."""

import sys
from inspect import signature
from pathlib import Path

from baqueano.cli import demo
from baqueano.cli.tune import command as tune


def test_the_demo_names_the_program_as_it_is_called_in_this_shell(tmp_path, monkeypatch):
    program = tmp_path / "baqueano"
    program.touch(mode=0o755)
    monkeypatch.setattr(sys, "argv", [str(program), "demo"])
    monkeypatch.setenv("PATH", "")
    assert demo.typed_here() == str(program), "make has put it into .venv, which no shell looks into"
    monkeypatch.setenv("PATH", str(tmp_path))
    assert demo.typed_here() == "baqueano"


def test_a_second_demo_keeps_the_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert demo.free_folder() == Path("demo")
    for name in ("demo", "demo-2"):
        Path(name).mkdir()
    assert demo.free_folder() == Path("demo-3")


def test_tune_prices_jerks_in_python_and_on_the_command_line_as_the_demo_does(baqueano):
    from baqueano.study.demo import EFFORT_M2
    from baqueano.tune.gains import rehearse

    assert {param.name: param.default for param in tune.params}["effort_m2"] == EFFORT_M2
    assert signature(rehearse).parameters["effort_m2"].default == EFFORT_M2


def test_a_shape_that_is_too_fast_to_follow_is_told_with_a_speed(baqueano, tmp_path):
    end = baqueano("teach", "r", "--vehicle", "small", "--driver", "circle", "--size", "0.3", "--speed", "3")
    assert end.code == 1
    assert "did not follow the circle at 3 m/s" in end.paragraph
    assert end.paragraph.endswith("baqueano teach r --driver circle --speed 0.2")
    assert not (tmp_path / "routes").exists()


def test_who_compares_a_run_without_an_estimate_is_told_how_to_make_one(baqueano):
    baqueano("simulate", "--vehicle", "small", "--seconds", "1")
    end = baqueano("compare", "1")
    assert end.code == 0
    line = "baqueano replay runs/0001-simulation.mcap --vehicle "
    assert line in end.err.replace("\\", "/")
    again = baqueano(*line.split()[1:], "small")
    assert again.code == 0, again.err
