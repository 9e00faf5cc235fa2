"""Physics that a student can calculate by hand. These cases test the physics, not the code."""

import numpy as np
import pytest

from baqueano.vehicles import Car, Drivetrain, Friction, Kinematic, Planar, constant_effort

REST = np.zeros(3)
G = 9.80665


def planar(**fields) -> Planar:
    """Return a vehicle of 2 kg and 0.5 kg m² whose command is a force."""
    return Planar(2.0, 0.5, np.eye(3), **fields)


def drive(vehicle, eta, nu, effort, duration_s, dt_s=0.01):
    nu_dot = None
    for _ in range(round(duration_s / dt_s)):
        eta, nu, nu_dot = vehicle.advance(eta, nu, constant_effort(effort), dt_s)
    return eta, nu, nu_dot


def test_with_viscous_friction_a_coasting_vehicle_stops_after_m_v_over_d():
    p = planar(friction=Friction(linear=np.array([4.0, 0.0, 0.0])))
    eta, nu, _ = drive(p, REST, np.array([3.0, 0.0, 0.0]), REST, 20.0)
    assert eta == pytest.approx([2.0 * 3.0 / 4.0, 0.0, 0.0], abs=1e-8)
    assert nu == pytest.approx(REST, abs=1e-9)


def test_with_dry_friction_a_coasting_vehicle_stops_after_mv2_over_2f():
    friction = Friction(coulomb=np.array([1.0, 0.0, 0.0]), coulomb_speed=np.array([1e-3, 0.05, 0.5]))
    eta, nu, _ = drive(planar(friction=friction), REST, np.array([0.5, 0.0, 0.0]), REST, 3.0, dt_s=1e-3)
    assert eta[0] == pytest.approx(2.0 * 0.5**2 / (2.0 * 1.0), abs=1e-4)  # 0.25 m
    assert nu[0] == pytest.approx(0.0, abs=1e-4)


def test_with_quadratic_friction_the_coasting_distance_is_logarithmic():
    p = planar(friction=Friction(quadratic=np.array([4.0, 0.0, 0.0])))
    eta, _, _ = drive(p, REST, np.array([3.0, 0.0, 0.0]), REST, 5.0)
    assert eta[0] == pytest.approx(2.0 / 4.0 * np.log(1.0 + 4.0 * 3.0 * 5.0 / 2.0), abs=1e-5)


def test_the_final_speed_under_constant_force_is_force_over_friction():
    p = planar(friction=Friction(linear=np.array([4.0, 1.0, 0.1])))
    _, nu, nu_dot = drive(p, REST, REST, np.array([2.0, 0.0, 0.0]), 20.0)
    assert nu == pytest.approx([0.5, 0.0, 0.0], abs=1e-8)
    assert nu_dot == pytest.approx(REST, abs=1e-8)


def test_a_spinning_body_without_forces_moves_straight_in_the_map():
    """Without a force the body moves straight in the map, so its velocity in its own axes changes."""
    eta, nu, _ = drive(planar(), REST, np.array([1.0, 0.0, np.pi / 2.0]), REST, 1.0)
    assert eta == pytest.approx([1.0, 0.0, np.pi / 2.0], abs=1e-8)
    assert nu == pytest.approx([0.0, -1.0, np.pi / 2.0], abs=1e-8)


def test_a_steady_circle_needs_m_v_omega_to_the_left():
    """2 kg at 0.5 m/s and 2 rad/s: 2 N to the left, and the circle has a radius of 0.25 m."""
    effort = np.array([0.0, 2.0 * 0.5 * 2.0, 0.0])
    nu = np.array([0.5, 0.0, 2.0])
    eta, nu_end, nu_dot = drive(planar(), REST, nu, effort, np.pi / 2.0, dt_s=np.pi / 200.0)
    assert nu_end == pytest.approx(nu, abs=1e-12)
    assert nu_dot == pytest.approx(REST, abs=1e-12)
    assert eta[:2] == pytest.approx([0.0, 0.5], abs=1e-8)  # half a turn: one diameter to the left


def test_a_constant_torque_gives_the_yaw_rate_n_t_over_i():
    _, nu, _ = drive(planar(), REST, REST, np.array([0.0, 0.0, 0.25]), 2.0)
    assert nu == pytest.approx([0.0, 0.0, 0.25 * 2.0 / 0.5], abs=1e-12)


