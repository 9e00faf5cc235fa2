"""What a person mistypes ends with exit code 2 and one paragraph that says what was expected and what to type."""

import subprocess
import sys

import pytest

from baqueano import __version__
from baqueano.cli import VERBS


@pytest.mark.parametrize(
    ("line", "found", "expected"),
    [
        ("experimnt", "experimnt", "Did you mean 'experiment'?"),
        ("fly", "There is no 'baqueano fly'", "repeat"),
        ("runs cot", "runs cot", "Did you mean 'cut'?"),
        ("study papr", "study papr", "paper"),
        ("blocks chek", "blocks chek", "check"),
        ("experiment --secs 5", "--secs", "--seconds"),
        ("experiment extra", "extra", "baqueano experiment --help"),
        ("experiment --seconds abc", "abc is refused", "a number above 0 and at most 86400 [s]"),
        ("experiment --seconds -5", "-5 is refused", "above 0"),
        ("experiment --seconds nan", "nan is refused", "above 0"),
        ("experiment --seconds 1e12", "1e12 is refused", "at most 86400"),
        ("experiment --seed -1", "-1", "x>=0"),
        ("experiment --backend rust", "rust", "'numpy'"),
        ("experiment --vehicle small --signal prb", "prb", "Did you mean prbs?"),
        ("experiment --vehicle small --signal desined --room 2x2", "desined", "--signal designed"),
        ("experiment --vehicle small --robot simulated:car --seconds 1", "3 commands", "2"),
        ("simulate --vehicles 0", "0", "x>=1"),
        ("simulate --vehicle small --set model.mass_kg", "model.mass_kg", "key=value"),
        ("simulate --vehicle small --set model.mas_kg=1", "model.mas_kg", "Did you mean model.mass_kg?"),
        ("simulate --vehicle small --set model.mass_kg=-1", "-1", "0.001 to 100000 [kg]"),
        ("repeat", "ROUTE", "baqueano repeat --help"),
        ("repeat lab --laps -1", "-1", "x>=0"),
        ("identify", "RUNS", "baqueano identify --help"),
        ("identify last --table fit.pdf", "fit.pdf", "--table fit.csv"),
        ("identify last --over-time --held-out 2", "--over-time", "--held-out: it follows all runs"),
        ("identify last --over-time --choose", "--over-time", "--choose: it follows all runs"),
        ("tune --speed -1", "-1 is refused", "[m/s]"),
        ("tune --size 0", "0 is refused", "[m]"),
        ("teach r --vehicle small --driver circle --size -1", "-1 is refused", "[m]"),
        ("experiment --vehicle small --robot emulatd", "--robot emulatd", "--robot emulated"),
        ("experiment --vehicle small --robot simulate:car", "--robot simulate:car", "--robot simulated"),
        ("teach r --vehicle small --driver cirle", "cirle", "teach r --vehicle small --driver circle"),
        ("teach r --vehicle small --driver loop", "'loop' is neither", "sinuous-circle, circle, eight"),
        ("study paper --seeds 0", "0", "x>=1"),
        ("blocks check ekff", "ekff", "Did you mean ekf?"),
        ("blocks check ekf --room kitchen", "kitchen", "estimator"),
        ("runs export 1 --to xls", "xls", "'csv', 'tum'"),
        ("runs cut 1 --from x", "x is refused", "[s]"),
    ],
)
def test_a_mistyped_command_ends_in_one_paragraph_and_code_2(baqueano, tmp_path, line, found, expected):
    end = baqueano(*line.split())
    assert end.code == 2, end.err
    assert end.out == ""
    assert found in end.paragraph
    assert expected in end.paragraph
    assert "baqueano " in end.paragraph or "Type:" in end.paragraph
    assert not list(tmp_path.rglob("*.mcap*")), "no number of a run was taken"


def test_help_is_for_every_verb(baqueano):
    for flag in ("-h", "--help"):
        shown = baqueano(flag)
        assert shown.code == 0
        assert all(verb in shown.out for verb in VERBS)
    for verb in VERBS:
        shown = baqueano(verb, "-h")
        assert shown.code == 0
        assert shown.out.startswith(f"Usage: baqueano {verb}")


def test_version_is_told(baqueano):
    assert baqueano("--version").out.strip() == f"baqueano, version {__version__}"


