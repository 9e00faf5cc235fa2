"""Each command line that baqueano advises is quoted and complete, and the parser of baqueano accepts it."""

import ast
import re
import shlex
import subprocess
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest

import baqueano as package
from baqueano.cli.next_command import run_options
from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.diagnostics import nearest
from baqueano.messages import templates, text
from baqueano.messages.printable import baqueano_command
from tests.syntax import SOURCE, nodes_of, python_files

WORD = r"\{[^}]*\}|[A-Z][A-Z_]*(?:\.[a-z]+)?|--[a-z-]+"  # a command line within a sentence
LINE = re.compile(rf"baqueano ((?:{'|'.join(SUBCOMMANDS)})\b(?: [a-z-]+(?=[ ,.;:)]|$))?(?: (?:{WORD}))*)")
ADVICE = re.compile(rf"baqueano ((?:{'|'.join(SUBCOMMANDS)})\b[^.\n]*(?:\.toml[^.\n]*)?)")
TYPED = re.compile(r"\{type\[(baqueano [^\]]*)\]\}")
OPEN = "1"  # replaces a word that is known only at run time


def of_call(node):
    """Return the words of a call of baqueano_command(…), with optional words once present and once absent."""
    has_star = any(isinstance(argument, ast.Starred) for argument in node.args)
    for prefix in ([OPEN], []) if has_star else ([],):
        words = []
        for argument in node.args:
            words += (
                prefix
                if isinstance(argument, ast.Starred)
                else [argument.value if isinstance(argument, ast.Constant) else OPEN]
            )
        yield words


def verb_of(node):
    """Return True for a call of baqueano_command(…) that begins with a known command."""
    is_line = isinstance(node.func, ast.Name) and node.func.id == "baqueano_command"
    return is_line and bool(node.args) and isinstance(node.args[0], ast.Constant)


def advised():
    """Yield each advised command line, in each way to read its words, with its file and line."""
    for path in python_files(SOURCE):
        place, source = path.relative_to(SOURCE), path.read_text(encoding="utf-8")
        if "baqueano_command" not in source and "baqueano " not in source:
            continue
        for node in nodes_of(path):
            if isinstance(node, ast.Call) and verb_of(node):
                yield f"{place}:{node.lineno}", list(of_call(node))
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                command = ADVICE.fullmatch(node.value)
                if command:
                    yield f"{place}:{node.lineno}", [command[1].split()]
    for code, template in templates().items():
        for line in (*LINE.findall(TYPED.sub("", template)), *TYPED.findall(template)):
            yield code, [line.removeprefix("baqueano ").split()]


def parse_line(words):
    """Return the context of a command, or None if it shows a help; raise click's error or KeyError for a wrong one."""
    words = [OPEN if word.startswith("{") else word for word in words]
    command, rest = load_command(words[0]), words[1:]
    while isinstance(command, click.Group):
        if not rest:
            return None
        command, rest = command.commands[rest[0]], rest[1:]
    if "--help" in rest:
        return None
    return command.make_context("baqueano", rest, help_option_names=["-h", "--help"])  # click stores them


def error_of(readings):
    """Return the error of the first reading if no reading of a line can be parsed, otherwise None."""
    errors = []
    for words in readings:
        try:
            parse_line(words)
        except (click.ClickException, KeyError) as error:
            errors.append(repr(error))
        else:
            return None
    return errors[0]


@pytest.fixture(scope="module")
def lines():
    return list(advised())


def test_more_than_fifty_advised_command_lines_can_be_parsed(lines):
    assert len(lines) > 50
    assert [(place, line[0], error) for place, line in lines if (error := error_of(line))] == []


def test_an_advised_line_does_not_contain_a_placeholder(lines):
    """Exceptions are the address of a robot, and a recording that only the user knows."""
    unknown = {"HOST", "RECORDING", "RECORDING.csv", "FILE", "MAP.toml"}
    words = {word for _, readings in lines for line in readings for word in line}
    assert {word for word in words if re.fullmatch(r"[A-Z]{2,}(\.[a-z]+)?", str(word))} <= unknown


