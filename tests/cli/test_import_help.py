"""The help shows a user with a recording the format of a map, and errors refer to this help."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from baqueano.cli.modelling.runs import MAP_EXAMPLE
from baqueano.errors import FileError
from baqueano.runs import import_run, read_run
from baqueano.runs.maps.column_map import load_map, maps_folder
from tests.codes import refused
from tests.runs.test_draft import drafted


def test_the_map_in_the_help_is_valid(tmp_path):
    text = MAP_EXAMPLE.partition("\b\n")[2]
    assert tomllib.loads(text)["name"] == "rover"
    (tmp_path / "rover.toml").write_text(text, encoding="utf-8")
    signal_map = load_map(tmp_path / "rover.toml")
    assert signal_map.wheels
    assert [len(signal.entries) for signal in (signal_map.command, signal_map.sensors["imu"])] == [2, 3]


def test_the_help_prints_the_map_unchanged(baqueano):
    assert "\n  [command]\n" in baqueano("runs", "import", "--help").out


@pytest.mark.parametrize("file_name", ["log.csv", "drive.mcap"])
def test_a_recording_given_as_a_map_is_refused(baqueano, tmp_path, file_name):
    (tmp_path / file_name).write_bytes(b"t;\xb0/s\n")
    end = baqueano("runs", "import", file_name)
    assert end.code == 3
    assert end.reason.code == "map.recording"
    assert end.fix == f"baqueano runs import {file_name} --draft {file_name.partition('.')[0]}.toml"


def test_advised_imports_name_the_files_of_the_folder(baqueano, tmp_path):
    (tmp_path / "log.csv").write_text("t,ax\n0.0,0.1\n", encoding="utf-8")
    (tmp_path / "log.toml").write_text(MAP_EXAMPLE.partition("\b\n")[2], encoding="utf-8")
    end = baqueano("runs", "import", "log.csv", "log.toml")
    assert (end.code, end.reason.code) == (2, "cli.map-second")
    assert end.fix == "baqueano runs import log.toml log.csv"
    assert baqueano("runs", "import", "log.csv").fix == "baqueano runs import log.csv --draft MAP.toml"
    end = baqueano("runs", "import", "log.toml")
    assert end.reason.code == "import.no-path"
    assert end.fix == "baqueano runs import log.toml FILE"


def test_the_draft_gives_each_duty_its_direction_pin(tmp_path):
    """Without the pins each backward command was a forward command; the rarer level is backward."""
    rows = ["t_ms,pwm_l,dir_l,pwm_r,dir_r", "0,0,0,0,0"]
    rows += [f"{10 * k},{90 + k},{int(k < 9)},{80 + k},{int(k > 7)}" for k in range(1, 12)]
    wheels = drafted(tmp_path, "\n".join(rows))["command"]["wheels"]
    assert [entry["backward"] for entry in wheels] == [{"dir_l": 0}, {"dir_r": 1}]


def test_a_map_is_recognised_by_its_content(baqueano, tmp_path):
    text = MAP_EXAMPLE.partition("\b\n")[2]
    (tmp_path / "rover.map").write_text(text, encoding="utf-8")
    assert load_map(tmp_path / "rover.map").name == "rover"
    (tmp_path / "rover.map").write_text(text.replace("format = 1", "format = = 1"), encoding="utf-8")
    end = baqueano("runs", "import", "rover.map")
    assert end.code == 3
    assert end.reason.code == "map.recording-or-wrong"
    assert dict(end.reason.figures) == {"path": "rover.map", "line": 1, "column": 10}


@pytest.mark.parametrize("rows", [b"t,ax\n0.0,0.1\n", b"t;\xb0/s\n"])
def test_a_recording_does_not_hide_a_built_in_map(tmp_path, monkeypatch, rows):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mpu6050").write_bytes(rows)
    assert load_map("mpu6050").path == maps_folder() / "mpu6050.toml"
    (tmp_path / "mpu6050").write_text(MAP_EXAMPLE.partition("\b\n")[2], encoding="utf-8")
    assert load_map("mpu6050").name == "rover"


def test_map_detection_reads_only_the_start_of_a_long_recording(tmp_path, monkeypatch):
    monkeypatch.setattr("baqueano.runs.maps.column_map.MAX_MAP_LETTERS", 1000)
    (tmp_path / "log.csv").write_bytes(b"t,ax\n" + b"0.0,0.1\n" * 2000 + b"\xff")
    with refused("map.recording-or-wrong", FileError, line=1, column=2):
        load_map(tmp_path / "log.csv")


def test_one_imported_run_is_written_to_the_reported_folder(baqueano, tmp_path):
    (tmp_path / "rover.toml").write_text(
        MAP_EXAMPLE.partition("\b\n")[2].split("[sensors.imu]")[0], encoding="utf-8"
    )
    for name in ("first", "second"):
        rows = "".join(f"{20 * k},{k},{2 * k}\n" for k in range(20))
        (tmp_path / f"{name}.csv").write_text("time_ms,pwm_left,pwm_right\n" + rows, encoding="utf-8")
    result = baqueano("runs", "import", "rover.toml", "first.csv", "second.csv", "-o", "my runs")
    assert result.out == "nothing in the data was doubtful\n"
    assert "next: baqueano new mylab\n" in result.err
    (line,) = re.findall(r"^then: (.*)", result.err, re.MULTILINE)
    ends = [str(Path("my runs") / f"{name}.mcap") for name in ("first", "second")]
    assert shlex.split(line) == [
        "baqueano",
        "identify",
        ends[0],
        "--held-out",
        ends[1],
        "--vehicle",
        "mylab/vehicle.toml",
        "--update",
    ]
    for file_name, names in (("first.csv", {"first"}), ("second.csv", {"first", "second"})):
        assert baqueano("runs", "import", "rover.toml", file_name, "-o", "trials").code == 0
        assert {path.stem for path in (tmp_path / "trials").glob("*.mcap")} == names
    assert baqueano("runs", "import", "rover.toml", "first.csv", "-o", "here.mcap").code == 0
    assert (tmp_path / "here.mcap").is_file()


def test_an_empty_cut_is_refused(baqueano, tmp_path):
    end = baqueano("runs", "cut", "1")
    assert (end.code, end.out) == (2, "")
    assert (end.reason.code, end.fix) == ("cli.cut-without-effect", "baqueano runs cut 1 --from 2 --to 30")


def test_the_advised_list_command_for_a_missing_run_works(baqueano, tmp_path):
    end = baqueano("runs", "show", "no.mcap")
    assert end.code == 3
    assert baqueano(*end.fix.split()[1:]).code == 0


LOG = "time_ms,left_pwm,right_pwm,left_rpm,right_rpm,ax_g,ay_g,gyro_dps,x_mm,y_mm,yaw_deg,note\n"


def test_a_draft_of_a_map_is_a_valid_map(baqueano, tmp_path):
    rows = "".join(f"{20 * k},{k % 200},100,10,10,0,0,{k % 7},{k},0,0,a\n" for k in range(60))
    (tmp_path / "log.csv").write_text(LOG + rows, encoding="utf-8")
    assert baqueano("runs", "import", "log.csv").fix == "baqueano runs import log.csv --draft log.toml"
    draft = baqueano("runs", "import", "log.csv", "--draft", "log.toml")
    assert draft.code == 0
    assert "baqueano runs import log.toml log.csv" in draft.out
    signal_map = load_map(tmp_path / "log.toml")
    assert (signal_map.wheels, set(signal_map.sensors), signal_map.truth is not None) == (
        True,
        {"wheels", "imu"},
        True,
    )
    assert [entry.unit for entry in signal_map.sensors["imu"].entries] == ["g", "g", "deg/s"]
    assert "columns that are not used: note" in (tmp_path / "log.toml").read_text(encoding="utf-8")
    assert baqueano("runs", "import", "log.csv", "--draft", "log.toml").reason.code == "cli.file-exists"
    (row,) = baqueano("runs", "import", "log.csv", "--draft", "again.toml", "--json").reply["rows"]
    assert row == {"map": "again.toml", "missing_units": 0}


def test_a_draft_is_for_all_its_files_or_names_the_one_with_other_columns(baqueano, tmp_path):
    for name in ("log.csv", "second.csv"):
        (tmp_path / name).write_text(
            LOG + "0,1,1,0,0,0,0,0,0,0,0,a\n20,1,1,0,0,0,0,0,0,0,0,a\n", encoding="utf-8"
        )
    (tmp_path / "camera.csv").write_text("time_ms,x_mm\n0,1\n20,2\n", encoding="utf-8")
    end = baqueano("runs", "import", "log.csv", "camera.csv", "--draft", "log.toml")
    assert (end.code, end.reason.code) == (2, "import.draft-columns")
    assert end.fix == "baqueano runs import camera.csv --draft camera.toml"
    assert not (tmp_path / "log.toml").exists()
    draft_end = baqueano("runs", "import", "log.csv", "second.csv", "--draft", "log.toml")
    assert "baqueano runs import log.toml log.csv second.csv" in draft_end.out


def test_a_draft_takes_columns_with_the_package_names_of_commands_as_commands(baqueano, tmp_path):
    rows = "".join(f"{0.02 * k},0.5,0.1,{0.01 * k},0,0\n" for k in range(60))
    (tmp_path / "log.csv").write_text("t,u_x,u_psi,x_m,y_m,psi_rad\n" + rows, encoding="utf-8")
    assert baqueano("runs", "import", "log.csv", "--draft", "log.toml").code == 0
    signal_map = load_map(tmp_path / "log.toml")
    assert signal_map.names == ("u_x", "u_psi")
    assert baqueano("runs", "import", "log.toml", "log.csv").code in (0, 1)


@pytest.mark.parametrize(
    ("times", "unit"),
    [
        ([f"{1_700_000_000_000_000_000 + 20_000_000 * k}" for k in range(9)], "ns"),
        (["0", "20", "", "60", "80"], "ms"),
        ([f"{20_000 * k}" for k in range(9)], "us"),
        ([f"{1.7e9 + 0.02 * k:.2f}".replace(".", ",") for k in range(9)], "s"),
        (["0"], "?"),
    ],
)
def test_a_draft_reads_the_unit_of_the_time_from_its_steps(tmp_path, times, unit):
    rows = "".join(f"{t};0,5;200\n" for t in times)
    tables = drafted(tmp_path, "tiempo;pwm izquierda;pwm derecha\n" + rows)
    assert tables["files"]["log"] == {"time": "tiempo", "time_unit": unit}
    scales = [entry["scale"] for entry in tables["command"]["wheels"]]
    assert scales == [pytest.approx(1 / 255, rel=1e-5)] * 2


@pytest.mark.parametrize("name", ["a\\b left", 'the "left"', "left #1", "it's left"])
def test_a_draft_is_valid_toml_with_any_column_name(tmp_path, name):
    head = "t,{0} rpm,right rpm,{0} pwm".format(name.replace('"', '""'))
    head = ",".join(f'"{cell}"' for cell in head.split(","))
    tables = drafted(tmp_path, f"{head}\n" + "0.1,1,2,3\n" * 3)
    assert tables["sensors"]["wheels"]["z"][0]["column"] == f"{name} rpm"
    assert tables["command"]["names"] == [f"{name} pwm"]


@pytest.mark.parametrize(
    ("header", "code", "has_rest_text"),
    [("t,x_m,y_m,psi_rad", 0, True), ("t,gyro_rad_s", 0, True), ("t,note", 3, False)],
)
def test_a_draft_without_commands_agrees_with_the_import(baqueano, tmp_path, header, code, has_rest_text):
    width = header.count(",")
    rows = "".join(f"{0.02 * k}" + f",{0.01 * (k % 5)}" * width + "\n" for k in range(100))
    (tmp_path / "log.csv").write_text(f"{header}\n{rows}", encoding="utf-8")
    assert baqueano("runs", "import", "log.csv", "--draft", "log.toml").code == 0
    assert ("without [command]" in (tmp_path / "log.toml").read_text(encoding="utf-8")) == has_rest_text
    end = baqueano("runs", "import", "log.toml", "log.csv", "-o", "log.mcap")
    assert end.code == code, end.reason
    if has_rest_text:
        assert not read_run(tmp_path / "log.mcap").applied_commands.any()
    else:
        assert (end.reason.code, end.reason.figures["place"]) == ("map.missing", "command")


@pytest.mark.parametrize("name", ["empty.csv", "empty.toml"])
def test_an_empty_file_in_place_of_a_map_is_called_empty(baqueano, tmp_path, name):
    (tmp_path / name).write_text("\n", encoding="utf-8")
    end = baqueano("runs", "import", name)
    assert (end.code, end.reason.code) == (3, "map.empty")
    assert end.fix == "baqueano runs import RECORDING.csv --draft MAP.toml"


def test_an_unknown_unit_must_be_stated_by_the_user(baqueano, tmp_path):
    (tmp_path / "log.csv").write_text(
        "t,gyro\n" + "".join(f"{0.02 * k},{k}\n" for k in range(9)), encoding="utf-8"
    )
    baqueano("runs", "import", "log.csv", "--draft", "log.toml")
    end = baqueano("runs", "import", "log.toml", "log.csv")
    assert (end.reason.code, end.reason.figures["value"]) == ("map.wrong", "'?'")
    assert not list(tmp_path.rglob("*.mcap*"))


def test_a_recording_at_rest_needs_no_command(baqueano, tmp_path):
    text = MAP_EXAMPLE.partition("\b\n")[2]
    start, end = text.index("[command]"), text.index("[sensors.imu]")
    (tmp_path / "rest.toml").write_text(text[:start] + text[end : text.index("[truth]")], encoding="utf-8")
    rows = "".join(f"{20 * k},0.0{k % 3},{k % 5}\n" for k in range(100))
    (tmp_path / "rest.csv").write_text("time_ms,ax,gyro\n" + rows, encoding="utf-8")
    assert baqueano("runs", "import", "rest.toml", "rest.csv", "-o", "rest.mcap").code == 0
    run = read_run(tmp_path / "rest.mcap")
    assert run.applied_commands.shape[1] == 3
    assert not run.applied_commands.any()


def test_a_draft_reads_spanish_names_signs_of_units_and_the_encoding_of_excel(baqueano, tmp_path):
    names = (
        "t (µs);tracción izq (%);tracción der (%);acel. x (m/s²);acel. y (m/s²);giro z (°/s);velocidad (km/h)"
    )
    rows = "".join(f"{20000 * k};{k % 90},5;{k % 70};0,1;0,2;{k % 7},5;3,5\n" for k in range(60))
    (tmp_path / "log.csv").write_text(f"{names}\n{rows}", encoding="cp1252")
    end = baqueano("runs", "import", "log.csv", "--draft", "log.toml")
    assert (end.code, "cp1252" in (tmp_path / "log.toml").read_text(encoding="utf-8")) == (0, True)
    signal_map = load_map(tmp_path / "log.toml")
    assert signal_map.files["log"].time_unit == "us"
    assert [entry.unit for entry in signal_map.command.entries] == ["%", "%"]
    assert [entry.unit for entry in signal_map.sensors["imu"].entries] == ["m/s^2", "m/s^2", "deg/s"]
    assert signal_map.sensors["odometer"].entries[0].unit == "km/h"
    assert baqueano("runs", "import", "log.toml", "log.csv").code == 0
    one_path, in_a_list = (import_run(tmp_path / "log.toml", files).run
                           for files in (str(tmp_path / "log.csv"), [tmp_path / "log.csv"]))  # fmt: skip
    assert len(one_path.t_ns) == len(in_a_list.t_ns) == 59


def test_an_import_without_commands_advises_no_fit(baqueano, tmp_path):
    rows = "".join(f"{20 * k},0.1,0.2,0.{k % 7}\n" for k in range(200))
    (tmp_path / "log.csv").write_text("t_ms,ax_g,ay_g,gz_dps\n" + rows, encoding="utf-8")
    baqueano("runs", "import", "log.csv", "--draft", "log.toml")
    end = baqueano("runs", "import", "log.toml", "log.csv")
    assert end.code == 0
    assert "baqueano runs noise 0001-log" in end.err
    assert "identify" not in end.err
