"""The distance of a fit from the theoretical limit on the independent truth: bound, calculations, one fit, and
Ctrl-C.
"""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import (
    car_file,
    car_unknowns,
    car_values,
    drive_group,
    robot_file,
    robot_values,
    with_car_unknowns,
    with_values,
)
from baqueano.study.counterpart.cars import SPEED
from baqueano.study.identification import Identification, identification, result, trials
from baqueano.study.identification.bound import cramer_rao_bound, difference_steps, perturbed_copies
from baqueano.study.identification.page import identification_page
from baqueano.study.identification.trials import CASES, TrialOutcome
from baqueano.study.truth import TruthWorld, draw_cars
from baqueano.sweep.workers import run_in_processes

NAMES = ("model.friction.linear[0]", "model.drivetrain.lag_s")


def outcome_of(case="clean", verdict="USABLE", reasons=(), std=1.0, error=0.0, seed=0, within_limits=True):
    """Return an outcome with random errors in bounds of 0.01 and with standard errors of `std` bounds."""
    truth, rng = np.array([3.0, 0.05]), np.random.default_rng(seed)
    estimate = truth + 0.01 * (error + rng.normal(size=2))
    bound = np.full(2, 0.01 if case in ("clean", "rough") else np.nan)
    return TrialOutcome(
        case, seed, NAMES, truth, estimate, np.full(2, 0.01 * std), bound, verdict, reasons, within_limits
    )


def study_of(count=200, **options):
    return Identification(tuple(outcome_of(seed=k, **options) for k in range(count)), count)


@pytest.mark.parametrize("path", sorted(robot_values(trials.draw_robot(0))))
def test_setting_a_true_value_of_a_robot_changes_no_other_value(path):
    robot = trials.draw_robot(0)
    before = robot_values(robot)
    after = robot_values(with_values(robot, {path: before[path] + 0.01}))
    for name, value in after.items():
        assert value[0] == pytest.approx(before[name][0] + 0.01 * (name == path), abs=1e-12), name


@pytest.mark.parametrize("path", car_unknowns(draw_cars(1, 0)))
def test_setting_a_true_value_of_a_car_changes_no_other_value(path):
    cars = draw_cars(2, 3)
    numbers = car_unknowns(cars)[path] * [1.1, 0.9] + [0.01, 0.02]
    result = car_unknowns(with_car_unknowns(cars, {path: numbers}))
    np.testing.assert_allclose(result[path], numbers)
    for name, before in car_unknowns(cars).items():
        if name != path:
            np.testing.assert_allclose(result[name], before)


def test_the_error_bound_of_an_unobservable_parameter_is_its_prior_error():
    car = draw_cars(1, 0)
    readings = np.zeros((50, 2 * len(car_unknowns(car)), 4))
    bounds = cramer_rao_bound(readings, car, {path: 0.5 for path in car_unknowns(car)})
    np.testing.assert_allclose(list(bounds.values()), 0.5)


def test_the_file_of_a_robot_contains_its_true_values():
    robot = trials.draw_robot(3)
    file = robot_file(robot)
    for path, value in robot_values(robot).items():
        assert float(np.ravel(file.value(path))[0]) == pytest.approx(value[0], rel=1e-9, abs=1e-12), path


def test_the_stated_true_speed_of_a_car_is_its_final_speed():
    car = draw_cars(1, 0)
    car = car.with_parameters(servo_offset_rad=np.zeros(1))
    world = TruthWorld(car, [0])
    for _ in range(100):
        world.tick(np.array([[0.35, 0.0]]), 0.02)
    assert world.truth.nu[0, 0] == pytest.approx(car_values(car)[SPEED][0], rel=0.05)
    assert car_file(car).vehicle.wheelbase_m == pytest.approx(0.15)


def test_the_error_bound_is_computed_from_the_inverse_information():
    """The readings are linear in the parameters, with derivatives that can be calculated by hand."""
    robot = trials.draw_robot(1)
    steps, rng = difference_steps(robot), np.random.default_rng(0)
    G = rng.normal(size=(60, 3, len(steps)))
    values = robot_values(perturbed_copies(robot))
    theta = np.stack([values[path] for path in steps])
    bounds = cramer_rao_bound(np.einsum("tcp,pk->tkc", G, theta), robot)
    flat = (G / robot.imu.noise[0][:, None]).reshape(-1, len(steps))
    expected = np.sqrt(np.diagonal(np.linalg.inv(flat.T @ flat)))
    np.testing.assert_allclose(list(bounds.values()), expected, rtol=1e-6)


@pytest.mark.parametrize("case", ["floor", "low-passed"])
def test_the_fit_to_one_robot_is_not_wrong(case):
    study = identification(1, 5, cases=(case,), duration_s=5.0)
    (outcome,) = study.outcomes
    assert len(outcome.names) == 26
    rows = study.rows()
    assert rows[0]["name"] == "pooled"
    assert rows[0]["wrongly_usable"] == 0
    json.dumps(rows, allow_nan=False)


def test_the_true_value_of_a_drifting_bias_is_its_mean():
    robot = trials.draw_robot(0)
    imu = robot.imu.with_parameters(noise=np.zeros((1, 3)), walk=np.array([[0.1, 0.2, 0.01]]))
    motion = drive_group(robot.with_parameters(imu=imu), np.zeros((200, 1, 3)), [0], tick_times(200, 100.0))
    assert np.all(np.abs(motion.bias_drift) > 1e-3)
    np.testing.assert_allclose((motion.readings - motion.noiseless).mean(axis=0), motion.bias_drift)


