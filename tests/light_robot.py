"""A robot of 0.61 kg with an IMU, and the process noise of its filter."""

from dataclasses import replace

import numpy as np

from baqueano.sensors import Imu
from baqueano.signals import sensor_slots
from baqueano.vehicles import Friction, Planar

SMALL = Planar(
    mass_kg=0.61,
    inertia_kg_m2=0.0015,
    actuator_matrix=np.diag([1.5, 0.0, 0.03]),
    friction=Friction(linear=np.array([1.2, 4.0, 0.006])),
)
DRAGGED = replace(
    SMALL, friction=Friction(linear=np.array([1.2, 4.0, 0.006]), quadratic=np.array([0.5, 0.5, 0.001]))
)
VEHICLE = replace(DRAGGED, process_noise_std=np.array([0.02, 0.005, 0.05]))
SENSORS = sensor_slots(("imu",))(Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005))
LIMIT = np.array([1.0, 0.0, 1.0])
R = np.diag([1e-3, 1e-3, 5e-3, 0.05, 0.05, 0.5]) ** 2
