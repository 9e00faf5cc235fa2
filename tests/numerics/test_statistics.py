"""Covariances that enclose errors, and lines through the forward and the backward part of a drive."""

import numpy as np
import pytest

from baqueano.numerics.statistics import enclosing_cov, lines_by_sign


def test_errors_of_one_cause_count_once_and_independent_errors_add():
    line = np.array([3.0, -1.0])
    np.testing.assert_allclose(
        enclosing_cov(np.array([line, 0.5 * line, -line])), np.outer(line, line), atol=1e-9
    )
    corners = np.array([[1.0, 1.0], [1.0, -1.0], [0.2, 0.1]])
    np.testing.assert_allclose(enclosing_cov(corners), 2.0 * np.eye(2), rtol=1e-3, atol=1e-3)
    assert not enclosing_cov(np.zeros((0, 2))).any()
    assert not enclosing_cov(np.zeros((3, 2))).any()


@pytest.mark.parametrize("seed", range(5))
def test_the_enclosing_covariance_contains_each_error_in_any_direction(seed):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((12, 2)) @ rng.standard_normal((2, 2))
    C = enclosing_cov(x)
    assert np.all(np.einsum("ni,ij,nj->n", x, np.linalg.inv(C), x) <= 1.0 + 1e-6)
    larger = [np.linalg.det(s) for s in (x.T @ x, np.eye(2) * np.max(np.sum(x**2, axis=1)))]
    assert np.linalg.det(C) <= min(larger)


def test_lines_by_sign_separate_forward_and_backward_rows():
    x = np.array([0.1, 0.2, 0.4, -0.1, -0.3, 0.001, 0.3, 0.4])
    w = np.array([1.0, -2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    z = w[[0, 1, 2, 7]] - np.polyval(np.polyfit(x[[0, 1, 2, 7]], w[[0, 1, 2, 7]], 1), x[[0, 1, 2, 7]])
    y = np.where(x > 0.0, 2.0 * x + 0.5, 3.0 * x - 0.25)[:, None]
    y[[0, 1, 2, 7], 0] += 0.7 * z
    y[-2] = np.nan
    forward, backward = lines_by_sign(np.stack([x, w], axis=1), y, 0.02)
    np.testing.assert_allclose(forward.B[:, 0], [2.0, 0.5, 0.7])
    np.testing.assert_allclose(backward.B[:, 0], [3.0, 0.25, 0.0])
    assert (forward.share, backward.share) == (4 / 7, 2 / 7)
