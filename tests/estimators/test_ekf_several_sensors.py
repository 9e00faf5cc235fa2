"""Several sensors: each corrects the state when it has a reading, and each has its own gate."""

import numpy as np

from baqueano.estimators import Ekf
from baqueano.sensors import Imu, Pose, Wheels
from baqueano.signals import Slot, Tick, sensor_slots
from tests.light_robot import SMALL

Sensors = sensor_slots(("imu", "pose", "wheels"))
SENSORS = Sensors(
    Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005),
    Pose(noise_std=np.array([0.01, 0.01, 0.02])),
    Wheels(track_m=0.12, noise_std=0.01),
)
R = np.diag([1e-3, 1e-3, 1e-2, 0.05, 0.05, 0.5]) ** 2
ALL = ("imu", "pose", "wheels")


def tick(k, **readings):
    slots = {name: Slot(0.0, np.zeros(getattr(SENSORS, name).size)) for name in ALL}
    slots |= {name: Slot(1.0, np.array(z, dtype=float)) for name, z in readings.items()}
    return Tick(k * 10_000_000, np.zeros(3), Sensors(**slots))


def test_only_the_sensors_in_use_correct_the_state_and_have_innovations():
    imu_only, all_sensors = Ekf(SMALL, SENSORS, R), Ekf(SMALL, SENSORS, R, use=ALL)
    readings = {"imu": (0, 0, 0), "wheels": (0.02, 0.02)}
    _, a = imu_only.step(imu_only.init(), tick(1, **readings))
    _, b = all_sensors.step(all_sensors.init(), tick(1, **readings))
    assert a.innovation.shape == (3,)
    assert a.nu[0] < 1e-6
    assert b.nu[0] > 1e-3
    assert b.innovation.shape == (8,)
    assert b.innovation_cov.shape == (8, 8)
    assert np.array_equal(np.isnan(b.innovation), [False] * 3 + [True] * 3 + [False] * 2)
    assert np.all(b.innovation_cov[:3, 3:] == 0.0)


def test_a_pose_measurement_bounds_the_drift_of_an_imu():
    filter_ = Ekf(SMALL, SENSORS, R, use=ALL)
    belief, resting = filter_.init(), {"imu": (0, 0, 0)}
    spread = []
    for k in range(1, 201):
        fix = {"pose": (0.0, 0.0, 0.0)} if k == 150 else {}
        belief, estimate = filter_.step(belief, tick(k, **resting, **fix))
        spread.append(estimate.cov[0, 0])
    assert np.all(np.diff(spread[:149]) > 0.0)
    assert spread[149] < 0.5 * spread[148]


def test_a_pose_innovation_is_wrapped_across_pi():
    filter_ = Ekf(SMALL, SENSORS, R, use=ALL, initial_std=np.full(9, 0.05))
    belief = filter_.init(eta=np.array([0.0, 0.0, np.pi - 0.02]))
    _, estimate = filter_.step(belief, tick(1, pose=(0.0, 0.0, -np.pi + 0.02)))
    assert abs(estimate.innovation[5] - 0.04) < 1e-3
    assert estimate.eta[2] < -3.1 or estimate.eta[2] > 3.13


def test_a_spike_of_one_sensor_does_not_reject_the_other_sensors():
    filter_ = Ekf(SMALL, SENSORS, R, use=ALL)
    belief, _ = filter_.step(filter_.init(), tick(1, imu=(0, 0, 0)))
    hit, _ = filter_.step(belief, tick(2, imu=(90.0, 0, 0), wheels=(0.02, 0.02)))
    calm, _ = filter_.step(belief, tick(2, wheels=(0.02, 0.02)))
    assert np.array_equal(hit.mean, calm.mean)
    assert hit.mean[3] > belief.mean[3]