def test_the_module_is_the_command():
    shown = subprocess.run([sys.executable, "-m", "baqueano", "--version"], capture_output=True, text=True)
    assert shown.stdout.strip() == f"baqueano, version {__version__}"


def test_no_verb_at_all_shows_the_verbs_with_code_2(baqueano):
    end = baqueano()
    assert end.code == 2
    assert "demo" in end.err


def test_debug_shows_the_traceback_and_keeps_the_exit_code(baqueano):
    end = baqueano("runs", "show", "no.mcap", "--debug")
    assert end.code == 3
    assert "Traceback" in end.err
    assert "no.mcap: there is no such file" in end.err


def test_help_loads_no_verb_and_no_numpy():
    code = (
        "import sys\nfrom baqueano.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "from baqueano.cli import ROOMS\n"
        "rooms = ('numpy', 'scipy', 'mcap', *(f'baqueano.cli.{room}' for room in ROOMS))\n"
        "print([m for m in sys.modules if m.startswith(rooms)])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.rstrip().endswith("[]")


def test_an_error_that_nobody_foresaw_names_its_place(baqueano, monkeypatch):
    def broken(*args, **kwargs):
        raise RuntimeError("the moon")

    monkeypatch.setattr("baqueano.runs.folder.listing", broken)
    end = baqueano("runs", "ls")
    assert end.code == 1
    assert "an error that should not happen: RuntimeError: the moon" in end.paragraph
    assert "--debug" in end.paragraph


def test_a_full_disk_is_told_with_the_command_to_repeat(baqueano, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device", "runs")

    monkeypatch.setattr("baqueano.runs.folder.listing", full)
    end = baqueano("runs", "ls")
    assert end.code == 3
    assert "runs: No space left on device." in end.paragraph
    assert "baqueano runs ls" in end.paragraph


def test_too_little_memory_is_told(baqueano, monkeypatch):
    def big(*args, **kwargs):
        raise MemoryError("22 TiB")

    monkeypatch.setattr("baqueano.runs.folder.listing", big)
    assert "not enough memory for this (22 TiB)" in baqueano("runs", "ls").paragraph


def test_ctrl_c_ends_with_130(baqueano, monkeypatch):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("baqueano.runs.folder.listing", interrupted)
    end = baqueano("runs", "ls")
    assert end.code == 130
    assert "stopped from the keyboard" in end.paragraph


def test_an_unknown_back_end_in_the_environment_is_told(baqueano, monkeypatch):
    monkeypatch.setenv("BAQUEANO_BACKEND", "rust")
    end = baqueano("runs", "ls")
    assert end.code == 2
    assert "BAQUEANO_BACKEND=rust: expected one of auto, c, python, numpy." in end.paragraph


def test_a_c_back_end_without_a_compiler_is_told_with_the_other_one(baqueano, monkeypatch):
    from baqueano.symbolic.c_code.compile import CompileError

    def refused(*args, **kwargs):
        raise CompileError("no C compiler: install gcc or clang")

    monkeypatch.setattr("baqueano.simulate.simulate", refused)
    end = baqueano("simulate", "--vehicle", "small", "--seconds", "1", "--backend", "c")
    assert end.code == 2
    assert "no C compiler: install gcc or clang. Or let Python compute: --backend python" in end.paragraph


def test_a_vehicle_that_nobody_reaches_ends_in_one_paragraph_and_code_4(baqueano):
    end = baqueano("experiment", "--vehicle", "small", "--robot", "nobody@127.0.0.1:1")
    assert end.code == 4, end.err
    assert "nobody@127.0.0.1:1 cannot be reached: " in end.err
    assert ". To see why: ssh nobody@127.0.0.1:1 baqueano robot status" in end.err


def test_a_laptop_that_is_taken_for_the_vehicle_is_told_to_name_it(baqueano):
    end = baqueano("robot", "status")
    assert end.code == 4
    assert "from a laptop name the vehicle, as pilot@rover.local" in end.err


@pytest.mark.parametrize("group", ["robot", "runs", "study", "blocks"])
def test_no_sentence_of_a_list_of_verbs_is_cut_short(baqueano, group):
    assert "..." not in baqueano(group, "--help").out.partition("Commands:")[2]
