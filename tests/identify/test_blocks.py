"""The information of blocks of a run: the jackknife, and the conditions for its use."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.identify import FitOptions, fit as module, identify
from baqueano.identify.covariance.clusters import BLOCK_S, jackknife, with_larger_errors
from baqueano.identify.covariance.information import (
    Information,
    UncertainParameters,
    information,
    joint_information,
    parameter_cov,
)
from baqueano.identify.result.assemble import assemble_fit
from baqueano.numerics.block_sums import MIN_REMAINDER
from baqueano.numerics.statistics import HUBER
from baqueano.runs.run import Run, TruthLog
from tests.identify.true_drives import cars_on_floor


@pytest.fixture
def end(case, case_run):
    """Return a finished search over two runs with biases, and the information at its end."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "fit_by_simulation", lambda task: task)
        fit = identify([case_run(seed, 20.0) for seed in range(2)], case)
    return fit, information(fit.task.problem, fit.search.solution.theta)


def with_camera_poses(run: Run, seed: int) -> Run:
    """Return the run with every fourth pose, accurate to 2 mm and 5 mrad."""
    assert run.truth is not None
    rows = slice(3, None, 4)
    eta = run.truth.eta[rows]
    eta = eta + np.random.default_rng(seed).normal(size=eta.shape) * [2e-3, 2e-3, 5e-3]
    none = np.full_like(eta, np.nan)
    return replace(run, truth=TruthLog(run.truth.t_ns[rows], eta, none, none))


