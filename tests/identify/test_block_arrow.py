"""Solving the normal equations of many segments block by block equals solving the whole matrix."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.identify import FitOptions, identify
from baqueano.identify.parameters.theta import ThetaLayout, arrow_layout
from baqueano.identify.residuals import simulation as simulated
from baqueano.numerics.least_squares import RIDGE, _bounded_step, _step, minimise
from baqueano.numerics.normal_equations import BlockArrow, Evaluation, add, diagonal_matrix, row_product


def equations(seed, runs, extra_rows=0, common=4, by_run=3, by_segment=6):
    """Return (places, arrow, the same as one matrix, g) of random derivatives of every segment."""
    rng = np.random.default_rng(seed)
    layout = ThetaLayout(common, by_run, by_segment, runs)
    places, size = arrow_layout(layout, extra_rows), layout.size + extra_rows
    prior = rng.uniform(0.0, 1.0, size)
    arrow, full = diagonal_matrix(prior, places), diagonal_matrix(prior, None)
    unit = 10.0 ** rng.uniform(-4.0, 4.0, size)
    indices = [np.concatenate([index, layout.size + np.arange(extra_rows)]) for index in layout.indices]
    slopes = [rng.normal(size=(40, len(index))) * unit[index] for index in indices]
    for H in (arrow, full):
        add(H, indices, [J.T @ J for J in slopes])
    return arrow, full, rng.normal(size=size) * unit


ONE_RUN, TWO_RUNS, WHOLE_RUNS = (0,) * 12, (0,) * 6 + (1,) * 8, tuple(range(9))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    runs=st.sampled_from([ONE_RUN, TWO_RUNS, WHOLE_RUNS]),
    extra_rows=st.integers(0, 3),
    damping=st.sampled_from([RIDGE, 1e-6, 1e-2, 10.0]),
)
def test_the_block_solution_equals_the_solution_of_the_whole_matrix(seed, runs, extra_rows, damping):
    arrow, full, g = equations(seed, runs, extra_rows)
    assert isinstance(arrow, BlockArrow)
    index = np.flatnonzero(np.random.default_rng(seed).random(len(g)) < 0.8)
    scale = full.diagonal().copy()
    x, y = (_step(H, damping, scale, index, g[index]) for H in (arrow, full))
    root = np.sqrt(scale[index])  # in units of the standard error of each entry
    assert np.max(np.abs(x - y) * root) < 1e-10 * np.max(np.abs(y) * root)


@pytest.mark.parametrize("runs", [ONE_RUN, TWO_RUNS, WHOLE_RUNS])
def test_the_blocks_equal_the_parts_of_the_whole_matrix(runs):
    arrow, full, g = equations(1, runs, 2)
    np.testing.assert_allclose(arrow.dense(), full, rtol=1e-13)
    np.testing.assert_allclose(arrow.diagonal(), full.diagonal(), rtol=1e-13)
    index = np.array([0, 3, 20])
    np.testing.assert_allclose(row_product(arrow, index, g), row_product(full, index, g), rtol=1e-10)
    assert arrow.is_finite
    arrow.border[3, 1, 2] = np.nan
    assert not arrow.is_finite


def test_blocks_and_whole_matrix_give_the_same_bounded_step():
    arrow, full, g = equations(2, ONE_RUN)
    root = np.sqrt(full.diagonal())
    low, high = -0.02 / root, 0.05 / root
    movable = np.arange(len(g)) % 7 != 3
    ends = [
        _bounded_step(Evaluation(1.0, 5.0 * g, H), root**2, 1e-3, 1.1, movable, np.zeros(len(g)), low, high)
        for H in (arrow, full)
    ]
    assert np.sum((ends[1] == low) | (ends[1] == high)) > 5
    np.testing.assert_allclose(ends[0] * root, ends[1] * root, atol=1e-11)


def test_unobservable_initial_states_do_not_change_the_minimum():
    """The last entry of each segment has no effect, like an initial state behind a delay."""
    rng, layout = np.random.default_rng(3), ThetaLayout(3, 0, 5, (0,) * 12)
    slopes = [rng.normal(size=(30, 8)) * [*np.ones(7), 0.0] for _ in layout.runs]
    z = [rng.normal(size=30) for _ in layout.runs]

    def solution_of(places):
        def evaluate(theta):
            cost, g, H = 0.0, np.zeros(len(theta)), diagonal_matrix(np.zeros(len(theta)), places)
            for J, index, z_i in zip(slopes, layout.indices, z, strict=True):
                r = J @ theta[index] - z_i
                cost += float(0.5 * r @ r)
                g[index] += J.T @ r
            add(H, layout.indices, [J.T @ J for J in slopes])
            return Evaluation(cost, g, H)

        bounds = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
        return minimise(evaluate, np.ones(layout.size), *bounds, tolerance=1e-18)

    arrow, dense = solution_of(arrow_layout(layout)), solution_of(None)
    assert arrow.converged
    assert dense.converged
    np.testing.assert_allclose(arrow.theta, dense.theta, atol=1e-8)
    assert np.all(arrow.theta[layout.first_start :].reshape(-1, 5)[:, -1] == 1.0)


def test_few_segments_are_solved_with_the_whole_matrix():
    assert arrow_layout(ThetaLayout(3, 3, 6, (0,))) is None
    assert arrow_layout(ThetaLayout(3, 3, 3, (0, 0, 0))) is None
    assert arrow_layout(ThetaLayout(3, 3, 0, (0,) * 100)) is None


def test_block_solver_and_whole_matrix_give_the_same_segmented_fit(case, case_run, monkeypatch):
    """Steps, minimum and errors are compared along a whole search."""
    run, free = case_run(5, 40.0), ("model.friction.linear[0]", "model.actuator_matrix[0,0]")
    pieces = identify(run, case, free, options=FitOptions(segment_s=1.5, diagnose=False))
    monkeypatch.setattr(simulated, "arrow_layout", lambda layout: None)
    full = identify(run, case, free, options=FitOptions(segment_s=1.5, diagnose=False))
    assert pieces.evaluations == full.evaluations
    np.testing.assert_allclose((pieces.estimate - full.estimate) / full.std, 0.0, atol=1e-5)
    np.testing.assert_allclose(pieces.cov, full.cov, rtol=1e-6)
