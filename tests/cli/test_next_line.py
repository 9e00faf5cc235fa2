"""After an error, a helpful command is printed as it must be typed: the failed one only if its cause is elsewhere."""

import pytest

from baqueano.cli.modelling.identify import command, next_words
from baqueano.cli.next_command import UNWRITTEN_CODES, next_command
from baqueano.diagnostics import fault, note
from baqueano.messages import language, templates
from baqueano.messages.notation import OPTIONS, Argument, Option
from baqueano.validation import Forecast


@pytest.mark.parametrize(
    ("name", "value", "python", "line"),
    [
        ("clocks", "gps", 'clocks = "gps"', "--clock gps"), ("use", "imu[2]", 'use = "imu[2]"', "--use 'imu[2]'"),
        ("use", "…", 'use = "…"', "--use SENSOR"), ("free", "…", 'free = "…"', "--free KEY"),
        ("segment_s", "", "segment_s", "--segment"), ("speed_noise", "…", 'speed_noise = "…"', "--speed-noise"),
        ("laps", "", "laps", "--laps"),
    ],
)  # fmt: skip
def test_an_argument_is_formatted_for_python_or_for_the_shell(name, value, python, line):
    assert (format(Argument(name), value), format(Option(name), value)) == (python, line)


def test_each_advised_option_for_an_argument_is_an_option_of_the_command():
    options = {option for param in command.params for option in param.opts}
    assert {option for option, _ in OPTIONS.values()} <= options


@pytest.mark.parametrize(
    ("line", "put_right"),
    [
        ("identify god.mcap", "identify good.mcap"),
        ("identify good.mcap --vehicle mine.tml", "identify good.mcap --vehicle mine.toml"),
        ("identify good.mcap --vehicle smal", "identify good.mcap --vehicle small"),
        ("identify good.mcap --set model.mas_kg=1", "identify good.mcap --set model.mass_kg=1"),
        ("runs import cpm_run_c", "runs import cpm_run_b"),
        ("runs import mine.tml x.csv", "runs import mine.toml x.csv"),
        ("experimnt", "experiment"),
    ],
)
def test_a_mistyped_name_is_corrected_in_the_advised_command(baqueano, lab, tmp_path, line, put_right):
    (tmp_path / "good.mcap").write_bytes((lab / "runs" / "0001-experiment.mcap").read_bytes())
    (tmp_path / "mine.toml").touch()
    end = baqueano(*line.split())
    assert end.code in (2, 3)
    assert end.fix == f"baqueano {put_right}"


def test_help_advice_of_a_subcommand_names_the_subcommand(baqueano):
    end = baqueano("robot", "card", "bootfs", "--name", "rover", "--wifi", "net", "--own-network")
    assert (end.code, end.reason.code, end.fix) == (2, "cli.network-conflict", "baqueano robot card --help")


def test_the_error_about_a_missing_run_advises_to_list_the_runs(baqueano, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert baqueano("identify", "77").fix == "baqueano experiment"
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "1.mcap").touch()
    assert baqueano("identify", "77").fix == "baqueano runs ls"


def test_an_error_about_a_missing_path_lists_existing_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    args = ["runs", "import", "map.toml", "trials.csv"]
    cause = fault("table.not-read", absent_path="trials.csv")
    advice = next_command(cause, 3, args)
    assert (advice.code, dict(advice.figures)) == (
        "next.no-file",
        {"folder": tmp_path.name, "suffix": ".csv"},
    )
    for name in ("a.csv", "b.csv", "c.csv", "d.csv", "e.csv", "f.csv", "notes.txt"):
        (tmp_path / name).touch()
    figures = next_command(cause, 3, args).figures
    assert (figures["files"], figures["count"]) == ("a.csv, b.csv, c.csv, d.csv, e.csv", 1)


def test_the_error_about_a_damaged_file_does_not_advise_the_same_command():
    assert (
        next_command(fault("toml.syntax", file="mine.toml"), 3, ["experiment", "--vehicle", "mine.toml"])
        is None
    )
    advice = next_command(fault("map.wrong", map="map.toml"), 3, ["runs", "import", "map.toml"])
    assert advice.fix == "baqueano runs import --help"


