"""The Kalman core compared with explicit matrices and with filterpy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from baqueano.estimators.kalman import Gaussian, boxplus, correct, independent, predict


def _case(seed: int, n: int = 6, m: int = 3):
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    return A @ A.T, rng.normal(size=m), rng.normal(size=(m, n)), B @ B.T + 0.1 * np.eye(m)


@given(st.integers(0, 10_000))
def test_sequential_corrections_equal_one_joint_correction(seed):
    P, y, H, Q = _case(seed)
    S = H @ P @ H.T + Q
    K = np.linalg.solve(S, H @ P).T
    correction = correct(P, y, H, Q)
    assert correction.mean_change == pytest.approx(K @ y, rel=1e-8, abs=1e-10)
    assert correction.cov == pytest.approx(P - K @ H @ P, rel=1e-7, abs=1e-9)
    assert np.sum(correction.e**2) == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)
    assert np.sum(np.log(correction.s)) == pytest.approx(np.linalg.slogdet(S)[1], rel=1e-9, abs=1e-9)


@given(st.integers(0, 10_000), st.lists(st.booleans(), min_size=3, max_size=3))
def test_es4_a_channel_that_is_nan_has_the_effect_of_a_sensor_without_this_channel(seed, is_measured):
    P, y, H, Q = _case(seed)
    mask = np.array(is_measured)
    partial = correct(P, np.where(mask, y, np.nan), H, Q, mask=np.where(mask, 1.0, 0.0))
    smaller = correct(P, y[mask], H[mask], Q[np.ix_(mask, mask)])
    assert partial.mean_change == pytest.approx(smaller.mean_change, rel=1e-9, abs=1e-12)
    assert partial.cov == pytest.approx(smaller.cov, rel=1e-9, abs=1e-12)
    assert partial.e[mask] == pytest.approx(smaller.e, rel=1e-9)
    assert not partial.e[~mask].any()


def test_prediction_and_correction_equal_filterpy():
    filterpy = pytest.importorskip("filterpy.kalman")
    P, y, H, Q = _case(1)
    F, R = np.random.default_rng(2).normal(size=(6, 6)), 0.1 * np.eye(6)
    reference = filterpy.KalmanFilter(6, 3)
    reference.x = np.ones(6)
    reference.P = P.copy()
    reference.F = F
    reference.Q = R
    reference.H = H
    reference.R = Q
    reference.predict()
    prediction = predict(Gaussian(np.ones(6), P), lambda x: F @ x, R)
    assert prediction.mean == pytest.approx(reference.x)
    assert prediction.cov == pytest.approx(reference.P)
    reference.update(H @ reference.x + y)
    correction = correct(prediction.cov, y, H, Q)
    assert prediction.mean + correction.mean_change == pytest.approx(reference.x)
    assert correction.cov == pytest.approx(reference.P)
    log_likelihood = -0.5 * np.sum(correction.e**2 + np.log(2.0 * np.pi * correction.s))
    assert log_likelihood == pytest.approx(reference.log_likelihood)


def test_es3_covariance_stays_positive_where_a_measurement_is_almost_exact():
    P = np.diag([1e6, 1.0, 1e-6])
    H = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + 1e-9]])
    for _ in range(100):
        P = correct(P, np.zeros(2), H, np.array([1e-12, 1e-12])).cov
        assert np.linalg.eigvalsh(P)[0] > -1e-18


def test_a_considered_state_is_not_corrected_but_its_uncertainty_counts():
    """Schmidt filter: a scale of unknown size affects the measurement. The covariance equals that of many random
    draws."""
    P, H, Q = np.diag([1.0, 0.25]), np.array([[1.0, 2.0]]), np.array([0.5])
    estimate_mask = np.array([1.0, 0.0])
    correction = correct(P, np.array([1.0]), H, Q, estimate_mask)
    assert correction.mean_change[1] == 0.0
    assert correction.cov[1, 1] == 0.25
    rng = np.random.default_rng(0)
    x = rng.normal(size=(200_000, 2)) * np.sqrt(np.diag(P))
    z = x @ H[0] + np.sqrt(Q[0]) * rng.normal(size=len(x))
    gain = correct(P, np.array([1.0]), H, Q, estimate_mask).mean_change
    errors = x - z[:, None] * gain
    assert correction.cov == pytest.approx(np.cov(errors.T), abs=0.01)


def test_a_smaller_weight_has_the_effect_of_more_noise():
    P, y, H, _ = _case(3)
    s = H[0] @ P @ H[0] + 0.3
    weighted_update = correct(P, y[:1], H[:1], np.array([0.3]), weight=lambda c, e, s: 0.25)
    noisier = correct(P, y[:1], H[:1], np.array([4.0 * s - H[0] @ P @ H[0]]))
    assert weighted_update.mean_change == pytest.approx(noisier.mean_change)
    assert weighted_update.cov == pytest.approx(noisier.cov)
    without_weight = correct(P, y, H, np.full(3, 0.3), weight=lambda c, e, s: 0.0)
    assert without_weight.mean_change == pytest.approx(np.zeros(6))
    assert without_weight.cov == pytest.approx(P)


def test_decorrelation_preserves_the_information_of_measurements():
    _, y, H, Q = _case(4)
    v, rows, q = independent(y, H, Q)
    assert (rows.T / q) @ v == pytest.approx(H.T @ np.linalg.solve(Q, y))
    assert (rows.T / q) @ rows == pytest.approx(H.T @ np.linalg.solve(Q, H))


@pytest.mark.parametrize("Q", [np.zeros(0), np.zeros((0, 0))], ids=["variances", "matrix"])
def test_a_measurement_without_channels_changes_nothing(Q):
    P = _case(3)[0]
    correction = correct(P, np.zeros(0), np.zeros((0, 6)), Q)
    assert not correction.mean_change.any()
    assert np.array_equal(correction.cov, P)
    assert (correction.gain.shape, correction.H.shape, correction.e.shape) == ((0, 6), (0, 6), (0,))


def test_boxplus_wraps_only_the_heading():
    x = boxplus(np.array([3.0, -4.0, 3.0, 5.0]), np.array([1.0, -1.0, 1.0, 1.0]))
    assert x == pytest.approx([4.0, -5.0, 4.0 - 2.0 * np.pi, 6.0])