def test_study_robots_have_the_documented_properties():
    q = trials.draw_robot(7)
    assert np.all((q.forward >= 0.25) & (q.forward <= 0.33))
    assert np.linalg.norm(q.imu.place_m) == pytest.approx(0.03)
    assert np.linalg.norm(np.degrees(q.imu.tilt_rad)) == pytest.approx(2.0)
    u = trials._steps(trials.initial_file(q), 0, 10.0)
    counts = 255 * np.stack([u[:, 0] - u[:, 2], u[:, 0] + u[:, 2]])
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(counts).max() <= 255 + 1e-9


def test_a_study_that_meets_every_limit_is_usable():
    study = study_of()
    assert study.verdict == "USABLE", study.reasons
    assert study.rows()[0]["rmse"] == pytest.approx(1.0, abs=0.1)
    assert study.table().endswith("USABLE: every limit is met, within the scatter of 200 seeds")


@pytest.mark.parametrize(
    ("bars", "message"),
    [
        ({"std": 0.7}, "of the intervals contain the truth"),
        ({"std": 1.6}, "of the intervals contain the truth"),
        ({"error": 3.0, "std": 3.0}, "bounds"),
        ({"verdict": "WARN"}, "0 % USABLE, expected 95 %"),
        ({"case": "rough", "std": 1.8}, "standard errors of 1.80 bounds"),
        ({"case": "floor", "error": 30.0}, "wrong fits were called USABLE"),
        ({"case": "wrong start", "within_limits": False}, "200 ended in another minimum without a warning"),
        ({"case": "understeer", "error": 3.0}, "are in their interval or named"),
        (
            {"case": "matched", "reasons": (("residual.missing", "model.drivetrain.lag_s"),)},
            "name a parameter",
        ),
    ],
)
def test_each_missed_limit_of_the_study_is_a_reason(bars, message):
    study = study_of(**bars)
    assert study.verdict == "WARN"
    assert message in "; ".join(study.reasons)


def test_a_poorly_identified_parameter_does_not_change_the_study_verdict():
    study = study_of(case="matched", reasons=(("fit.poor", "fit"),))
    assert study.verdict == "USABLE", study.reasons


def test_the_study_page_contains_table_and_figures():
    text = identification_page(study_of(8)).html()
    assert text.count('<svg class="wide"') == 3
    assert "--seeds 8" in text


def test_an_interrupted_study_resumes_from_stored_results(tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(
        result, "fit_job", lambda job: calls.append(job.seeds) or [outcome_of(seed=job.seeds[0])]
    )
    for seeds in (8, 16):
        study = identification(seeds, cases=("clean",), drives_folder=tmp_path / "kept")
    assert [seeds[0] for seeds in calls] == [0, 8]
    assert len(study.outcomes) == 2


def test_an_unknown_case_is_refused_with_the_list_of_cases(capsys):
    from baqueano.cli import main

    with pytest.raises(SystemExit) as exit_info:
        main(["study", "identification", "--case", "claen"])
    assert exit_info.value.code == 2
    errors = capsys.readouterr().err
    assert "Did you mean clean?" in errors
    assert all(case in errors for case in CASES)


def test_jobs_run_in_this_process_or_in_other_processes():
    progress = []
    assert sorted(run_in_processes(abs, [-3, 1, -2], 1, progress.append)) == [1, 2, 3]
    assert sorted(run_in_processes(abs, [-3, 1, -2], 2, progress.append)) == [1, 2, 3]
    assert progress == [1] * 6


def test_results_before_ctrl_c_are_returned():
    def work(job):
        if job == 3:
            raise KeyboardInterrupt
        return job

    assert run_in_processes(work, [1, 2, 3, 4]) == [1, 2]


def test_ctrl_c_before_the_first_seed_is_raised_again(monkeypatch):
    monkeypatch.setattr(result, "run_in_batches", lambda *args: [])
    with pytest.raises(KeyboardInterrupt):
        identification(3)


@pytest.mark.skipif(os.name == "nt", reason="SIGINT is sent to a process in another way there")
def test_ctrl_c_leaves_the_table_of_completed_seeds(tmp_path):
    code = (
        "import sys, time\nimport numpy as np\nfrom baqueano.cli import main\n"
        "from baqueano.study.identification import result\nfrom baqueano.sweep import workers\n"
        "from baqueano.study.identification.trials import TrialOutcome\none, none = np.ones(1), (np.nan * np.ones(1))\n"
        "def slow(job):\n    if job.seeds[0]:\n        print('one', file=sys.stderr, flush=True)\n"
        "        time.sleep(30)\n"
        "    return [TrialOutcome('clean', s, ('a',), one, one, one, none, 'USABLE', (), True) for s in job.seeds]\n"
        "result.fit_job, workers.processor_count = slow, lambda: 1\n"
        "main(['study', 'identification', '--seeds', '400', '--json', '--figures', 'f'])\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    assert process.stderr.readline() == "one\n"
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert len(json.loads(out)["rows"]) == 2
    assert "the table covers" in err
    assert "of 400." in err
    assert (tmp_path / "study-identification.html").exists()
    assert [path.suffix for path in (tmp_path / "f").iterdir()] == [".svg"] * 3
