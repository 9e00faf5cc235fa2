"""The smoother equals the least-squares solution over the whole run, and is better than the filter."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf, Ekf, Unscented
from baqueano.estimators.kalman import Gaussian, boxplus, correct, predict
from baqueano.estimators.smoother import (
    ForwardPass,
    RowErrors,
    can_be_smoothed,
    run_forward,
    smooth,
    smooth_backward,
)
from baqueano.geometry import compose, wrap
from baqueano.sensors import Imu, Pose
from baqueano.signals import Estimate, Motion, Slot, Tick, sensor_slots
from baqueano.symbolic import compile_block
from baqueano.vehicle_file import load
from tests.light_robot import SMALL

N = 6
A = np.eye(N) + 0.1 * np.eye(N, k=3)
A[3:, 3:] *= 0.9
H = np.random.default_rng(60).normal(size=(2, N))
R = 0.01 * np.diag([1.0, 2.0, 1e-4, 3.0, 2.0, 1e-4])
Q, P0 = np.array([[0.04, 0.01], [0.01, 0.09]]), np.diag([0.5, 0.4, 1e-3, 0.3, 0.2, 1e-3])
Sensors = sensor_slots(("both",))


class Belief(NamedTuple):
    t_ns: int
    mean: np.ndarray
    cov: np.ndarray


@dataclass(frozen=True)
class Linear:
    """x⁺ = A x + u, z = H x: only the core. The third entry is a heading that stays away from ±π."""

    start: np.ndarray
    cov: np.ndarray

    def init(self):
        return Belief(-1, self.start, self.cov)

    def step(self, belief, tick):
        x = predict(Gaussian(belief.mean, belief.cov), lambda x: A @ x + tick.u, R)
        slot = tick.sensors.both
        correction = correct(x.cov, slot.z - H @ x.mean, H, Q)
        mean = np.where(slot.is_new > 0.0, boxplus(x.mean, correction.mean_change), x.mean)
        cov = np.where(slot.is_new > 0.0, correction.cov, x.cov)
        S = H @ x.cov @ H.T + Q
        return Belief(tick.t_ns, mean, cov), Estimate(
            tick.t_ns, mean[:3], mean[3:6], cov, slot.z - H @ x.mean, S
        )


def smoothed(block, belief, ticks, backend="python"):
    """Return the smoothed mean (N, n) and covariance (N, n, n) of each row."""
    return smooth_backward(run_forward(block, belief, ticks, backend))


def drive(n, seed, turn_rad=0.0):
    """Return commands and measurements with gaps of a vehicle with the heading `turn_rad`."""
    rng, x, u, z = np.random.default_rng(seed), np.array([0, 0, turn_rad, 0, 0, 0.0]), [], []
    for k in range(n):
        u.append(0.1 * np.array([np.sin(0.1 * k), 1.0, 0.02 * np.cos(0.1 * k), 0, 0, 0]))
        x = A @ x + u[-1] + np.sqrt(np.diag(R)) * rng.standard_normal(N)
        z.append(H @ x + np.linalg.cholesky(Q) @ rng.standard_normal(2))
    is_new = (rng.uniform(size=n) < 0.6).astype(float)
    slots = Sensors(Slot(is_new, np.array(z), np.zeros(n)))
    return Tick(10_000_000 * np.arange(1, n + 1), np.array(u), slots)


def batch(ticks, start, cov):
    """Return mean and covariance of x_1 … x_n by the normal equations of all residuals together."""
    n = len(ticks.t_ns)
    rows, right = [np.eye(N, N * (n + 1))], [start]
    weights = [np.linalg.inv(cov)]
    for k in range(n):
        row = np.zeros((N, N * (n + 1)))
        row[:, N * k : N * (k + 1)], row[:, N * (k + 1) : N * (k + 2)] = -A, np.eye(N)
        rows, right, weights = [*rows, row], [*right, ticks.u[k]], [*weights, np.linalg.inv(R)]
        if ticks.sensors.both.is_new[k]:
            row = np.zeros((2, N * (n + 1)))
            row[:, N * (k + 1) : N * (k + 2)] = H
            rows, right = [*rows, row], [*right, ticks.sensors.both.z[k]]
            weights = [*weights, np.linalg.inv(Q)]
    normal = sum(a.T @ w @ a for a, w in zip(rows, weights, strict=True))
    gradient = sum(a.T @ w @ b for a, w, b in zip(rows, weights, right, strict=True))
    cov = np.linalg.inv(normal)
    parts = [slice(N * k, N * (k + 1)) for k in range(1, n + 1)]
    x = np.linalg.solve(normal, gradient)
    return np.array([x[i] for i in parts]), np.array([cov[i, i] for i in parts])


def test_the_smoother_equals_the_least_squares_solution_over_the_whole_run():
    ticks, start = drive(40, 61), np.zeros(N)
    block = Linear(start, P0)
    mean, cov = smoothed(block, block.init(), ticks)
    x, P = batch(ticks, start, P0)
    np.testing.assert_allclose(mean, x, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(cov, P, rtol=0.0, atol=1e-9)
    assert np.array_equal(cov, np.swapaxes(cov, 1, 2))


def pass_with_error(sources, E, n, rows=6):
    """Return the filter's pass over a linear vehicle whose truth is 0: one source of error acts, with its deviation."""
    rng = np.random.default_rng(65)
    G, H, q = np.eye(n) + 0.2 * rng.normal(size=(n, n)), rng.normal(size=(2, n)), np.array([0.3, 0.7])
    P, e, columns = np.eye(n), sources[0], []
    for k in range(rows):
        predicted_cov = G @ P @ G.T + 0.02 * np.eye(n)
        c = correct(
            predicted_cov, np.zeros(2), H, q, E, lambda c, e, s, k=k: float(c == 0 or k % 3 == 0) * 0.8
        )
        e, y = G @ e + np.sqrt(0.02) * sources[1][k], []
        for j, w in enumerate(c.weight):
            noise = np.sqrt(q[j] + c.s[j] * (1.0 / w - 1.0)) if w else 0.0
            y.append(H[j] @ e + noise * sources[2][k, j])
            e = e - E[j] * c.gain[j] * y[j]
        P = c.cov
        columns.append((-e, P, (G, c.H, c.gain, E, np.array(y), c.weight / c.s, np.eye(6, n))))
    mean, cov, errors = zip(*columns, strict=True)
    errors = RowErrors(*(np.array(column) for column in zip(*errors, strict=True)))
    return ForwardPass(np.array(mean), np.array(cov), None, errors)


