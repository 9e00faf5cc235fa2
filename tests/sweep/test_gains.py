"""A controller of a sweep has the gains of its own vehicle file; several vehicles, routes by name, stopped drives."""

import json

import numpy as np
import pytest

import baqueano as bq
from baqueano.blocks import resolve
from baqueano.cli import main
from baqueano.diagnostics import StopReason, stop
from baqueano.errors import FileError, UsageError
from baqueano.guides.shapes import circle
from baqueano.report.pages.result_page import build_page
from baqueano.runs.route_file import write_route
from baqueano.sweep import grid
from baqueano.sweep.columns import short_labels
from baqueano.sweep.combination import SweepBlocks, SweepJob, SweepSettings
from baqueano.sweep.drawing import register
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.gains import ControllerGains, FileText, find_gains
from baqueano.sweep.result import SweepCombination, SweepDrive, SweepResult
from baqueano.sweep.stored_drives import job_digest
from tests.codes import refused
from tests.web.chromium import CHROMIUM, SIZES, Chromium

ROUTE = circle(0.3, 0.2)
CODE = """from dataclasses import dataclass
import numpy as np
from baqueano.signals import Command

@dataclass(frozen=True, slots=True, eq=False)
class Mine:
    push: float = 0.4

    def init(self):
        return None

    def step(self, state, reference, estimate):
        return state, Command(estimate.t_ns, np.array([self.push, 0.0, 0.0]))
"""
SMALL = bq.load("small").text
KIND = "ana/my.py:Mine"


def with_controller(table):
    before, after = SMALL.split("[controller]\n", 1)
    return f"{before}[controller]\n{table}\n[{after.split('[', 1)[1]}"


