"""The study of faults at one seed: no wrong fit is usable, no run without faults is refused; its table and rows."""

import json

import numpy as np
import pytest

from baqueano.study.faults import FAULTS, Faults, detection, faults
from baqueano.study.faults.detection import SOUND_DATA, FaultJob, FaultOutcome
from baqueano.study.wrong_estimates import wrong_mask

SOME = (
    "clean", "clean, other start", "gyro in °/s", "time jumps a day", "time jumps seconds", "repeated samples",
    "frames as zero", "second vehicle",
)  # fmt: skip


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(detection, "DRIVE_S", 12.0)
        return faults(1, 2, vehicles=("car",), names=SOME)


def test_no_wrong_fit_is_called_usable_and_no_sound_run_refused(study):
    rows = {row["fault"]: row for row in study.rows()}
    assert set(rows) == set(SOME)
    assert all(row["fits"] == 1 for row in rows.values())
    assert all(row["wrongly_usable"] == 0 and row["wrongly_refused"] == 0 for row in rows.values())
    assert all(rows[fault]["usable"] == 1 for fault in SOME[:2])
    assert all(rows[fault]["usable"] == 0 for fault in ("gyro in °/s", "second vehicle"))
    assert study.verdict == "USABLE"


def test_a_repaired_time_jump_gives_nearly_the_same_errors(study):
    rows = {row["fault"]: row for row in study.rows()}
    assert 0.5 < rows["time jumps a day"]["error_ratio_clean"] < 2.0


def test_a_fit_to_a_run_split_in_two_converges(study):
    (row,) = [row for row in study.rows() if row["fault"] == "time jumps seconds"]
    assert row["refused"] == 0
    assert row["error_ratio_clean"] < 1.5


def test_the_table_names_each_fault_and_ends_with_the_verdict(study):
    table = study.table()
    assert all(fault in table for fault in SOME)
    assert table.endswith("verdict: USABLE")
    json.dumps(study.rows(), allow_nan=False)


def outcome_of(fault, verdict, is_off):
    return FaultOutcome(FaultJob(fault, "small", 0, "auto"), verdict, is_off, np.nan, np.nan, ())


def test_one_wrong_fit_called_usable_fails_the_study():
    study = Faults((outcome_of("clean", "USABLE", False), outcome_of("lag", "USABLE", True)), 2, 2)
    assert study.verdict == "REFUSED"
    assert "1 wrong fits with lag were called USABLE" in study.reasons


def test_a_fit_that_crashes_fails_the_study():
    study = Faults((outcome_of("clean", "USABLE", False), outcome_of("lag", "CRASH", False)), 2, 2)
    assert study.verdict == "REFUSED"
    assert study.reasons == ("1 fits with lag crashed",)


def test_more_than_two_per_cent_of_sound_runs_refused_fail_the_study():
    sound = [outcome_of("clean", "USABLE", False)] * 49
    assert Faults((*sound, outcome_of("clean", "REFUSED", False)), 50, 50).verdict == "USABLE"
    assert Faults((*sound[:48], outcome_of("clean", "REFUSED", False)), 49, 49).verdict == "REFUSED"


def test_a_fit_without_parameters_is_excluded_from_the_ratio():
    none = outcome_of("stuck", "REFUSED", False)._replace(undamaged_error_rms=1.0)
    fault = none._replace(error_rms=3.0, undamaged_error_rms=2.0)
    assert Faults((none, fault), 2, 2).rows()[0]["error_ratio_clean"] == 1.5
    assert Faults((none,), 1, 1).rows()[0]["error_ratio_clean"] is None


def test_repeated_samples_do_not_reduce_the_information_of_other_samples(study):
    """The remaining readings equal, one by one, the readings of the clean run without the repeated ones."""
    rows = {row["fault"]: row for row in study.rows()}
    assert 0.3 < rows["repeated samples"]["loss_share"] < 0.9
    assert 0.02 < rows["frames as zero"]["loss_share"] < 0.35
    for fault in ("repeated samples", "frames as zero"):
        assert rows[fault]["error_ratio_reduced"] == pytest.approx(1.0, abs=0.01)


def test_the_sound_reference_run_lacks_the_same_readings_as_the_damaged_run(case_study):
    from baqueano.study.faults.damage import not_numbers, repeated_time, time_jumps_a_day
    from baqueano.study.faults.undamaged import undamaged_run

    file, run = case_study
    rng = np.random.default_rng(0)
    damaged_run = not_numbers(run, file, rng)
    restored_run, lost_share = undamaged_run(run, damaged_run, file)
    np.testing.assert_array_equal(restored_run.sensors["imu"].z, damaged_run.sensors["imu"].z)
    assert lost_share == np.mean(np.isnan(damaged_run.sensors["imu"].z))
    faulty_run = repeated_time(run, file, rng)
    restored_run, lost_share = undamaged_run(run, faulty_run, file)
    lost_rows = np.isnan(restored_run.sensors["imu"].z).all(axis=1)
    assert 0.02 < lost_share == lost_rows.mean() < 0.25
    repeats = np.flatnonzero(np.diff(faulty_run.sensors["imu"].t_ns) == 0) + 1
    assert np.all(lost_rows[repeats])
    assert undamaged_run(run, time_jumps_a_day(run, file, rng), file) is None


