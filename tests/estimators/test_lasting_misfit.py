"""A model with a wrong turning gain does not pull the heading away from the gyro in a long bend."""

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import scan
from baqueano.vehicles import Drivetrain, Friction, Planar

Sensors = sensor_slots(("imu",))
GYRO_STD, TICKS, DT_S = 0.05, 1500, 0.01
SENSORS = Sensors(
    Imu(
        accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=GYRO_STD, gyro_bias_std=0.0, gyro_scale_std=0.0
    )
)
U = np.array([0.6, 0.0, 0.2])


def steady(turning_gain):
    """A model whose command turns it at 1 rad/s times this gain, by pencil: 0.006 r = 0.03 · gain · 0.2."""
    return Planar(
        mass_kg=0.61,
        inertia_kg_m2=0.0015,
        actuator_matrix=np.diag([1.5, 0.0, 0.03 * turning_gain]),
        friction=Friction(linear=np.array([1.2, 4.0, 0.006])),
        drivetrain=Drivetrain(mixing="two_wheels"),
    )


@pytest.mark.parametrize("turning_gain", [0.7, 1.0, 1.4])
def test_the_heading_follows_the_gyro_with_any_model(turning_gain):
    rng = np.random.default_rng(1)
    block = AugmentedEkf(
        steady(turning_gain), SENSORS, use=("imu[2]",), disturbance_std=np.array([0.3, 0.5]),
        disturbance_fade_s=np.array([1.0, 0.3]), velocity_walk_std=np.array([0.03, 0.01, 0.1]),
    )  # fmt: skip
    readings = 1.0 + GYRO_STD * rng.standard_normal(TICKS)
    z = np.column_stack([np.zeros((TICKS, 2)), readings])
    ticks = Tick(
        10_000_000 * np.arange(1, TICKS + 1),
        np.tile(U, (TICKS, 1)),
        Sensors(Slot(np.ones(TICKS), z, np.zeros(TICKS))),
    )
    begin = block.init(np.zeros(3), np.array([0.5, 0.0, 1.0]))
    kernel = scan(
        block.row, begin, Tick(0, np.zeros(3), Sensors(Slot(0.0, np.zeros(3), 0.0))), backend="auto"
    )
    heading = kernel.run(ticks, carry=begin)[1].eta[:, 2]
    error = np.unwrap(heading) - DT_S * np.arange(1, TICKS + 1)
    sums = DT_S * np.cumsum(readings - 1.0)
    last_part = slice(TICKS // 3, None)  # the misfit has lasted for 5 s
    drift = (error - sums)[last_part]
    assert np.ptp(drift) < 0.003  # of 10 rad; a permanent pull of the model moves the heading by 0.008
