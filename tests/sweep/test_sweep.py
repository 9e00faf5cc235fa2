"""A sweep: figures equal to other programs, intervals with coverage, and the same rows in every execution mode."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import baqueano as bq
from baqueano.atomic_file import replace_file
from baqueano.blocks import resolve
from baqueano.cli import main
from baqueano.diagnostics import StopReason
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.messages.language import use_language
from baqueano.runs.run import EstimateLog, Run, TruthLog
from baqueano.sweep import grid
from baqueano.sweep.combination import FileText, SweepBlocks, SweepJob, SweepSettings
from baqueano.sweep.figures import drive_figures, joining_distance
from baqueano.sweep.grid import sweep as one_process
from baqueano.sweep.result import SweepCombination, SweepResult
from baqueano.sweep.stored_drives import job_digest
from tests.codes import refused
from tests.compare.test_errors_of_paths import trajectories
from tests.figure_files import width_mm

ROUTE = circle(0.3, 0.2)
MINE = '''
from baqueano.controllers import Kanayama


class Mine(Kanayama):
    """Kanayama's, under a name of mine."""
'''
SCALED = """
    def velocity_law(self, memory, tracking):
        memory, (v, r) = super().velocity_law(memory, tracking)
        return memory, ({scale} * v, r)
"""


def rows_of(result: SweepResult) -> str:
    return repr(result.rows()) + repr([drive.pieces for drive in result.drives])


@pytest.fixture(scope="module")
def small():
    return bq.load("small")


@pytest.fixture(scope="module")
def combinations(small):
    return {
        "subjects": small, "routes": {"circle": ROUTE}, "controllers": ["kanayama", "lqr"], "seeds": (3, 4),
        "start": (0.0, 0.08, 0.3), "backend": "python",  # conftest.py compiles otherwise here than in other processes
    }  # fmt: skip


@pytest.fixture(scope="module")
def result(combinations):
    return one_process(**combinations, processes=1)


@pytest.mark.parametrize(
    ("alignment", "figures"),
    [
        ("none", (3.385636012415972, 0.7003727373090944)),
        ("start", (0.06864218176798112, 0.013987322265409594)),
        ("rigid", (0.04466864600024149, 0.013999775774547899)),
    ],
)
def test_ate_and_rpe_of_a_replay_equal_the_results_of_evo(alignment, figures):
    """evo 1.38.1, as in tests/compare/test_errors_of_paths.py."""
    t_ns, eta, truth = trajectories()
    zero = np.zeros_like(eta)
    P = np.tile(np.eye(6), (len(t_ns), 1, 1))
    run = Run(
        "evo", None, t_ns, np.zeros((len(t_ns), 3)), estimate=EstimateLog(t_ns, eta, zero, P),
        truth=TruthLog(t_ns, truth, zero, zero), metadata={"kind": "replay"},
    )  # fmt: skip
    f, pieces = drive_figures(run, alignment=alignment)
    assert (f["ate_m"], f["ate_heading_rad"]) == pytest.approx(figures, abs=1e-9)
    assert (f["rpe_m"], f["rpe_heading_rad"]) == pytest.approx((0.039987329757, 0.0170090357855), abs=1e-9)
    assert len(pieces["ate_m"].squares) == 2  # of 20 s
    assert np.isnan(f["across_rms_m"])


def test_each_sweep_drive_starts_beside_its_route_and_joins_it(result):
    rows = result.rows()
    assert [(row["combination"], row["drive"]) for row in rows[:3]] == [
        ("kanayama", "circle, seed 3"), ("kanayama", "circle, seed 4"), ("lqr", "circle, seed 3"),
    ]  # fmt: skip
    assert all(0.05 < row["joining_m"] < 1.0 for row in rows)
    assert all(0.08 < row["across_max_m"] < 0.1 for row in rows)
    assert {row["laps"] for row in rows} == {1.0}
    assert joining_distance(np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.02, 0.01])) == 1.0
    assert np.isnan(joining_distance(np.array([1.0, 2.0]), np.array([0.0, 0.5])))


def test_the_latex_table_has_a_column_for_each_combination_and_a_row_for_each_median(result, tmp_path):
    lines = result.save_table(tmp_path / "sweep.tex").read_text(encoding="utf-8").splitlines()
    head = next(line for line in lines if line.endswith(r"\\"))
    assert head.count("&") == 1 + len(result.combinations())
    ratio = next(line for line in lines if line.strip().startswith("ratio"))
    assert ratio.split("&")[2].strip() == "$1$"
    assert sum(line.endswith(r"\\") for line in lines) < 20  # not a row for each drive
    assert any(r"ATE $\psi$" in line for line in lines), "pdflatex does not know the letter ψ"


def test_an_interrupted_sweep_resumes_and_equals_two_processes(combinations, result, tmp_path):
    counts = []

    def until_two(n: int) -> None:
        counts.append(n)
        if len(counts) == 2:
            raise KeyboardInterrupt

    part = one_process(**combinations, processes=1, drives_folder=tmp_path, advance=until_two)
    assert (len(part.drives), part.requested_drives, [reason.code for reason in part.reasons]) == (
        2,
        4,
        ["sweep.part"],
    )
    files = sorted(tmp_path.glob("*.json"))
    assert len(files) == 2
    # an incomplete file is not from this program, so the drive is repeated
    files[0].write_text(files[0].read_text()[:40])
    second = one_process(**combinations, processes=2, drives_folder=tmp_path)
    assert rows_of(second) == rows_of(result)
    assert len(list(tmp_path.iterdir())) == 4
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert rows_of(one_process(**combinations, processes=1, drives_folder=tmp_path)) == rows_of(result)
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before


def test_the_name_of_a_stored_drive_depends_on_block_source_and_seed(tmp_path, monkeypatch, small):
    monkeypatch.chdir(tmp_path)
    names = set()
    for text, seed in ((MINE, 0), (MINE + "\n# other\n", 0), (MINE, 1)):
        (tmp_path / "my.py").write_text(text, encoding="utf-8")
        blocks = SweepBlocks(controller="my.py:Mine")
        file = FileText(small.text, small.label, small.path, small.on_disk)
        names.add(
            job_digest(
                SweepJob(SweepCombination("m", "", "", ""), "d", file, blocks, SweepSettings(), ROUTE, seed),
                {},
            )
        )
    assert len(names) == 3
    from_class = one_process(small, routes=ROUTE, controllers=["my.py:Mine", "kanayama"], processes=1)
    by_class, by_text = from_class.drives
    assert by_class.figures == by_text.figures


def test_a_stored_drive_is_not_used_after_a_change_of_a_block_that_the_file_names(
    tmp_path, monkeypatch, small
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vehicle.toml").write_text(
        small.text.replace('kind = "pd_feedforward"', 'kind = "my.py:Mine"'), encoding="utf-8"
    )
    efforts = []
    for scale in (1.0, 0.5):
        text = MINE.replace("Kanayama", "PdFeedforward") + SCALED.format(scale=scale)
        (tmp_path / "my.py").write_text(text, encoding="utf-8")
        result = one_process(
            bq.load("vehicle.toml"),
            routes=ROUTE,
            processes=1,
            drives_folder=tmp_path / "keep",
            backend="python",
        )
        efforts.append(result.drives[0].figures["effort"])
    assert len(list((tmp_path / "keep").iterdir())) == 2
    assert efforts[1] != efforts[0]


def test_the_name_of_a_stored_drive_contains_each_entry_of_an_array(small):
    file = FileText(small.text, small.label, small.path, small.on_disk)
    law = small.controller("lqr")
    laws = [law, replace(law, e_max=law.e_max * (1.0 + 1e-12))]
    combination, settings = SweepCombination("m", "", "", ""), SweepSettings()
    names = {
        job_digest(SweepJob(combination, "d", file, SweepBlocks(controller=law), settings, ROUTE, 0), {})
        for law in laws
    }
    assert len(names) == 2


def test_the_name_of_a_stored_drive_contains_the_ends_of_a_route_and_the_start_of_a_run(small):
    run = bq.simulate(small, np.zeros((10, 3)))
    moved_run = replace(run, metadata=run.metadata | {"start": "1.0 0.0 0.0"})
    file, combination = (
        FileText(small.text, small.label, small.path, small.on_disk),
        SweepCombination("m", "", "", ""),
    )
    job = SweepJob(combination, "d", file, SweepBlocks(), SweepSettings(), ROUTE)
    jobs = (
        job,
        job._replace(route=ROUTE._replace(closed=False)),
        job._replace(run=run),
        job._replace(run=moved_run),
    )
    assert len({job_digest(x, {}) for x in jobs}) == 4


def test_two_sweeps_can_store_the_same_drive_at_once(tmp_path):
    path = tmp_path / "drive.json"
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda k: [replace_file(path, str(k)) for _ in range(200)], range(4)))
    assert [x.name for x in tmp_path.iterdir()] == ["drive.json"]


def test_a_dict_gives_the_names_of_blocks_and_the_routes_need_no_keyword(small):
    controllers = {"base": "kanayama", "other": bq.controllers.Kanayama}
    result = bq.sweep(small, ROUTE, controllers=controllers, processes=1)
    base, second = result.combinations()
    assert (base["combination"], second["combination"]) == ("base", "other")
    assert base["across_rms_m"] == second["across_rms_m"] > 0.0


def test_recorded_runs_are_replayed_only_through_estimators(small):
    run = bq.repeat(small, ROUTE, seed=1)
    result = one_process(
        run, estimators=["augmented_ekf", "dead_reckoning"], reference="dead_reckoning", processes=1
    )
    assert [row["estimator"] for row in result.rows()] == ["augmented_ekf", "dead_reckoning"]
    assert all(np.isnan(row["across_rms_m"]) and row["ate_m"] > 0.0 for row in result.rows())
    assert result.combinations()[1]["ate_m_ratio"] == 1.0
    replay_row = bq.compare(bq.replay(run)).rows()[0]
    assert result.rows()[0]["rpe_m"] == pytest.approx(replay_row["rpe_m"], rel=1e-12)
    with refused("sweep.of-runs", UsageError, factor="controllers"):
        one_process(run, controllers="lqr")


@pytest.mark.parametrize(
    ("code", "options"),
    [
        ("sweep.nothing", {}),
        ("call.kind", {"routes": [3]}),
        ("sweep.route", {"routes": [SimpleNamespace()]}),
        ("sweep.setting", {"routes": ROUTE, "lap": 3}),
        ("sweep.seeds", {"routes": ROUTE, "seeds": 3}),
        ("simulate.pose", {"routes": ROUTE, "start": (0.0, 1.0)}),
        ("sweep.numbers", {"routes": ROUTE, "laps": 0}),
        ("sweep.reference", {"routes": ROUTE, "reference": "lqx"}),
        ("block.unknown", {"routes": ROUTE, "controllers": "lqx"}),
        ("compare.alignment", {"routes": ROUTE, "alignment": "all"}),
    ],
)
def test_an_impossible_sweep_is_refused_before_the_first_drive(small, code, options):
    with refused(code):
        one_process(small, **options, advance=lambda n: pytest.fail("a drive was done"))


def test_a_sweep_over_vehicles_and_runs_together_is_refused(small):
    run = bq.simulate(small, np.zeros((10, 3)))
    with refused("sweep.mixed", UsageError):
        one_process([small, run], routes=ROUTE)


@pytest.mark.parametrize("language", ["en", "es"])
def test_a_sweep_of_long_labels_is_at_most_80_wide_and_shows_each_label(result, language):
    names = {"kanayama": "augmented_ekf · my_own_controllers.py:MyFirstController", "lqr": "unscented · lqr"}
    drives = [
        d._replace(combination=d.combination._replace(label=names[d.combination.label]))
        for d in result.drives
    ]
    with use_language(language):
        table = SweepResult(tuple(drives), result.requested_drives, names["kanayama"]).table()
    lines = table.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines.count("augmented_ekf · MyFirstController") >= 2


def test_a_sweep_is_printed_briefly_and_as_data_frame_and_page(result, tmp_path):
    assert len(repr(result).splitlines()) <= 12
    assert "lqr" in repr(result)
    frame = result.to_pandas()
    assert (len(frame), set(frame["combination"])) == (4, {"kanayama", "lqr"})
    assert "lqr" in result._repr_html_()
    assert result.plot("differences").axes
    bq.report(result, tmp_path / "sweep.html", figures=tmp_path, file_format="pdf", width="column")
    page = (tmp_path / "sweep.html").read_text(encoding="utf-8")
    assert "lqr" in page
    assert page.count("<svg") >= 2
    assert [width_mm(path) for path in tmp_path.glob("*.pdf")] == pytest.approx([88.0, 88.0], abs=0.1)


def test_the_sweep_command_prints_one_json_object_with_drives_and_cells(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["baqueano"])
    line = "sweep --vehicle small --route circle --size 0.3 --seeds 1 --controller lqr --json --keep k"
    with pytest.raises(SystemExit) as exit_info:
        main([*line.split(), "--controller", "kanayama"])
    assert exit_info.value.code in (None, 0)
    output = json.loads(capsys.readouterr().out)
    assert [row["combination"] for row in output["combinations"]] == ["lqr", "kanayama"]
    assert len(output["rows"]) == len(list((tmp_path / "k").iterdir())) == 2


STUDENT = """from dataclasses import dataclass
import numpy as np
from baqueano.signals import Command

@dataclass(frozen=True, slots=True, eq=False)
class Mine:
    def init(self):
        return None

    def step(self, state, reference, estimate):
        return state, Command(estimate.t_ns, np.array([{command}, 0.0, 0.0]))
"""


@pytest.fixture
def students(tmp_path, monkeypatch):
    """Two students with equal names of files and classes; the controller of the second raises."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(grid, "processor_count", lambda: 1)
    for name, command in (("ana", "0.5"), ("luis", "0.5 + [][0]")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").write_text(STUDENT.format(command=command))
    return tmp_path


def test_equal_names_of_students_are_told_apart_and_a_stop_names_its_line(small, students, tmp_path):
    kinds = ["kanayama", "ana/mine.py:Mine", "luis/mine.py:Mine"]
    folder = tmp_path / "drives"
    for _ in range(2):  # the second sweep reads the stored drives
        result = one_process(small, routes=ROUTE, controllers=kinds, processes=1, drives_folder=folder)
        names = [line.split()[0] for line in result.table().splitlines()[4:7]]
        assert names == ["kanayama", "ana/mine", "luis/mine"]
        (reason,) = result.reasons
        assert (reason.subject, reason.figures["cause"].code) == (
            "luis/mine.py:Mine",
            StopReason.BLOCK_RAISED,
        )
        assert "luis/mine.py:11" in result.table()


def test_a_class_that_was_read_from_a_file_is_driven_in_this_process(small, students):
    mine = resolve("controller", "ana/mine.py:Mine")
    drives = bq.sweep(small, routes=ROUTE, controllers=[mine(), "kanayama"], processes=2).drives
    assert [drive.stop_code for drive in drives] == ["", ""]


def test_a_pattern_selects_the_controllers_of_all_students(students, capsys):
    line = "sweep --vehicle small --controller */mine.py:Mine --seeds 1 --json"
    with pytest.raises(SystemExit):
        main(line.split())
    labels = [row["combination"] for row in json.loads(capsys.readouterr().out)["combinations"]]
    assert labels == ["ana/mine.py:Mine", "luis/mine.py:Mine"]
    with pytest.raises(SystemExit) as exit_info:
        main(line.replace("mine.py", "other.py").split())
    assert exit_info.value.code == 2
    assert json.loads(capsys.readouterr().out)["code"] == "cli.no-match"
