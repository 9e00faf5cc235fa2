"""The correct R predicts an unseen run best, and its NIS is consistent."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import identify, measure_noise, random_steps
from baqueano.simulate import simulate
from baqueano.validation.noise_comparison import compare_noise
from tests.codes import of_code
from tests.ekf_file import with_ekf


@pytest.fixture(scope="module")
def small(small):
    return with_ekf(small)


@pytest.fixture(scope="module")
def truth_fit(small):
    """A fit, its noise from the truth, and an unseen run."""
    runs = []
    for seed in (1, 2):
        u = random_steps(small.command.limit, 30.0, small.rate_hz, seed)
        runs.append(simulate(small, u, seed, name=f"run {seed}"))
    fit = identify(runs[0], small)
    return fit, measure_noise(fit, runs[0]), runs[1]


def test_a_wrong_covariance_predicts_worse_and_its_nis_is_inconsistent(truth_fit):
    fit, noise, unseen_run = truth_fit
    values = {
        "too small": replace(noise, process=1e-4 * noise.process),
        "too large": replace(noise, process=1e2 * noise.process),
    }
    comparison = compare_noise(fit, {"truth": noise} | values, unseen_run)
    by_name = {trial.name: trial for trial in comparison.trials}
    assert comparison.best == "truth"
    assert abs(by_name["truth"].nis - 1.0) < 0.1
    assert by_name["too large"].consistent == "too cautious"
    assert by_name["too small"].consistent == "too sure"
    assert comparison.rows()[0]["name"] == "truth"
    assert "best: truth" in comparison.table()


def test_the_nis_equals_an_independent_filter_within_its_interval(truth_fit, small):
    from baqueano.compare import compare
    from baqueano.drive import replay

    fit, noise, unseen_run = truth_fit
    replayed_run = replay(unseen_run, noise.updated_file(fit.vehicle_file))
    nis_of_replay = compare(replayed_run, names=["x"]).rows()[0]["nis"]
    judged_noise = compare_noise(fit, {"truth": noise}, unseen_run).trials[0]
    assert judged_noise.nis == pytest.approx(nis_of_replay, rel=0.02)
    assert judged_noise.low < 1.0 + 0.1
    assert np.isfinite(judged_noise.likelihood)


def test_fitted_runs_are_refused_as_validation_runs(truth_fit):
    fit, noise, _ = truth_fit
    u = random_steps(fit.file.command.limit, 30.0, fit.file.rate_hz, 1)
    run = simulate(fit.file, u, 1, name="run 1")
    with pytest.raises(UsageError, check=of_code("noise.fitted-to", run="run 1")):
        compare_noise(fit, {"truth": noise}, run)


def test_a_comparison_without_candidates_is_refused(truth_fit):
    fit, _, unseen_run = truth_fit
    with pytest.raises(UsageError, check=of_code("noise.nothing-to-compare")):
        compare_noise(fit, {}, unseen_run)
