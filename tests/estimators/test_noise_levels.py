"""The filter adapts the noise of its sensors and of the motion to the run, but not to a broken sensor."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from baqueano.compare.filter_consistency import filter_consistency
from baqueano.drive import replay
from baqueano.estimators.augmented.motion import predict_row
from baqueano.estimators.augmented.noise_levels import (
    MAX_LEVEL,
    InnovationSquares,
    NoiseLevels,
    file_innovation_cov,
    next_levels,
)
from baqueano.estimators.augmented.state import layout
from baqueano.estimators.pauses import FilterRow
from baqueano.monitor import expected_innovation_cov
from baqueano.signals import Slot, Tick
from baqueano.simulate import simulate
from baqueano.symbolic import scan
from baqueano.vehicle_file import load

SMALL = load("small")
U = np.outer(np.ones(6000), [0.3, 0.0, 0.0]) + np.outer(
    np.sign(np.sin(0.02 * np.arange(6000))), [0.0, 0.0, 0.3]
)
ACCEL, GYRO = SMALL.sensors.imu.accel_noise_std, SMALL.sensors.imu.gyro_noise_std


@cache
def noisy_run(factor: float, seed: int = 0):
    """Return a run whose IMU is noisier than its file by this factor, and whose floor is that of the file."""
    noisy = SMALL.with_values(
        {
            "sensors.imu.accel_noise_std": (factor * ACCEL).tolist(),
            "sensors.imu.gyro_noise_std": factor * GYRO,
        }
    )
    return simulate(noisy, U, seed)


@cache
def filtered(factor: float, noise_gain: float, damage: str = "", speed_from: tuple[str, ...] = ()):
    """Return the estimates over a shaken run, and the belief at the end."""
    run, n = noisy_run(factor), 3300 if damage.startswith("shaken") else 6000
    z = run.sensors["imu"].z[:n].copy()
    if damage == "outliers":
        z[::10] += 100.0 * ACCEL[0]
    if damage.startswith("shaken"):
        z[3000:3300] += np.random.default_rng(int(damage.split()[1])).standard_normal((300, 3)) * [
            3.0,
            3.0,
            1.0,
        ]
    return kernel_of(noise_gain, speed_from).run(ticks(run.t_ns[:n], run.applied_commands[:n], z))


def levels_of(belief):
    return NoiseLevels.from_row(belief.memory.noise_levels)


@cache
def kernel_of(noise_gain: float, speed_from: tuple[str, ...]):
    ekf = replace(SMALL.estimator(), noise_gain=noise_gain, speed_from=speed_from)
    return scan(ekf.step, ekf.init(), ticks(10_000_000, np.zeros(3), np.zeros(3), 1.0))


def ticks(t_ns: Any, u: np.ndarray, z: np.ndarray, is_new: Any = None) -> Tick:
    """Return ticks (N,) with the readings z (N, 3) of the IMU, or one tick."""
    is_new = np.ones(len(z)) if is_new is None else is_new
    return Tick(t_ns, u, SMALL.sensors._replace(imu=Slot(is_new, z, 0.0 * is_new)))


def nis(estimate, S) -> np.ndarray:
    """Return the mean of y²/S of each channel over the second half."""
    return np.mean((estimate.innovation**2 / np.diagonal(S, axis1=1, axis2=2))[3000:], axis=0)


def mean_variance(S) -> np.ndarray:
    """Return the mean diagonal of S over the second half."""
    return np.mean(np.diagonal(S, axis1=1, axis2=2)[3000:], axis=0)


def test_a_noisier_imu_has_a_nis_of_one():
    _, file_estimates = filtered(2.0, 0.0)
    belief, estimates = filtered(2.0, 0.01)
    assert np.all(nis(file_estimates, file_estimates.innovation_cov)[:2] > 1.35)
    np.testing.assert_allclose(nis(estimates, estimates.innovation_cov), 1.0, atol=0.15)
    assert np.all(levels_of(belief).sensors[:2] > 2.0)


def test_a_calmer_run_has_a_nis_nearer_to_one():
    """The garage's file is cautious; what the disturbance adds to an accelerometer is not adapted."""
    _, file_estimates = filtered(1.0, 0.0)
    belief, estimates = filtered(1.0, 0.01)
    nis_before, now = (
        nis(file_estimates, file_estimates.innovation_cov),
        nis(estimates, estimates.innovation_cov),
    )
    assert np.all(nis_before < 0.5)
    assert np.all((now > nis_before + 0.15) & (now < 1.15))
    assert np.all(levels_of(belief).sensors[:2] < 0.5)
    assert (
        0.5 < levels_of(belief).sensors[2] < 1.15
    )  # its noise is that of the file; only the motion is calmer
    assert levels_of(belief).motion[1] < 0.2


