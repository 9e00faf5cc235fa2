"""The complementary filter, a first filter for students: fast changes by the model, slow changes by the wheels, bias
at rest.
"""

import numpy as np
import pytest

from baqueano.estimators import Complementary
from baqueano.sensors import Imu, Odometer
from baqueano.signals import Motion, Slot, Tick, empty_slots, sensor_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.truth import draw_robots
from baqueano.symbolic import compile_block, scan
from baqueano.vehicle_file import load
from tests.light_robot import SMALL

DT = 0.01
IMU = Imu(gyro_noise_std=0.005, accel_noise_std=np.array([0.1, 0.1]), gyro_scale=1.03, gyro_bias=0.02)
ODOMETER = Odometer(scale=1.02, noise_std=0.02)


def blended(odometer=None, **options):
    sensors = (
        sensor_slots(("imu",))(IMU) if odometer is None else sensor_slots(("imu", "odometer"))(IMU, odometer)
    )
    return Complementary(SMALL, sensors, **options)


def estimate_of(block, u, z, start=None):
    """Return estimates (N,) from commands (N, 3) and measurements {name: (N, m)}."""
    names, n = block.sensors._fields, len(u)
    slots = type(block.sensors)(
        *(Slot(np.ones(n), np.asarray(z[k], dtype=float), np.zeros(n)) for k in names)
    )
    empty_tick = Tick(
        10_000_000, np.zeros(3), empty_slots({k: s.size for k, s in block.sensors._asdict().items()})
    )
    belief = block.init() if start is None else block.init(start)
    return scan(block.step, belief, empty_tick).run(Tick(10_000_000 * np.arange(1, n + 1), u, slots))


def of_motion(nu, nu_dot):
    """Return the IMU measurements (N, 3) of ν, ν̇ (N, 3)."""
    return np.array([IMU.h(Motion(np.zeros(3), a, b, np.zeros(2))) for a, b in zip(nu, nu_dot, strict=True)])


def test_fast_speed_changes_follow_the_model_and_fade_with_the_blend_time():
    """The estimate responds to the model with T s / (T s + 1). If the wheels stay at rest with a command of
    0.5 m/s, they dominate after T."""
    n, time_s, lag_s = 400, 0.5, 0.61 / 1.2
    u = np.tile([0.4, 0.0, 0.0], (n, 1))
    z = {"imu": of_motion(np.zeros((n, 3)), np.zeros((n, 3))), "odometer": np.zeros((n, 1))}
    _, motion = estimate_of(blended(ODOMETER, blend_time_s=time_s), u, z)
    t_s, rates = DT * np.arange(1, n + 1), np.array([1.0 / lag_s, 1.0 / time_s])
    fading = np.exp(-np.outer(t_s, rates))
    exact = 0.5 / lag_s * (fading[:, 1] - fading[:, 0]) / (rates[0] - rates[1])
    np.testing.assert_allclose(motion.nu[:, 0], exact, atol=0.01)


def test_wheels_correct_the_speed_only_at_ticks_with_a_reading():
    n = 600
    v = np.full(n, 0.3)
    block = blended(ODOMETER, blend_time_s=0.2)
    slots = type(block.sensors)(
        Slot(np.ones(n), of_motion(np.zeros((n, 3)), np.zeros((n, 3))), np.zeros(n)),
        Slot((np.arange(n) % 2).astype(float), 1.02 * v[:, None], np.zeros(n)),
    )
    silent_tick = Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3, "odometer": 1}))
    ticks = Tick(10_000_000 * np.arange(1, n + 1), np.zeros((n, 3)), slots)
    _, motion = scan(block.step, block.init(), silent_tick).run(ticks)
    assert motion.nu[-1, 0] == pytest.approx(0.3, rel=0.01)


def test_slow_speed_changes_follow_the_wheels_with_any_model():
    n = 1000
    v = 0.3 * np.sin(0.2 * DT * np.arange(1, n + 1))
    z = {"imu": of_motion(np.zeros((n, 3)), np.zeros((n, 3))), "odometer": 1.02 * v[:, None]}
    _, motion = estimate_of(blended(ODOMETER, blend_time_s=0.1), np.zeros((n, 3)), z)
    np.testing.assert_allclose(motion.nu[:, 0], v, atol=0.01)


