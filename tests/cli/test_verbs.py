"""Every command in the order in which a new user types it: figures are on stdout, messages on stderr."""

import html
import shlex
import shutil
import sys
from importlib.resources import files

import pytest

from baqueano.diagnostics import note
from baqueano.messages import text
from baqueano.runs import read_run


@pytest.fixture
def project(baqueano, lab, tmp_path):
    """Run commands in a folder that contains the runs and routes of the lab."""
    for name in ("runs", "routes"):
        shutil.copytree(lab / name, tmp_path / name)
    return baqueano


def test_the_blocks_of_a_new_project_pass_the_check(baqueano, tmp_path, monkeypatch):
    creation = baqueano("new", "mi lab")
    assert creation.code == 0
    assert (
        creation.out.strip()
        == "mi lab: vehicle.toml, my_estimator.py, my_guide.py, my_controller.py, first_evening.ipynb"
    )
    second = baqueano("new", "mi lab")
    assert second.code == 2
    assert second.reason.code == "cli.folder-not-empty"
    assert second.fix == "baqueano new 'mi lab-2'"
    (tmp_path / "mi lab-2").mkdir()
    assert baqueano("new", "mi lab").fix == "baqueano new 'mi lab-3'"
    assert baqueano("new", ".").fix == "baqueano new mylab"
    monkeypatch.chdir(tmp_path / "mi lab")
    for block in ("my_estimator.py:MyEstimator", "my_guide.py:MyGuide", "my_controller.py:MyController"):
        check = baqueano("blocks", "check", block, "--vehicle", "vehicle.toml", "--json")
        assert check.code == 0, check.out
        assert check.reply == {"rows": [], "verdict": "USABLE"}


def test_an_experiment_prints_the_contents_of_its_run(baqueano, tmp_path):
    end = baqueano("experiment", "--vehicle", "small", "--seconds", "1", "--json")
    assert end.code == 0
    assert {row["topic"] for row in end.reply["rows"]} >= {
        "command applied",
        "sensor imu",
        "estimate",
        "truth",
    }
    assert "next: baqueano identify 0001-experiment --update" in end.err
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["0001-experiment.mcap"]


def test_a_simulation_writes_a_run_without_a_control_loop(baqueano):
    end = baqueano("simulate", "--vehicle", "small", "--seconds", "1", "--json")
    assert end.code == 0
    assert {row["topic"] for row in end.reply["rows"]} == {"command applied", "sensor imu", "truth"}


def test_a_fit_is_written_to_the_vehicle_file_only_with_update(project, tmp_path):
    project("simulate", "--vehicle", "small", "--seconds", "20", "-o", "long.mcap")
    arguments = ("identify", "long.mcap", "--free", "model.actuator_matrix[0,0]", "--no-noise", "--json")
    fit = project(*arguments)
    assert fit.code == 0, fit.err
    assert [row["name"] for row in fit.reply["rows"]] == ["model.actuator_matrix[0,0]"]
    assert "add --update" in fit.err
    assert not (tmp_path / "vehicle.toml").exists()
    assert project(*arguments, "--update").code == 0
    assert "[provenance" in (tmp_path / "vehicle.toml").read_text(encoding="utf-8")
    mixed_end = project(*arguments, "--free", "+model.actuator_matrix[2,2]")
    assert len(mixed_end.reply["rows"]) == 2
    sentence = text(note("cli.free-mixed", names=["model.actuator_matrix[0,0]"]))
    assert (sentence in mixed_end.err, sentence in fit.err) == (True, False)
    result = project("identify", "long.mcap", "--bound", "model.mass_kg")
    assert result.code == 2
    assert (result.reason.code, result.fix) == ("cli.bound", "--bound model.mass_kg=0,10")


def test_a_taught_route_is_repeated_and_judged(project, tmp_path):
    lesson = project("teach", "otra", "--vehicle", "small", "--driver", "lab", "--json")
    assert lesson.code == 0
    assert lesson.reply["rows"][0]["poses"] > 50
    assert (tmp_path / "routes" / "otra.csv").is_file()
    end = project("repeat", "otra", "--vehicle", "small", "--json", "--report", "page.html")
    assert end.code == 0, end.err
    assert end.reply["rows"][0]["across_true_rms_m"] < 0.1
    assert "report: page.html" in end.err
    assert (tmp_path / "page.html").stat().st_size > 10_000


def test_a_replay_gives_the_same_estimates(project):
    end = project("replay", "1", "--json")
    assert end.code == 0
    first, second = end.reply["rows"]
    assert second["ate_m"] == first["ate_m"]
    assert second["nis"] == first["nis"]


def test_a_replay_needs_only_a_model_and_an_estimator(project, tmp_path):
    (tmp_path / "mine.py").write_text(
        files("baqueano.project").joinpath("my_estimator.py").read_text(encoding="utf-8"), encoding="utf-8"
    )
    text = files("baqueano.garage").joinpath("small.toml").read_text(encoding="utf-8")
    text = text.replace('kind = "augmented_ekf"', 'kind = "ekf"').replace(
        'kind = "pd_feedforward"', 'kind = "pd"'
    )
    (tmp_path / "bare.toml").write_text(text, encoding="utf-8")
    project("repeat", "lab", "--vehicle", "small", "--json")
    own_replay = ("replay", "last", "--vehicle", "bare.toml", "--estimator", "mine.py:MyEstimator", "--json")
    assert project(*own_replay).code == 0
    assert project(*own_replay[:-3], "--json").reason.figures["role"] == "estimator"