def test_excluding_a_block_shifts_the_fit_by_one_gauss_newton_step(end):
    fit, info = end
    problem = fit.task.problem
    theta = fit.search.solution.theta
    identifiable = np.flatnonzero(fit.identifiability.mask)
    moves = []
    for (r, d, index), record in zip(problem.sensitivities(theta), problem.records, strict=True):
        block = (np.cumsum(record.dt_s) // BLOCK_S).astype(int)
        edges = np.flatnonzero(np.diff(block, prepend=-1, append=-1))
        for first, last in pairwise(edges):
            x, residual = d[first:last].reshape(-1, len(index)), r[first:last].ravel()
            g, H = np.zeros(problem.size), (1.0 + MIN_REMAINDER) * info.bread
            g[index] = np.clip(residual, -HUBER, HUBER) @ x
            x = x[np.abs(residual) < HUBER]
            H[np.ix_(index, index)] -= x.T @ x
            moves.append(np.linalg.solve(H[np.ix_(identifiable, identifiable)], g[identifiable]))
    errors = np.array(moves) - np.mean(moves, axis=0)
    expected = (len(moves) - 1) / len(moves) * errors.T @ errors
    cov = jackknife(info, problem.layout, identifiable)
    assert cov is not None
    assert jackknife(info, problem.layout, identifiable, by_segment=True) is None  # the runs are whole
    root = np.sqrt(np.diagonal(expected))
    np.testing.assert_allclose(cov / np.outer(root, root), expected / np.outer(root, root), atol=1e-6)


def test_only_larger_block_errors_widen_the_errors_of_shared_parameters():
    problem = SimpleNamespace(records=[SimpleNamespace(dt_s=np.full(3000, 0.01), lead=0)])
    cov = np.array([[4.0, 1.0, 0.5], [1.0, 1.0, 0.2], [0.5, 0.2, 1.0]])
    choices = [with_larger_errors(problem, cov, block_cov, 2) for block_cov in (None, 1.3 * cov, 0.2 * cov)]  # pyright: ignore[reportArgumentType]
    assert all(np.array_equal(choice, cov) for choice in choices)
    larger = with_larger_errors(problem, cov, np.diag([36.0, 0.1, 1e9]), 2)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(np.diagonal(larger), [36.0, 1.0, 1.0])  # the third belongs to one run
    np.testing.assert_allclose(larger[0, 1] / np.sqrt(larger[0, 0] * larger[1, 1]), 0.5)


@pytest.fixture(scope="module")
def drives():
    """Drives of 30 s with cars of the independent truth, over a floor that disturbs them."""
    return cars_on_floor(range(12), 30.0)


@pytest.mark.long
def test_block_errors_have_coverage_with_floor_disturbance_and_outliers(drives):
    rng, counts, before = np.random.default_rng(0), [], []
    for drive in drives:
        channels = {}
        for name, channel in drive.run.sensors.items():
            std = np.sqrt(np.diagonal(getattr(drive.file.sensors, name).cov))
            hit = (rng.random(channel.z.shape) < 0.1) * rng.choice([-20.0, 20.0], channel.z.shape)
            channels[name] = channel._replace(z=channel.z + hit * std)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(module, "fit_by_simulation", lambda task: task)
            search = identify(replace(drive.run, sensors=channels), drive.file)
        info = information(search.task.problem, search.search.solution.theta)
        identifiable = np.flatnonzero(search.identifiability.mask)
        white = np.sqrt(np.diagonal(parameter_cov(info, identifiable)))[
            identifiable < search.task.problem.layout.shared_count
        ]
        fit = assemble_fit(search)
        finite = np.isfinite(fit.estimate)
        truth = np.array([drive.true.get(name, np.nan) for name in fit.names])[finite]
        inner = np.isfinite(truth) & (fit.bound[finite] == 0)
        errors = np.abs(fit.estimate[finite] - truth)[inner]
        counts += (errors < 1.96 * fit.std[finite][inner]).tolist()
        before += (errors < 1.96 * white[inner]).tolist()
    assert 0.88 < np.mean(counts) <= 1.0
    assert np.mean(before) < np.mean(counts) - 0.04


def test_a_score_matrix_with_a_negative_eigenvalue_gives_a_valid_covariance():
    rng = np.random.default_rng(3)
    rotation = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    meat = rotation @ np.diag([-1e-5, 1e-4, 1.0, 20.0, 2e5]) @ rotation.T
    info = Information(np.eye(5), 0.5 * (meat + meat.T), np.ones((1, 5)), False, np.zeros(1), 1000)
    cov = parameter_cov(info, np.arange(5))
    assert np.isfinite(cov).all()
    assert np.min(np.linalg.eigvalsh(cov)) > -1e-9 * np.max(np.diagonal(cov))
    np.testing.assert_allclose(np.diagonal(cov), np.diagonal(meat) * 1000 / 995, rtol=1e-3)


def test_information_without_a_sound_row_causes_no_warning():
    """If all rows of an entry are outliers, A is the difference of equal sums: rounding can make it negative."""
    info = Information(np.diag([-1e-12, 1.0]), np.eye(2), np.ones((1, 2)), False, np.zeros(1), 1000)
    with np.errstate(invalid="raise"):
        assert np.isfinite(parameter_cov(info, np.arange(2))).all()


def coverage(drives, segment_s, with_camera):
    """Return the share of the 95 % intervals that contain the truth."""
    z = []
    for drive in drives:
        run = with_camera_poses(drive.run, drive.seed) if with_camera else drive.run
        use = ("imu", "truth") if with_camera else None
        options = FitOptions(segment_s=segment_s, diagnose=False)
        z += drive.normalised_errors(identify(run, drive.file, use=use, options=options)).tolist()
    return np.mean(np.abs(z) < 1.96)


def test_error_bars_of_a_segmented_run_on_a_disturbing_floor_have_coverage(drives):
    """76 of 80 intervals contain the truth; without blocks of segments, 66 do."""
    assert coverage(drives, 3.0, with_camera=False) > 0.85


@pytest.mark.long
def test_error_bars_of_segments_with_a_camera_have_coverage(drives):
    """Over 36 seeds 196 of 220 intervals contain the truth. Over the first 12, 58 of 74 do; without blocks, 36 do.

    The six intervals of a fit count as three independent ones. If each has 92 % coverage, the share over 24 fits is
    below 0.82 once in 1,000 times.
    """
    assert coverage([*drives, *cars_on_floor(range(12, 24), 30.0)], 5.0, with_camera=True) > 0.82


def test_the_jackknife_excludes_segments_in_which_the_model_diverged(case, case_run, monkeypatch):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "fit_by_simulation", lambda task: task)
        fit = identify(case_run(0, 24.0), case, options=FitOptions(segment_s=4.0))
    problem = fit.task.problem
    theta = fit.search.solution.theta
    identifiable = np.flatnonzero(fit.identifiability.mask)
    ways = {"by_segment": False}, {"by_segment": True}
    assert all(jackknife(fit.info, problem.layout, identifiable, **s) is not None for s in ways)
    slopes = [(r, d.copy(), index) for r, d, index in problem.sensitivities(theta)]
    slopes[2][1][-1] = np.inf
    monkeypatch.setattr(problem, "sensitivities", lambda theta: slopes)
    info = joint_information(problem, theta, UncertainParameters((), np.zeros((0, 0))))
    assert np.isfinite(info.bread).all()
    assert all(jackknife(info, problem.layout, identifiable, **s) is None for s in ways)
