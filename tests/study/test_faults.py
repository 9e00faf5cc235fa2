"""The study of faults at two seeds: no wrong fit is called usable, no sound run is refused; its table and rows."""

import json

import numpy as np
import pytest

from baqueano.study.faults import FAULTS, Faults, faults
from baqueano.study.faults.judged import SOUND, Job, Outcome, wrong

SOME = (
    "sound", "sound, 10 % outliers", "sound, other start", "gyro in °/s", "time jumps a day", "held samples",
    "frames as zero", "delay of the command", "dry friction", "second vehicle",
)  # fmt: skip


@pytest.fixture(scope="module")
def study():
    return faults(2, vehicles=("case-study-1",), only=SOME)


def test_no_wrong_fit_is_called_usable_and_no_sound_run_refused(study):
    rows = {row["fault"]: row for row in study.rows()}
    assert set(rows) == set(SOME)
    assert all(row["fits"] == 2 for row in rows.values())
    assert all(row["wrongly_usable"] == 0 and row["wrongly_refused"] == 0 for row in rows.values())
    assert all(rows[fault]["usable"] == 2 for fault in SOME[:3])
    assert rows["delay of the command"]["wrong"] == 2
    assert study.verdict == "USABLE"


def test_what_is_mended_is_about_as_good_as_before(study):
    rows = {row["fault"]: row for row in study.rows()}
    for fault in ("time jumps a day", "frames as zero"):
        assert 0.5 < rows[fault]["over_clean"] < 2.0


def test_a_run_that_is_cut_in_two_converges_though_the_second_start_hardly_shows():
    found = faults(1, 102, vehicles=("car",), only=("time jumps seconds",))
    (row,) = found.rows()
    assert row["refused"] == 0
    assert row["over_clean"] < 1.5


def test_the_table_names_each_fault_and_ends_with_the_verdict(study):
    table = study.table()
    assert all(fault in table for fault in SOME)
    assert table.endswith("verdict: USABLE")
    json.dumps(study.rows(), allow_nan=False)


def made(fault, verdict, off):
    return Outcome(Job(fault, "small", 0, "auto"), verdict, off, np.nan, np.nan, ())


def test_one_wrong_fit_that_is_called_usable_fails_the_study():
    found = Faults((made("sound", "USABLE", False), made("lag", "USABLE", True)), 2, 2)
    assert found.verdict == "REFUSED"
    assert "1 wrong fits with lag were called USABLE" in found.reasons


def test_more_than_two_per_cent_of_sound_runs_refused_fail_the_study():
    sound = [made("sound", "USABLE", False)] * 49
    assert Faults((*sound, made("sound", "REFUSED", False)), 50, 50).verdict == "USABLE"
    assert Faults((*sound[:48], made("sound", "REFUSED", False)), 49, 49).verdict == "REFUSED"


def test_a_damaged_fit_without_parameters_leaves_the_ratio_to_the_others():
    none = made("stuck", "REFUSED", False)._replace(clean=1.0)
    some = none._replace(off=3.0, clean=2.0)
    assert Faults((none, some), 2, 2).rows()[0]["over_clean"] == 1.5
    assert Faults((none,), 1, 1).rows()[0]["over_clean"] is None


def test_samples_that_were_only_held_cost_what_is_gone_and_nothing_more(study):
    """What is left is the same, reading by reading, as in the sound run without them."""
    (row,) = [row for row in study.rows() if row["fault"] == "held samples"]
    assert 0.6 < row["lost"] < 0.9
    assert row["over_left"] == pytest.approx(1.0, abs=0.01)


def test_readings_of_the_sound_run_are_taken_out_where_they_are_of_the_damaged_one(case_study):
    from baqueano.study.faults.damage import not_numbers, repeated_time, time_jumps_a_day
    from baqueano.study.faults.left import left_of

    file, run = case_study
    rng = np.random.default_rng(0)
    damaged = not_numbers(run, file, rng)
    left, lost = left_of(run, damaged, file)
    np.testing.assert_array_equal(left.sensors["imu"].z, damaged.sensors["imu"].z)
    assert lost == np.mean(np.isnan(damaged.sensors["imu"].z))
    late = repeated_time(run, file, rng)
    left, lost = left_of(run, late, file)
    gone = np.isnan(left.sensors["imu"].z).all(axis=1)
    assert 0.02 < lost == gone.mean() < 0.25
    repeats = np.flatnonzero(np.diff(late.sensors["imu"].t_ns) == 0) + 1
    assert np.all(gone[repeats])
    assert left_of(run, time_jumps_a_day(run, file, rng), file) is None


@pytest.fixture(scope="module")
def case_study():
    from baqueano.identify import random_steps
    from baqueano.simulate import simulate
    from baqueano.vehicle_file import load

    file = load("case-study-1")
    return file, simulate(file, random_steps(file.command.limit, 10.0, file.rate_hz, 0), 0)


def test_wrong_is_five_errors_and_five_per_cent(study):
    from types import SimpleNamespace

    names = ("a", "b", "c", "d")

    class Truth:
        def value(self, name):
            return {"a": 1.0, "b": 1.0, "c": 0.0, "d": 1.0}[name]

    fit = SimpleNamespace(
        names=names, estimate=np.array([1.04, 1.2, 0.1, np.nan]), sd=np.array([1e-3, 0.05, 0.01, 0.1])
    )
    assert wrong(fit, Truth()).tolist() == [False, False, True, False]


def test_each_fault_of_the_issue_is_there():
    words = (
        "°/s", " g", "ms", "volts", "PWM", "clipped", "late", "repeated", "jumps", "bursts", "held", "stuck", "zero",
        "swapped", "inverted", "gravity", "dead", "second vehicle", "backlash", "slip", "caster",
    )  # fmt: skip
    for word in words:
        assert any(word in fault for fault in FAULTS), word
    assert len(SOUND) == 5


@pytest.mark.parametrize(("off", "code"), [(False, 0), (True, 1)])
def test_the_command_line_answers_in_rows_and_says_no_where_the_detectors_fail(
    monkeypatch, capsys, off, code
):
    from baqueano.cli import main
    from baqueano.study import faults as room

    found = Faults((made("sound", "USABLE", False), made("lag", "USABLE", off)), 2, 2)
    monkeypatch.setattr(room, "faults", lambda *args, **options: found)
    with pytest.raises(SystemExit) as ended:
        main(["study", "faults", "--seeds", "1", "--json"])
    assert ended.value.code == code
    said = json.loads(capsys.readouterr().out)
    assert [row["wrongly_usable"] for row in said["rows"]] == [0, int(off)]
    assert {"fault", "fits", "wrongly_usable", "wrongly_refused"} <= set(said["rows"][0])


def test_a_study_that_was_stopped_tells_what_is_done(monkeypatch, capsys):
    from baqueano.cli import main
    from baqueano.study import faults as room

    monkeypatch.setattr(
        room, "faults", lambda *args, **options: Faults((made("sound", "USABLE", False),), 9, 1)
    )
    with pytest.raises(SystemExit) as ended:
        main(["study", "faults", "--seeds", "1"])
    assert ended.value.code == 130
    assert "interrupted: 1 of 9 fits" in capsys.readouterr().out
