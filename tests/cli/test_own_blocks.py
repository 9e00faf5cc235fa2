"""A broken user block stops the vehicle and loses no data; the error names its file and line."""

import json
import shutil
from pathlib import Path

import pytest

from baqueano.diagnostics import StopReason
from baqueano.errors import FileError
from baqueano.messages import text
from baqueano.runs import read_run
from baqueano.vehicle_file import load, parse

CONTROLLER = """import numpy as np
from baqueano.signals import Command

class Mine:
    def init(self):
        return None

    def step(self, state, reference, estimate):
        {line}
        return state, Command(estimate.t_ns, {u})
"""
GUIDE = """import numpy as np
from baqueano.signals import Reference

class Mine:
    def init(self):
        return None

    def step(self, state, estimate):
        {line}
        return state, Reference(estimate.t_ns, {u}, np.zeros(3), 1.0 * (estimate.t_ns > 200_000_000))
"""
ESTIMATOR = """import numpy as np
from baqueano.signals import Estimate

class Mine:
    def init(self):
        return None

    def step(self, state, tick):
        {line}
        return state, Estimate(tick.t_ns, {u}, np.zeros(3), np.eye(6))
"""
ROOMS = {"controller": CONTROLLER, "guide": GUIDE, "estimator": ESTIMATOR}
SMALL = ("--vehicle", "small")


@pytest.fixture
def project(baqueano, lab, tmp_path):
    shutil.copytree(lab / "routes", tmp_path / "routes")
    return baqueano


TUNABLE = """from dataclasses import dataclass
import numpy as np
from baqueano.parameter import parameter
from baqueano.geometry import pose_error
from baqueano.signals import Command

@dataclass(frozen=True, slots=True, eq=False)
class Mine:
    k: float = {k}

    def init(self):
        return None

    def step(self, state, reference, estimate):
        e = pose_error(reference.eta, estimate.eta)
        return state, Command(estimate.t_ns, np.array([0.4 + self.k * e[0], 0.0, e[2] + 5.0 * e[1]]))
"""


def own_controller(folder, k):
    """Write a vehicle file with a user controller whose gain is only in its code."""
    (folder / "mine.py").write_text(TUNABLE.format(k=k))
    text = load("small").text
    start, end = text.index("[controller]"), text.index("[guide]")
    path = folder / "mine.toml"
    path.write_text(f'{text[:start]}[controller]\nkind = "mine.py:Mine"\n\n{text[end:]}', encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "k", ['parameter("unit of u per m", "ahead", low=0.0, high=30.0, default=0.5)', "0.5"]
)
def test_gains_declared_in_controller_code_are_tuned_and_written(project, tmp_path, k):
    own_file = own_controller(tmp_path, k)
    end = project("tune", "--vehicle", str(own_file), "--route", "lab", "--update", "--json")
    assert end.code in (0, 1), end.err
    (row,) = end.reply["rows"]
    assert row["name"] == "k"
    updated_file = load(own_file)
    assert updated_file.controller().k == pytest.approx(row["value"]) != 0.5
    assert updated_file.provenance["controller.k"].run == "tune, perfect pose"
    assert updated_file.value("controller.k") == pytest.approx(row["value"])


def test_a_tuned_file_is_readable_without_the_controller_code(project, tmp_path):
    own_file = load(own_controller(tmp_path, 'parameter("unit of u per m", "ahead", default=0.5)'))
    tuned_file = own_file.with_values(
        {"controller.k": 2.0}, {"controller.k": {"run": "tune", "verdict": "USABLE"}}
    )
    (tmp_path / "mine.py").unlink()
    assert parse(tuned_file.text, "the vehicle file of a run").provenance["controller.k"].run == "tune"


def test_a_controller_without_a_number_is_refused_before_tuning(project, tmp_path):
    own_file = own_controller(tmp_path, "None")
    end = project("tune", "--vehicle", str(own_file), "--route", "lab")
    assert end.code == 2
    assert (end.reason.code, end.reason.figures["kind"]) == ("tune.no-gains", "Mine")
    assert "k: float = 3.0" in end.paragraph


def test_an_error_about_a_block_path_without_a_class_lists_the_classes(project, tmp_path):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(3)"))
    for line in ("blocks check mine.py", "repeat lab --vehicle small --controller mine.py"):
        end = project(*line.split())
        assert end.code in (2, 3)
        assert '"classes": "mine.py:Mine"' in json.dumps(end.reason.to_json())