def test_monitors_use_the_innovation_covariance_of_the_file():
    _, file_estimates = filtered(2.0, 0.0)
    _, estimates = filtered(2.0, 0.01)
    ratio = mean_variance(expected_innovation_cov(estimates)) / mean_variance(file_estimates.innovation_cov)
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


def test_outliers_do_not_change_the_noise_levels():
    without_outliers, _ = filtered(1.0, 0.01)
    belief, _ = filtered(1.0, 0.01, "outliers")
    np.testing.assert_allclose(levels_of(belief).sensors, levels_of(without_outliers).sensors, rtol=0.5)


def test_an_imu_that_is_shaken_for_three_seconds_does_not_widen_its_gate():
    """The mean of six such disturbances: a single one has only 200 readings."""
    correcting = ("imu[0]", "imu[1]")  # only a channel that corrects has a weight
    shares = np.array([
        [
            np.mean(filtered(1.0, gain, f"shaken {seed}", correcting)[1].weight[3100:3300] < 0.5, axis=0)
            for seed in range(6)
        ]
        for gain in (0.0, 0.01)
    ])  # fmt: skip
    without_levels, with_levels = shares.mean(axis=1)
    assert np.all(with_levels > without_levels - 0.05)
    assert np.all(with_levels > 0.6)


def test_noise_levels_do_not_change_at_rest():
    ekf, n = SMALL.estimator(), 1000
    kernel = kernel_of(ekf.noise_gain, ekf.speed_from)
    t_ns, zeros = 10_000_000 * np.arange(1, n + 1), np.zeros((n, 3))
    carry, _ = kernel.run(ticks(t_ns, zeros, zeros))
    result, _ = kernel.run(ticks(t_ns + t_ns[-1], zeros, zeros), carry=carry)
    np.testing.assert_array_equal(result.memory.noise_levels, carry.memory.noise_levels)


@pytest.mark.parametrize("previous", [0.0, 1.5])
def test_a_level_follows_the_gradient_of_the_likelihood(previous):
    """2 d log N(y; 0, λ q + κ p)/d log λ by a difference quotient, of a gyro divided by d log S/d log λ.

    There p²/(p + λ r) = κ v, so the gain g = p/(p + λ r), which moved the prediction by g y⁻, depends on both levels.
    """
    states, h = layout(SMALL.estimator()), 1e-6
    q, p, y = np.array([0.5, 2.0, 1.0]), np.array([1.0, 0.5, 3.0]), np.array([0.3, 2.5, -4.0])
    last = np.array([7.0, 7.0, previous])  # of an accelerometer that corrects nothing, y⁻ has no effect

    def logarithms(c: int, sensor: float, motion: float) -> np.ndarray:
        r, v, innovation = np.exp(sensor) * q[c], np.exp(motion) * p[c] ** 2 / (p[c] + q[c]), y[c]
        variance = r + p[c]
        if c == 2:
            prior = 0.5 * (v + np.sqrt(v**2 + 4.0 * v * r))
            innovation, variance = y[c] - (prior / (prior + r) - p[c] / (p[c] + q[c])) * last[c], prior + r
        return np.array([-0.5 * (np.log(variance) + innovation**2 / variance), np.log(variance)])

    def step(c: int, sensor: float, motion: float) -> float:
        slope, share = (logarithms(c, sensor, motion) - logarithms(c, -sensor, -motion)) / (2.0 * h)
        return 2e-3 * slope / (share if c == 2 else 1.0)

    squares = InnovationSquares(y, last, np.diag(q + p), np.diag(q), np.ones(3))
    after = next_levels(NoiseLevels(np.ones(3), np.ones(2)), squares, states, 1e-3)
    np.testing.assert_allclose(after.sensors, [1.0 + step(c, h, 0.0) for c in range(3)], rtol=1e-9)
    np.testing.assert_allclose(after.motion, [1.0, 1.0 + step(2, 0.0, h)], rtol=1e-9)


