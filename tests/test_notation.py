"""Messages advise calls in Python, and lines on the command line; every call is one that Python accepts."""

import ast
import importlib
import re

import pytest

import baqueano as bq
from baqueano.diagnostics import fault
from baqueano.errors import FileError, UsageError
from baqueano.messages import text
from baqueano.messages.notation import CALLS, COMMAND_LINE, FLAGS, python_call, use_notation


@pytest.mark.parametrize(
    ("line", "call"),
    [
        ("baqueano new 'my lab'", 'bq.new("my lab")'),
        ("baqueano runs import log.csv --draft log.toml", 'print(draft_map("log.csv", path="log.toml"))'),
        ("baqueano runs cut 3 --from 2 --to 30.5", "run = run.cut(2, 30.5)"),
        ("baqueano runs ls", 'Path("runs")'),
        ("baqueano tune --controller lqr --update", 'bq.tune(robot, route, controller="lqr")'),
        ("--set model.mass_kg=0.7", 'robot = robot.with_values({"model.mass_kg": 0.7})'),
        ("--free +friction.coulomb", 'free=["+friction.coulomb"]'),
        ("--bound delay_s=0,0.5", 'options=bq.FitOptions(bounds={"delay_s": (0, 0.5)})'),
        ("--free +lag_s --clock gps", 'free=["+lag_s"], options=bq.FitOptions(clocks=["gps"])'),
        ("baqueano route draw ring circle", 'route = shape("circle", 1.0, 0.25)'),
        ("--free +a --free +b --set c=0.2", 'robot.with_values({"c": 0.2}); free=["+a", "+b"]'),
        ("--cost innovations", 'options=bq.FitOptions(cost="innovations")'),
    ],
)
def test_a_line_of_the_command_line_becomes_a_call(line, call):
    assert call in python_call(line)


@pytest.mark.parametrize(
    "line", ["baqueano robot flash", "pip install scipy", "robot = bq.load('a')", "it's"]
)
def test_a_line_without_a_function_in_python_is_unchanged(line):
    assert python_call(line) == line


def arguments_of(key):
    return " ".join(
        f"{word} 1" if word.startswith("--") and word not in FLAGS else word for word in key.split()
    )


@pytest.mark.parametrize("key", CALLS)
def test_each_call_is_valid_python_with_names_that_exist(key):
    prefix = "" if key.startswith("--") else "baqueano "
    call = python_call(f"{prefix}{arguments_of(key)}")
    is_argument = re.match(r"\w+=[^=]", call.replace(" ", ""))
    tree = ast.parse(f"call({call})" if key.startswith("--") and " = " not in call and is_argument else call)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, name.name) for name in node.names)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "bq":
            assert hasattr(bq, node.attr)


def test_the_same_message_advises_a_call_in_python_and_a_line_in_the_terminal():
    message = fault("runs.absent", "baqueano runs ls --runs drives", absent_path="drives/7.mcap")
    assert 'sorted(Path("drives")' in text(message)
    with use_notation(COMMAND_LINE):
        assert text(message).endswith("baqueano runs ls --runs drives")
    assert 'sorted(Path("drives")' in text(message)


def test_a_recording_without_a_map_gets_a_call_that_drafts_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("t,ax,ay,gz\n0.0,0,0,0\n0.1,0,0,0\n", encoding="utf-8")
    with pytest.raises(FileError) as error_info:
        bq.import_run("log.csv")
    exec(python_call(error_info.value.diagnostic.fix))
    assert (tmp_path / "log.toml").exists()


def test_an_unknown_key_lists_the_keys_of_its_table():
    with pytest.raises(UsageError) as error_info:
        bq.load("small").value("controler.k_y")
    suggestion = error_info.value.diagnostic.figures["suggestion"].figures
    assert suggestion["match"] == "controller.k_x"
    assert all(key.startswith("controller.") for key in suggestion["valid"].split(", "))