def test_the_source_quotes_every_argument_of_an_advised_line():
    unquoted_command = re.compile(rf"f\"baqueano (?:{'|'.join(SUBCOMMANDS)}) [^\"]*\{{")
    offenders = [
        path.name
        for path in python_files(SOURCE)
        if unquoted_command.search(path.read_text(encoding="utf-8"))
    ]
    assert offenders == []


def test_a_command_line_is_quoted_for_the_shell_of_the_system(monkeypatch):
    assert baqueano_command("runs", "show", "my runs/1.mcap") == "baqueano runs show 'my runs/1.mcap'"
    monkeypatch.setattr("os.name", "nt")
    assert baqueano_command("runs", "show", "my runs/1.mcap") == 'baqueano runs show "my runs/1.mcap"'


def test_the_advised_lines_of_a_new_project_can_be_parsed(baqueano, tmp_path):
    end = baqueano("new", "my lab")
    line, advice = (text.partition(": ")[2].strip() for text in end.err.strip().splitlines()[-2:])
    assert line == "cd 'my lab'"
    assert advice == "baqueano experiment"
    assert (
        subprocess.run(
            ["sh", "-c", f"{line} && cat vehicle.toml"], capture_output=True, cwd=tmp_path
        ).returncode
        == 0
    )


def test_the_replay_line_printed_by_compare_works(baqueano):
    assert baqueano("simulate", "--vehicle", "small", "--seconds", "0.3", "-o", "tiny.mcap").code == 0
    line = baqueano("compare", "tiny.mcap").err.strip().splitlines()[-1].partition("to make one: ")[2]
    assert line == "baqueano replay tiny.mcap"
    assert baqueano(*shlex.split(line)[1:]).code == 0


def test_the_advised_lesson_of_a_missing_route_names_the_vehicle_of_the_user(baqueano):
    end = baqueano("repeat", "nowhere", "--vehicle", "small")
    assert (end.code, end.fix) == (3, "baqueano teach nowhere --vehicle small")
    assert baqueano("repeat", "nowhere").fix == "baqueano teach nowhere"


def test_a_part_of_a_run_that_ends_before_its_start_is_refused_with_both_times_in_order(baqueano):
    end = baqueano("runs", "cut", "last", "--from", "5", "--to", "2")
    assert end.reason.code == "cli.cut-order"
    assert end.fix == "baqueano runs cut last --from 2 --to 5"


def test_a_key_of_another_quantity_is_not_proposed(baqueano):
    end = baqueano("simulate", "--vehicle", "car", "--set", "model.mass_kg=-3")
    assert (end.code, end.reason.code) == (2, "vehicle.unknown-key")
    assert end.reason.figures["suggestion"].code == "name.unknown"
    assert "model.throttle_gain" in end.paragraph
    assert end.fix == "baqueano simulate --help"


def test_an_error_in_a_block_option_does_not_blame_the_vehicle_file(baqueano):
    end = baqueano("sweep", "--vehicle", "small", "--controller", "lqrr")
    assert (end.code, end.reason.code) == (3, "cli.own-block")
    assert end.fix == "baqueano sweep --vehicle small --controller lqr"
    assert "line" not in end.paragraph


def test_an_unknown_block_is_refused_with_the_list_of_blocks(baqueano, lab):
    run = next((lab / "runs").glob("0001*"))
    end = baqueano("replay", str(run), "--vehicle", "small", "--estimator", "kalmann")
    assert end.reason.code == "cli.own-block"
    assert end.fix == "baqueano blocks ls"
    assert baqueano(*shlex.split(end.fix)[1:]).code == 0


def test_the_keys_are_a_driver_and_not_a_route(baqueano):
    end = baqueano("tune", "--vehicle", "small", "--route", "keys")
    assert end.reason.code == "cli.driver-unknown"
    assert "keys" not in end.reason.figures["suggestion"].figures["valid"]


