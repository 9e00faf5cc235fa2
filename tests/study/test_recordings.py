"""Recordings of real vehicles: each is compared with its requirement, and a missing recording is named."""

import json

import pytest

from baqueano.cli import main
from baqueano.errors import FileError
from baqueano.study import recordings as collected
from baqueano.study.recorded import dart, micromouse, warthog
from baqueano.study.recordings import RecordingStudy, check_cpm_present, missing_paths, recordings
from baqueano.study.recordings_page import make_recordings_page
from tests.codes import refused

FILES = ("run_a_truth_ips", "run_a_vehicle", "run_b_truth_ips", "run_b_vehicle")
KEYS = ["recording", "quantity", "value", "bar", "ok"]


def rows_of(module):
    missing = missing_paths(module.files())
    if missing:
        pytest.skip(f"recordings: there is no {missing[0]}; set BAQUEANO_DATA to its folder")
    return module.rows(lambda text: None, "auto")


def test_a_car_fitted_to_half_the_throttle_steps_predicts_the_others():
    rows = rows_of(dart)
    assert [row["quantity"] for row in rows[:2]] == ["held-out speed error [m/s rms]", "dead zone"]
    assert all(row["ok"] for row in rows), rows


def test_a_duty_sweep_identifies_dead_zone_and_faster_wheel():
    rows = rows_of(micromouse)
    assert all(row["ok"] for row in rows), rows


def test_a_skid_steered_vehicle_is_predicted_from_its_wheels():
    """The test uses a fifth of the windows; `baqueano study recordings` uses all of them."""
    if missing_paths(warthog.files()):
        pytest.skip("recordings drive_warthog_husky: set BAQUEANO_DATA to their folder")
    runs = warthog.load_runs("warthog")
    half = len(runs) // 2
    fit = warthog.fit_windows(runs[:half:5], "warthog")
    far_m, far_rad = warthog.median_errors(fit.vehicle_file, runs[half::5])
    assert far_m < 0.5
    assert far_rad < warthog.MAX_ERROR_RAD
    assert "effective track 1." in warthog.fit_sentence(fit, "warthog")


def study_of(ok=True):
    row = {"recording": "one", "quantity": "speed [m/s]", "value": 0.0712345, "bar": "≤ 0.09", "ok": ok}
    return RecordingStudy((row, row | {"quantity": "text", "value": True}), ())


def test_rows_table_and_page_report_the_met_requirements():
    study = study_of()
    assert [list(row) for row in study.rows()] == [KEYS, KEYS]
    assert json.dumps(study.rows())
    assert "0.07123" in study.table()
    assert study.table().endswith("USABLE: 2 of 2 requirements are met")
    assert "All recordings" in make_recordings_page(study, None).html()


def test_a_missed_requirement_is_a_reason_of_the_verdict():
    study = study_of(ok=False)
    assert study.verdict == "WARN"
    assert study.reasons[0] == "one: speed [m/s] is 0.07123"
    assert "NO" in study.table()


def test_a_missing_recording_is_excluded_with_a_note(monkeypatch, tmp_path):
    monkeypatch.setenv("BAQUEANO_DATA", str(tmp_path))
    (tmp_path / "here.csv").touch()

    class Here:
        files = staticmethod(lambda: ["here.csv"])
        rows = staticmethod(lambda progress, backend: study_of().rows())

    real = collected.import_module
    monkeypatch.setattr(
        collected, "import_module", lambda name: Here if name.endswith("here") else real(name)
    )
    study = recordings(names=("here", "dart"))
    assert len(study.rows()) == 2
    assert study.missing_recordings[0].startswith("dart is excluded: dart_jetracer/throttle_step_input")
    assert study.verdict == "WARN"


def test_missing_recordings_are_named_and_end_with_code_3(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("BAQUEANO_DATA", str(tmp_path))
    with pytest.raises(SystemExit) as exit_info:
        main(["study", "recordings"])
    assert exit_info.value.code == 3
    output = capsys.readouterr()
    assert output.out == ""
    for name in FILES:
        assert f"cpm_mucar/{name}.csv.gz" in output.err
    assert f"{tmp_path} do not contain " in output.err
    assert "set BAQUEANO_DATA to the folder that contains cpm_mucar" in output.err


def test_an_incomplete_set_of_recordings_is_refused(monkeypatch, tmp_path):
    (tmp_path / "cpm_mucar").mkdir()
    for name in FILES[:3]:
        (tmp_path / "cpm_mucar" / f"{name}.csv.gz").touch()
    monkeypatch.setenv("BAQUEANO_DATA", str(tmp_path))
    with refused("study.recordings-missing", FileError, first="cpm_mucar"):
        check_cpm_present()
