"""The filter adapts the noise of its sensors and of the motion to the run, but not to a broken sensor."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from baqueano.compare.filter_consistency import filter_consistency
from baqueano.drive import replay
from baqueano.estimators.augmented.noise_levels import (
    MAX_LEVEL,
    InnovationSquares,
    NoiseLevels,
    file_innovation_cov,
    levels_after,
)
from baqueano.estimators.augmented.state import layout
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
    ekf = replace(SMALL.estimator(), noise_gain=noise_gain, speed_from=speed_from)
    run = noisy_run(factor)
    z = run.sensors["imu"].z.copy()
    if damage == "outliers":
        z[::10] += 100.0 * ACCEL[0]
    if damage == "shaken":
        z[3000:3300] += np.random.default_rng(1).standard_normal((300, 3)) * [3.0, 3.0, 1.0]
    return kernel_of(ekf).run(ticks(run.t_ns, run.applied_commands, z))


def levels_of(belief):
    return NoiseLevels.from_row(belief.memory.noise_levels)


def kernel_of(ekf):
    return scan(ekf.step, ekf.init(), ticks(10_000_000, np.zeros(3), np.zeros(3), 1.0))


def ticks(t_ns: Any, u: np.ndarray, z: np.ndarray, is_new: Any = None) -> Tick:
    """Return ticks (N,) with the readings z (N, 3) of the IMU, or one tick."""
    is_new = np.ones(len(z)) if is_new is None else is_new
    return Tick(t_ns, u, SMALL.sensors._replace(imu=Slot(is_new, z, 0.0 * is_new)))


def nis(estimate, S) -> np.ndarray:
    """Return the mean of y²/S of each channel over the second half."""
    return np.mean((estimate.innovation**2 / np.diagonal(S, axis1=1, axis2=2))[3000:], axis=0)


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
    assert np.all(levels_of(belief).sensors < 0.5)


def test_monitors_see_the_innovations_with_the_noise_of_the_file():
    _, file_estimates = filtered(2.0, 0.0)
    _, estimates = filtered(2.0, 0.01)
    ratio = nis(estimates, expected_innovation_cov(estimates)) / nis(
        file_estimates, expected_innovation_cov(file_estimates)
    )
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


def test_outliers_do_not_change_the_noise_levels():
    without_outliers, _ = filtered(1.0, 0.01)
    belief, _ = filtered(1.0, 0.01, "outliers")
    np.testing.assert_allclose(levels_of(belief).sensors, levels_of(without_outliers).sensors, rtol=0.5)


def test_an_imu_that_is_shaken_for_three_seconds_does_not_widen_its_gate():
    correcting = ("imu[0]", "imu[1]")  # only a channel that corrects has a weight
    weights = [filtered(1.0, gain, "shaken", correcting)[1].weight[3100:3300] for gain in (0.0, 0.01)]
    rejected_shares = [np.mean(weight < 0.5, axis=0) for weight in weights]
    assert np.all(rejected_shares[1] > rejected_shares[0] - 0.05)
    assert np.all(rejected_shares[1] > 0.6)


def test_noise_levels_do_not_change_at_rest():
    kernel, n = kernel_of(SMALL.estimator()), 1000
    t_ns, zeros = 10_000_000 * np.arange(1, n + 1), np.zeros((n, 3))
    carry, _ = kernel.run(ticks(t_ns, zeros, zeros))
    result, _ = kernel.run(ticks(t_ns + t_ns[-1], zeros, zeros), carry=carry)
    np.testing.assert_array_equal(result.memory.noise_levels, carry.memory.noise_levels)


def test_a_level_follows_the_gradient_of_the_likelihood():
    """d log N(y; 0, λ q + κ p)/d log λ = ½ ρ (y²/S − 1), here with a difference quotient."""
    states, h = layout(SMALL.estimator()), 1e-6
    q, p, y = np.array([0.5, 2.0, 1.0]), np.array([1.0, 0.5, 3.0]), np.array([0.3, 2.5, -4.0])

    def log_likelihood(c: int, log_level: float) -> float:
        variance = np.exp(log_level) * q[c] + p[c]
        return -0.5 * (np.log(variance) + y[c] ** 2 / variance)

    squares = InnovationSquares(y, np.diag(q + p), np.diag(q), np.ones(3))
    after = levels_after(NoiseLevels(np.ones(3), np.ones(2)), squares, states, 1e-3)
    slopes = [(log_likelihood(c, h) - log_likelihood(c, -h)) / (2.0 * h) for c in range(3)]
    np.testing.assert_allclose(after.sensors, 1.0 + 2e-3 * np.array(slopes), rtol=1e-9)


@pytest.mark.parametrize("y", [0.0, 3.0])
def test_noise_levels_stay_bounded(y):
    states, levels = layout(SMALL.estimator()), NoiseLevels(np.ones(3), np.ones(2))
    for _ in range(5000):
        S = np.diag(levels.sensors + levels.motion[1])
        squares = InnovationSquares(y * np.sqrt(np.diag(S)), S, np.diag(levels.sensors), np.ones(3))
        levels = levels_after(levels, squares, states, 0.01)
    bound = MAX_LEVEL if y else 1.0 / MAX_LEVEL
    np.testing.assert_allclose(levels.sensors, bound)


def test_the_innovation_covariance_of_the_file_does_not_use_noise_levels():
    states, levels = layout(SMALL.estimator()), NoiseLevels(np.array([4.0, 1.0, 0.25]), np.array([1.0, 9.0]))
    q, p = np.diag([0.5, 2.0, 1.0]), np.diag([0.0, 0.3, 2.0])
    S = levels.sensor_cov(q) + np.diag([1.0, 1.0, 9.0]) @ p
    squares = InnovationSquares(np.zeros(3), S, levels.sensor_cov(q), np.ones(3))
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
