"""The integrator, tested by the order of its error, and the process noise added after it."""

import dataclasses

import numpy as np
import pytest

from baqueano.block_checks import check_vehicle
from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar, constant_effort
from baqueano.vehicles.rk4 import rk4

NONE = constant_effort(np.zeros(1))
T = np.diag([2.0, 1.0, 0.5])
FRICTION = Friction(linear=np.array([2.0, 6.0, 0.5]), quadratic=np.array([0.5, 0.0, 0.1]), cornering=0.3)
CASES = {
    "planar": (
        Planar(2.0, 0.5, T, centre_of_mass_x_m=0.1, friction=FRICTION, slope_rad=0.2),
        np.array([1.0, 0.0, 0.6]),
    ),
    "kinematic": (Kinematic(T), np.array([1.0, 0.3, 4.0])),
    "car": (
        Car(wheelbase_m=0.3, throttle_gain=4.0, steering_gain=0.3, linear_drag=2.0, yaw_lag_s=0.2),
        np.array([0.8, 0.9]),
    ),
}


def end(vehicle, effort, steps, duration_s=0.8):
    eta, nu = np.zeros(3), np.array([0.5, 0.0, 0.3])
    for _ in range(steps):
        eta, nu, _ = vehicle.advance(eta, nu, constant_effort(effort), duration_s / steps)
    return np.concatenate([eta, nu])


@pytest.mark.parametrize("name", CASES)
def test_the_integration_error_is_of_fourth_order(name):
    vehicle, effort = CASES[name]
    exact = end(vehicle, effort, 640)
    steps = np.array([20, 40, 80])
    errors = [np.linalg.norm(end(vehicle, effort, n) - exact) for n in steps]
    slope = np.polyfit(np.log(1.0 / steps), np.log(errors), 1)[0]
    assert 3.8 < slope < 4.4


@pytest.mark.parametrize("lag_s", [0.0, 1e-4, 0.002, 0.01])
def test_a_short_lag_of_a_car_is_stable_over_the_longest_step(lag_s):
    """At 50 Hz a row may last 25 ms."""
    car = Car(wheelbase_m=0.3, throttle_gain=4.0, steering_gain=0.3, linear_drag=2.0, yaw_lag_s=lag_s)
    turn_rate = end(car, np.array([0.8, 0.9]), 320, duration_s=8.0)[5]
    assert turn_rate == pytest.approx(end(car, np.array([0.8, 0.9]), 1600, duration_s=8.0)[5], rel=1e-6)


def test_rk4_is_exact_for_a_polynomial_of_the_third_degree():
    x = rk4(lambda x, e: np.array([1.0, 3.0 * x[0] ** 2]), np.zeros(2), NONE, 0.7)
    assert x == pytest.approx([0.7, 0.7**3], abs=1e-15)


def test_rk4_is_stable_below_2_785_time_constants_and_not_above():
    def factor(ratio):
        return abs(rk4(lambda x, e: -x, np.ones(1), NONE, ratio)[0])

    assert factor(2.78) < 1.0 < factor(2.79)


@pytest.mark.parametrize("name", CASES)
def test_the_returned_acceleration_is_taken_at_the_end_of_the_step(name):
    vehicle, effort = CASES[name]
    eta, nu = np.array([0.0, 0.0, 0.4]), np.array([0.5, 0.0, 0.3])
    if name == "kinematic":
        expected = (vehicle.velocity_matrix @ effort - nu) / 0.01
        assert vehicle.advance(eta, nu, constant_effort(effort), 0.01)[2] == pytest.approx(expected)
        return
    eta_end, nu_end, nu_dot = vehicle.advance(eta, nu, constant_effort(effort), 0.01)
    np.testing.assert_allclose(nu_dot, vehicle.nu_dot(nu_end, effort, eta_end[2]), rtol=1e-9)


def test_a_kinematic_tick_without_duration_has_no_acceleration():
    _, _, nu_dot = CASES["kinematic"][0].advance(np.zeros(3), np.zeros(3), constant_effort(np.ones(3)), 0.0)
    assert np.array_equal(nu_dot, np.zeros(3))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("dt_s", [0.01, 0.04])
def test_process_noise_is_added_to_the_velocity_once_per_tick(name, dt_s):
    """σ √δ per tick, so that ν walks by σ² a second at any rate; a kinematic ν scatters by σ."""
    vehicle, effort = CASES[name]
    std, noise = np.array([0.3, 0.2, 0.1]), np.array([1.0, -2.0, 0.5])
    noisy = dataclasses.replace(vehicle, process_noise_std=std)
    exact_state, _ = vehicle.step(vehicle.init(), effort, dt_s, noise)
    noisy_state, motion = noisy.step(noisy.init(), effort, dt_s, noise)
    kick = std * noise * (1.0 if name == "kinematic" else np.sqrt(dt_s))
    if name == "car":
        kick[1] = 0.0  # the rear axle does not slip
    assert noisy_state.nu - exact_state.nu == pytest.approx(kick)
    assert np.array_equal(motion.nu, noisy_state.nu)
    assert np.array_equal(motion.nu_dot, noisy_state.nu_dot)


@pytest.mark.parametrize("name", CASES)
def test_a_vehicle_passes_the_vehicle_check(name):
    assert check_vehicle(CASES[name][0]) == []


SMALL_MOTORS = Planar(  # 0.61 kg on two geared motors: the stiffest friction that a ready vehicle has
    0.61,
    1.4945e-3,
    np.array([[3.7, 0.0, 0.11], [0.0, 0.0, 0.0], [0.0066, 0.0, 0.22]]),
    friction=Friction(
        linear=np.array([4.0, 40.0, 0.0155]),
        coulomb=np.array([0.66, 0.0, 0.02]),
        coulomb_speed=np.array([0.03, 0.05, 0.3]),
    ),
    drivetrain=Drivetrain(mixing="two_wheels", lag_s=0.03),
)


def test_dry_friction_of_small_motors_is_far_from_unstable_at_100_hz():
    """Fastest modes: m/(d_l + d_k/ν_k) = 23 ms forward, m/d_ly = 15 ms sideways; RK4 is stable down to 3.6 ms."""
    nu_dot, h = SMALL_MOTORS.nu_dot, 1e-6
    columns = [(nu_dot(h * e, np.zeros(3)) - nu_dot(-h * e, np.zeros(3))) / (2.0 * h) for e in np.eye(3)]
    fastest = np.max(np.abs(np.linalg.eigvals(np.stack(columns, axis=1))))
    assert fastest == pytest.approx(40.0 / 0.61, rel=1e-6)
    assert fastest * 0.01 < 2.785 / 4.0


def test_dry_friction_of_small_motors_is_integrated_within_a_millimetre_a_second():
    """Four seconds with starts, stops and reversals, at 100 Hz and at 1 kHz."""
    u = np.repeat([[0.6, 0.0, 0.2], [-0.5, 0.0, 0.1], [0.0, 0.0, 0.0], [0.5, 0.0, -0.3]], 100, axis=0)

    def ends(parts):
        state = SMALL_MOTORS.init()
        for row in np.repeat(u, parts, axis=0):
            state, _ = SMALL_MOTORS.step(state, row, 0.01 / parts, np.zeros(3))
        return np.concatenate([state.eta, state.nu])

    assert ends(1) == pytest.approx(ends(10), abs=4e-3)
