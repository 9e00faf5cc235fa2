"""An ageing vehicle is tracked; only a changed parameter is named, with the run of its change."""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, random_steps
from baqueano.simulate import simulate
from baqueano.validation.parameter_drift import Drift, parameter_history
from tests.codes import of_code
from tests.identify.true_drives import case_drives, case_file

FREE = ("model.friction.linear[0]", "model.friction.linear[2]", "model.actuator_matrix[0,0]")
RUNS = 8


def drives(case, change, seed=0):
    """Return runs of 15 s of a vehicle whose parameters `change(k)` gives."""
    out = []
    for k in range(RUNS):
        file = case.with_values(change(k))
        u = random_steps(file.command.limit, 15.0, file.rate_hz, 100 * seed + k)
        out.append(simulate(file, u, 100 * seed + k, name=f"run {k}"))
    return out


@pytest.fixture(scope="module")
def worn_history(case):
    """Rolling friction grows by a fifth between the fifth and the sixth run."""
    linear = np.asarray(case.value("model.friction.linear"))

    def change(k):
        return {"model.friction.linear": (linear * [1.2 if k >= 5 else 1.0, 1.0, 1.0]).tolist()}

    return parameter_history(drives(case, change), case, free=FREE, options=FitOptions(biases=False))


def test_a_parameter_step_is_detected_between_the_right_runs(worn_history):
    (drift,) = worn_history.changes
    assert drift.name == "model.friction.linear[0]"
    assert drift.pattern == "step"
    assert drift.runs == ("run 4", "run 5")
    assert (drift.last_value - drift.first_value) / drift.first_value == pytest.approx(0.2, abs=0.03)
    assert (drift.message.code, drift.message.subject) == ("over-time.step", "model.friction.linear[0]")
    assert (drift.message.figures["first"], drift.message.figures["second"]) == ("run 4", "run 5")
    assert worn_history.verdict == "WARN"
    assert [row["name"] for row in Drift(worn_history).rows()] == [drift.name]


def test_the_tracked_parameter_reaches_the_present_value(worn_history, case):
    now = worn_history.vehicle_file.value("model.friction.linear[0]")
    truth = 1.2 * case.value("model.friction.linear[0]")
    assert abs(now - truth) < 4.0 * worn_history.filtered_std[-1, 0]
    assert worn_history.filtered_std[-1, 0] <= 1.01 * worn_history.single_std[-1, 0]
    assert (
        abs(worn_history.smoothed_values[0, 0] - case.value("model.friction.linear[0]"))
        < 4.0 * worn_history.smoothed_std[0, 0]
    )


def test_the_error_of_a_constant_parameter_shrinks_with_every_run(worn_history):
    k = worn_history.names.index("model.actuator_matrix[0,0]")
    assert worn_history.walk[k] == 0.0
    assert worn_history.filtered_std[-1, k] < 0.5 * worn_history.single_std[-1, k]


def test_a_vehicle_that_does_not_age_shows_no_drift():
    """Eight runs of nine vehicles have a false alarm in a hundred: more than one indicates an error of the method."""
    seeds, file = range(9 * RUNS), case_file()
    runs = [drive.run for drive in case_drives(seeds, 15.0, file)]
    alarms = 0
    for first in seeds[::RUNS]:
        history = parameter_history(
            runs[first : first + RUNS], file, free=FREE, options=FitOptions(biases=False)
        )
        alarms += bool(history.changes)
    assert alarms <= 1


def test_slow_wear_is_a_drift(case):
    linear = np.asarray(case.value("model.friction.linear"))

    def change(k):
        return {"model.friction.linear": (linear * [1.0 + 0.05 * k, 1.0, 1.0]).tolist()}

    history = parameter_history(drives(case, change, 20), case, free=FREE, options=FitOptions(biases=False))
    (drift,) = history.changes
    assert (drift.name, drift.pattern) == ("model.friction.linear[0]", "drift")
    assert drift.runs == ("run 0", "run 7")
    assert (drift.last_value - drift.first_value) / drift.first_value == pytest.approx(0.35, abs=0.05)


def test_a_history_of_one_run_is_refused(case, case_run):
    with pytest.raises(UsageError, check=of_code("over-time.few-runs", count=1)):
        parameter_history([case_run(0, 3.0)], case, free=FREE)


def test_uninformative_runs_are_named(case, case_run):
    resting = simulate(case, np.full((300, 3), [1e-6, 0.0, 0.0]), 0, name="still")
    with pytest.raises(UsageError, check=of_code("over-time.few-fits", accepted_count=1, count=2)):
        parameter_history([case_run(0, 10.0), resting], case, free=FREE, options=FitOptions(biases=False))