@pytest.mark.parametrize(
    ("kind", "code"),
    [("mi.py:Mine", "cli.own-name"), ("my.py:Mime", "cli.own-name"), ("broken.py:Mine", "cli.own-file")],
)
def test_a_check_is_advised_only_for_a_block_of_that_name(baqueano, tmp_path, kind, code):
    (tmp_path / "my.py").write_text("class Mine: ...\n", encoding="utf-8")
    (tmp_path / "broken.py").write_text("class Mine\n", encoding="utf-8")
    end = baqueano("sweep", "--vehicle", "small", "--controller", kind)
    assert (end.code, end.reason.code) == (3, code)
    right = (
        "sweep --vehicle small --controller my.py:Mine" if code == "cli.own-name" else f"blocks check {kind}"
    )
    assert end.fix == f"baqueano {right}"


def test_the_tolerance_of_a_vehicle_with_two_wheels_is_refused_without_another_sensor_to_use(baqueano, lab):
    run = str(next((lab / "runs").glob("0001*")))
    line = "--vehicle", "small", "--use", "imu", "--tolerance", "sensors.imu.gyro_scale=0.01"
    end = baqueano("identify", run, *line)
    assert (end.code, end.reason.code, end.reason.fix) == (2, "cli.tolerance-car", "")


def test_a_name_error_reports_an_empty_list_of_names():
    suggestion = nearest("lap", [])
    assert suggestion.code == "name.none"
    assert "–" not in text(suggestion)


def test_the_update_option_adds_noise_and_an_estimator_to_a_file(baqueano, lab, tmp_path):
    run = str(next((lab / "runs").glob("0001*")))
    small = (SOURCE / "garage" / "small.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(re.sub(r"\[estimator\](.|\n)*?(?=\n\[)", "", small), encoding="utf-8")
    assert "[estimator]" not in (tmp_path / "mine.toml").read_text(encoding="utf-8")
    words = "--vehicle", "mine.toml", "--free", "model.friction.linear[0]", "--update"
    end = baqueano("identify", run, *words)
    assert (end.code, end.err.count("baqueano tune --update --vehicle mine.toml")) == (0, 1)
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert "measurement_noise_cov" in text
    assert "[estimator]" in text
    assert baqueano("replay", run, "--vehicle", "mine.toml").code == 0


def test_a_replay_tells_that_the_file_of_the_folder_differs_and_names_the_first_run(baqueano, lab, tmp_path):
    run = str(next((lab / "runs").glob("0001*")))
    (tmp_path / "vehicle.toml").write_text(package.read_run(run).vehicle_text, encoding="utf-8")
    assert "differs" not in baqueano("replay", run).err
    with (tmp_path / "vehicle.toml").open("a", encoding="utf-8") as file:
        file.write("# measured again\n")
    assert "vehicle.toml differs from it; to use it: --vehicle vehicle.toml" in baqueano("replay", run).err
    assert baqueano("replay", "last").code == 0
    names = [path.stem[5:] for path in sorted((tmp_path / "runs").glob("*replay*"))]
    assert names == [f"replay-{Path(run).stem}"] * 3


def test_advice_about_a_run_names_the_vehicle_file_that_it_belongs_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small, car = package.load("small"), package.load("car")
    run = package.simulate(car, np.zeros((50, 2)))
    assert run_options("runs", package.simulate(small, np.zeros((50, 3)))) == ["--vehicle", "small"]
    small.save("a.toml")
    car.save("rover.toml")
    assert run_options("runs", run) == ["--vehicle", "rover.toml"]
    assert run_options("lab", run, is_in_run=True) == ["--runs", "lab"]
    imported_run = replace(run, vehicle_text="")
    assert run_options("runs", imported_run, is_in_run=True) == ["--vehicle", "rover.toml"]
    car.save("again.toml")
    assert run_options("runs", imported_run) == ["--vehicle", "FILE"]