def test_the_covariance_is_right_for_gains_that_correct_some_states_only():
    """The smoothed errors of all sources, each alone, add up to the covariance that the smoother states."""
    n, rows, mask = 4, 6, np.array([[1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 0.0]])
    unit = 1e-3 * np.eye(n + rows * (n + 2))  # so small that no heading is wrapped
    total, cov, filter_estimates = 0.0, None, None
    for source in unit:
        start, walk, noise = np.split(source, [n, n + rows * n])
        forward = pass_with_error((start, walk.reshape(rows, n), noise.reshape(rows, 2)), mask, n)
        mean, cov = smooth_backward(forward)
        total, filter_estimates = total + 1e6 * mean[:, :, None] * mean[:, None, :], forward.cov
    np.testing.assert_allclose(cov, total, rtol=0.0, atol=1e-12)
    gain = np.diagonal(filter_estimates - cov, axis1=1, axis2=2)
    assert np.all(gain >= 0.0)
    assert np.max(gain[:, 1]) == 0.0  # no measurement corrects this state
    assert np.min(gain[:-1, [0, 2, 3]]) > 1e-3


def test_states_with_zero_variance_retain_zero_variance():
    """Two entries of the start are known, and one of them does not have process noise, so an inverse does not exist."""
    certain = P0.copy()
    certain[0, 0] = certain[3, 3] = 0.0
    ticks = drive(30, 62)
    block = Linear(np.zeros(N), certain)
    mean, cov = smoothed(block, block.init(), ticks)
    x, P = batch(ticks, np.zeros(N), certain + 1e-12 * np.diag([1.0, 0, 0, 1.0, 0, 0]))
    np.testing.assert_allclose(mean, x, atol=1e-6)
    np.testing.assert_allclose(cov, P, atol=1e-6)


BOTH = sensor_slots(("imu", "pose"))
SENSORS = BOTH(
    Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.01),
    Pose(noise_std=np.array([1e-3, 1e-3, 2e-3])),
)
NOISE = np.diag([2e-3, 1e-3, 2e-2, 0.02, 0.01, 0.1]) ** 2