@pytest.mark.parametrize(
    ("wrong_part", "right"), [("min.py:Mine", "mine.py:Mine"), ("mine.py:Mina", "mine.py:Mine")]
)
def test_a_mistyped_part_of_a_block_path_is_corrected(project, tmp_path, wrong_part, right):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(3)"))
    end = project("repeat", "lab", "--vehicle", "small", "--controller", wrong_part)
    assert end.fix == f"baqueano repeat lab --vehicle small --controller {right}"


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize(
    ("line", "u", "message"),
    [
        ('raise ValueError("boom")', "np.zeros(3)", "mine.py:9) raised ValueError: boom"),
        ("stat", "np.zeros(3)", "mine.py:9) raised NameError: name 'stat' is not defined"),
        ("pass", "np.zeros(2)", ".shape = (2,), expected (3,)"),
        ("pass", "np.full(3, np.nan)", "= [nan, nan, nan], expected finite numbers"),
        ("return None", "np.zeros(3)", "returned None, expected (state, output)"),
    ],
)
def test_rt3_a_broken_block_stops_the_vehicle_and_the_run_is_complete(
    project, tmp_path, room, line, u, message
):
    (tmp_path / "mine.py").write_text(ROOMS[room].format(line=line, u=u), encoding="utf-8")
    end = project("repeat", "lab", f"--{room}", "mine.py:Mine", *SMALL, "--rest", "0", "--json")
    assert end.code == 5, end.err
    assert (end.reason.code, end.fix) == (
        "cli.stopped",
        f"baqueano runs show {Path('runs', '0001-repeat.mcap')}",
    )
    assert end.cause.code in (StopReason.BLOCK_RAISED, StopReason.BLOCK_RETURNED)
    assert str(end.cause.figures["block"]).startswith(f"{room} Mine (")
    assert message in text(end.cause)
    assert len(end.reply["rows"]) == 1
    run = read_run(tmp_path / "runs" / "0001-repeat.mcap")
    assert run.notes == ()
    assert run.duration_s == pytest.approx(1.0, abs=0.05)  # the coasting is recorded
    assert run.sent_commands is not None
    assert not run.sent_commands[1:].any()


def test_a_block_failure_after_one_second_loses_no_recorded_data(project, tmp_path):
    line = "assert estimate.t_ns < 1_000_000_000, 'late'"
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line=line, u="np.zeros(3)"), encoding="utf-8")
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL, "--rest", "0")
    assert end.code == 5
    assert end.cause.figures["error"] == "AssertionError: late"
    assert read_run(tmp_path / "runs" / "0001-repeat.mcap").duration_s == pytest.approx(2.0, abs=0.05)


def test_a_block_whose_init_raises_writes_no_run(project, tmp_path):
    text = CONTROLLER.format(line="pass", u="np.zeros(3)").replace(
        "return None", 'raise OSError("no port")', 1
    )
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL)
    assert end.code == 5
    assert "mine.py:6) raised OSError: no port" in end.paragraph
    assert end.reason.code == "drive.not-started"
    assert not list(tmp_path.rglob("*.mcap*"))


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("import nothere\n", "Mine", ("block.raised-while-read", "place", "mine.py line 1")),
        ("class Mine:\n    def step step(self):\n", "Mine", ("block.not-python", "line", 2)),
        ("x = 1\0\n", "Mine", ("block.not-python", "line", 1)),
        ("class Mine: ...\n", "Myne", ("block.class-unknown", "value", "Myne")),
        ("Mine = 3\n", "Mine", ("block.not-class", "kind", "int")),
        (None, "Mine", ("block.file-absent", "value", "mine.py")),
    ],
)  # fmt: skip
def test_a_block_that_cannot_be_loaded_is_refused_before_the_drive(
    project, tmp_path, room, text, name, message
):
    if text is not None:
        (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("repeat", "lab", f"--{room}", f"mine.py:{name}", *SMALL)
    assert end.code == 3
    code, figure, value = message
    assert (end.cause.code, end.cause.figures[figure]) == (code, value)
    assert (end.reason.figures["role"], end.reason.figures["kind"]) == (room, f"mine.py:{name}")
    exists = code not in ("block.class-unknown", "block.file-absent")
    assert end.reason.fix == (f"baqueano blocks check mine.py:{name}" if exists else "")
    assert not list(tmp_path.rglob("*.mcap*"))


def test_the_message_about_a_missing_block_file_lists_the_files_once(project, tmp_path):
    """Before, the names of the files stood in it twice, in two sentences."""
    (tmp_path / "another.py").touch()
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL)
    assert (end.code, end.err.count("another.py")) == (3, 1)