@pytest.fixture
def students(tmp_path, monkeypatch):
    """Two students with the same code; only the vehicle file of the first names the class, with a gain."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(grid, "processor_count", lambda: 1)
    for name, table in (("ana", 'kind = "my.py:Mine"\npush = 0.6\n'), ("luis", 'kind = "pd_feedforward"\n')):
        (tmp_path / name).mkdir()
        (tmp_path / name / "my.py").write_text(CODE)
        (tmp_path / name / "vehicle.toml").write_text(with_controller(table))
    return tmp_path


def drive(controllers, **options):
    return bq.sweep(bq.load("small"), routes=ROUTE, controllers=controllers, processes=1, **options)


def effort(result):
    return [drive.figures["effort"] for drive in result.drives]


def test_a_controller_drives_with_the_gains_of_the_vehicle_file_in_its_folder(students):
    result, mine = drive([KIND, "luis/my.py:Mine"]), resolve("controller", KIND)
    assert effort(result) == effort(drive([mine(push=0.6), mine(push=0.4)]))
    assert [row["gains"] for row in result.rows()] == ["ana/vehicle.toml", "code"]
    own, of_code = result.notes
    assert (own.code, own.figures["count"], own.figures["total"]) == ("sweep.gains", 1, 2)
    assert own.figures["file"] == "ana/vehicle.toml"
    assert (of_code.code, of_code.figures["names"]) == ("sweep.gains-of-code", "luis/my")
    assert "ana/vehicle.toml" in result.table()


def test_the_gains_of_the_driven_vehicle_are_a_choice(students):
    result = drive([KIND], gains="vehicle")
    assert [drive.gains for drive in result.drives] == ["code"]
    assert result.notes == ()
    assert effort(result)[0] < 0.5
    with refused("sweep.gains-choice", UsageError, value="mine"):
        drive([KIND], gains="mine")


def test_a_change_of_the_driven_file_in_python_has_priority_over_the_file_on_disk(students):
    vehicle_file = bq.load("ana/vehicle.toml").with_values({"controller.push": 0.5})
    gains = find_gains(vehicle_file, "my.py:Mine")
    assert (gains.file, gains.source) == (None, "vehicle.toml")
    assert find_gains(bq.load("small"), KIND).source == "ana/vehicle.toml"


def test_code_in_the_folder_of_the_driven_vehicle_has_the_gains_beside_it(students):
    (students / "cars").mkdir()
    (students / "ana").rename(students / "cars" / "ana")
    (students / "cars" / "car.toml").write_text(SMALL)
    result = bq.sweep("cars/car.toml", routes=ROUTE, controllers=KIND, processes=1)
    assert [drive.gains for drive in result.drives] == ["cars/ana/vehicle.toml"]
    assert effort(result)[0] > 0.4


def test_a_vehicle_file_names_a_controller_with_its_gains(students):
    result = drive(["ana/vehicle.toml", KIND])
    by_file, by_class = result.drives
    assert by_file.figures == by_class.figures
    assert [(entry.figures["count"], entry.figures["total"]) for entry in result.notes] == [(1, 1)]
    (students / "pd.toml").write_text(with_controller('kind = "pd"\nalpha = 2.0\nbeta = 0.3\ngamma = 0.1\n'))
    (pd,) = drive(["pd.toml"]).drives
    assert (pd.combination.controller, pd.gains, pd.stop_code) == ("pd.toml", "pd.toml", "")
    with pytest.raises(FileError):
        drive(["absent.toml"])


def test_a_fault_in_the_gains_of_a_student_names_the_file_before_the_first_drive(students):
    (students / "ana" / "vehicle.toml").write_text(
        with_controller('kind = "my.py:Mine"\npush = "fast"\n').replace("small", "ana", 1)
    )
    with pytest.raises(FileError) as error_info:
        drive(["kanayama", KIND])
    assert "ana/vehicle.toml" in str(error_info.value)
    (students / "ana" / "vehicle.toml").write_text("[controller\n")
    with pytest.raises(FileError) as error_info:
        drive([KIND])
    assert "ana/vehicle.toml" in str(error_info.value)


def test_a_stored_drive_is_not_used_after_a_change_of_the_gains(students):
    small = bq.load("small")
    file = FileText(small.text, small.label, small.path, small.on_disk)
    job = SweepJob(
        SweepCombination("m", "", "", ""), "d", file, SweepBlocks(controller=KIND), SweepSettings(), ROUTE
    )
    texts = [with_controller(f'kind = "my.py:Mine"\npush = {push}\n') for push in (0.5, 0.6)]
    gains = [ControllerGains(KIND, "ana/vehicle.toml", FileText(text, "ana", None, text)) for text in texts]
    assert len({job_digest(x, {}) for x in (job, *(job._replace(gains=own) for own in gains))}) == 3


def test_gains_of_another_controller_are_computed_into_another_file(students):
    vehicle_file = bq.load("luis/vehicle.toml")
    with refused("vehicle.lacks-gains-of", FileError, kind="pd", own_kind="pd_feedforward") as error_info:
        vehicle_file.controller("pd")
    assert "--out pd.toml" in error_info.value.diagnostic.fix
    assert "--update" not in error_info.value.diagnostic.fix


def ask(line, capsys, code=None):
    with pytest.raises(SystemExit) as exit_info:
        main(line.split())
    assert exit_info.value.code in (code, code or 0)
    return capsys.readouterr()


def test_tune_writes_the_gains_into_a_new_file(students, capsys):
    text = (students / "luis" / "vehicle.toml").read_text()
    line = "tune --vehicle luis/vehicle.toml --controller kanayama --out k.toml --route circle --size 0.3"
    ask(line, capsys)
    assert bq.load("k.toml").data["controller"]["kind"] == "kanayama"
    assert (students / "luis" / "vehicle.toml").read_text() == text
    assert "cli.file-exists" in ask(f"{line} --json", capsys, 3).out
    assert "cli.options-together" in ask(f"{line} --update --json", capsys, 2).out


def test_equal_vehicles_of_the_garage_are_numbered(students):
    files = [bq.load("small"), bq.load("small").with_values({"model.mass_kg": 0.7})]
    result = bq.sweep(files, routes=ROUTE, controllers="kanayama", processes=1)
    assert result.vehicles() == ["small", "small #2"]


def test_several_vehicles_are_named_by_their_files_or_folders(students, capsys):
    line = "sweep --controller kanayama --route circle --size 0.3 --seeds 1 --json --vehicle"
    output = json.loads(ask(f"{line} */vehicle.toml --vehicle small", capsys).out)
    assert [row["vehicle"] for row in output["rows"]] == ["ana", "luis", "small"]
    assert len({row["drive"] for row in output["rows"]}) == 3


def test_replayed_runs_have_one_vehicle_file(students, capsys):
    output = ask("sweep runs --vehicle small --vehicle ana/vehicle.toml --json", capsys, 2)
    assert json.loads(output.out)["code"] == "sweep.several-vehicles"


def test_routes_are_given_by_their_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "routes").mkdir()
    write_route(ROUTE, tmp_path / "routes" / "loop.csv")
    small = bq.load("small")
    result = bq.sweep(small, routes=["loop", "routes/loop.csv"], controllers="kanayama", processes=1)
    assert [drive.route for drive in result.drives] == ["loop", "loop #2"]
    with refused("name.near-only", FileError, match="loop"):
        bq.sweep(small, routes="lop", controllers="kanayama")
    with refused("route.absent", FileError, value="zzz"):
        bq.sweep(small, routes=["zzz"], controllers="kanayama")


def test_a_misspelt_route_is_answered_by_the_nearest_stored_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "routes").mkdir()
    write_route(ROUTE, tmp_path / "routes" / "loop.csv")
    route, example = 'read_route("loop")', 'shape("sinuous-circle"'
    for name, fix in (("lop", route), ("loop", route), ("zzz", example)):
        with pytest.raises(TypeError) as error_info:
            bq.repeat(bq.load("small"), name)
        assert fix in str(error_info.value)


def made_up(values, label="a", stopped=(), vehicle="v"):
    """Return drives with these cross-track and position errors; those with the numbers `stopped` were stopped."""
    drives = []
    for k, value in enumerate(values):
        reason = stop(StopReason.INTERRUPTED) if k in stopped else None
        figures = {"across_rms_m": value, "ate_m": value, "laps": 0.0 if reason else 1.0}
        pieces = {"across_rms_m": ErrorSegments((value**2,) * 8, (1.0,) * 8)}
        code = "" if reason is None else reason.code
        combination = SweepCombination(label, "", label, "")
        drives.append(SweepDrive(combination, f"{vehicle}, {k}", figures, pieces, code, reason, vehicle))
    return drives


def test_stopped_drives_are_counted_apart_from_the_medians_and_ratios():
    drives = made_up([0.01, 0.01, 0.01, 9.0, 9.0, 9.0], "a", stopped=(3, 4, 5)) + made_up([0.02] * 6, "b")
    result = SweepResult(tuple(drives), len(drives), "b")
    first, second = result.combinations()
    assert (first["ate_m"], first["across_rms_m"], first["stopped"], second["stopped"]) == (0.01, 0.01, 3, 0)
    assert first["laps"] == 0.5
    assert result.difference("a", "across_rms_m").ratio == pytest.approx(0.5)
    assert result.ranking() == ["b", "a"]
    (reason,) = result.reasons
    assert (reason.code, reason.figures["count"]) == ("sweep.stopped", 3)


def test_the_page_of_a_class_has_a_row_per_controller_and_a_column_per_vehicle():
    register()
    drives = []
    for k in range(40):
        for v in range(12):
            stopped = (0, 1) if k == 7 and v == 3 else ()
            drives += made_up(
                [0.01 * (40 - k), 0.02 * (40 - k)], f"class/s{k}/my.py:Mine", stopped, f"car{v}"
            )
    result = SweepResult(tuple(drives), len(drives), "class/s0/my.py:Mine")
    assert result.ranking()[0] == "class/s39/my.py:Mine"
    assert result.ranking()[-1] == "class/s7/my.py:Mine"
    by_vehicle = result.by_vehicle()
    assert len(by_vehicle) == 40
    assert [name for name in by_vehicle[7] if name != "combination" and np.isnan(by_vehicle[7][name])] == [
        "car3"
    ]
    page = build_page(result)
    assert len(page.drawings()) == 3
    vehicles = next(iter(page.drawings().values())).figure.axes[0]
    assert [x.get_text() for x in vehicles.get_xticklabels()] == [f"car{v}" for v in range(12)]
    assert vehicles.get_yticklabels()[0].get_text() == "s39/my"
    assert len(vehicles.texts) == 480
    tables = [len(part.rows) for section in page.sections for part in section.parts if hasattr(part, "rows")]
    assert max(tables) == 40
    assert "car11" in result.table()


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
def test_the_page_with_a_long_path_of_a_student_fits_a_phone(tmp_path):
    register()
    drives = made_up([0.01, 0.02], f"{'a_long_folder/' * 8}my.py:Mine", stopped=(1,)) + made_up(
        [0.02] * 2, "pd"
    )
    page = build_page(SweepResult(tuple(drives), len(drives), "pd")).save(tmp_path / "page.html")
    with Chromium() as browser:
        tab = browser.tab()
        tab.size(*SIZES["phone"])
        tab.goto(page.as_uri())
        assert tab.js("document.documentElement.scrollWidth") == SIZES["phone"][0]


def test_the_shortest_distinct_names_of_students_are_shown():
    assert (
        short_labels(["class/ana/my.py:Mine", "class/bo/my.py:Mine", "pd"])["class/ana/my.py:Mine"]
        == "ana/my"
    )
    assert short_labels(["a/x/my.py:Mine", "b/x/my.py:Mine"])["a/x/my.py:Mine"] == "a/x/my"
    assert short_labels(["a/x/my.py:Mine", "pd"])["a/x/my.py:Mine"] == "Mine"


def test_a_wrong_file_of_a_pattern_is_named_and_the_others_are_compared(students, capsys):
    (students / "mal").mkdir()
    (students / "mal" / "my.py").write_text(CODE.replace("def init(self):", "def init(self)"))
    (students / "luis" / "vehicle.toml").write_text(SMALL)
    pattern = ["--controller", "*/my.py:Mine"]
    line = ["sweep", "--vehicle", "small", "--route", "circle", "--seeds", "1", *pattern]
    with pytest.raises(SystemExit, match="0"):
        main([*line, "--json"])
    out, err = capsys.readouterr()
    assert {row["controller"] for row in json.loads(out)["rows"]} == {"ana/my.py:Mine", "luis/my.py:Mine"}
    assert "mal/my.py:Mine" in err
    assert "1 of 3 files" in err
    with pytest.raises(SystemExit, match="3"):
        main([*line, "--controller", "mal/my.py:Mine"])  # a name of a file, not a pattern
