"""The first drive of an unknown vehicle: small motions near its start, an early end, and a report."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.drive import first_drive, first_drive_pulses, with_rough_gains
from baqueano.drive.first_drive import directions, estimate_first_drive, find_pulses
from baqueano.drive.first_drive_pulses import MIN_SIGMA, PAUSE_S, PULSE_S, STEP, PulsePlanner
from baqueano.errors import AnswerNo, UsageError
from baqueano.estimators import Inertial
from baqueano.messages import text
from baqueano.signals import Estimate, Slot, Tick, sensor_slots
from baqueano.study.counterpart import LoopWorld
from baqueano.study.first_drives import MiswiredLink, draw_unknown_robot, drive_unknown_vehicle, gain_ratios
from baqueano.study.truth import draw_robots
from baqueano.vehicle_file import load
from tests.codes import refused


@pytest.fixture(scope="module")
def small():
    return load("small")


@pytest.fixture(scope="module")
def first(small):
    """Return the first drive of the vehicle that the file describes."""
    return first_drive(small, seed=1)


@pytest.mark.parametrize("seed", [1, 7])
def test_an_unknown_vehicle_stays_near_its_start_and_its_wiring_is_identified(seed):
    drive = drive_unknown_vehicle(seed)
    assert drive.margin_m > 0.3  # of the available 0.68 m
    assert drive.is_named
    assert drive.seconds < 120.0


def test_command_levels_begin_small_and_grow_in_small_steps(first):
    sizes = {}
    for pulse in first.pulses:
        sizes.setdefault(tuple(np.sign(pulse.u)), []).append(np.max(np.abs(pulse.u)))
    assert len(sizes) == 4
    for levels in sizes.values():
        assert levels[0] <= 0.5 * STEP + 1e-9
        assert np.all(np.diff(levels) <= 0.06)


def test_no_pulse_exceeds_the_longest_permitted_duration(first, small):
    on = np.any(first.run.applied_commands != 0.0, axis=1)
    edges = np.flatnonzero(np.diff(on.astype(int), prepend=0, append=0))
    lengths, pauses = edges[1::2] - edges[::2], edges[2::2] - edges[1:-1:2]
    assert np.max(lengths) <= round(PULSE_S * small.rate_hz) + 1
    assert np.min(pauses) >= round(PAUSE_S * small.rate_hz) - 1


def test_the_dead_zones_of_each_wheel_are_identified(first, small):
    start = with_rough_gains(first, small).vehicle.drivetrain
    np.testing.assert_allclose(start.dead_zone_forward, [0.32, 0.27], atol=0.03)
    np.testing.assert_allclose(start.dead_zone_backward, [0.34, 0.29], atol=0.03)


@pytest.mark.parametrize("seed", [4])
def test_the_estimated_gain_is_within_40_percent_of_the_true_gain(small, seed):
    robot = draw_unknown_robot(seed)
    gain = gain_ratios(robot, small)
    first = first_drive(small, world=LoopWorld(robot, seed, small.rate_hz), seed=seed)
    assert first.forward_gain == pytest.approx(gain[0], rel=0.4)
    assert first.turn_gain == pytest.approx(gain[1], rel=0.4)
    start = with_rough_gains(first, small).vehicle.actuator_matrix
    assert start[2, 2] == pytest.approx(small.vehicle.actuator_matrix[2, 2] * gain[1], rel=0.4)


def test_a_wrongly_wired_vehicle_is_reported_and_not_fitted(small):
    world = MiswiredLink(LoopWorld(draw_robots(1, 3), 3, small.rate_hz), "swapped")
    first = first_drive(small, world=world)
    assert [finding.code for finding in first.wiring] == ["wiring.swapped"]
    assert text(first.wiring[0]) in first.table()
    with refused("wiring.swapped", AnswerNo):
        with_rough_gains(first, small)


def test_an_immobile_vehicle_is_reported_after_full_command(small, monkeypatch):
    monkeypatch.setattr(first_drive_pulses, "STEP", 0.4)
    stuck_vehicle = small.with_values({"model.drivetrain.gain": [0.0, 0.0]})
    first = first_drive(small, truth=stuck_vehicle, seed=2)
    assert len(first.no_motion) == 4
    assert first.no_motion[0].figures["command"] == "the left wheel forward"
    assert first.moving_pulses == 0
    with refused("first-drive.nothing-moved", AnswerNo):
        with_rough_gains(first, small)


def test_a_first_drive_that_ends_early_reports_no_motor_fault(first, small):
    estimate = estimate_first_drive(first.run.cut(0.0, 10.0), small)
    assert estimate.no_motion
    assert {finding.code for finding in estimate.no_motion} == {"first-drive.ended-early"}
    assert estimate.no_motion[0].figures["command"] == "the left wheel forward"
    assert estimate.no_motion[0].figures["command_percent"] == pytest.approx(8.0, abs=0.5)


@pytest.mark.parametrize("seed", [2, 19, 21, 22])
def test_motion_of_a_car_is_detected_with_a_noisy_accelerometer(seed):
    """Its noise of 0.6 m/s², integrated twice over a minute, is not mistaken for a distance."""
    first = first_drive(load("car"), seed=seed)
    assert first.no_motion == ()
    assert 0.5 < first.forward_gain < 2.0
    assert np.max(np.hypot(*first.run.truth.eta[:, :2].T)) < 0.6


def test_a_car_with_unequal_dead_zones_stays_near_its_start():
    car = load("car")
    zones = {
        "model.drivetrain.dead_zone_forward": [0.04, 0.0],
        "model.drivetrain.dead_zone_backward": [0.28, 0.0],
    }
    first = first_drive(
        car, truth=car.with_values(zones | {"sensors.imu.accel_noise_std": [0.1, 0.1]}), seed=1
    )
    assert first.no_motion == ()
    assert np.max(np.hypot(*first.run.truth.eta[:, :2].T)) < 0.3


def test_a_car_drives_both_ways_with_three_steering_angles():
    car = load("car")
    assert directions(car).tolist() == [[1, 0], [-1, 0], [1, 0.5], [-1, 0.5], [1, -0.5], [-1, -0.5]]


def test_a_first_drive_needs_an_imu(small):
    blind = SimpleNamespace(name="blind", sensors=sensor_slots(())())
    with refused("first-drive.no-imu", UsageError):
        first_drive(blind)


def test_a_vehicle_without_limit_is_refused(small):
    endless = SimpleNamespace(
        name="endless", vehicle=small.vehicle, command=SimpleNamespace(limit=np.full(3, np.inf))
    )
    with refused("first-drive.limit", UsageError):
        directions(endless)


def test_a_run_without_estimates_is_refused_as_a_first_drive(first):
    from dataclasses import replace

    with refused("first-drive.no-estimates", UsageError):
        find_pulses(replace(first.run, estimate=None))


def estimate(t_s, v=0.0, omega=0.0, std=1e-3):
    cov = np.zeros((6, 6))
    cov[2, 2] = cov[3, 3] = cov[5, 5] = std**2
    return Estimate(round(t_s * 1e9), np.zeros(3), np.array([v, 0.0, omega]), cov)


def test_a_pulse_ends_at_once_when_the_vehicle_turns_too_fast():
    pulses = PulsePlanner(np.array([[1.0], [-1.0]]))
    state, t_s, u = pulses.init(), 0.0, np.zeros(1)
    while not np.any(u):
        state, u, _ = pulses.advance(state, estimate(t_s))
        t_s += 0.01
    assert u == pytest.approx(STEP)
    state, u, _ = pulses.advance(state, estimate(t_s, omega=3.0))
    assert u == 0.0
    for _ in range(round(PAUSE_S / 0.01) + 2):
        t_s += 0.01
        state, u, _ = pulses.advance(state, estimate(t_s))
    assert state.is_done[0]
    assert u < 0.0  # the other direction is next


def test_a_first_drive_ends_within_its_time_limit():
    pulses = PulsePlanner(np.array([[1.0], [-1.0]]), max_duration_s=3.0)
    state, t_s, over = pulses.init(), 0.0, False
    while not over:
        state, u, over = pulses.advance(state, estimate(t_s))
        t_s += 0.01
    assert t_s <= 3.02
    assert np.all(u == 0.0)


def test_inertial_motion_is_the_integral_of_the_unbiased_imu():
    slots = sensor_slots(("imu",))
    rng, estimator = np.random.default_rng(0), Inertial()
    state, bias = estimator.init(), np.array([0.3, 0.0, 0.05])
    for k in range(400):
        moving = k >= 300
        z = bias + moving * np.array([0.5, 0.0, 0.8]) + 0.01 * rng.standard_normal(3)
        tick = Tick(round((k + 1) * 1e7), np.array([float(moving)]), slots(Slot(1.0, z)))
        state, pose = estimator.step(state, tick)
    assert pose.nu[0] == pytest.approx(0.5, abs=5.0 * np.sqrt(pose.cov[3, 3]))
    assert pose.eta[2] == pytest.approx(0.8, abs=5.0 * np.sqrt(pose.cov[2, 2]))
    assert np.sqrt(pose.cov[3, 3]) == pytest.approx(0.01 * 0.01 * np.sqrt(100 + 100**2 / 300), rel=0.15)


@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
def test_inertial_motion_does_not_depend_on_the_rate_of_the_loop(rate_hz):
    """An accelerometer of 50 Hz is silent in most ticks; its acceleration of 0.4 m/s² lasts half a second."""
    inertial, ticks_per_reading = Inertial(), round(rate_hz / 50.0)
    state, first_ns = inertial.init(), round(1e9 / rate_hz)
    for k in range(round(1.5 * rate_hz)):
        moves = k >= rate_hz
        slot = Slot(float(k % ticks_per_reading == 0), np.array([1.0 + 0.4 * moves, 0.0, 0.3 + 0.2 * moves]))
        tick = Tick(first_ns * (k + 1), np.full(3, float(moves)), sensor_slots(("imu",))(slot))
        state, motion = inertial.step(state, tick)
    np.testing.assert_allclose(motion.nu, [0.2, 0.0, 0.2], atol=0.01)
    np.testing.assert_allclose(motion.eta, [0.05, 0.0, 0.1], atol=0.01)


def test_inertial_motion_ignores_readings_that_are_nan_or_not_newer():
    slots, ends = sensor_slots(("imu",)), []
    for is_damaged in (False, True):
        inertial = Inertial()
        state = inertial.init()
        for k in range(1, 201):
            moves = k > 100
            z = np.array([0.4 * moves, 0.0, 0.2 * moves])
            state, motion = inertial.step(
                state, Tick(k * 10**7, np.full(3, float(moves)), slots(Slot(1.0, z)))
            )
            if is_damaged and k % 20 == 0:
                for t_ns, reading in ((k * 10**7 + 10**6, z * np.nan), ((k - 5) * 10**7, z + 1.0)):
                    state, motion = inertial.step(
                        state, Tick(t_ns, np.full(3, float(moves)), slots(Slot(1.0, reading)))
                    )
        ends.append(motion)
    np.testing.assert_array_equal(ends[0].eta, ends[1].eta)
    np.testing.assert_array_equal(ends[0].nu, ends[1].nu)


def test_inertial_speed_uses_the_latest_rest_on_a_sloping_floor():
    """After a turn on a floor of 3° the accelerometer at rest reads 0.5 m/s² more."""
    slots, errors = sensor_slots(("imu",)), []
    for seed in range(60):
        rng, estimator = np.random.default_rng(seed), Inertial()
        state = estimator.init()
        for k in range(600):
            drives = 200 <= k < 225 or 400 <= k < 425
            slope, a = 0.5 * (k >= 225), 0.4 * (400 <= k < 425)
            z = np.array([slope + a, 0.0, 0.0]) + 0.05 * rng.standard_normal(3)
            tick = Tick(round((k + 1) * 1e7), np.array([float(drives)]), slots(Slot(1.0, z)))
            state, pose = estimator.step(state, tick)
            if k == 424:
                errors.append([pose.nu[0] - 0.1, pose.cov[3, 3]])
                assert pose.cov[3, 3] < 0.15**2, "the change of gravity is within the standard deviation"
            if k == 460:
                assert pose.nu[0] > 0.05, "the vehicle still moves"
    error, var = np.array(errors).T
    assert np.mean(error) == pytest.approx(0.0, abs=0.005)
    assert np.all(np.abs(error) < 3.0 * np.sqrt(var))


def test_a_pulse_is_significant_for_a_sensor_without_noise():
    """The simulator of a user can have exact sensors."""
    slots, estimator, pulses = sensor_slots(("imu",)), Inertial(), PulsePlanner(np.array([[1.0]]))
    belief, state, v = estimator.init(), pulses.init(), 0.0
    for k in range(300):
        tick = Tick(
            (k + 1) * 10**7, np.array([float(k >= 200)]), slots(Slot(1.0, np.array([k >= 200, 0, 0])))
        )
        belief, estimate = estimator.step(belief, tick)
        state, _, _ = pulses.advance(state, estimate)
        v = max(v, state.significance)
    assert v > MIN_SIGMA


def test_inertial_distance_error_matches_its_covariance():
    """The vehicle is at rest, with and without the later knowledge that its speed was noise."""
    slots, ends = sensor_slots(("imu",)), {False: [], True: []}
    for seed in range(300):
        rng, estimator = np.random.default_rng(seed), Inertial()
        state = estimator.init()
        for k in range(300):
            on = 200 <= k < 225
            tick = Tick(round((k + 1) * 1e7), np.array([float(on)]), slots(Slot(1.0, rng.standard_normal(3))))
            state, pose = estimator.step(state, tick)
            if k in (283, 299):
                ends[k == 299].append(pose.eta[0] / np.sqrt(pose.cov[0, 0]))
    for errors in ends.values():
        assert np.std(errors) == pytest.approx(1.0, abs=0.15)