def test_a_block_of_another_role_is_refused_before_the_drive(project, tmp_path):
    (tmp_path / "mine.py").write_text(TUNABLE.format(k=1.0), encoding="utf-8")
    end = project("repeat", "lab", "--estimator", "mine.py:Mine", *SMALL)
    assert (end.code, end.reason.code) == (2, "block.of-other-role")
    assert end.reason.fix == "--controller mine.py:Mine"
    in_file = load("small").text.replace('"augmented_ekf"', '"mine.py:Mine"')
    with pytest.raises(FileError) as error_info:
        parse(in_file, "lab.toml", tmp_path / "lab.toml", on_disk=in_file)
    cause = error_info.value.diagnostic.figures["cause"]
    assert (cause.code, cause.fix) == ("block.of-other-role", '[controller] kind = "mine.py:Mine"')


def test_a_replay_with_a_broken_estimator_is_an_error(project, lab, tmp_path):
    text = ESTIMATOR.format(line='raise ValueError("boom")', u="np.zeros(3)")
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    run = str(lab / "runs" / "0001-experiment.mcap")
    end = project("replay", run, "--estimator", "mine.py:Mine", "--backend", "numpy")
    assert end.code == 5
    assert "estimator Mine (" in end.paragraph
    assert "raised ValueError: boom" in end.paragraph


def test_the_block_check_reports_each_fault_with_a_code(project, tmp_path):
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(2)"), encoding="utf-8")
    end = project("blocks", "check", "mine.py:Mine", "--json")
    assert end.code == 1
    assert end.reply["verdict"] == "REFUSED"
    assert [row["code"] for row in end.reply["rows"]] == ["check.not-frozen", "check.shape"]
    assert end.reason.code == "cli.block-breaks"
    (tmp_path / "mine.py").write_text(CONTROLLER.format(line="pass", u="np.zeros(3)"), encoding="utf-8")
    end = project("blocks", "check", "mine.py:Mine", "--json")
    assert (end.code, end.reply["verdict"]) == (0, "WARN")
    assert [row["code"] for row in end.reply["rows"]] == ["check.not-frozen"]


def test_a_class_whose_step_is_no_method_is_refused(project, tmp_path):
    (tmp_path / "mine.py").write_text("class Mine:\n    init = None\n    step = property(id)\n")
    end = project("blocks", "check", "mine.py:Mine")
    assert (end.code, end.reason.code) == (3, "block.no-step")


def test_a_constructor_that_hangs_is_named_with_its_line(project, tmp_path, monkeypatch):
    monkeypatch.setattr("baqueano.vehicle_file.build.PREPARE_S", 0.3)
    hang = "    def __init__(self):\n        while True: pass\n"
    block = CONTROLLER.format(line="pass", u="np.zeros(3)").replace("    def init", hang + "    def init")
    (tmp_path / "mine.py").write_text(block, encoding="utf-8")
    end = project("repeat", "lab", "--controller", "mine.py:Mine", *SMALL)
    assert end.code == 3
    assert "Mine (mine.py line 6) raised TimeoutError: it took longer than 0.3 s" in end.paragraph


@pytest.mark.parametrize("line", ["sys.exit(0)", "raise GeneratorExit", "raise KeyboardInterrupt"])
@pytest.mark.parametrize(
    "command", ["blocks check mine.py:Mine", "blocks check mine.py", "repeat lab --controller mine.py:Mine"]
)
def test_a_block_file_that_exits_on_import_is_named_with_its_line(project, tmp_path, line, command):
    text = CONTROLLER.format(line="pass", u="np.zeros(3)")
    (tmp_path / "mine.py").write_text(f"import sys\n{line}\n{text}", encoding="utf-8")
    end = project(*command.split())
    assert end.code == 3
    assert '"code": "block.raised-while-read-and-ends"' in (reason := json.dumps(end.reason.to_json()))
    assert '"place": "mine.py line 2"' in reason


@pytest.mark.parametrize("room", ROOMS)
@pytest.mark.parametrize("line", ["raise SystemExit(0)", "raise GeneratorExit", "raise KeyboardInterrupt"])
def test_the_block_check_reports_a_block_that_ends_the_program(project, tmp_path, room, line):
    text = ROOMS[room].format(line=line, u="np.zeros(3)")
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("blocks", "check", "mine.py:Mine", "--json")
    assert end.code == 1
    assert any(
        "mine.py line 8" in row["finding"] and "on line 9" in row["finding"] for row in end.reply["rows"]
    )


