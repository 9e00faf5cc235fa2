"""A model that is wrong in a lasting turn changes neither the yaw rate nor the heading of the recommended filter."""

from dataclasses import replace

import numpy as np

from baqueano.estimators import AugmentedEkf
from baqueano.signals import Slot, Tick, empty_slots
from baqueano.symbolic import scan
from baqueano.vehicle_file import load

RATE = 1.0  # rad/s, while the model predicts a straight drive


def test_a_gyro_with_a_low_pass_gives_the_heading_although_the_model_is_wrong():
    n, small = 1000, load("small")
    imu = replace(small.sensors.imu, low_pass_hz=44.0, gyro_bias=0.0, gyro_scale=1.0)
    ekf = AugmentedEkf(small.vehicle, small.sensors._replace(imu=imu), use=("imu[2]",), gate_sigma=1e6)
    z = np.tile([0.0, 0.0, RATE], (n, 1))
    slots = type(small.sensors)(Slot(np.ones(n), z, np.zeros(n)))
    ticks = Tick(10_000_000 * np.arange(1, n + 1), np.tile([0.5, 0.0, 0.0], (n, 1)), slots)
    kernel = scan(ekf.step, ekf.init(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})))
    _, estimates = kernel.run(ticks)
    heading = np.unwrap(estimates.eta[:, 2])
    assert abs(estimates.nu[-1, 2] - RATE) < 2e-4
    assert abs((heading[-1] - heading[n // 2]) / (0.01 * (n - 1 - n // 2)) - RATE) < 2e-4
