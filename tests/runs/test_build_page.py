"""docs/build.md: its keys are valid in a vehicle file, its map joins a run with a camera, and its quotations exist
in the source.
"""

import csv
import re
import tomllib
from pathlib import Path

import numpy as np
import tomlkit

from baqueano.cli.robot.settings import NAMES
from baqueano.runs import read_run
from baqueano.vehicle_file import load
from baqueano.vehicle_file.head import Hardware
from tests.runs.conftest import run_line

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/build.md").read_text(encoding="utf-8")
TABLES = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
LINES = re.findall(r"^baqueano runs .*$", PAGE, re.MULTILINE)


def with_keys(lines):
    """Return the file of the small vehicle with these lines of the page."""
    text = tomlkit.parse(load("small").text)

    def put_value(into, cells):
        for key, value in cells.items():
            if isinstance(value, dict):
                put_value(into.setdefault(key, {}), value)
            else:
                into[key] = value

    put_value(text, tomllib.loads(lines))
    return tomlkit.dumps(text)


def test_the_keys_of_the_build_page_configure_encoders_and_mark(tmp_path):
    path = tmp_path / "vehicle.toml"
    path.write_text(with_keys(TABLES[0]), encoding="utf-8")
    assert load(path).robot.counts_per_turn == 40
    path.write_text(with_keys(TABLES[1]), encoding="utf-8")
    file = load(path)
    assert set(file.sensors._fields) == {"imu", "mark"}
    assert file.estimator().use == ("imu", "mark")


def test_the_map_of_the_build_page_adds_camera_truth_to_a_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_line("baqueano experiment --vehicle small --seconds 6 --seed 4")
    run_line(LINES[0])
    Path("camera.toml").write_text(TABLES[2], encoding="utf-8")
    with (
        Path("log.csv").open(encoding="utf-8") as log,
        Path("camera.csv").open("w", encoding="utf-8") as camera,
    ):
        camera.write("t,x_mm,y_mm,yaw_deg\n")
        for row in list(csv.DictReader(log))[::4]:
            x, y, psi = (float(row[f"truth.{name}"]) for name in ("x_m", "y_m", "psi_rad"))
            camera.write(f"{row['t_s']},{1e3 * x},{1e3 * y},{np.degrees(psi)}\n")
    run_line(LINES[1])
    camera_run, driven_run = read_run(Path("with-camera.mcap")), read_run(next(Path("runs").glob("*.mcap")))
    np.testing.assert_allclose(camera_run.applied_commands, driven_run.applied_commands)
    np.testing.assert_allclose(camera_run.sensors["imu"].z, driven_run.sensors["imu"].z)
    np.testing.assert_allclose(camera_run.truth.eta, driven_run.truth.eta[::4], atol=1e-9)


def test_messages_quoted_on_the_build_page_exist_in_the_source():
    section = PAGE.split("## When it does not work")[1].split("\n## ")[0]
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    quotations = re.findall(r'"([^"\n]{8,})"', section)
    assert len(quotations) >= 4
    assert [words for words in quotations if words not in source] == []


def test_settings_named_on_the_build_page_exist():
    (line,) = re.findall(r"^baqueano robot settings (--bridge .*)$", PAGE, re.MULTILINE)
    options_given = dict(re.findall(r"--([a-z-]+) (\S+)", line))
    assert options_given.keys() <= NAMES.keys()
    assert all(
        value in NAMES[name][0].split("|") for name, value in options_given.items() if "|" in NAMES[name][0]
    )
    (names,) = re.findall(r"The bridge is (.*? or `low`)\.", PAGE)
    choices = {value for name in ("bridge", "encoders", "mark") for value in NAMES[name][0].split("|")}
    assert set(re.findall(r"`(\w+)`", names)) == choices


def test_robot_keys_named_on_the_pages_exist():
    keys = set(Hardware.__dataclass_fields__)
    for page in (PAGE, (ROOT / "docs/robot.md").read_text(encoding="utf-8")):
        names = set(re.findall(r"`\[robot\] (\w+)", page)) | set(
            re.findall(r"\b(imu_\w+|least_\w+|max_\w+) =", page)
        )
        assert names
        assert names <= keys