@pytest.mark.parametrize(("noise", "walk"), [(1.0, 0.25), (4.0, 0.5), (0.25, 2.0), (1.0, 1.0)])
def test_the_levels_of_a_gyro_separate_its_noise_from_the_motion(noise, walk):
    """A random walk is read with noise; the filter of the file has other variances. Both factors are found."""
    states, rng, n = layout(SMALL.estimator()), np.random.default_rng(0), 40_000
    x = np.cumsum(np.sqrt(walk) * rng.standard_normal(n))
    z = x + np.sqrt(noise) * rng.standard_normal(n)

    def step(carry, reading):
        levels, mean, variance, previous = carry
        variance = variance + levels.motion[1]
        y, S = reading - mean, variance + levels.sensors[2]
        squares = InnovationSquares(
            *(np.array([0.0, 0.0, value]) for value in (y, previous)),
            np.diag(np.array([1.0, 1.0, S])), np.diag(np.array([1.0, 1.0, levels.sensors[2]])),
            np.array([0.0, 0.0, 1.0]),
        )  # fmt: skip
        levels = next_levels(levels, squares, states, 0.01)
        carry = levels, mean + variance / S * y, variance * (1.0 - variance / S), y
        return carry, np.array([levels.sensors[2], levels.motion[1]])

    begin = NoiseLevels(np.ones(3), np.ones(2)), 0.0, 1.0, 0.0
    _, history = scan(step, begin, 0.0).run(z)
    np.testing.assert_allclose(np.mean(history[n // 4 :], axis=0), [noise, walk], rtol=0.15)


def test_a_lasting_disturbance_keeps_the_motion_at_the_variance_of_the_file():
    """A calm drive lowers the level of the motion; a disturbance with a mean of σ_d contradicts it."""
    ekf = SMALL.estimator()
    row = FilterRow(1.0, 0.01, 0.01, U[0])
    effort, belief = ekf.vehicle.drivetrain.step(ekf.vehicle.drivetrain.init(), U[0], 0.01)[1], ekf.init()

    def yaw_noise(level: float, mean_disturbance: float) -> float:
        levels = np.concatenate([np.ones(3), [level, level]])
        calm = belief._replace(
            memory=belief.memory._replace(noise_levels=levels),
            mean_disturbance=np.array([0.0, mean_disturbance]),
        )
        cov = predict_row(ekf, calm, effort, row, ekf.disturbance_std**2).cov
        silent = predict_row(ekf, calm, effort, row, 0.0 * ekf.disturbance_std).cov
        return cov[7, 7] - silent[7, 7]

    file_noise, std = yaw_noise(1.0, 0.0), ekf.disturbance_std[1]
    shares = [yaw_noise(0.1, factor * std) / file_noise for factor in (0.0, 0.2, 0.5, -0.5, 1.0, 3.0)]
    np.testing.assert_allclose(shares, [0.1, 0.1, 0.25, 0.25, 1.0, 1.0], rtol=1e-9)


@pytest.mark.parametrize("y", [0.0, 3.0])
def test_noise_levels_stay_bounded(y):
    states, levels = layout(SMALL.estimator()), NoiseLevels(np.ones(3), np.ones(2))
    for _ in range(5000):
        S = np.diag(levels.sensors + levels.motion[1])
        squares = InnovationSquares(
            y * np.sqrt(np.diag(S)), np.zeros(3), S, np.diag(levels.sensors), np.ones(3)
        )
        levels = next_levels(levels, squares, states, 0.01)
    bound = MAX_LEVEL if y else 1.0 / MAX_LEVEL
    np.testing.assert_allclose(levels.sensors, bound)


def test_the_innovation_covariance_of_the_file_does_not_use_noise_levels():
    states, levels = layout(SMALL.estimator()), NoiseLevels(np.array([4.0, 1.0, 0.25]), np.array([1.0, 9.0]))
    q, p = np.diag([0.5, 2.0, 1.0]), np.diag([0.0, 0.3, 2.0])
    S = levels.sensor_cov(q) + np.diag([1.0, 1.0, 9.0]) @ p
    squares = InnovationSquares(np.zeros(3), np.zeros(3), S, levels.sensor_cov(q), np.ones(3))
    np.testing.assert_allclose(file_innovation_cov(levels, squares, states), q + p)


def test_a_replay_of_a_noisier_run_is_consistent():
    """The verdict of a replay: too sure with the noise of the file, consistent with adapted noise."""
    run = noisy_run(2.0)
    file_estimates, estimates = (
        filter_consistency(replay(run, SMALL.with_values({"estimator.noise_gain": gain})))
        for gain in (0.0, 0.01)
    )
    assert file_estimates.channels["imu[0]"].mean > 1.35
    assert estimates.channels["imu[0]"].mean == pytest.approx(1.0, abs=0.15)


def test_an_accelerometer_that_corrects_nothing_does_not_decide_about_the_covariance():
    """On a wavy floor the accelerometers are wrong by 2 m/s² for seconds; the estimate does not use them."""
    run = noisy_run(1.0)
    z = run.sensors["imu"].z + np.outer(2.0 * np.sin(0.01 * np.arange(len(run.t_ns))), [1.0, 1.0, 0.0])
    sensors = run.sensors | {"imu": run.sensors["imu"]._replace(z=z)}
    consistency = filter_consistency(replay(replace(run, sensors=sensors), SMALL))
    assert consistency.channels["imu[0]"].verdict == "too sure"
    assert consistency.nis == pytest.approx(consistency.channels["imu[2]"], rel=0.05)
