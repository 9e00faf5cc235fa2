"""Provide the paper's case study I for all benches: blocks, signal, noise."""

import numpy as np

from baqueano.sensors import Imu
from baqueano.signals import sensor_slots
from baqueano.vehicles import Friction, Planar
from benchmarks import peers

RATE_HZ = 100.0


def vehicle() -> Planar:
    """Return the dynamic model of the paper with the numbers of its case study I."""
    theta, m, I = peers.parameters()
    return Planar(m, I, theta[6:].reshape(3, 3), friction=Friction(theta[:3], theta[3:6]))


def sensors():
    """Return the paper's IMU, with the noise that errata.md assumes."""
    imu = Imu("paper", accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005)
    return sensor_slots(("imu",))(imu)


def signal(duration_s: float, sideways: float = 0.0) -> np.ndarray:
    """Return random steps (N, 3), each 1 s long: u_x within ± 20, u_y within ± `sideways`, u_ψ within ± 60."""
    rng = np.random.default_rng(7)
    steps = rng.uniform(-1.0, 1.0, (int(np.ceil(duration_s)), 3)) * [20.0, sideways, 60.0]
    return np.repeat(steps, round(RATE_HZ), axis=0)[: round(duration_s * RATE_HZ)]
