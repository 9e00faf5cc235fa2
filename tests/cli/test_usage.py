"""A typing error ends with exit code 2 and one paragraph with the expected input and a remedy."""

import json
import os
import subprocess
import sys
from importlib import import_module

import click
import pytest

from baqueano import __version__
from baqueano.cli import main
from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.diagnostics import fault


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("experimnt", "cli.unknown-verb", "baqueano experiment"),
        ("fly", "cli.no-such-verb", "repeat"),
        ("runs cot", "cli.unknown-verb", "baqueano runs cut"),
        ("study papr", "cli.unknown-verb", "baqueano study paper"),
        ("blocks chek", "cli.unknown-verb", "baqueano blocks check"),
        ("experiment --secs 5", "cli.no-such-option", "--seconds"),
        ("simulate --duration 5", "cli.no-such-option", "--seconds"),
        ("--seconds 3 experiment --seed 1", "cli.option-before-verb", "experiment --seed 1 --seconds 3"),
        ("--jsn identify last", "cli.no-such-option", "baqueano --help"),
        ("experiment extra", "cli.usage", "baqueano experiment --help"),
        ("experiment a.toml --seconds 5", "cli.vehicle-argument", "experiment --vehicle a.toml --seconds 5"),
        ("tune small", "cli.vehicle-argument", "baqueano tune --vehicle small"),
        ("teach vehicle.toml", "route.ending", "vehicle.toml"),
        ("teach 0001.mcap", "route.ending", "0001.mcap"),
        ("repeat vehicle.toml", "route.ending", "vehicle.toml"),
        ("experiment --seconds abc", "cli.number", "> 0, ≤ 86400 [s]"),
        ("experiment --seconds -5", "cli.number", "'value': '-5'"),
        ("experiment --seconds nan", "cli.number", "'value': 'nan'"),
        ("experiment --seconds 1e12", "cli.number", "'option': '--seconds'"),
        ("experiment --seed -1", "cli.whole-number", "≥ 0"),
        ("experiment --backend rust", "cli.usage", "'numpy'"),
        ("experiment --vehicle small --signal prb", "cli.signal-unknown", "--signal prbs"),
        ("experiment --vehicle small --signal desined --room 2x2", "cli.signal-unknown", "--signal designed"),
        (
            "experiment --vehicle small --robot simulated:car --seconds 1",
            "drive.other-vehicle",
            "'value': 3, 'expected': 2",
        ),
        ("repeat lab --laps tres", "cli.whole-number", "'value': 'tres'"),
        ("simulate --vehicles 0", "cli.whole-number", "≥ 1"),
        ("simulate --vehicle small --set model.mass_kg", "vehicle.setting", "model.mass_kg"),
        ("simulate --vehicle small --set model.mas_kg=1", "vehicle.unknown-key", "--set model.mass_kg=1"),
        ("simulate --vehicle small --set model.mass_kg=-1", "vehicle.set", "'low': 0.001"),
        ("repeat", "cli.usage", "baqueano repeat --help"),
        ("repeat lab --laps -1", "cli.whole-number", "≥ 0"),
        ("identify", "cli.usage", "baqueano identify --help"),
        ("identify last --table fit.pdf", "report.table-ending", "--table fit.csv"),
        ("identify last --over-time --held-out 2", "cli.options-conflict", "--held-out"),
        ("identify last --over-time --choose", "cli.options-conflict", "--choose"),
        ("tune --speed -1", "cli.number", "[m/s]"),
        ("tune --size 0", "cli.number", "[m]"),
        ("teach r --vehicle small --driver circle --size -1", "cli.number", "[m]"),
        ("experiment --vehicle small --robot emulatd", "cli.robot-mistyped", "--robot emulated"),
        ("experiment --vehicle small --robot emulado", "cli.robot-mistyped", "--robot emulated"),
        ("experiment --vehicle small --robot simulado", "cli.robot-mistyped", "--robot simulated"),
        ("experiment --vehicle small --robot simulate:car", "cli.robot-mistyped", "--robot simulated:car"),
        ("teach r --vehicle small --driver cirle", "cli.driver-unknown", "--driver circle"),
        ("teach r --vehicle small --driver loop", "cli.driver-unknown", "sinuous-circle, circle, eight"),
        ("study paper --seeds 0", "cli.whole-number", "≥ 1"),
        ("sweep 1 --estimator ekf --laps 3", "cli.options-together", "--laps"),
        ("teach lab --driver keys --speed 0.2", "cli.options-together", "--driver keys"),
        ("route faster lab --speed 0.2 --command-share 0.5", "cli.options-together", "--command-share"),
        ("route import last lab --speed 0.2", "cli.options-together", "last"),
        ("drive --page --command-share 0.3 --robot emulatd", "cli.options-together", "--page"),
        ("simulate --vehicles 3 -o many.mcap", "cli.options-together", "-o"),
        ("tune --seeds 3", "cli.option-needs", "--estimator"),
        ("experiment --trust-file", "cli.option-needs", "--signal designed"),
        ("blocks check ekff", "cli.block-unknown", "baqueano blocks check ekf"),
        ("blocks check ekf --role kitchen", "cli.block-role", "estimator"),
        ("runs export 1 --to xls", "cli.usage", "'csv', 'tum'"),
        ("runs cut 1 --from x", "cli.number", "[s]"),
        ("route scale lap 0", "cli.number", "'expected': '> 0, ≤ 1000'"),
        ("route scale lap 0", "cli.number", "baqueano route scale --help"),
    ],
)
def test_a_mistyped_command_ends_in_one_paragraph_and_code_2(baqueano, tmp_path, line, code, message):
    end = baqueano(*line.split())
    assert (end.code, end.out, end.reason.code) == (2, "", code)
    assert message in f"{end.reason.to_json()} {end.fix}"
    assert end.fix
    assert not list(tmp_path.rglob("*.mcap*")), "no run number was used"


