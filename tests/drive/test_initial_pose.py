"""A replay begins at the pose that the run contains."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.drive import experiment
from baqueano.drive.budget import BudgetedBlock
from baqueano.drive.session import initial_pose_for
from baqueano.runs import Run, TruthLog
from baqueano.runs.initial_pose import initial_pose
from baqueano.signals import NANOSECONDS
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


def circling(first_s, has_nu=False, psi=3.0):
    """Return a run of 2 s with a camera that begins `first_s` after it: 1 m/s, 0.5 rad/s, across ±π."""
    t_ns = (np.arange(100) * 0.02 * NANOSECONDS).astype(np.int64) + NANOSECONDS
    arrival_ns = t_ns + int(first_s * NANOSECONDS)
    t = (arrival_ns - t_ns[0]) / NANOSECONDS
    heading = psi + 0.5 * t
    x, y = 2.0 * (np.sin(heading) - np.sin(psi)), 2.0 * (np.cos(psi) - np.cos(heading))
    eta = np.column_stack([x, y, np.angle(np.exp(1j * heading))])
    nu = np.tile([1.0, 0.0, 0.5], (100, 1)) if has_nu else np.full((100, 3), np.nan)
    return Run(
        "seen", None, t_ns, np.zeros((100, 2)), truth=TruthLog(arrival_ns, eta, nu, np.full((100, 3), np.nan))
    )


@pytest.mark.parametrize("has_nu", [True, False])
@pytest.mark.parametrize("first_s", [-0.13, 0.0])
def test_a_recording_begins_at_the_pose_and_velocity_of_its_truth(first_s, has_nu):
    assert initial_pose(circling(first_s, has_nu)) == pytest.approx([0.0, 0.0, 3.0, 1.0, 0.0, 0.5], abs=2e-3)


def test_camera_velocity_is_wrapped_across_pi():
    assert initial_pose(circling(0.0, psi=np.pi - 0.01))[3:] == pytest.approx([1.0, 0.0, 0.5], abs=2e-3)


def test_a_recording_that_accelerates_from_rest_begins_at_rest():
    run = circling(0.0, has_nu=True)
    run.truth.nu[:, 0] = np.minimum(0.08 + np.arange(100) / 10.0, 1.0)  # the first row after the rest
    run.truth.nu[:, 2] = 0.0
    assert initial_pose(run)[3:].tolist() == [0.0, 0.0, 0.0]
    run.truth.nu[:, 2] = 0.5  # it already turns
    assert initial_pose(run)[3:].tolist() == [0.08, 0.0, 0.5]


@pytest.mark.parametrize(("begins_s", "at_rest"), [(0.0, True), (-0.5, False)])
def test_a_vehicle_that_a_camera_sees_accelerate_from_rest_begins_at_rest(begins_s, at_rest):
    """The mean speed of the first 0.2 s is not the speed at the first tick."""
    t = 0.02 * np.arange(100) - begins_s
    speed = 1.0 - np.exp(-t / 0.3)
    path_m = t - 0.3 * speed + 1e-3 * np.random.default_rng(0).standard_normal(100)
    run = circling(0.0)
    eta = np.column_stack([path_m, 0.0 * t, 0.0 * t])
    nu = initial_pose(replace(run, truth=run.truth._replace(eta=eta)))[3:]
    assert (nu == 0.0).all() == at_rest
    assert at_rest or abs(nu[0] - speed[5]) < 0.05


def test_a_replay_begins_at_the_start_pose_of_the_simulation():
    small = load("small")
    run = simulate(small, np.ones((20, 3)) * [0.5, 0.0, 0.0], eta0=np.array([1.0, 2.0, 0.5]))
    assert initial_pose(run).tolist() == [1.0, 2.0, 0.5, 0.0, 0.0, 0.0]


def test_a_replay_begins_at_the_stored_start_pose():
    run = circling(0.0)
    run.metadata["start"] = "1.0 2.0 0.5"
    assert initial_pose(run).tolist() == [1.0, 2.0, 0.5]


def test_a_run_without_truth_at_its_start_begins_at_the_origin():
    run = circling(0.0)
    assert initial_pose(Run("blind", None, run.t_ns, run.applied_commands)).tolist() == [0.0, 0.0, 0.0]
    assert initial_pose(circling(0.7)).tolist() == [0.0, 0.0, 0.0]


def test_an_estimator_receives_the_start_arguments_that_it_accepts():
    class FromPose:
        def init(self, eta=None):
            return eta

    class Moving:
        def init(self, eta=None, nu=None):
            return eta, nu

    start = np.arange(6.0)
    assert initial_pose_for(FromPose(), start)[0].tolist() == [0.0, 1.0, 2.0]
    assert initial_pose_for(Moving(), start)[0].tolist() == start.tolist()
    limited_block = BudgetedBlock(FromPose())  # its init takes any arguments
    assert initial_pose_for(limited_block, start)[0].tolist() == [0.0, 1.0, 2.0]
    assert initial_pose_for(BudgetedBlock(Moving()), start)[0].tolist() == start.tolist()


@pytest.mark.parametrize("shake", [None, []])
def test_a_simulated_drive_begins_in_motion(shake):
    start = np.array([1.0, 2.0, 0.5, 0.3, 0.0, 0.2])
    run = experiment(load("small"), np.zeros((1, 3)), eta=start, shake=shake)
    np.testing.assert_allclose(run.truth.eta[0], start[:3], atol=0.01)
    np.testing.assert_allclose(run.truth.nu[0], start[3:], atol=0.05)
    np.testing.assert_allclose(run.estimate.nu[0], start[3:], atol=0.05)
