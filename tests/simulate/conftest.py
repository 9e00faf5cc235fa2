"""The small vehicle of these tests."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.controllers import Pd
from baqueano.estimators import Ekf
from baqueano.guides import Repeat
from baqueano.sensors import Imu, Odometer
from baqueano.signals import sensor_slots
from baqueano.supervisor import Supervisor
from baqueano.vehicles import Drivetrain, Friction, Planar


def small(**sensors):
    """Return the loaded vehicle file of a small vehicle."""
    vehicle = Planar(
        mass_kg=0.61,
        inertia_kg_m2=0.0015,
        actuator_matrix=np.array([[1.2, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.05]]),
        friction=Friction(np.array([1.5, 40.0, 0.01]), np.array([0.4, 0.0, 0.001])),
        drivetrain=Drivetrain(delay_s=0.02, delay_slots=2, lag_s=0.05),
        process_noise_std=np.array([0.02, 0.001, 0.1]),
    )
    imu = Imu(
        gyro_bias=0.01, gyro_noise_std=0.002, accel_noise_std=np.array([0.05, 0.05]), gyro_bias_walk=1e-3
    )
    sensors = {"imu": imu} | sensors
    slots = sensor_slots(tuple(sensors))(**sensors)
    limit = np.array([1.0, 0.0, 1.0])
    R = np.diag([1e-6, 1e-8, 1e-4, 1e-3, 1e-4, 1e-1])
    return SimpleNamespace(
        name="small",
        text='name = "small"\n',
        rate_hz=100.0,
        parameter_cov=None,
        envelope=None,
        command=SimpleNamespace(names=("u_x", "u_y", "u_psi"), unit="duty", limit=limit),
        vehicle=vehicle,
        sensors=slots,
        estimator=lambda: Ekf(vehicle, slots, R),
        controller=lambda: Pd(3.0, 1.5, 0.1, limit),
        guide=lambda route: Repeat.along(route),
        supervisor=lambda: Supervisor(limit),
    )


@pytest.fixture
def vehicle():
    return small()


@pytest.fixture
def vehicle_with_odometer():
    return small(odometer=Odometer(rate_hz=20.0, noise_std=0.01))
