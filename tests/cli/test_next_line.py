"""After an error stands a command that goes further, spelt as it is typed; never the one that failed, as it was."""

import shlex

import pytest

from baqueano.cli.modelling.identify import command
from baqueano.cli.next_line import with_next
from baqueano.cli.spelling import OPTIONS, as_typed


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ('clocks = "gps": expected imu', "--clock gps: expected imu"),
        ('use = "imu[2]": its channels', "--use 'imu[2]': its channels"),
        ("segment_s = -1.5: expected", "--segment -1.5: expected"),
        ("Leave it out with use=(…).", "Leave it out with --use SENSOR."),
        ("Name it with free=[…]", "Name it with --free KEY"),
        ("leave out segment_s, and", "leave out --segment, and"),
        ('measured "12": expected', '--measured "12": expected'),
        ('Type: --measured "12 s: 1 m"', 'Type: --measured "12 s: 1 m"'),
        ("the clock is free, and it costs use = nothing", "the clock is free, and it costs use = nothing"),
        ("start = 3 is free to use", "--set 3 is free to use"),
    ],
)
def test_an_error_names_options_where_python_has_arguments(text, typed):
    assert as_typed(text) == typed


def test_every_option_that_stands_for_an_argument_is_one_of_the_verb():
    known = {option for param in command.params for option in param.opts}
    assert {option for option, _ in OPTIONS.values()} <= known


@pytest.mark.parametrize(
    ("line", "put_right"),
    [
        ("identify god.mcap", "identify good.mcap"),
        ("identify good.mcap --vehicle mine.tml", "identify good.mcap --vehicle mine.toml"),
        ("identify good.mcap --vehicle smal", "identify good.mcap --vehicle small"),
        (
            "identify good.mcap --free model.friction.lineer",
            "identify good.mcap --free model.friction.linear",
        ),
        (
            "identify good.mcap --free friction.linear[1]",
            "identify good.mcap --free 'model.friction.linear[1]'",
        ),
        ("identify good.mcap --set model.mas_kg=1", "identify good.mcap --set model.mass_kg=1"),
        ("runs import cpm_run_c", "runs import cpm_run_b"),
        ("runs import mine.tml x.csv", "runs import mine.toml x.csv"),
    ],
)
def test_a_name_that_was_mistyped_is_put_right_in_the_command(baqueano, lab, tmp_path, line, put_right):
    (tmp_path / "good.mcap").write_bytes((lab / "runs" / "0001-experiment.mcap").read_bytes())
    (tmp_path / "mine.toml").touch()
    end = baqueano(*line.split())
    assert end.code in (2, 3)
    assert end.paragraph.endswith(f"Type: baqueano {put_right}")


def test_the_options_of_a_verb_of_a_group_are_those_of_the_verb(baqueano):
    end = baqueano("robot", "card", "bootfs", "--name", "rover", "--wifi", "net", "--own-network")
    assert end.code == 2
    assert end.paragraph.endswith("All options: baqueano robot card --help")


def test_a_run_that_is_not_there_is_looked_for_in_the_list(baqueano):
    assert baqueano("identify", "77").paragraph.endswith("All that there are: baqueano runs ls")


def test_a_path_that_is_not_there_is_answered_with_what_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    args = ["runs", "import", "map.toml", "trials.csv"]
    (tmp_path / "map.toml").touch()
    said = with_next("trials.csv cannot be read", 3, args)
    assert said.endswith(f"In {tmp_path.name} is no file *.csv. Give the path of one in its place.")
    for name in ("a.csv", "b.csv", "c.csv", "d.csv", "e.csv", "f.csv", "notes.txt"):
        (tmp_path / name).touch()
    said = with_next("trials.csv cannot be read", 3, args)
    assert "there are a.csv, b.csv, c.csv, d.csv, e.csv and 1 more." in said


def test_a_file_that_is_to_be_mended_is_followed_by_the_same_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").touch()
    args = ["runs", "import", "map.toml"]
    said = with_next("map.toml line 3 is no TOML", 3, args)
    assert said == f"map.toml line 3 is no TOML. When it is mended, again: baqueano {shlex.join(args)}"


def test_what_says_itself_what_to_type_is_left_as_it_is():
    for text in ("no. Type: --update", "no. Bring it in: baqueano runs import"):
        assert with_next(text, 2, ["identify", "x"]) == (text if "Type:" in text else f"{text}.")
    assert with_next("the answer is no", 1, ["identify", "x"]) == "the answer is no"
