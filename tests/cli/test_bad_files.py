"""An unusable file ends with exit code 3 and one paragraph: file, place, value, expected value, remedy."""

import json
import re
import shutil

import pytest

from baqueano.vehicle_file import load


@pytest.mark.parametrize(
    ("pattern", "replacement", "place", "code"),
    [
        (r"mass_kg = 0.61.*\n", "", "[model]", "vehicle.model-lacks"),
        (r"mass_kg = 0.61", "mas_kg = 0.61", "line 21, [model]", "vehicle.key-unknown"),
        (r"mass_kg = 0.61", "mass_kg = -0.61", "line 21, [model]", "vehicle.out-of-range"),
        (r"mass_kg = 0.61", "mass_g = 610", "line 21, [model]", "vehicle.unit-other"),
        (r"mass_kg = 0.61", "mass_kg = 610.0", "line 21, [model]", "vehicle.too-heavy"),
        (r"mass_kg = 0.61", "mass_kg = nan", "line 21, [model]", "vehicle.not-finite"),
        (r"mass_kg = 0.61", 'mass_kg = "heavy"', "line 21, [model]", "vehicle.not-number"),
        (r"mass_kg = 0.61", "mass_kg = = 1", "line 21", "toml.syntax"),
        (r'kind = "pd_feedforward"', 'kind = "pid"', "[controller]", "block.unknown"),
    ],
)
def test_a_wrong_vehicle_file_is_reported_by_file_line_and_key(
    baqueano, tmp_path, pattern, replacement, place, code
):
    text, count = re.subn(pattern, replacement, load("small").text, count=1)
    assert count
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    end = baqueano("experiment", "--vehicle", "mine.toml", "--seconds", "1")
    assert (end.code, end.out) == (3, "")
    assert f'"code": "{code}"' in json.dumps(end.reason.to_json())
    assert "mine.toml" in end.paragraph
    assert place in end.paragraph
    assert "baqueano experiment" not in end.fix, "the failed command is not advised again"
    assert not list(tmp_path.rglob("*.mcap*"))


FOREIGN = {
    "picture.mcap": (b"\x89PNG\r\n\x1a\n" + bytes(100), "runs.is-bytes"),
    "empty.mcap": (b"", "runs.empty"),
    "bag.mcap": (b"#ROSBAG V2.0\n", "runs.is-ros-1"),
    "table.csv": (b"t,x\n0,1\n", "runs.is-text"),
    "vehicle.toml": (b"format = 1\n", "runs.is-toml"),
}


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("verb", ["runs show", "runs recover", "identify", "replay", "compare", "report"])
def test_every_command_refuses_a_file_that_is_not_a_run(baqueano, tmp_path, name, verb):
    content, code = FOREIGN[name]
    (tmp_path / name).write_bytes(content)
    end = baqueano(*verb.split(), name)
    assert end.code == 3
    assert (end.reason.code, end.reason.figures["path"]) == (code, name)
    assert end.fix
    assert end.out == ""


@pytest.mark.parametrize("verb", ["runs show", "runs recover", "identify", "replay", "compare", "report"])
def test_a_missing_run_is_reported(baqueano, verb, tmp_path):
    end = baqueano(*verb.split(), "last")
    assert end.code == 3
    assert (end.reason.code, end.reason.figures["value"]) == ("runs.folder-empty", "last")
    (tmp_path / "runs").mkdir()
    reason = baqueano(*verb.split(), "no.mcap").reason
    assert (reason.code, reason.fix) == ("runs.absent", "baqueano runs ls")


def test_a_truncated_run_is_read_to_its_end_with_a_warning(baqueano, lab, tmp_path):
    data = (lab / "runs" / "0001-experiment.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: 2 * len(data) // 3])
    listing = baqueano("runs", "show", "cut.mcap", "--json")
    assert listing.code == 0
    assert listing.reply["rows"][0]["count"] > 100
    assert "cut.mcap was not closed" in listing.err
    recovery = baqueano("runs", "recover", "cut.mcap")
    assert recovery.code == 0
    assert "cut-recovered.mcap" in recovery.out
    assert "not closed" not in baqueano("runs", "show", "cut-recovered.mcap").err
    assert len((tmp_path / "cut.mcap").read_bytes()) == 2 * len(data) // 3, "the original is unchanged"


def test_an_empty_cut_is_refused_with_the_length_of_the_run(baqueano, lab):
    end = baqueano("runs", "cut", str(lab / "runs" / "0001-experiment.mcap"), "--from", "50")
    assert end.code == 2
    assert end.reason.code == "cli.cut-after-end"
    assert (end.reason.figures["start_s"], end.reason.figures["duration_s"]) == (
        50.0,
        pytest.approx(3.0, abs=0.01),
    )


def test_an_existing_run_is_never_overwritten(baqueano, tmp_path):
    (tmp_path / "mine.mcap").write_bytes(b"precious")
    for verb in ("experiment", "simulate"):
        end = baqueano(verb, "--vehicle", "small", "--seconds", "1", "-o", "mine.mcap")
        assert end.code == 3
        assert end.reason.code == "cli.file-exists"
    assert (tmp_path / "mine.mcap").read_bytes() == b"precious"


HEAD = b"# closed = false\nt_s,x_m,y_m,psi_rad,nu_x_m_s,nu_y_m_s,nu_psi_rad_s\n"


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (None, "route.absent-stored"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "cli.route-not-text"),
        (b"t_s,x_m\n0,1\n1,2\n", "route.no-column"),
        (HEAD + b"0,0,0,0,0,0,0,5\n1,1,0,0,0,0,0,5\n", "route.uneven"),
        (HEAD + b"0,0,0,0,0,0,0\n0,1,0,0,0,0,0\n", "route.times"),
        (HEAD + b"1,0,0,0,0,0,0\n2,1,0,0,0,0,0\n", "route.times"),
        (HEAD + b"0,0,0,0,0,0,0\n1,nan,0,0,0,0,0\n", "route.not-number"),
        (HEAD[17:] + b"0,0,0,0,0,0,0\n1,1,0,0,0,0,0\n", "route.closed-missing"),
    ],
)
def test_a_wrong_route_is_refused_before_the_drive(baqueano, lab, tmp_path, content, code):
    shutil.copytree(lab / "routes", tmp_path / "routes")
    shutil.copy(tmp_path / "routes" / "lab.csv", tmp_path / "routes" / "mine2.csv")
    if content is not None:
        (tmp_path / "routes" / "mine.csv").write_bytes(content)
    end = baqueano("repeat", "mine", "--vehicle", "small")
    assert end.code == 3
    assert end.reason.code == code
    assert "mine.csv" in end.paragraph
    assert ("repeat" in end.fix) == (content is None)  # with the nearest name
    assert not list(tmp_path.rglob("*.mcap*"))