def test_a_smoothed_replay_has_a_smaller_error(project, tmp_path):
    end = project("replay", "1", "--smooth", "--estimator", "ekf", "--json")
    assert end.code == 0, end.err
    replay_row = end.reply["rows"][1]
    assert replay_row["run"].startswith("0003-replay")
    first = project("replay", "1", "--estimator", "ekf", "--json").reply["rows"][1]
    assert replay_row["speed_error_m_s"] < first["speed_error_m_s"]
    replayed_run = read_run(tmp_path / "runs" / f"{replay_row['run']}.mcap")
    assert replayed_run.events[0].diagnostic.code == "smooth.smoothed"
    assert len(replayed_run.estimate.t_ns) == len(replayed_run.t_ns)


def test_runs_are_listed_shown_cut_and_exported(project, tmp_path):
    assert [row["number"] for row in project("runs", "ls", "--json").reply["rows"]] == [1, 2]
    assert "2.50" not in project("runs", "show", "last").out
    cut = project("runs", "cut", "1", "--from", "1", "--to", "2")
    assert cut.code == 0
    assert read_run(tmp_path / "runs" / "0003-0001-experiment-cut.mcap").duration_s == pytest.approx(
        1, abs=0.02
    )
    assert project("runs", "export", "1").out.strip() == "0001-experiment.csv"
    assert project("runs", "export", "1", "--to", "tum").out.strip() == "0001-experiment.tum"
    assert project("compare", "1", "2", "--json").code == 0
    page = project("report", "1", "-o", "one.html")
    assert page.out.strip() == "one.html"
    assert (tmp_path / "one.html").read_text(encoding="utf-8").startswith("<!")


def test_blocks_are_listed_with_their_package_and_kind(baqueano):
    rows = baqueano("blocks", "ls", "--json").reply["rows"]
    assert {"role": "controller", "kind": "pd"} in rows


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("--vehicle car", "not the same kind of vehicle"),
        ("--vehicle small --bound model.friction.linear=5,1", "expected the lower one first"),
        ("--vehicle small --bound model.mass_kg=0,1", "not fitted, so they have no effect"),
        ("--vehicle small --free model.nope", "model.nope is not a parameter"),
    ],
)
def test_unsuitable_options_of_identify_are_refused(project, options, expected):
    end = project("identify", "1", *options.split())
    assert end.code == 2
    assert expected in end.paragraph


def test_a_report_is_advised_only_if_no_report_was_written(baqueano, tmp_path):
    baqueano("simulate", "--vehicle", "small", "--seconds", "0.3", "-o", "tiny.mcap")
    fit = ("identify", "tiny.mcap", "--vehicle", "small", "--no-noise")
    plain_fit, with_report = baqueano(*fit), baqueano(*fit, "--report", "page.html")
    assert plain_fit.code == with_report.code == 1
    assert plain_fit.out.endswith(" more: --report fit.html shows all, with figures\n")
    assert plain_fit.reason.code == "cli.fit-refused"
    assert plain_fit.reason.figures["data"].fix == "--report fit.html"
    assert with_report.out.endswith(" more: the report shows all, with figures\n")
    assert with_report.reason.figures["data"].code == "cli.data-in-report"
    assert "report: page.html" in with_report.err
    assert "--report" not in with_report.out + with_report.err
    assert (tmp_path / "page.html").exists()


def test_a_report_contains_the_command_line_that_reproduces_its_numbers(baqueano, tmp_path, monkeypatch):
    baqueano("simulate", "--vehicle", "small", "--seconds", "0.3", "-o", "tiny.mcap")
    line = (
        "identify",
        "tiny.mcap",
        "--vehicle",
        "small",
        "--no-noise",
        "--use",
        "imu[2]",
        "--report",
        "page.html",
    )
    monkeypatch.setattr(sys, "argv", ["baqueano", *line])
    baqueano(*line)
    page = html.unescape((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert f"To reproduce these numbers: <code>{shlex.join(['baqueano', *line])}</code>" in page


def test_json_of_a_fit_contains_the_reasons_of_its_verdict(baqueano):
    baqueano("simulate", "--vehicle", "small", "--seconds", "3", "-o", "short.mcap")
    fit = baqueano("identify", "short.mcap", "--vehicle", "small", "--no-noise", "--json").reply
    assert fit["verdict"] != "USABLE"
    assert fit["reasons"], "three seconds are too short, and the verdict needs a reason"
    assert all({"code", "figures", "text"} <= set(reason) for reason in (*fit["reasons"], *fit["findings"]))


def test_terms_are_not_chosen_for_a_car_with_only_an_imu(baqueano):
    baqueano("experiment", "--vehicle", "car", "--seconds", "4", "--seed", "1", "-o", "car.mcap")
    end = baqueano("identify", "car.mcap", "--vehicle", "car", "--use", "imu", "--choose")
    assert end.code == 2
    assert (end.reason.code, end.fix) == ("cli.choose-without-encoders", "--free +KEY")


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ("small", "small (imu): augmented_ekf. Compare it with dead_reckoning"),
        (
            "car",
            'car (imu, odometer): dead_reckoning until the vehicle is identified, then augmented_ekf with use = ["imu"',
        ),
    ],
)
def test_one_line_recommends_an_estimator_for_the_sensors(baqueano, vehicle, words):
    assert words in baqueano("blocks", "ls", "--vehicle", vehicle).err


def test_an_estimator_that_uses_a_pose_is_recommended_for_a_camera(baqueano, tmp_path):
    from baqueano.vehicle_file import load

    text = load("small").text + '\n[sensors.camera]\nkind = "pose"\nnoise_std = [0.01, 0.01, 0.02]\n'
    (tmp_path / "identifiability.toml").write_text(text, encoding="utf-8")
    output = baqueano("blocks", "ls", "--vehicle", "identifiability.toml").err
    assert 'augmented_ekf with use = ["imu", "camera"]: it corrects the pose with camera' in output