def test_every_command_has_help(baqueano):
    for flag in ("-h", "--help"):
        help_end = baqueano(flag)
        assert help_end.code == 0
        assert all(verb in help_end.out for verb in SUBCOMMANDS)
    for verb in SUBCOMMANDS:
        help_end = baqueano(verb, "-h")
        assert help_end.code == 0
        assert help_end.out.startswith(f"Usage: baqueano {verb}")


def test_a_command_called_without_its_group_accepts_the_short_help_option(baqueano):
    """click stores the help option of the first call, even of a call without the group."""
    import_module("baqueano.cli.demo").command.main(["--help"], standalone_mode=False)
    assert baqueano("demo", "-h").code == 0


def test_the_version_is_printed(baqueano):
    assert baqueano("--version").out.strip() == f"baqueano, version {__version__}"


def test_python_m_runs_the_command():
    process = subprocess.run([sys.executable, "-m", "baqueano", "--version"], capture_output=True, text=True)
    assert process.stdout.strip() == f"baqueano, version {__version__}"


def test_a_call_without_a_command_lists_the_commands_with_code_2(baqueano):
    end = baqueano()
    assert end.code == 2
    assert "demo" in end.err


def test_the_debug_option_prints_the_traceback_with_the_same_exit_code(baqueano):
    end = baqueano("runs", "show", "no.mcap", "--debug")
    assert end.code == 3
    assert "Traceback" in end.err
    assert (end.ending.reason.code, end.ending.reason.figures["absent_path"]) == ("runs.absent", "no.mcap")


