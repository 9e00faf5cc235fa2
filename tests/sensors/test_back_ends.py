"""The same code under NumPy, as Python and as C gives equal results to 1e-12; derivatives match central differences."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.sensors import Beacon, Compass, Encoders, Imu, Odometer, Pose, Rangefinder, Tags, Wheels
from baqueano.signals import Motion
from baqueano.symbolic import jacobian, scan, value_at_path, with_value

QUICK = settings(max_examples=30)

IMU = Imu(
    rate_hz=80.0,
    delay_s=0.0049,
    delay_slots=1,
    accel_bias=np.array([0.05, -0.03]),
    gyro_bias=0.002,
    accel_bias_walk=1e-3,
    gyro_bias_walk=1e-4,
    accel_noise_std=np.array([0.15, 0.2]),
    gyro_noise_std=0.005,
    accel_scale=np.array([1.02, 0.98]),
    gyro_scale=0.97,
    lever_arm_m=np.array([0.02, -0.01]),
    tilt_rad=np.array([0.02, -0.03]),
    accel_limit=2.0,
    gyro_limit=1.5,
    accel_step=0.0005985,
    gyro_step=0.000532,
    temperature_c=31.0,
    accel_temperature_slope=np.array([0.002, -0.003]),
    gyro_temperature_slope=1e-4,
)
SENSORS = {
    "imu": IMU,
    "paper": Imu(measurement_model="paper", accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005),
    "low-pass": replace(IMU, low_pass_hz=44.0),
    "wheels": Wheels(track_m=0.12, radius_scale=np.array([1.01, 0.98]), noise_std=0.01, rate_hz=50.0),
    "odometer": Odometer(scale=1.02, noise_std=0.01, delay_s=0.013, delay_slots=2),
    "pose": Pose(rate_hz=30.0, noise_std=np.array([0.01, 0.01, 0.05]), delay_s=0.025, delay_slots=3),
    "tags": Tags(points_m=np.array([[0.5, 0.2], [-1.0, 1.0]]), radius_m=0.8, lever_arm_m=np.array([0.1, -0.05])),
    "tags without offset": Tags(points_m=np.array([[0.5, 0.2]]), radius_m=1.5, measures_offset=False),
    "beacon": Beacon(
        point_m=np.array([4.0, 1.0]), height_m=2.0, offset_m=0.3, max_range_m=6.0, lever_arm_m=np.array([0.1, -0.05]),
        delay_s=0.013, delay_slots=2,
    ),
    "rangefinder": Rangefinder(
        wall_point_m=np.array([5.0, 1.0]), wall_heading_rad=0.3, heading_rad=0.2, lever_arm_m=np.array([0.1, 0.05]),
        half_width_m=3.0, max_range_m=20.0, incidence_rad=1.2,
    ),
    "compass": Compass(iron=np.array([0.2, -0.1]), heading_rad=0.4, rate_hz=30.0),
    "encoders": Encoders(track_m=0.12, count_m=7e-4, counter=256.0, radius_scale=np.array([1.01, 0.98])),
}  # fmt: skip
names = pytest.mark.parametrize("name", SENSORS)


class Input(NamedTuple):
    motion: Motion
    dt_s: float
    noise: np.ndarray  # (noise_size,)


def flat(tree) -> np.ndarray:
    if isinstance(tree, tuple):
        return np.concatenate([flat(leaf) for leaf in tree])
    return np.ravel(np.asarray(tree, dtype=float))


def moved_motion(motion: Motion, k: int) -> Motion:
    tick = motion.tick and tuple(moved_motion(part, k) for part in motion.tick)
    return Motion(*(leaf[k] for leaf in motion[:4]), tick)


def input_at(inputs: Input, k: int) -> Input:
    return Input(moved_motion(inputs.motion, k), inputs.dt_s[k], inputs.noise[k])


@names
def test_sensor_readings_are_the_same_in_every_back_end(name):
    sensor, rng, N = SENSORS[name], np.random.default_rng(4), 150
    motion, *tick = (Motion(*(rng.uniform(-3.0, 3.0, (N, n)) for n in (3, 3, 3, 2))) for _ in range(4))
    motions = motion._replace(tick=tuple(tick))
    inputs = Input(motions, rng.uniform(0.005, 0.015, N), rng.standard_normal((N, sensor.noise_size)))

    def step(state, x):
        return sensor.step(state, x.motion, x.dt_s, x.noise)

    state, rows = sensor.init(), []
    for k in range(N):
        state, slot = step(state, input_at(inputs, k))
        rows.append(flat(slot))
    expected = np.array(rows)
    assert 0.0 < expected[:, 0].mean() <= 1.0
    for backend in ("python", "c"):
        end, slots = scan(step, sensor.init(), input_at(inputs, 0), backend=backend).run(inputs)
        outputs = np.concatenate([np.reshape(leaf, (N, -1)) for leaf in slots], axis=1)
        assert np.all(np.abs(outputs - expected) <= 1e-12 * np.maximum(1.0, np.abs(expected))), backend
        assert flat(end) == pytest.approx(flat(state), abs=1e-12, rel=1e-12), backend


def differences(f, x, h=1e-5):
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2.0 * h) for e in np.eye(len(x))], axis=-1)


@names
@QUICK
@given(x=arrays(float, 11, elements=st.floats(-2.0, 2.0)))
def test_measurement_derivatives_by_dual_numbers_match_finite_differences(name, x):
    def h(x):
        return SENSORS[name].h(Motion(x[:3], x[3:6], x[6:9], x[9:]))

    assert jacobian(h)(x) == pytest.approx(differences(h, x), abs=1e-7, rel=1e-7)


def test_every_parameter_of_the_imu_model_has_a_derivative():
    paths = ["accel_bias[0]", "accel_bias[1]", "gyro_bias", "accel_scale[0]", "accel_scale[1]", "gyro_scale"]
    paths += ["lever_arm_m[0]", "lever_arm_m[1]", "tilt_rad[0]", "tilt_rad[1]", "temperature_c"]
    paths += ["accel_temperature_slope[1]", "gyro_temperature_slope"]
    start = np.array([float(value_at_path(IMU, path)) for path in paths])
    motion_ = Motion(
        np.zeros(3), np.array([0.4, -0.1, 2.0]), np.array([0.5, 0.3, -1.0]), np.array([0.1, -0.2])
    )

    def h(values):
        imu = IMU
        for path, value in zip(paths, values, strict=True):
            imu = with_value(imu, path, value)
        return imu.h(motion_)

    slope = jacobian(h)(start)
    assert slope == pytest.approx(differences(h, start), abs=1e-7, rel=1e-7)
    assert np.all(np.abs(slope).max(axis=0) > 0.0), "each parameter has an effect"
