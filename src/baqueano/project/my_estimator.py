"""An estimator of your own: the vehicle's model, with its turning rate pulled towards the gyro.

It runs without changes. Change it, then check it, and compare it with the estimator of the file on a run:

    baqueano blocks check my_estimator.py:MyEstimator
    baqueano replay last --estimator my_estimator.py:MyEstimator
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.signals import Estimate, Tick, seconds


class MyBelief(NamedTuple):
    """The state of the estimator between two ticks."""

    t_ns: int  # of the last tick; -1 before the first, whose clock may begin anywhere
    eta: np.ndarray  # (3,) pose in the map [m, m, rad]
    nu: np.ndarray  # (3,) velocity in the body frame [m/s, m/s, rad/s]
    cov: np.ndarray  # (6, 6) covariance of (eta, nu)
    drivetrain: Any


@dataclass(frozen=True, slots=True, eq=False)
class MyEstimator:
    """An estimator with vehicle and sensors of the vehicle file.

    gyro_trust, from 0 to 1, is a key of the table [estimator].
    """

    vehicle: Any
    sensors: Any
    gyro_trust: float = 0.8

    def init(self, eta: Any = None) -> MyBelief:
        """Return a belief at rest at `eta` (3,), by default the origin; the standard deviations are 1e-3."""
        pose = np.zeros(3) if eta is None else np.array(eta, dtype=float)
        return MyBelief(-1, pose, np.zeros(3), 1e-6 * np.eye(6), self.vehicle.drivetrain.init())

    def step(self, belief: MyBelief, tick: Tick) -> tuple[MyBelief, Estimate]:
        """Return belief and estimate after a tick: a step of the model, with its yaw rate corrected by the gyro."""
        dt_s = np.where(belief.t_ns < 0, 0.0, seconds(tick.t_ns, belief.t_ns))
        drivetrain, effort = self.vehicle.drivetrain.step(belief.drivetrain, tick.u, dt_s)
        eta, nu, _ = self.vehicle.advance(belief.eta, belief.nu, effort, dt_s)
        gyro = tick.sensors.imu
        is_usable = (gyro.is_new > 0) & np.isfinite(gyro.z[2])
        yaw_rate = np.where(is_usable, gyro.z[2] - self.sensors.imu.gyro_bias, nu[2])
        nu = np.array([nu[0], nu[1], nu[2] + self.gyro_trust * (yaw_rate - nu[2])])
        cov = belief.cov + dt_s * 1e-3 * np.eye(6)  # a guess that only grows: yours will be better
        return MyBelief(tick.t_ns, eta, nu, cov, drivetrain), Estimate(tick.t_ns, eta, nu, cov)
