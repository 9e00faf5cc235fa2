"""The filter of the paper: its gain on (ν, ν̇) equals that of the 6-state filter, compared with filterpy."""

import numpy as np
import pytest

from baqueano.estimators import Ekf
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.vehicles import Drivetrain, Friction, Kinematic, Planar

DT = 0.01
M, I = 1.47, 3.0
D_L, D_C = np.array([7.0, 7.0, 5.0]), np.array([3.5, 3.5, 2.5])
T = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.2, 0.0, 3.0]])
Q = np.diag([0.05, 0.04, 0.005]) ** 2 + 1e-5
A = np.random.default_rng(3).normal(size=(6, 6)) * 0.02
R = A @ A.T + 1e-6 * np.eye(6)
SENSORS = sensor_slots(("imu",))(Imu(measurement_model="paper", measurement_noise_cov=Q))
PLANAR = Planar(mass_kg=M, inertia_kg_m2=I, actuator_matrix=T, friction=Friction(linear=D_L, quadratic=D_C))


def paper_g(mu, u):
    """Return g(u, μ), written by hand with the signs of errata 1."""
    x, y, r = mu[:3]
    force = T @ u - (D_L + D_C * np.abs(mu[:3])) * mu[:3]
    return np.concatenate([mu[:3] + mu[3:] * DT, [force[0] / M + y * r, force[1] / M - x * r, force[2] / I]])


def paper_G(mu):
    """Return its Jacobian as printed, with the signs of errata 1 and the zeros of errata 2."""
    x, y, r = mu[:3]
    d = -(D_L + 2.0 * D_C * np.abs(mu[:3])) / np.array([M, M, I])
    lower = np.array([[d[0], r, y], [-r, d[1], -x], [0.0, 0.0, d[2]]])
    return np.block([[np.eye(3), DT * np.eye(3)], [lower, np.zeros((3, 3))]])


PAPER_H = np.array([[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0]], dtype=float)


def ticks(n, seed=0):
    rng = np.random.default_rng(seed)
    for k in range(1, n + 1):
        u = 5.0 * np.sin(0.05 * k * np.array([1.0, 0.7, 1.3]))
        yield Tick(k * 10_000_000, u, sensor_slots(("imu",))(Slot(1.0, rng.normal(size=3))))


@pytest.mark.parametrize("mixing", ["none"])
def test_the_velocity_gain_equals_the_six_state_filter_of_the_paper(mixing):
    ekf = Ekf(PLANAR, SENSORS, R, mode="paper")
    belief = ekf.init()
    oracle = pytest.importorskip("filterpy.kalman").ExtendedKalmanFilter(dim_x=6, dim_z=3)
    oracle.x, oracle.P, oracle.R = belief.mean[3:].copy(), belief.cov[3:, 3:].copy(), Q
    for tick in ticks(300):
        G = paper_G(oracle.x)
        oracle.x = paper_g(oracle.x, tick.u)
        oracle.P = G @ oracle.P @ G.T + R
        oracle.update(tick.sensors.imu.z, lambda x: PAPER_H, lambda x: PAPER_H @ x)
        belief, estimate = ekf.step(belief, tick)
        np.testing.assert_allclose(belief.mean[3:], oracle.x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(belief.cov[3:, 3:], oracle.P, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(estimate.innovation, oracle.y, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(estimate.innovation_cov, oracle.S, rtol=1e-8, atol=1e-12)


def test_the_paper_mode_does_not_gate_readings():
    ekf = Ekf(PLANAR, SENSORS, R, mode="paper")
    belief, _ = ekf.step(ekf.init(), next(ticks(1)))
    spike = Tick(20_000_000, np.zeros(3), sensor_slots(("imu",))(Slot(1.0, np.array([1e3, 0.0, 0.0]))))
    after, _ = ekf.step(belief, spike)
    assert after.mean[6] > 10.0


@pytest.mark.parametrize("mode", ["paper", "default"])
def test_the_kinematic_model_predicts_the_command_times_its_matrix_v(mode):
    V = np.diag([0.3, 0.0, 2.0])
    ekf = Ekf(Kinematic(velocity_matrix=V, drivetrain=Drivetrain()), SENSORS, R, mode=mode)
    belief, silence = ekf.init(), sensor_slots(("imu",))(Slot(0.0, np.zeros(3)))
    u = np.array([1.0, 0.0, -0.5])
    belief, _ = ekf.step(belief, Tick(10_000_000, u, silence))
    np.testing.assert_allclose(belief.mean[3:6], V @ u, atol=1e-12)
    np.testing.assert_allclose(belief.mean[6:], V @ u / DT, atol=1e-9)
    belief, _ = ekf.step(belief, Tick(20_000_000, u, silence))
    np.testing.assert_allclose(belief.mean[6:], 0.0, atol=1e-9)