@pytest.fixture(scope="module")
def case_study():
    from baqueano.identify import random_steps
    from baqueano.simulate import simulate
    from baqueano.vehicle_file import load

    file = load("case-study-1")
    return file, simulate(file, random_steps(file.command.limit, 10.0, file.rate_hz, 0), 0)


def test_an_estimate_is_wrong_beyond_five_errors_and_five_percent():
    truth, std = np.array([1.0, 1.0, 0.0, 1.0, np.nan]), np.array([1e-3, 0.05, 0.01, 0.1, 0.1])
    estimate = np.array([1.04, 1.2, 0.1, np.nan, 1.0])
    assert wrong_mask(estimate, std, truth).tolist() == [False, False, True, False, False]


def test_the_study_contains_every_specified_fault():
    words = (
        "°/s", " g", "ms", "volts", "PWM", "clipped", "late", "repeated", "jumps", "bursts", "repeated samples",
        "stuck", "zero", "swapped", "inverted", "gravity", "dead", "second vehicle",
        "backlash", "slip", "caster", "200 ppm", "2 %", "mount", "slip for 5 s", "resampled", "low-passed",
        "sign lost", "epoch", "duplicated", "two IMUs", "zeroes", "tilted floor", "10 Hz", "1 kHz", "2 s",
    )  # fmt: skip
    for word in words:
        assert any(word in fault for fault in FAULTS), word
    assert len(SOUND_DATA) == 5


@pytest.mark.parametrize(("is_off", "code"), [(False, 0), (True, 1)])
def test_the_faults_command_exits_with_1_if_the_detectors_fail(monkeypatch, capsys, is_off, code):
    from baqueano.cli import main
    from baqueano.study import faults as room

    study = Faults((outcome_of("clean", "USABLE", False), outcome_of("lag", "USABLE", is_off)), 2, 2)
    monkeypatch.setattr(room, "faults", lambda *args, **options: study)
    with pytest.raises(SystemExit) as exit_info:
        main(["study", "faults", "--seeds", "1", "--json"])
    assert exit_info.value.code == code
    output = json.loads(capsys.readouterr().out)
    assert [row["wrongly_usable"] for row in output["rows"]] == [0, int(is_off)]
    assert {"fault", "fits", "wrongly_usable", "wrongly_refused"} <= set(output["rows"][0])


def test_a_stopped_study_reports_its_completed_part(monkeypatch, capsys):
    from baqueano.cli import main
    from baqueano.study import faults as room

    monkeypatch.setattr(
        room, "faults", lambda *args, **options: Faults((outcome_of("clean", "USABLE", False),), 9, 1)
    )
    with pytest.raises(SystemExit) as exit_info:
        main(["study", "faults", "--seeds", "1"])
    assert exit_info.value.code == 130
    assert "interrupted: 1 of 9 fits" in capsys.readouterr().out


@pytest.fixture(scope="module")
def sound():
    """Return a file and a run at 100 Hz whose readings count up with the time."""
    from baqueano.runs.run import Channel, Run
    from baqueano.vehicle_file import load

    t_ns = np.arange(1, 3001) * 10_000_000
    z = np.stack([t_ns * 1e-9, np.sin(t_ns * 1e-9), np.cos(2e-9 * t_ns)], axis=1)
    u = np.stack([np.sin(3e-9 * t_ns), 0.0 * t_ns, np.cos(3e-9 * t_ns)], axis=1)
    return load("small"), Run("counted", None, t_ns, u, sensors={"imu": Channel(t_ns, t_ns, z)})


def harm(sound, name, seed=0):
    from baqueano.study.faults.logging import LOGGING

    file, run = sound
    return run, LOGGING[name](run, file, np.random.default_rng(seed))


@pytest.mark.parametrize(("name", "part"), [("clock 200 ppm off", 200e-6), ("clock 2 % off", 0.02)])
def test_a_clock_with_a_wrong_rate_has_an_error_proportional_to_time(sound, name, part):
    run, faulty_run = harm(sound, name)
    error = (faulty_run.sensors["imu"].t_ns[-1] - run.t_ns[-1]) * 1e-9
    assert abs(error) == pytest.approx(part * 29.99, rel=1e-6)
    np.testing.assert_array_equal(faulty_run.t_ns, run.t_ns)


