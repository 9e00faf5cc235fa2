"""The recommended filter: the sensor that determines each state, the estimated biases, the stated uncertainty."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from baqueano.estimators import AugmentedEkf
from baqueano.estimators.augmented.motion import disturbance_variance
from baqueano.estimators.augmented.state import BEND_INDEX, BIAS_INDEX, SCALE_INDEX, layout, start_std
from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.geometry import wrap
from baqueano.runs.filter_ticks import example_filter_tick
from baqueano.sensors import Imu, Odometer, Pose, Wheels
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.truth import draw_robots, merge
from baqueano.symbolic import compile_block, scan
from baqueano.vehicle_file import load
from baqueano.vehicles import Drivetrain, Friction, Kinematic, Planar
from tests.codes import refused

FRICTION = Friction(linear=np.array([3.0, 40.0, 0.012]))
SMALL = Planar(
    mass_kg=0.61, inertia_kg_m2=0.0015, actuator_matrix=np.diag([3.0, 0.0, 0.1]), friction=FRICTION
)
IMU = Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005, gyro_bias_walk=1e-5)
ODOMETER = Odometer(noise_std=0.01)
BOTH = sensor_slots(("imu", "odometer"))
PERIOD_NS = 10_000_000
U = (0.3, 0.0, 0.1)


@cache
def filter_of(**options):
    return compile_block(AugmentedEkf(SMALL, BOTH(IMU, ODOMETER), **options), "c")


def tick(k, imu=None, speed=None, u=U):
    slots = [
        Slot(0.0, np.zeros(m)) if z is None else Slot(1.0, np.array(z, dtype=float))
        for z, m in ((imu, 3), (None if speed is None else [speed], 1))
    ]
    return Tick(k * PERIOD_NS, np.array(u), BOTH(*slots))


def run(block, ticks, belief=None):
    belief, estimate = block.init() if belief is None else belief, None
    for tick in ticks:
        belief, estimate = block.step(belief, tick)
    return belief, estimate


@pytest.mark.parametrize("rate", [-3.0, 0.4, 2.0])
def test_the_heading_follows_the_gyro_despite_a_wrong_turning_model(rate):
    belief, _ = run(filter_of(), (tick(k, (0.0, 0.0, rate)) for k in range(1, 50)))
    after, estimate = run(filter_of(), (tick(k, (0.0, 0.0, rate)) for k in range(50, 150)), belief)
    assert wrap(after.mean[2] - belief.mean[2] - rate) == pytest.approx(0.0, abs=0.005)
    assert estimate.nu[2] == pytest.approx(rate, rel=2e-3)


def test_an_error_of_the_motor_lag_disturbs_the_yaw_rate_only_while_the_effort_changes():
    motors = replace(SMALL, drivetrain=Drivetrain(lag_s=0.05))
    block = AugmentedEkf(motors, BOTH(IMU, ODOMETER), motor_lag_std_s=0.02)
    _, effort = motors.drivetrain.step(motors.drivetrain.init(), np.array(U), 0.01)
    added_variance = disturbance_variance(block, np.zeros(12), effort) - block.disturbance_std**2
    np.testing.assert_allclose(added_variance, [0.0, (0.02 * 0.1 / 0.0015 * effort.mean_rate[2]) ** 2])
    _, effort = motors.drivetrain.step(motors.drivetrain.steady_state(np.array(U)), np.array(U), 0.01)
    np.testing.assert_array_equal(disturbance_variance(block, np.zeros(12), effort), block.disturbance_std**2)


@pytest.mark.parametrize("noise_gain", [0.0, 0.01])
def test_a_lasting_disagreement_with_the_model_does_not_turn_the_heading_away_from_the_gyro(noise_gain):
    block = filter_of(noise_gain=noise_gain)
    belief, _ = run(block, (tick(k, (0.0, 0.0, 2.0)) for k in range(1, 200)))
    after, _ = run(block, (tick(k, (0.0, 0.0, 2.0)) for k in range(200, 1200)), belief)
    assert wrap(after.mean[2] - belief.mean[2] - 20.0) == pytest.approx(0.0, abs=1e-3)


def test_the_region_of_the_position_contains_each_heading_of_its_own_95_percent():
    imu = replace(IMU, gyro_scale_std=0.0145, gyro_bias_std=1e-6)
    options = {"disturbance_std": np.array([1e-3, 3.0]), "velocity_walk_std": np.array([1e-4, 1e-4, 1e-3])}
    ekf = compile_block(AugmentedEkf(SMALL, BOTH(imu, ODOMETER), course_std=1e-4, **options), "c")
    belief, square, place = ekf.init(), [], np.zeros(2)
    for k in range(1, 2001):
        before = belief.mean[2]
        belief, estimate = ekf.step(belief, tick(k, (0.0, 0.0, 1.0)))
        psi = before + 0.5 * wrap(belief.mean[2] - before) - 1.96 * np.sqrt(estimate.cov[2, 2])
        place = place + 0.01 * estimate.nu[0] * np.array([np.cos(psi), np.sin(psi)])
        error = estimate.eta[:2] - place
        square.append(error @ np.linalg.solve(estimate.cov[:2, :2], error))
    assert np.sqrt(estimate.cov[2, 2]) == pytest.approx(0.29, abs=0.01)
    assert max(square[500:]) < CHI_SQUARE_95


def test_without_a_speed_sensor_the_model_predicts_the_speed():
    silent, _ = run(filter_of(), (tick(k) for k in range(1, 200)))
    turning, _ = run(filter_of(), (tick(k, (3.0, -2.0, 4.0)) for k in range(1, 200)))
    assert turning.mean[3] == pytest.approx(silent.mean[3], rel=1e-9)
    assert silent.mean[3] > 0.2


def test_trusted_accelerometers_correct_the_speed():
    filter_with_speed = filter_of(speed_from=("imu[1]",))
    belief, _ = run(filter_of(), (tick(k, (0.0, 1.5, 3.0)) for k in range(1, 200)))
    moving, _ = run(filter_with_speed, (tick(k, (0.0, 1.5, 3.0)) for k in range(1, 200)))
    assert abs(moving.mean[3] - belief.mean[3]) > 0.05


def test_an_odometer_determines_the_speed_and_the_gyro_the_heading():
    block = filter_of(use=("imu", "odometer"))
    belief, estimate = run(block, (tick(k, (0.0, 0.0, 1.0), 0.6) for k in range(1, 200)))
    gyro_only, _ = run(filter_of(), (tick(k, (0.0, 0.0, 1.0)) for k in range(1, 200)))
    assert estimate.nu[0] == pytest.approx(0.6, abs=0.01)
    assert wrap(belief.mean[2] - gyro_only.mean[2]) == pytest.approx(0.0, abs=1e-3)


def test_sideways_process_noise_fades_within_one_tick():
    """The tyres stop sideways motion within 15 ms, and a tick lasts 10 ms: the remaining variance is σ² τ/2."""
    belief, _ = run(filter_of(), (tick(k, u=(0.0, 0.0, 0.0)) for k in range(1, 45)))
    fade_s = SMALL.mass_kg / FRICTION.linear[1]
    assert belief.cov[4, 4] == pytest.approx(0.5 * fade_s * filter_of().velocity_walk_std[1] ** 2, rel=0.03)


def test_a_gyro_reading_also_corrects_the_sideways_velocity_of_a_car():
    """ν_y = l ν_ψ of a car also holds for a correction by its gyro; the covariance contains this correlation."""
    car = load("car")
    block = compile_block(car.estimator(use=("imu",)), "c")
    resting = [Slot(0.0, np.zeros(sensor.size)) for sensor in car.sensors]
    slots, l = type(block.sensors), car.vehicle.rear_axle_m
    belief = block.init()
    for k, rate in enumerate([0.0] * 50 + [0.4] * 50):
        readings = slots(*resting)._replace(imu=Slot(1.0, np.array([0.0, 0.0, rate])))
        belief, _ = block.step(belief, Tick((k + 1) * 2 * PERIOD_NS, np.array([0.3, 0.0]), readings))
    assert belief.mean[4] == pytest.approx(l * belief.mean[5], rel=1e-3)
    assert belief.cov[4, 5] == pytest.approx(l * belief.cov[5, 5], rel=1e-3)
    assert belief.cov[4, 4] == pytest.approx(l**2 * belief.cov[5, 5], rel=0.1)


def test_a_bias_is_estimated_only_at_rest():
    rest = [tick(k, (0.1, 0.0, 0.004), u=(0.0, 0.0, 0.0)) for k in range(1, 300)]
    resting, _ = run(filter_of(), rest)
    driving, _ = run(filter_of(), (tick(k, (0.1, 0.0, 0.004)) for k in range(1, 300)))
    assert resting.mean[-1] == pytest.approx(0.004, rel=0.1)
    assert driving.mean[-1] == 0.0
    assert np.sqrt(resting.cov[-1, -1]) < 0.4 * IMU.gyro_bias_std
    assert resting.mean[:6] == pytest.approx(np.zeros(6), abs=2e-3)


def test_the_estimate_follows_the_gyro_of_a_vehicle_turned_by_hand():
    rest, _ = run(filter_of(), (tick(k, (0, 0, 0), u=(0, 0, 0)) for k in range(1, 200)))
    _, carried_estimate = run(filter_of(), (tick(k, (0, 0, 1.0), u=(0, 0, 0)) for k in range(200, 230)), rest)
    assert carried_estimate.nu[2] == pytest.approx(1.0, rel=0.02)


def test_a_gyro_spike_is_rejected_and_a_lasting_turn_is_followed():
    belief, _ = run(filter_of(), (tick(k, (0, 0, 0.5)) for k in range(1, 100)))
    spike, _ = run(filter_of(), [tick(100, (0, 0, 17.0))], belief)
    silent, _ = run(filter_of(), [tick(100)], belief)
    assert spike.mean[:8] == pytest.approx(silent.mean[:8], abs=1e-3)
    _, turning = run(filter_of(), (tick(k, (0, 0, 0.9)) for k in range(100, 104)), belief)
    assert turning.nu[2] == pytest.approx(0.9, rel=0.05)


def test_an_impossible_yaw_rate_is_never_followed():
    belief, _ = run(filter_of(), (tick(k, (0, 0, 0.5)) for k in range(1, 100)))
    after, _ = run(filter_of(), (tick(k, (0, 0, 500.0)) for k in range(100, 200)), belief)
    assert abs(after.mean[5]) < 1.0


def test_rt8_a_saturated_gyro_reading_is_not_used():
    imu_with_limit = replace(IMU, gyro_limit=4.0)
    block = compile_block(AugmentedEkf(SMALL, BOTH(imu_with_limit, ODOMETER)), "c")
    _, estimate = run(block, (tick(k, (0, 0, 4.0)) for k in range(1, 100)))
    assert np.isnan(estimate.innovation[2])
    assert estimate.nu[2] < 1.0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_one_nan_does_not_discard_the_other_readings_of_its_sensor(value):
    belief, _ = run(filter_of(), (tick(k, (0, 0, 0.5)) for k in range(1, 100)))
    expected, _ = run(filter_of(), [tick(100, (0, 0, 0.6))], belief)
    belief_after, estimate = run(filter_of(), [tick(100, (value, 0, 0.6))], belief)
    assert belief_after.mean == pytest.approx(expected.mean)
    assert np.isnan(estimate.innovation).tolist() == [True, False, False]


def test_scale_uncertainty_widens_the_heading_covariance_with_the_turned_angle():
    belief, estimate = run(filter_of(), (tick(k, (0.0, 0.0, 2.0)) for k in range(1, 500)))
    assert belief.mean[SCALE_INDEX:BIAS_INDEX] == pytest.approx(np.zeros(5), abs=1e-12)
    turn_rad, bias = 2.0 * 5.0, IMU.gyro_bias_std * 5.0
    assert np.sqrt(estimate.cov[2, 2]) == pytest.approx(
        np.hypot(IMU.gyro_scale_std * turn_rad, bias), rel=0.05
    )


@pytest.mark.parametrize(("gyro", "wheel"), [(0.015, 0.002), (0.002, 0.015)])
def test_wheels_beside_a_gyro_do_not_make_its_scale_more_certain(gyro, wheel):
    """The gyro alone determines the heading: with a scale 1.9 standard deviations wrong, the claim was 2.8."""
    sensors = sensor_slots(("imu", "wheels"))
    wheels = Wheels(track_m=0.12, radius_scale_std=wheel, noise_std=0.01)
    imu = replace(IMU, gyro_scale_std=gyro)
    assert start_std(AugmentedEkf(SMALL, sensors(imu, wheels), use=("imu", "wheels")))[
        SCALE_INDEX : SCALE_INDEX + 2
    ] == pytest.approx([wheel, gyro])
    by_wheels = start_std(AugmentedEkf(SMALL, sensors(imu, wheels), use=("wheels",)))
    assert by_wheels[SCALE_INDEX : SCALE_INDEX + 2] == pytest.approx([wheel, wheel])


def test_a_pose_sensor_corrects_the_whole_state():
    sensors = sensor_slots(("imu", "pose"))(IMU, Pose(noise_std=np.array([0.01, 0.01, 0.02])))
    slots = layout(AugmentedEkf(SMALL, sensors, use=("imu", "pose")))
    # the curvature of the region is considered
    assert np.all(np.delete(slots.moving_mask[3:], BEND_INDEX, axis=1) == 1.0)
    assert not np.any(slots.moving_mask[2, BIAS_INDEX:]), "an error of the model is not a bias of the gyro"
    assert not np.any(layout(AugmentedEkf(SMALL, sensors)).moving_mask[:, SCALE_INDEX:])


def test_the_filter_of_a_kinematic_vehicle_follows_its_sensors():
    vehicle = Kinematic(velocity_matrix=np.diag([0.5, 0.0, 2.0]), drivetrain=Drivetrain(commands=3))
    block = compile_block(AugmentedEkf(vehicle, BOTH(IMU, ODOMETER), use=("imu[2]", "odometer")), "c")
    belief, estimate = run(block, (tick(k, (0.0, 0.0, 1.0), 0.4) for k in range(1, 200)))
    assert estimate.nu[[0, 2]] == pytest.approx([0.4, 1.0], rel=0.05)
    assert np.linalg.eigvalsh(belief.cov)[0] > 0.0


def test_an_unknown_sensor_name_is_refused():
    with refused("field.use", ValueError, valid="imu, odometer"):
        AugmentedEkf(SMALL, BOTH(IMU, ODOMETER), use=("camera[2]",))


def test_heading_errors_match_their_covariance_on_the_independent_truth():
    """The 40 robots differ from the file; their gyro scale is known to 3 % and their bias to 0.002 rad/s. If the
    claim is true, the mean of 40 NEES lies between 0.58 and 1.52 in 99 of 100 such studies."""
    seeds, ticks, rng = range(40), 1000, np.random.default_rng(7)
    robots = merge([draw_robots(1, seed) for seed in seeds])
    scale, bias = 1.0 + 0.03 * rng.standard_normal(len(seeds)), 0.002 * rng.standard_normal(len(seeds))
    u = np.zeros((ticks, 3))
    u[:, 0], u[:, 2] = 0.5, np.repeat(rng.uniform(0.1, 0.5, ticks // 50), 50)
    file = load("small").with_values({"sensors.imu.gyro_bias": 0.0, "sensors.imu.gyro_scale_std": 0.03})
    block = replace(file.estimator(), use=("imu[2]",))
    motion = drive_group(
        robots, np.repeat(u[:, None], len(seeds), axis=1), seeds, tick_times(ticks, 100.0), ROBOT_STEP_S
    )
    z = motion.readings.swapaxes(0, 1)
    z[..., 2] = scale[:, None] * (z[..., 2] - robots.imu.bias[:, 2:]) + bias[:, None]
    kernel, new, t_ns = (
        scan(block.row, block.init(), example_filter_tick(block)),
        np.ones(ticks),
        np.arange(ticks),
    )
    slots = [type(block.sensors)(Slot(new, of_robot, 0.0 * new)) for of_robot in z]
    ends = [kernel.run(Tick((t_ns + 1) * PERIOD_NS, u, slot))[1] for slot in slots]
    error = wrap(np.array([estimate.eta[-1, 2] for estimate in ends]) - motion.truth[-1, :, 2])
    assert 0.58 < np.mean(error**2 / [estimate.cov[-1, 2, 2] for estimate in ends]) < 1.52
