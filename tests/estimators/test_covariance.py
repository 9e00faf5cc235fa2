"""The paper's printed Q and R are the test case: they are refused, and the nearest valid matrix is
offered."""

import numpy as np
import pytest

from baqueano.estimators.covariance import covariance, mirror_upper, nearest_covariance
from tests.codes import refused
from tests.papers_noise import PAPER_Q, PAPER_R


def test_es1_the_q_of_the_paper_is_refused_with_its_impossible_entry():
    with refused("cov.eigenvalue", ValueError, i=0, j=1, entry=-0.006, second=0.0):
        covariance(PAPER_Q, 3, "measurement_noise_cov")


def test_the_r_of_the_paper_is_refused_as_not_symmetric():
    with refused("cov.not-symmetric", ValueError, i=0, j=5, first=-0.05, second=-0.058):
        covariance(PAPER_R, 6, "process_noise_cov")


@pytest.mark.parametrize("matrix", [PAPER_Q, PAPER_R])
def test_es1_the_proposed_covariance_is_valid_and_close_to_the_given_matrix(matrix):
    valid = nearest_covariance(np.array(matrix))
    assert np.array_equal(valid, valid.T)
    assert np.linalg.eigvalsh(valid)[0] > -1e-12
    assert np.max(np.abs(valid - np.array(matrix))) < 0.02
    covariance(valid, len(matrix), "offered")


def test_es1_a_negative_variance_is_named():
    with refused("cov.eigenvalue", ValueError, smallest=-1.0, i=1, j=1, entry=-1.0, first=-1.0, second=-1.0):
        covariance(np.diag([1.0, -1.0]), 2, "Q")


def test_mirroring_copies_the_upper_triangle():
    assert np.array_equal(mirror_upper(np.array([[1.0, 2.0], [9.0, 3.0]])), [[1.0, 2.0], [2.0, 3.0]])
