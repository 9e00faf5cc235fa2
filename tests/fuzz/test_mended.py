"""Defects that the fuzzer detected; each has one test."""

import json

import numpy as np
import pytest

from baqueano.drive.mission import Mission
from baqueano.errors import FileError, UsageError
from baqueano.guides.route import Route
from baqueano.runs import import_runs
from baqueano.runs.diagnostics.truth import truth_findings
from baqueano.runs.run import TruthLog
from tests.codes import refused
from tests.fuzz.formats import MAP, log


@pytest.fixture
def import_log(tmp_path):
    """Import the recording of the fuzzer, with one text in place of another in the map, or in the log."""

    def import_texts(before="", after="", of_log=("", "")):
        (tmp_path / "log.csv").write_text(log().replace(*of_log, 1), encoding="utf-8")
        (tmp_path / "log.toml").write_text(MAP.replace(before, after, 1), encoding="utf-8")
        return import_runs(tmp_path / "log.toml")

    return import_texts


def test_the_undamaged_recording_of_the_fuzzer_is_imported(import_log):
    (imported_run,) = import_log()
    assert len(imported_run.run.t_ns) > 30


@pytest.mark.parametrize(
    "key", ["scale = 0.00392157", "radius_m = 0.03", "split_gap_s = 5.0", "counts_per_turn = 600"]
)
def test_a_map_integer_beyond_the_double_range_is_refused(import_log, key):
    with refused("map.wrong", FileError):
        import_log(key, f"{key.split(' = ')[0]} = {'9' * 400}")


def test_an_absent_row_value_of_400_digits_is_refused(import_log):
    with pytest.raises(FileError):
        import_log("ok = 1", f"ok = {'9' * 400}")


@pytest.mark.parametrize("name", ["x" * 5000 + ".csv", "**x/*.csv", "/*.csv/**"])
def test_an_impossible_file_name_is_reported_as_a_missing_file(import_log, name):
    with refused("import.file-absent", FileError):
        import_log("log.csv", name)


@pytest.mark.parametrize("time", ["1e305", "9223372036854775807", "-9223372036854775808", "9" * 300])
def test_a_time_beyond_64_bits_is_refused_or_ignored(import_log, time):
    """In milliseconds it was converted to another time without a report."""
    try:
        runs = import_log(of_log=("\n20,", f"\n{time},"))
    except FileError:
        return
    assert all(imported_run.run.duration_s < 1.0 for imported_run in runs)


def test_an_extremely_small_wraps_value_is_refused(import_log):
    with pytest.raises(FileError):
        import_log("wraps = 65536", "wraps = 5e-324")


def test_an_extremely_distant_pose_uses_no_extra_memory():
    eta = np.zeros((50, 3))
    eta[:, 0] = 0.01 * np.arange(50)
    eta[20, 0] = 1e15
    truth = TruthLog(20_000_000 * np.arange(50), eta, eta, eta)
    assert [finding.code for finding in truth_findings(truth)] in ([], ["unit"])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("u", "[[NaN, 0, 0]]"), ("u", "[[1e999, 0, 0]]"), ("u", "[[" + "9" * 400 + ", 0, 0]]"), ("laps", "NaN"),
        ("laps", "-1"), ("laps", "true"), ("laps", "1.5"), ("hold", "1"), ("blocks", '{"guide": 1}'), ("texts", "[]"),
        ("vehicle", "3"), ("kind", "null"),
    ],
)  # fmt: skip
def test_a_mission_with_a_field_of_wrong_type_is_refused(name, value):
    mission = json.loads(Mission("experiment", u=np.zeros((1, 3))).to_json())
    text = json.dumps(mission | {name: "HERE"}).replace('"HERE"', value)
    with refused("mission.damaged", UsageError):
        Mission.from_json(text)


def test_an_impossible_route_can_still_be_displayed():
    ends = np.array([[-1e308, 0.0, 0.0], [1e308, 0.0, 0.0], [-1e308, 0.0, 0.0]])
    assert "3 poses" in repr(Route(np.arange(3.0), ends, ends, False))
