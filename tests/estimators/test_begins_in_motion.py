"""A recording that begins in motion: the motors had a command before, so the speed is constant from the first tick."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf, DeadReckoning, Ekf, Unscented
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.vehicles import Drivetrain
from tests.light_robot import SMALL

Sensors = sensor_slots(("imu",))
SENSORS = Sensors(Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005))
U = np.array([0.6, 0.0, 0.2])
VEHICLE = replace(
    SMALL,
    drivetrain=Drivetrain(
        mixing="two_wheels", delay_s=0.03, delay_slots=3, lag_s=0.03, dead_zone_forward=np.array([0.1])
    ),
)
BLOCKS = {
    "augmented_ekf": AugmentedEkf(VEHICLE, SENSORS, use=()),
    "dead_reckoning": DeadReckoning(VEHICLE, SENSORS, 1e-6 * np.eye(6), use=("imu",)),
    "ekf": Ekf(VEHICLE, SENSORS, 1e-6 * np.eye(6), use=()),
    "unscented": Unscented(VEHICLE, SENSORS, 1e-6 * np.eye(6), use=()),
}


def steady():
    """ν that the command holds, by pencil. The wheels lose 0.1 of 0.4 and 0.8 to the dead zone: u = (0.5, 0, 0.2).

    0 = 0.03 · 0.2 − 0.006 r,   0 = −4 ν_y − m ν_x r,   0 = 1.5 · 0.5 − 1.2 ν_x + m ν_y r
    """
    m, r = 0.61, 0.03 * 0.2 / 0.006
    speed = 1.5 * 0.5 / (1.2 + (m * r) ** 2 / 4.0)
    return np.array([speed, -m * speed * r / 4.0, r])


def speeds(block, nu, first=U):
    """Return the estimated speeds in 8 ticks without readings, from the velocity `nu`."""
    belief, out = block.init(np.zeros(3), nu), []
    for k in range(8):
        u = first if k == 0 else U
        belief, estimate = block.step(belief, Tick((k + 1) * 10_000_000, u, Sensors(Slot(0.0, np.zeros(3)))))
        out.append(estimate.nu[0])
    return np.array(out)


@pytest.mark.parametrize("kind", BLOCKS)
def test_the_speed_is_constant_from_the_first_tick(kind):
    np.testing.assert_allclose(speeds(BLOCKS[kind], steady()), steady()[0], rtol=2e-3)


@pytest.mark.parametrize("kind", BLOCKS)
def test_a_start_from_rest_waits_for_the_command_delay(kind):
    from_rest = speeds(BLOCKS[kind], np.zeros(3))
    assert np.all(np.abs(from_rest[:3]) < 1e-12)
    assert from_rest[-1] > 0.005