def test_a_slope_moves_a_free_vehicle_by_half_g_sin_alpha_t2():
    p = planar(slope_rad=0.1, slope_heading_rad=0.0)
    eta, nu, _ = drive(p, REST, REST, REST, 2.0)
    assert eta == pytest.approx([-0.5 * G * np.sin(0.1) * 4.0, 0.0, 0.0], abs=1e-9)
    assert nu == pytest.approx([-G * np.sin(0.1) * 2.0, 0.0, 0.0], abs=1e-9)


def test_gravity_pulls_right_on_a_slope_that_rises_left():
    p = planar(slope_rad=0.1, slope_heading_rad=np.pi / 2.0)
    assert p.gravity(0.0) == pytest.approx([0.0, -G * np.sin(0.1)], abs=1e-12)
    assert p.gravity(np.pi / 2.0) == pytest.approx([-G * np.sin(0.1), 0.0], abs=1e-12)


def test_a_push_through_the_centre_of_mass_does_not_turn_the_body():
    """F at the axle and a torque c F about it are one force through the centre of mass."""
    p = planar(centre_of_mass_x_m=0.3)
    assert p.nu_dot(REST, np.array([0.0, 1.0, 0.3])) == pytest.approx([0.0, 0.5, 0.0], abs=1e-12)


def test_a_sideways_force_at_the_axle_turns_the_front_the_opposite_way():
    """1 N to the left on the axle, the mass 0.3 m ahead: −1·0.3/0.5 rad/s², and the centre accelerates with 1/2
    m/s²."""
    nu_dot = planar(centre_of_mass_x_m=0.3).nu_dot(REST, np.array([0.0, 1.0, 0.0]))
    assert nu_dot == pytest.approx([0.0, 0.5 + 0.3 * 0.6, -0.6], abs=1e-12)


def test_a_spinning_body_without_forces_turns_about_its_centre_of_mass():
    """The axle moves round a fixed centre of mass: after half a turn it is 2 c away."""
    c, omega = 0.3, 2.0
    nu = np.array([0.0, -c * omega, omega])  # the centre of mass is at rest
    eta, _, _ = drive(planar(centre_of_mass_x_m=c), REST, nu, REST, np.pi / omega, dt_s=np.pi / 400.0)
    assert eta[:2] == pytest.approx([2.0 * c, 0.0], abs=1e-8)


def test_a_kinematic_vehicle_drives_a_circle_of_radius_v_over_omega():
    k = Kinematic(np.diag([0.5, 0.0, 2.0]))
    eta, nu, nu_dot = drive(k, REST, REST, np.array([1.0, 0.0, 1.0]), np.pi / 2.0, dt_s=np.pi / 400.0)
    assert eta[:2] == pytest.approx([0.0, 0.5], abs=1e-8)
    assert nu == pytest.approx([0.5, 0.0, 2.0])
    assert nu_dot == pytest.approx(REST)


def test_a_kinematic_vehicle_reaches_its_velocity_within_the_first_tick():
    k = Kinematic(np.diag([0.5, 0.0, 2.0]))
    _, nu, nu_dot = k.advance(REST, REST, constant_effort(np.array([1.0, 0.0, 1.0])), 0.01)
    assert nu == pytest.approx([0.5, 0.0, 2.0])
    assert nu_dot == pytest.approx([50.0, 0.0, 200.0])


def test_a_car_drives_a_circle_of_radius_wheelbase_over_tan_delta():
    """With 0.15 m and 0.3 rad the radius is 0.485 m; a full turn ends at its start."""
    car = Car(wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.3, linear_drag=4.0)
    radius = 0.15 / np.tan(0.3)
    effort = np.array([0.5, 1.0])
    nu = np.array([0.5, 0.0, 0.5 / radius])
    turn_s = 2.0 * np.pi * radius / 0.5
    eta, nu_end, _ = drive(car, REST, nu, effort, turn_s, dt_s=turn_s / 600.0)
    assert eta == pytest.approx(REST, abs=1e-7)
    assert nu_end == pytest.approx(nu, abs=1e-12)
    half, _, _ = drive(car, REST, nu, effort, turn_s / 2.0, dt_s=turn_s / 600.0)
    assert half[1] == pytest.approx(2.0 * radius, abs=1e-7)