def test_a_rotating_mount_preserves_the_magnitude_of_the_acceleration(sound):
    run, faulty_run = harm(sound, "mount turns")
    before, after = run.sensors["imu"].z, faulty_run.sensors["imu"].z
    np.testing.assert_allclose(np.hypot(*after[:, :2].T), np.hypot(*before[:, :2].T))
    differing = np.flatnonzero(np.any(before != after, axis=1))
    assert 0.3 * len(before) <= differing[0] <= 0.7 * len(before)
    np.testing.assert_array_equal(before[:, 2], after[:, 2])


def test_a_low_pass_delays_a_ramp_by_its_time_constant(sound):
    run, faulty_run = harm(sound, "low-passed")
    delay = run.sensors["imu"].z[-1, 0] - faulty_run.sensors["imu"].z[-1, 0]
    assert 0.5 / (2.0 * np.pi * 44.0) - 0.01 < delay < 1.0 / (2.0 * np.pi * 5.0)


def test_resampled_values_are_linear_interpolations(sound):
    run, faulty_run = harm(sound, "resampled")
    np.testing.assert_allclose(faulty_run.sensors["imu"].z[:2900, 0], run.sensors["imu"].z[:2900, 0])
    assert 0.0 < np.max(np.abs(faulty_run.sensors["imu"].z[:2900] - run.sensors["imu"].z[:2900])) < 1e-3


def test_a_gyro_that_zeroes_itself_removes_a_steady_turn(sound):
    from dataclasses import replace

    from baqueano.study.faults.logging import gyro_zeroes_itself

    file, run = sound
    steady = run.sensors["imu"]._replace(z=np.tile([0.0, 0.0, 1.0], (3000, 1)))
    faulty_run = gyro_zeroes_itself(replace(run, sensors={"imu": steady}), file, np.random.default_rng(0))
    assert abs(faulty_run.sensors["imu"].z[-1, 2]) < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_a_lost_sign_changes_only_the_second_half(sound, seed):
    run, faulty_run = harm(sound, "sign lost", seed)
    np.testing.assert_array_equal(faulty_run.applied_commands[:1500], run.applied_commands[:1500])
    np.testing.assert_array_equal(faulty_run.sensors["imu"].z[:1500], run.sensors["imu"].z[:1500])
    has_changed = np.any(faulty_run.applied_commands != run.applied_commands) or np.any(
        faulty_run.sensors["imu"].z != run.sensors["imu"].z
    )
    assert has_changed or seed in (1, 2)  # a channel without negative values cannot lose a sign


def test_each_fault_changes_rate_and_duration_as_named(sound):
    _, ten = harm(sound, "10 Hz")
    assert (len(ten.t_ns), int(np.median(np.diff(ten.t_ns)))) == (300, 100_000_000)
    run, fast = harm(sound, "1 kHz repeats")
    assert (len(fast.t_ns), set(np.diff(fast.t_ns).tolist())) == (10_000, {1_000_000})
    index = np.searchsorted(fast.t_ns, run.t_ns[5])
    np.testing.assert_array_equal(fast.applied_commands[index], run.applied_commands[5])
    np.testing.assert_array_equal(
        fast.applied_commands[index + 1 : index + 11], np.tile(run.applied_commands[6], (10, 1))
    )
    _, short = harm(sound, "2 s")
    assert short.duration_s == pytest.approx(2.0, abs=0.02)
    _, epoch = harm(sound, "epoch in ms")
    assert set(np.diff(epoch.t_ns).tolist()) == {10}


def test_a_duplicated_half_and_a_second_imu_have_the_expected_samples(sound):
    run, faulty_run = harm(sound, "half duplicated")
    np.testing.assert_array_equal(faulty_run.sensors["imu"].z[1500:], run.sensors["imu"].z[:1500])
    np.testing.assert_array_equal(faulty_run.applied_commands[1500:], run.applied_commands[:1500])
    run, two = harm(sound, "two IMUs")
    np.testing.assert_array_equal(two.sensors["imu"].z[::2], run.sensors["imu"].z[::2])
    assert np.all(np.any(two.sensors["imu"].z[1::2] != run.sensors["imu"].z[1::2], axis=1))


@pytest.mark.parametrize("vehicle", ["robot", "car"])
def test_structural_faults_do_not_change_the_original_data(vehicle):
    from types import SimpleNamespace

    from baqueano.study.faults.detection import ROBOT_FAULTS
    from baqueano.study.faults.structures import STRUCTURES
    from baqueano.study.faults.subject import subject

    q = subject(vehicle, 0)
    u = q.signal(12.0)
    nu = np.sin(np.arange(len(u)) / 100.0)[:, None] * np.ones(3)
    sound = SimpleNamespace(truth=SimpleNamespace(nu=nu))
    for name in STRUCTURES.keys() - (ROBOT_FAULTS if vehicle == "car" else ()):
        plan = STRUCTURES[name](q, u, sound, np.random.default_rng(0))
        has_changed = plan.vehicle is not q.vehicle or not np.array_equal(plan.effective_commands, u)
        assert has_changed or plan.vehicle_file is not q.vehicle_file or plan.second_vehicle, name
