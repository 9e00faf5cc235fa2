"""A real car: fitted to one recorded run, judged on the other. Skipped, by name, without the recordings."""

import json

import numpy as np
import pytest

from baqueano.runs.importing import import_run
from baqueano.study.cross_validation_cpm import CrossValidation, evaluate_on_run, fit_car
from baqueano.study.recordings import CPM_MAPS
from baqueano.study.recordings_page import make_recordings_page

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def study(cpm_recordings):
    """Return both fits, each judged on the unseen run."""
    runs = {name[-1]: import_run(name).run for name in CPM_MAPS}
    fits = {name: fit_car(run) for name, run in runs.items()}
    ways = (("a", "b"), ("b", "a"))
    return CrossValidation(fits, tuple(evaluate_on_run(fits[a].vehicle_file, a, runs[b], b) for a, b in ways))


def test_a_fit_to_one_run_predicts_the_other_run(study):
    for validation in study.evaluations:
        assert validation.is_held_out
        assert np.all(validation.prediction.explained_variance > 0.9), validation.row()


def test_the_filter_error_is_below_one_percent_of_the_distance(study):
    for validation in study.evaluations:
        row = validation.row()
        assert row["distance_m"] == pytest.approx(74.6, abs=1.0)
        assert row["ate_m"] < 0.01 * row["distance_m"]
        assert np.degrees(row["ate_heading_rad"]) < 10.0
        assert not row["is_lost"]


def test_the_filter_begins_at_the_first_pose_of_the_camera(study):
    for validation in study.evaluations:
        estimate, truth = validation.replay_run.estimate, validation.replay_run.truth
        index = np.argmin(np.abs(truth.t_ns - estimate.t_ns[0]))
        assert np.hypot(*(estimate.eta[0] - truth.eta[index])[:2]) < 0.05


def test_both_fits_give_similar_parameters(study):
    for row in study.parameters():
        if row["name"].endswith(("throttle_gain", "steering_gain", "yaw_lag_s")):
            assert row["a"] == pytest.approx(row["b"], rel=0.2), row


def test_rows_table_and_page_report_the_cross_validation(study):
    assert study.verdict == "WARN"
    assert [(row["fit_run"], row["test_run"]) for row in study.rows()] == [("a", "b"), ("b", "a")]
    assert json.dumps(study.rows(), allow_nan=False)
    table = study.table()
    assert "a → b" in table
    assert "throttle from -0.41 to 0.57 leaves the range of the fit" in table
    page = make_recordings_page(None, study).html()
    assert page.count('<svg class="wide"') == 6
    assert "Fitted on b, tested on a: the path" in page
