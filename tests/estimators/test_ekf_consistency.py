"""The covariance of the filter is correct: NEES and NIS lie in their χ² bands if the world equals the filter model.

False-alarm rates: a correct filter leaves each band once in 1,000 choices of the seed. There are three bands of NEES
and one of NIS for each of two models. So a correct filter fails this file once in 125 choices; the seed is fixed.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.special import gammaincinv  # scipy.stats takes three times as long to import

from baqueano.estimators import Ekf
from baqueano.geometry import wrap
from baqueano.sensors import Imu
from baqueano.signals import Motion, Slot, Tick, sensor_slots
from baqueano.symbolic import scan
from baqueano.vehicles import Kinematic
from tests.light_robot import DRAGGED as SMALL

RUNS, TICKS, FALSE_ALARM = 40, 300, 1e-3
Sensors = sensor_slots(("imu",))
FLAT = Kinematic(velocity_matrix=np.diag([0.5, 0.0, 3.0]))
SENSORS = Sensors(Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005))
R = np.diag([2e-4, 1e-4, 1e-3, 0.02, 0.01, 0.1]) ** 2
START = np.array([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 5e-3, 0.02, 0.02, 0.1])


class Noise(NamedTuple):
    process: np.ndarray  # (6,) on (ν, ν̇)
    measurement: np.ndarray  # (3,)


def lab(ekf):
    """Run one tick of a world that equals the filter model, and of the filter."""

    def step(carry, x):
        (truth, belief), (t_ns, u, noise) = carry, x
        silent = Tick(t_ns, u, Sensors(Slot(0.0, np.zeros(3))))
        truth, _ = ekf.step(truth, silent)  # g(u, μ): without a measurement the filter only predicts
        mean = truth.mean + np.concatenate([np.zeros(3), np.sqrt(np.diag(R)) * noise.process])
        imu = ekf.sensors.imu
        z = (
            imu.h(Motion(mean[:3], mean[3:6], mean[6:], np.zeros(2)))
            + np.sqrt(np.diag(imu.cov)) * noise.measurement
        )
        belief, estimate = ekf.step(belief, Tick(t_ns, u, Sensors(Slot(1.0, z))))
        out = (mean, belief.mean, belief.cov, estimate.innovation, estimate.innovation_cov)
        return (truth._replace(mean=mean), belief), out

    return step


def squared_error(e, S):
    return np.einsum("...i,...i", e, np.linalg.solve(S, e[..., None])[..., 0])


def band(freedom):
    """Return the limits of χ² for FALSE_ALARM."""
    return 2.0 * gammaincinv(0.5 * freedom, [0.5 * FALSE_ALARM, 1.0 - 0.5 * FALSE_ALARM])


@pytest.mark.parametrize("vehicle", [SMALL, FLAT], ids=["dynamic", "kinematic"])
def test_es8_nees_and_nis_lie_in_their_bands(vehicle):
    ekf = Ekf(vehicle, SENSORS, R, initial_std=START)
    example = (10_000_000, np.zeros(3), Noise(np.zeros(6), np.zeros(3)))
    kernel = scan(lab(ekf), (ekf.init(), ekf.init()), example)
    t_ns = 10_000_000 * np.arange(1, TICKS + 1)
    u = 0.4 * np.sin(0.02 * np.outer(np.arange(TICKS), [1.0, 0.0, 1.7])) + [0.3, 0.0, 0.1]
    rng = np.random.default_rng(20)
    nees, nis = [], []
    for _ in range(RUNS):
        noise = Noise(rng.standard_normal((TICKS, 6)), rng.standard_normal((TICKS, 3)))
        start = ekf.init()
        truth = start._replace(mean=start.mean + START * rng.standard_normal(9))
        _, (truth, mean, cov, y, S) = kernel.run((t_ns, u, noise), carry=(truth, start))
        e = truth - mean
        e[:, 2] = wrap(e[:, 2])
        nees.append(squared_error(e, cov))
        nis.append(squared_error(y, S))
    for k in (20, 100, 299):
        total = np.sum(np.array(nees)[:, k])
        low, high = band(9 * RUNS)
        assert low < total < high, f"NEES at tick {k}: {total / (9 * RUNS):.3f} of its mean"
    total = np.sum(nis)
    low, high = band(3 * RUNS * TICKS)
    assert low < total < high, f"NIS: {total / (3 * RUNS * TICKS):.3f} of its mean"


@pytest.mark.parametrize("mode", ["default", "paper"])
def test_es2_the_covariance_is_symmetric_and_positive_over_a_hundred_thousand_ticks(mode):
    """At the start the pose is 1e8 times less certain than the other states; the readings of the IMU are
    intermittent."""
    ekf = Ekf(SMALL, SENSORS, R, mode=mode, initial_std=np.array([10.0, 10.0, 1.0, *START[3:]]))
    n, rng = 100_000, np.random.default_rng(21)

    def step(belief, tick):
        belief, estimate = ekf.step(belief, tick)
        return belief, (belief.cov, estimate.nu)

    u = np.repeat(rng.uniform(-1.0, 1.0, (n // 100, 3)), 100, axis=0)
    slots = Slot((rng.uniform(size=n) < 0.7).astype(float), rng.normal(scale=0.05, size=(n, 3)), np.zeros(n))
    example = Tick(10_000_000, np.zeros(3), Sensors(Slot(1.0, np.zeros(3))))
    belief, (cov, nu) = scan(step, ekf.init(), example).run(
        Tick(10_000_000 * np.arange(1, n + 1), u, Sensors(slots))
    )
    assert np.array_equal(cov, np.swapaxes(cov, 1, 2))
    sample = cov[::97]
    scale = np.sqrt(np.einsum("kii->ki", sample))
    assert np.min(np.linalg.eigvalsh(sample / (scale[:, :, None] * scale[:, None, :]))) > 0.0
    assert np.isfinite(nu).all()
    assert np.array_equal(belief.cov, cov[-1])