def test_a_braking_car_with_a_constant_steering_angle_stays_on_its_circle():
    car = Car(wheelbase_m=0.2, throttle_gain=4.0, steering_gain=0.3, linear_drag=4.0, yaw_lag_s=0.1)
    curvature = np.tan(0.3) / 0.2
    state = car.init(nu=np.array([2.0, 0.0, 2.0 * curvature]))
    for _ in range(30):  # 0.3 s without throttle
        state, _ = car.step(state, np.array([0.0, 1.0]), 0.01, np.zeros(3))
    assert state.nu[0] == pytest.approx(2.0 * np.exp(-1.2), rel=1e-3)
    assert state.nu[2] / state.nu[0] == pytest.approx(curvature, rel=1e-2)


def test_the_middle_of_a_car_moves_sideways_at_b_omega():
    car = Car(wheelbase_m=0.2, throttle_gain=4.0, steering_gain=0.3, rear_axle_m=0.1)
    state = car.init(nu=np.array([0.5, 7.0, 2.0]))  # a sideways speed that the rear axle does not allow
    assert state.nu == pytest.approx([0.5, 0.2, 2.0])
    _, nu, nu_dot = car.advance(REST, state.nu, constant_effort(np.array([0.0, 1.0])), 0.01)
    assert nu[1] == pytest.approx(0.1 * nu[2])
    assert nu_dot[1] == pytest.approx(0.1 * nu_dot[2])


def test_cornering_drag_slows_a_car_by_k_v_omega():
    straight = Car(wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.3)
    car = Car(wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.3, cornering_drag=0.8)
    for v, r in ((0.5, 2.0), (0.5, -2.0), (-0.5, 2.0)):
        nu, effort = np.array([v, 0.0, r]), np.zeros(2)
        extra = car.nu_dot(nu, effort)[0] - straight.nu_dot(nu, effort)[0]
        assert extra == pytest.approx(-0.8 * abs(v * r) * np.sign(v))


def test_a_car_that_understeers_turns_on_a_wider_circle_at_speed():
    """0.1 s²/m and 2 m/s add 0.4 m to a wheelbase of 0.2 m, so the circle is three times as large as at rest."""
    car = Car(wheelbase_m=0.2, throttle_gain=4.0, steering_gain=0.3, understeer=0.1)
    for v, radius in ((0.0, 0.2 / np.tan(0.3)), (2.0, 0.6 / np.tan(0.3)), (-2.0, 0.6 / np.tan(0.3))):
        steady = car.nu_dot(np.array([v, 0.0, v / radius]), np.array([0.0, 1.0]))
        assert steady == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_pwm_motor_that_can_coast_brakes_only_during_its_pulses():
    """Duty 0.5 of 0.3 effort and a dead zone of 0.2; back EMF 4 1/s: at 1 m/s the motor brakes with 2 m/s²."""
    free = Drivetrain(commands=2, dead_zone_forward=np.array([0.2, 0.0]))
    car = Car(0.15, throttle_gain=10.0, steering_gain=0.3, motor_drag=4.0, drivetrain=free)
    nu = np.array([1.0, 0.0, 0.0])
    assert car.nu_dot(nu, np.array([0.3, 0.0]))[0] == pytest.approx(3.0 - 4.0 * 0.5)
    assert car.nu_dot(nu, np.array([0.0, 0.0]))[0] == 0.0


def test_a_kinematic_vehicle_slides_outward_in_a_curve():
    """2 m/s and 0.5 rad/s to the left with 0.3 s give 0.3 m/s to the right; without a curve they give 0."""
    vehicle = Kinematic(np.diag([1.0, 0.0, 1.0]), slide_s=0.3)
    assert vehicle.velocity(np.array([2.0, 0.0, 0.5])) == pytest.approx([2.0, -0.3, 0.5])
    assert vehicle.velocity(np.array([-2.0, 0.0, 0.5])) == pytest.approx([-2.0, 0.3, 0.5])
    assert vehicle.velocity(np.array([2.0, 0.0, 0.0]))[1] == 0.0
    assert vehicle.velocity(np.array([0.0, 0.0, 2.0]))[1] == 0.0