def test_the_heading_is_correct_at_a_lower_tick_rate():
    """A log at 10 Hz with a file of 100 Hz: 2 s at 0.5 rad/s are 1 rad."""
    block = blended()
    belief = block.init()
    for k in range(1, 22):
        z = of_motion(np.array([[0.0, 0.0, 0.5]]), np.zeros((1, 3)))[0]
        tick = Tick(100_000_000 * k, np.array([0.4, 0.0, 0.0]), type(block.sensors)(Slot(1.0, z)))
        belief, estimate = block.step(belief, tick)
    assert estimate.eta[2] == pytest.approx(1.0, rel=0.2)


def test_without_wheel_speeds_the_model_predicts_the_speed():
    n = 800
    u = np.tile([0.4, 0.0, 0.0], (n, 1))
    _, motion = estimate_of(blended(), u, {"imu": of_motion(np.zeros((n, 3)), np.zeros((n, 3)))})
    assert motion.nu[-1, 0] == pytest.approx(1.5 * 0.4 / 1.2, rel=0.01)
    block, silent_tick = blended(), Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3}))
    # the vehicle was driving before
    _, estimate = block.step(block.init(np.zeros(3), np.array([0.5, 0.0, 0.0])), silent_tick)
    assert estimate.nu[0] == pytest.approx(0.5, rel=0.03)


def test_the_gyro_bias_is_estimated_only_at_rest():
    n = 600
    error = np.array([0.0, 0.0, 0.03]) + of_motion(np.zeros((n, 3)), np.zeros((n, 3)))
    rest, motion = estimate_of(blended(rest_time_s=0.5), np.zeros((n, 3)), {"imu": error})
    assert float(rest.bias) == pytest.approx(0.03 / 1.03, rel=0.01)
    assert abs(motion.nu[-1, 2]) < 1e-3
    driving, _ = estimate_of(blended(rest_time_s=0.5), np.tile([0.4, 0.0, 0.0], (n, 1)), {"imu": error})
    assert float(driving.bias) == 0.0
    # by hand
    turning_state, _ = estimate_of(
        blended(rest_time_s=0.5), np.zeros((n, 3)), {"imu": np.array([0.0, 0.0, 1.0]) + error}
    )
    assert float(turning_state.bias) == 0.0


def test_the_complementary_filter_halves_the_wheel_noise_on_the_independent_truth():
    """The rms of the speed error over 8 s of 6 robots is less than half of that of the wheels, whose noise is white."""
    n, ticks, rng = 6, 800, np.random.default_rng(41)
    physics = draw_robots(n, 6)
    physics = physics.with_parameters(
        imu=physics.imu.with_parameters(bias=np.zeros((n, 3)), tilt_rad=np.zeros((n, 2)))
    )
    small = load("small")
    imu = Imu(lever_arm_m=np.array([0.02, 0.005]), accel_noise_std=np.array([0.1, 0.1]), gyro_noise_std=0.004)
    block = Complementary(small.vehicle, type(blended(ODOMETER).sensors)(imu, Odometer(noise_std=0.05)))
    u = np.column_stack([0.7 + 0.2 * np.sin(0.02 * np.arange(ticks)), np.zeros(ticks), np.zeros(ticks)])
    t_ns = tick_times(ticks, 1.0 / DT)
    motion = drive_group(physics, np.repeat(u[:, None], n, axis=1), range(n), t_ns, ROBOT_STEP_S)
    z, v = motion.readings.swapaxes(0, 1), motion.truth[:, :, 3].T
    readings = v + 0.05 * rng.standard_normal(v.shape)
    speeds = [
        estimate_of(block, u, {"imu": z[i], "odometer": readings[i][:, None]})[1].nu[:, 0] for i in range(n)
    ]
    assert np.sqrt(np.mean((np.array(speeds) - v) ** 2)) < 0.5 * 0.05


def test_the_bias_stays_while_the_gyro_is_silent():
    block, noise = compile_block(blended(), "c"), np.random.default_rng(0)
    slots = type(block.sensors)
    belief = block.init()
    for k in range(1, 4001):
        is_silent = k > 1000
        z = np.array([0.0, 0.0, 0.02 + 0.005 * noise.standard_normal()])
        slot = Slot(0.0, np.zeros(3)) if is_silent else Slot(1.0, z)
        belief, _ = block.step(belief, Tick(k * 10_000_000, np.zeros(3), slots(slot)))
        if k == 1000:
            bias = belief.bias
    assert belief.bias == bias