@pytest.mark.parametrize("line", ["sys.exit(0)", "raise KeyboardInterrupt", "1 / 0"])
def test_an_unguarded_block_failure_is_attributed_to_its_file(project, tmp_path, line):
    text = f"import sys\nclass Mine:\n    @property\n    def laps(self):\n        {line}\n"
    text += "    def init(self): return 0\n    def step(self, state, estimate): return state, None\n"
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    end = project("repeat", "lab", "--guide", "mine.py:Mine", *SMALL)
    assert end.code == 3
    assert (end.reason.figures["place"], end.fix) == ("mine.py line 5", "")


LAW = """from baqueano.controllers import ModelFollower

class Mine(ModelFollower):
    def velocity_law(self, memory, now):
        return {value}
"""


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("memory, (now.nu_f[0], self.gain)", "cli.block-raised"),
        ("now.nu_f[0], now.nu_f[2]", "follower.law-result"),
    ],
)
def test_a_wrong_law_is_no_fault_of_the_package_when_it_is_tuned(
    baqueano, tmp_path, monkeypatch, value, code
):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(LAW.format(value=value))
    end = baqueano("tune", "--route", "eight", "--controller", "mine.py:Mine")
    assert (end.code, end.reason.code) == (3, code)
    assert end.reason.figures.get("place", "mine.py line 5") == "mine.py line 5"


def test_the_classes_of_a_file_are_listed_without_those_that_are_no_blocks(project, tmp_path):
    (tmp_path / "mine.py").write_text("class Belief:\n    pass\n" + CONTROLLER.format(line="pass", u="0"))
    for command in ("blocks check mine.py", "repeat lab --controller mine.py", "blocks check mine.py:Other"):
        assert "Belief" not in (paragraph := project(*command.split()).paragraph)
        assert "Mine" in paragraph


SENSOR = """from dataclasses import dataclass
import numpy as np
from baqueano.sensors.sampling import SampledSensor

@dataclass(frozen=True, slots=True, eq=False)
class Mine(SampledSensor):
    rate_hz: float = 10.0
    noise_std: float = 0.01
    delay_s: float = 0.0
    delay_slots: int = 0
    measurement_noise_cov: object = None
    size = 1

    def h(self, motion):
        return {h}

    def detects(self, motion):
        return {detects}
"""
FAULTY_SENSORS = {  # case → h, detects, code of the cause, the line that it names
    "raises": ("1 / 0", "True", "check.raises-on-line", 15),
    "is not an array": ("motion.nu[0]", "True", "check.shape", 14),
    "is too long": ("motion.nu", "True", "check.shape", 14),
    "returns nothing": ("None", "True", "check.no-numbers", 14),
    "raises in a part of the step": ("motion.nu[:1]", "motion.speed > 0", "check.raises-on-line", 18),
}


@pytest.mark.parametrize("case", FAULTY_SENSORS)
@pytest.mark.parametrize("command", [("experiment", "--seconds", "2"), ("repeat", "lab")])
def test_a_faulty_sensor_is_named_with_its_line_before_the_drive(case, command, project, tmp_path):
    h, detects, code, line = FAULTY_SENSORS[case]
    (tmp_path / "mine.py").write_text(SENSOR.format(h=h, detects=detects))
    file = load("small").text + '\n[sensors.lamp]\nkind = "mine.py:Mine"\n'
    (tmp_path / "own.toml").write_text(file)
    end = project(*command, "--vehicle", "own.toml")
    assert (end.code, end.reason.code, end.cause.code) == (3, "vehicle.sensor-breaks", code)
    assert end.cause.figures.get("line", line) == line
    assert str(end.cause.figures["place"]).startswith("mine.py line ")
    assert end.fix == "baqueano blocks check mine.py:Mine"
    assert not list((tmp_path / "runs").glob("*"))


def test_a_sensor_with_a_limited_range_drives(project, tmp_path):
    sensor = SENSOR.format(h="np.array([np.where(motion.nu[0] > 0.3, np.nan, motion.nu[0])])", detects="True")
    (tmp_path / "mine.py").write_text(sensor)
    (tmp_path / "own.toml").write_text(load("small").text + '\n[sensors.lamp]\nkind = "mine.py:Mine"\n')
    assert project("experiment", "--seconds", "2", "--vehicle", "own.toml").code == 0