def circle(n, seed, start):
    """Return truth (n, 9) of the filter model, and its ticks: an IMU, and a camera only at the end."""
    rng = np.random.default_rng(seed)
    world = compile_block(Ekf(SMALL, SENSORS, NOISE))
    belief, truth, z = world.init(eta=start), [], []
    u = np.tile([0.4, 0.0, 0.25], (n, 1))
    for k in range(n):
        silence = BOTH(Slot(0.0, np.zeros(3)), Slot(0.0, np.zeros(3)))
        belief, _ = world.step(belief, Tick(10_000_000 * (k + 1), u[k], silence))
        kick = np.concatenate([np.zeros(3), np.sqrt(np.diag(NOISE)) * rng.standard_normal(6)])
        belief = belief._replace(mean=belief.mean + kick)
        truth.append(belief.mean)
        motion = Motion(belief.mean[:3], belief.mean[3:6], belief.mean[6:], np.zeros(2))
        z.append([s.h(motion) + np.sqrt(np.diag(s.cov)) * rng.standard_normal(3) for s in SENSORS])
    z = np.array(z)
    is_new = np.zeros(n)
    is_new[-1] = 1.0
    slots = BOTH(Slot(np.ones(n), z[:, 0], np.zeros(n)), Slot(is_new, z[:, 1], np.zeros(n)))
    return np.array(truth), Tick(10_000_000 * np.arange(1, n + 1), u, slots)


@pytest.mark.parametrize("kind", [Ekf, Unscented])
def test_a_camera_reading_at_the_end_corrects_the_earlier_path_across_pi(kind):
    start, n = np.array([1.0, 2.0, 2.5]), 300
    truth, ticks = circle(n, 63, start)
    block = kind(SMALL, SENSORS, NOISE, use=("imu", "pose"))
    mean, cov = smoothed(block, block.init(eta=start), ticks, "auto")
    filter_estimates, _ = smoothed(block, block.init(eta=start), blind(ticks), "auto")

    def rms(x):
        return np.sqrt(np.mean(wrap(x[:, 2] - truth[:, 2]) ** 2)), np.sqrt(
            np.mean((x[:, :2] - truth[:, :2]) ** 2)
        )

    assert np.all(np.abs(mean[:, 2]) <= np.pi)
    assert np.min(mean[:, 2]) < -3.0
    assert np.max(np.abs(wrap(np.diff(mean[:, 2])))) < 0.1
    assert rms(mean)[1] < 0.7 * rms(filter_estimates)[1]
    e = mean[:, :6] - truth[:, :6]
    e[:, 2] = wrap(e[:, 2])
    nees = np.einsum("ki,ki->k", e, np.linalg.solve(cov[:, :6, :6], e[:, :, None])[:, :, 0])
    assert 0.3 < np.mean(nees) / 6.0 < 2.0


def test_in_the_default_filter_a_camera_corrects_the_earlier_path_and_a_gyro_no_earlier_speed():
    start = np.array([1.0, 2.0, 2.5])
    _, ticks = circle(30, 66, start)
    for use in (("imu", "pose"), ("imu",)):
        block = AugmentedEkf(SMALL, SENSORS, use=use)
        forward = run_forward(block, block.init(eta=start), ticks, "python")
        mean, cov = smooth_backward(forward)
        ratio = np.diagonal(cov - forward.cov, axis1=1, axis2=2) / np.diagonal(forward.cov, axis1=1, axis2=2)
        assert np.max(ratio) < 1e-9
        if "pose" in use:
            assert np.max(ratio[-5:-1, :3]) < -0.01
        else:
            assert np.array_equal(mean[:, [0, 1, 3]], forward.mean[:, [0, 1, 3]])
            assert not np.array_equal(mean[:, 5], forward.mean[:, 5])


def blind(ticks):
    pose = ticks.sensors.pose
    return ticks._replace(sensors=ticks.sensors._replace(pose=pose._replace(is_new=0.0 * pose.is_new)))


def test_shifting_and_rotating_the_map_moves_the_smoothed_estimate_equally():
    _, ticks = circle(60, 64, np.zeros(3))
    block, start = Ekf(SMALL, SENSORS, NOISE), np.array([3.0, -2.0, 2.9])
    original = smooth(block, block.init(), ticks, "python").eta
    moved_estimate = smooth(block, block.init(eta=start), ticks, "python").eta
    moved_poses = np.array([compose(start, eta) for eta in original])
    np.testing.assert_allclose(moved_estimate[:, :2], moved_poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap(moved_estimate[:, 2] - moved_poses[:, 2]), 0.0, atol=1e-9)


def test_only_a_kalman_filter_can_be_smoothed():
    file = load("small")
    silent_tick = Tick(1, np.zeros(3), sensor_slots(("imu",))(Slot(0.0, np.zeros(3))))
    smoothable = {}
    for kind in ("augmented_ekf", "ekf", "unscented", "dead_reckoning", "complementary"):
        block = file.estimator(kind=kind)
        smoothable[kind] = can_be_smoothed(block, block.init(), silent_tick)
    assert [kind for kind, can in smoothable.items() if can] == ["augmented_ekf", "ekf", "unscented"]
