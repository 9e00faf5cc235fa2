"""ATE, RPE and the distance across a path, against `evo` 1.38.1 and against hand calculations.

The figures of evo were computed once from the same closed-form trajectories (APE and RPE, rmse; alignment by
align_origin and align; RPE over 10 frames, all pairs).
"""

import numpy as np
import pytest

from baqueano.compare import errors
from baqueano.errors import UsageError
from baqueano.geometry import wrap
from baqueano.runs.interpolation import interpolate_poses
from tests.codes import refused


def trajectories():
    t = np.arange(0, 20, 0.1)

    def drive(k):
        psi = 0.9 * np.sin(0.4 * t) + 0.3 * t + k * 0.02 * np.sin(1.3 * t)
        x = 2 * np.sin(0.3 * t) + k * 0.05 * np.cos(0.9 * t)
        return np.column_stack([x, 1.5 * np.sin(0.6 * t + 0.2) + k * 0.04 * np.sin(0.7 * t), psi])

    truth, shifted_drive = drive(0.0), drive(1.0)
    c, s = np.cos(0.7), np.sin(0.7)
    x, y, psi = shifted_drive.T
    moved_poses = np.column_stack([x * c - y * s + 3, x * s + y * c - 1, wrap(psi + 0.7)])
    return np.round(t * 1e9).astype(np.int64), moved_poses, truth


@pytest.mark.parametrize(
    ("alignment", "position", "heading"),
    [
        ("none", 3.385636012415972, 0.7003727373090944),
        ("start", 0.06864218176798112, 0.013987322265409594),
        ("rigid", 0.04466864600024149, 0.013999775774547899),
    ],
)
def test_absolute_errors_equal_the_results_of_evo(alignment, position, heading):
    _, eta, truth = trajectories()
    error = errors.absolute_pose_errors(errors.align_trajectory(eta, truth, alignment), truth)
    assert errors.rms(error.position_m) == pytest.approx(position, rel=1e-9)
    assert errors.rms(error.heading_rad) == pytest.approx(heading, rel=1e-7)


def test_a_truth_without_heading_is_aligned_by_the_umeyama_method():
    """With a gap and a mirrored start, the singular values must give an error of 4.1 m and not 150 m."""
    _, eta, truth = trajectories()
    truth[:, 2] = np.nan
    truth[:7, 0] = np.nan
    a, b = eta[7:, :2] - eta[7:, :2].mean(axis=0), truth[7:, :2] - truth[7:, :2].mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, np.linalg.det(U @ Vt)]) @ Vt  # Umeyama 1991, without scale
    errors_m = np.hypot(*(a @ R.T - b).T)
    error = errors.absolute_pose_errors(errors.align_trajectory(eta, truth, "rigid"), truth)
    np.testing.assert_allclose(error.position_m[7:], errors_m, atol=1e-12)
    assert np.isnan(error.heading_rad).all()


def test_a_truth_without_heading_cannot_be_aligned_at_the_start():
    _, eta, truth = trajectories()
    truth[:, 2] = np.nan
    with refused("compare.no-first-heading", UsageError):
        errors.align_trajectory(eta, truth, "start")


def test_relative_errors_equal_the_results_of_evo():
    t_ns, eta, truth = trajectories()
    drift = errors.relative_pose_errors(t_ns, eta, truth, span_s=1.0)
    assert len(drift.position_m) == 190
    assert errors.rms(drift.position_m) == pytest.approx(0.039987329757444796, rel=1e-9)
    assert errors.rms(drift.heading_rad) == pytest.approx(0.017009035785507002, rel=1e-9)


def test_relative_errors_do_not_span_a_gap():
    t_ns, eta, truth = trajectories()
    keep = (t_ns < 5e9) | (t_ns > 9e9)
    drift = errors.relative_pose_errors(t_ns[keep], eta[keep], truth[keep], span_s=1.0)
    assert len(drift.position_m) == 190 - 41 - 10


def test_truth_is_interpolated_but_not_extrapolated():
    of_ns = np.array([0, 100, 200, 2_000]) * 1_000_000
    eta = np.array([[0.0, 0, 3.1], [1, 0, -3.1], [2, 0, -3.0], [9, 0, 0]])
    poses = interpolate_poses(np.array([-1, 50, 100, 1_000, 2_000, 2_001]) * 1_000_000, of_ns, eta)
    assert np.isnan(poses[[0, 3, 5]]).all()
    np.testing.assert_allclose(poses[1, 0], 0.5)
    np.testing.assert_allclose(abs(poses[1, 2]), np.pi, atol=1e-12)  # the shorter direction, across ±π
    np.testing.assert_allclose(poses[4], eta[3])


def test_distance_across_a_straight_path_is_positive_to_the_left():
    t_ns = np.arange(101) * 10_000_000
    ref = np.column_stack([t_ns * 1e-9, np.zeros(101)])
    error = errors.cross_track(t_ns, ref + np.array([-0.2, 0.03]), t_ns, ref)
    np.testing.assert_allclose(error[21:], 0.03, atol=1e-12)  # a delay along the path does not count
    np.testing.assert_allclose(errors.cross_track(t_ns, ref - [0.0, 0.05], t_ns, ref), -0.05, atol=1e-12)


def test_at_a_crossing_the_nearest_point_stays_on_the_same_branch():
    t_ns = np.arange(2000) * 10_000_000
    th = 2 * np.pi * np.arange(2000) / 2000
    eight = np.column_stack([np.sin(th), np.sin(th) * np.cos(th)])
    path_with_jump = eight + np.column_stack([np.zeros(2000), np.where(np.abs(eight[:, 0]) < 0.02, 0.3, 0.0)])
    error = np.abs(errors.cross_track(t_ns, path_with_jump, t_ns, eight, window_s=0.5))
    assert error.max() > 0.1


def test_a_reference_at_rest_is_a_single_point():
    t_ns = np.arange(50) * 10_000_000
    error = errors.cross_track(t_ns, np.tile([0.3, 0.4], (50, 1)), t_ns, np.zeros((50, 2)))
    np.testing.assert_allclose(error, 0.5)


def test_errors_are_invariant_under_rotation_of_the_world():
    t_ns, eta, truth = trajectories()
    c, s = np.cos(2.0), np.sin(2.0)

    def turn(p):
        return np.column_stack(
            [p[:, :2] @ np.array([[c, s], [-s, c]]) + [5, -7], wrap(p[:, 2] + 2.0 + 2 * np.pi)]
        )

    a = errors.relative_pose_errors(t_ns, eta, truth)
    b = errors.relative_pose_errors(t_ns, turn(eta), turn(truth))
    np.testing.assert_allclose(a.position_m, b.position_m, atol=1e-12)
    np.testing.assert_allclose(a.heading_rad, b.heading_rad, atol=1e-12)
    path = errors.cross_track(t_ns, eta[:, :2], t_ns, truth[:, :2])
    np.testing.assert_allclose(
        path, errors.cross_track(t_ns, turn(eta)[:, :2], t_ns, turn(truth)[:, :2]), atol=1e-10
    )


def test_an_unknown_alignment_is_refused_with_the_valid_names():
    with refused("compare.alignment", UsageError, value="scaled", valid="none, start, rigid"):
        errors.align_trajectory(np.zeros((2, 3)), np.zeros((2, 3)), "scaled")


def test_a_path_needs_two_points():
    with refused("compare.reference-short", UsageError, points=1):
        errors.cross_track(np.zeros(1), np.zeros((1, 2)), np.zeros(1), np.zeros((1, 2)))