@pytest.mark.parametrize(
    ("line", "right"),
    [
        ("teach a --speed 0,3", "teach a --speed 0.3"), ("teach a --speed=0,3", "teach a --speed=0.3"),
        ("compare 3 --skip 0,5", "compare 3 --skip 0.5"), ("drive --command-share 0,5", "drive --command-share 0.5"),
        ("experiment --set model.mass_kg=0,7", "experiment --set model.mass_kg=0.7"),
    ],
)  # fmt: skip
def test_a_decimal_comma_is_reported_and_corrected(baqueano, line, right):
    end = baqueano(*line.split(), *(["--vehicle", "small"] if not line.startswith("compare") else []))
    assert (end.code, end.ending.next.code) == (2, "next.decimal-comma")
    assert end.fix.startswith(f"baqueano {right}")


def test_the_decimal_comma_of_a_room_gets_one_advice(baqueano):
    end = baqueano("experiment", "--vehicle", "small", "--signal", "designed", "--room", "2,5x2")
    assert (end.ending.reason.code, end.ending.reason.fix) == ("room.unreadable", "--room 2.5x2")
    assert end.ending.next is None


@pytest.mark.parametrize(
    "line",
    [
        "repeat lap --laps 1,5", "experiment --duration 60,5", "sweep --seeds 2,5", "repeat lap --from 0,5",
        "route check lap --room 2x2 --start 0,5", "identify 1 --tolerance sensors.imu.gyro_scale=0,01",
    ],
)  # fmt: skip
def test_a_decimal_point_is_not_advised_where_it_does_not_help(baqueano, line):
    ending = baqueano(*line.split()).ending
    assert (ending.next or ending.reason).code != "next.decimal-comma"


def test_numbers_of_a_list_get_brackets(baqueano):
    end = baqueano("simulate", "--vehicle", "small", "--set", "model.friction.linear=1,2.5,3")
    assert end.fix == "baqueano simulate --vehicle small --set 'model.friction.linear=[1,2.5,3]'"


def test_two_numbers_of_a_bound_are_not_read_as_a_decimal_comma():
    args = ["identify", "1", "--bound", "model.mass_kg=0,10"]
    assert next_command(fault("cli.usage"), 2, args).code == "next.options"


def test_an_error_that_contains_advice_gets_no_second_advice():
    cause = fault("cli.own-block", cause=fault("block.unknown", "baqueano blocks ls"))
    assert next_command(fault("cli.hand-options", "--driver keys"), 2, ["teach"]) is None
    assert next_command(cause, 3, ["repeat"]) is None
    assert next_command(fault("cli.fit-refused"), 1, ["identify", "x"]) is None


@pytest.mark.parametrize("code", ["cli.next-command", "cli.next-new", "cli.route-stored", "cli.taught"])
@pytest.mark.parametrize("name", language.LANGUAGES)
def test_an_advised_command_ends_its_line_so_that_it_can_be_copied(name, code):
    with language.use_language(name):
        lines = language.translate(templates()[code], code).split("\n")
    assert [line for line in lines if "{" in line and not line.endswith("}")] == []


@pytest.mark.parametrize("code", UNWRITTEN_CODES)
def test_a_result_that_could_not_be_written_is_advised_to_be_computed_again(code):
    args = ["identify", "2", "--update"]
    cause = fault("cli.text", words=fault(code, path="vehicle.toml", file="vehicle.toml", error="read-only"))
    assert next_command(cause, 3, args).fix == "baqueano identify 2 --update"


def test_a_model_that_leaves_the_lap_of_its_own_runs_needs_an_experiment_before_gains():
    """The line after "A lap cannot be predicted" advised to tune."""
    strays = Forecast((), (note("forecast.strays", distance="2.3 m"),))
    assert next_words(strays, None)[0] == "experiment"
    for lap, route in ((strays, "eight"), (Forecast((), ()), None), (None, None)):
        assert next_words(lap, route)[0] == "tune"