def test_help_imports_no_command_module_and_no_numpy():
    code = (
        "import sys\nfrom baqueano.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "from baqueano.cli.subcommands import SUBPACKAGE_VERBS\n"
        "rooms = ('numpy', 'scipy', 'mcap', *(f'baqueano.cli.{room}' for room in SUBPACKAGE_VERBS))\n"
        "print([m for m in sys.modules if m.startswith(rooms)])"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.rstrip().endswith("[]")


@pytest.mark.parametrize(
    ("error", "exit_code", "code", "figures"),
    [
        (RuntimeError("the moon"), 1, "cli.unexpected-error", {"error": "RuntimeError: the moon"}),
        (OSError(28, "No space left on device", "runs"), 3, "cli.system",
         {"place": "runs", "error": "No space left on device"}),
        (MemoryError("22 TiB"), 1, "cli.memory", {"error": "22 TiB"}),
        (KeyboardInterrupt(), 130, "cli.interrupted", {}),
    ],
)  # fmt: skip
def test_an_error_inside_a_command_has_its_exit_code_and_message(
    baqueano, monkeypatch, error, exit_code, code, figures
):
    def fail(*args, **kwargs):
        raise error

    monkeypatch.setattr("baqueano.runs.folder_listing.listing", fail)
    end = baqueano("runs", "ls")
    assert (end.code, end.reason.code) == (exit_code, code)
    assert figures.items() <= end.reason.figures.items()
    assert ("--debug" in end.paragraph) == (code == "cli.unexpected-error")
    assert end.fix == "baqueano runs ls" or code != "cli.system"


def test_an_unknown_back_end_in_the_environment_is_reported(baqueano, monkeypatch):
    monkeypatch.setenv("BAQUEANO_BACKEND", "rust")
    end = baqueano("runs", "ls")
    assert end.code == 2
    assert dict(end.reason.figures) == {
        "variable": "BAQUEANO_BACKEND", "value": "rust", "valid": "auto, c, python, numpy",
    }  # fmt: skip


def test_a_missing_c_compiler_is_reported_with_the_other_back_end(baqueano, monkeypatch):
    from baqueano.symbolic.c_code.compile import CompileError

    def refuse(*args, **kwargs):
        raise CompileError(fault("compiler.absent", "pip install ziglang"))

    monkeypatch.setattr(import_module("baqueano.simulate"), "simulate", refuse)
    end = baqueano("simulate", "--vehicle", "small", "--seconds", "1", "--backend", "c")
    assert end.code == 2
    assert (end.reason.code, end.fix) == ("cli.not-compiled", "--backend python")
    assert end.reason.figures["error"].code == "compiler.absent"


def test_an_unreachable_vehicle_gives_an_error_of_one_paragraph_and_code_4(baqueano):
    end = baqueano("experiment", "--vehicle", "small", "--robot", "nobody@127.0.0.1:1")
    assert end.code == 4, end.err
    assert (end.reason.code, end.reason.figures["host"]) == ("remote.unreachable", "nobody@127.0.0.1:1")
    assert end.reason.figures["command"] == "ssh -p 1 nobody@127.0.0.1 baqueano robot status"


def test_a_local_robot_command_on_a_laptop_advises_a_host_name(baqueano):
    end = baqueano("robot", "status")
    assert end.code == 4
    assert end.reason.code == "door.no-answer"
    assert "pilot@rover.local" in end.err


@pytest.mark.parametrize("group", ["robot", "runs", "study", "blocks"])
def test_no_sentence_in_a_command_list_is_truncated(baqueano, group):
    assert "..." not in baqueano(group, "--help").out.partition("Commands:")[2]


@pytest.mark.parametrize(
    ("line", "code", "ends"),
    [
        ("blocks check ekff --json", "cli.block-unknown", 2),
        ("compare nothing --json", "runs.folder-empty", 3),
        ("runs ls --jsonn --json", "cli.no-such-option", 2),
    ],
)
def test_an_error_with_json_is_one_object_with_code_and_figures(baqueano, line, code, ends):
    end = baqueano(*line.split())
    output = json.loads(end.out)
    assert (end.code, output["exit_code"], output["code"]) == (ends, ends, code)
    assert output["figures"] == end.reason.to_json()["figures"]
    assert output["text"] in end.paragraph


def test_a_negative_answer_with_json_prints_only_the_answer(baqueano, tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Mine:\n    def step(self, state, estimate): ...\n", encoding="utf-8"
    )
    end = baqueano("blocks", "check", "mine.py:Mine", "--role", "guide", "--json")
    assert end.code == 1
    assert json.loads(end.out)["verdict"] == "REFUSED"


@pytest.mark.parametrize(
    ("line", "fix"),
    [
        ("runs import a.csv --draft", "baqueano runs import --help"),  # an option without its value
        ("robot estado", "baqueano robot --help"),  # resembles stop, which moves no one forward
        ("runs list", "baqueano runs ls"),
        ("--json identify last", "baqueano identify last --json"),
        ("runs --json ls", "baqueano runs ls --json"),
        ("sweep 1 last --controller lqr --json", "baqueano sweep --controller lqr --json"),
        ("sweep 1 --route eight", "baqueano sweep --route eight"),
    ],
)
def test_a_usage_error_advises_a_command_that_helps(baqueano, line, fix):
    assert baqueano(*line.split()).fix == fix


@pytest.mark.parametrize(("environment", "expected"), [(None, "1"), ("4", "4")])
def test_the_command_line_computes_small_matrices_without_threads(environment, expected, monkeypatch):
    """The threads of OpenBLAS took two thirds of the processor time of `tune`; a value of the user stays."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", environment or "")
    if environment is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    with pytest.raises(SystemExit):
        main(["--version"])
    assert os.environ["OPENBLAS_NUM_THREADS"] == expected


def test_the_help_of_a_folder_names_a_folder():
    """`-o FILE  Folder to write` states two things."""
    commands = [load_command(verb) for verb in SUBCOMMANDS]
    commands += [child for command in commands for child in getattr(command, "commands", {}).values()]
    options = [p for command in commands for p in command.params if isinstance(p, click.Option) and p.help]
    folders = [p for p in options if p.help.startswith("Folder")]
    assert len(folders) > 5
    assert not [p.name for p in folders if not p.metavar and getattr(p.type, "file_okay", True)]
