"""The IMU: hand calculations of the accelerometer, then each error of a cheap chip separately."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.geometry import map_from_body
from baqueano.sensors import Imu
from baqueano.signals import Motion
from baqueano.vehicles import Car, Friction, Planar, constant_effort
from tests.codes import refused

QUICK = settings(max_examples=30)

G = 9.80665
QUIET = np.zeros(6)


def motion(nu=(0.0, 0.0, 0.0), nu_dot=(0.0, 0.0, 0.0), gravity=(0.0, 0.0), eta=(0.0, 0.0, 0.0)) -> Motion:
    return Motion(*(np.array(a, dtype=float) for a in (eta, nu, nu_dot, gravity)))


def reading_of(imu, motion_read, noise=QUIET, dt_s=0.01):
    _, slot = imu.step(imu.init(), motion_read, dt_s, noise)
    return slot.z


def test_on_a_left_circle_the_imu_measures_v_omega_to_the_left():
    assert Imu().h(motion(nu=[0.3, 0.0, 2.0])) == pytest.approx([0.0, 0.6, 2.0])
    assert Imu().h(motion(nu=[0.3, 0.0, -2.0])) == pytest.approx([0.0, -0.6, -2.0])


def test_on_a_steady_circle_a_car_imu_measures_only_v_omega():
    car = Car(wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.3, linear_drag=4.0)
    state = car.init()
    for _ in range(300):
        state, motion_ = car.step(state, np.array([0.5, 1.0]), 0.01, np.zeros(3))
    v, omega = 0.5, 0.5 * np.tan(0.3) / 0.15
    assert Imu().h(motion_) == pytest.approx([0.0, v * omega, omega], abs=1e-4)


def test_a_forward_acceleration_is_measured_forward():
    assert Imu().h(motion(nu_dot=[1.5, 0.0, 0.0])) == pytest.approx([1.5, 0.0, 0.0])


def test_an_uphill_imu_at_rest_measures_g_sin_alpha_forward():
    assert Imu().h(motion(gravity=[-G * np.sin(0.1), 0.0])) == pytest.approx([G * np.sin(0.1), 0.0, 0.0])


def test_an_imu_rolling_freely_downhill_measures_zero():
    p = Planar(1.0, 1.0, np.eye(3), slope_rad=0.3, slope_heading_rad=1.0)
    _, motion_ = p.step(p.init(), np.zeros(3), 0.01, np.zeros(3))
    assert Imu().h(motion_) == pytest.approx(np.zeros(3), abs=1e-12)


def test_an_imu_ahead_of_the_axis_measures_centripetal_and_tangential_acceleration():
    """5 cm ahead, 2 rad/s and 3 rad/s²: −0.05·4 = −0.2 and 0.05·3 = 0.15 m/s²."""
    imu = Imu(lever_arm_m=np.array([0.05, 0.0]))
    spin = motion(nu=[0.0, 0.0, 2.0], nu_dot=[0.0, 0.0, 3.0])
    assert imu.h(spin) == pytest.approx([-0.2, 0.15, 2.0])
    left = Imu(lever_arm_m=np.array([0.0, 0.05]))
    assert left.h(spin) == pytest.approx([-0.15, -0.2, 2.0])


def test_a_tilted_imu_measures_a_component_of_gravity():
    pitched_imu = Imu(tilt_rad=np.array([0.0, 0.02]))
    assert pitched_imu.h(motion()) == pytest.approx([-G * np.sin(0.02), 0.0, 0.0])
    tilted_imu = Imu(tilt_rad=np.array([0.02, 0.0]))
    assert tilted_imu.h(motion()) == pytest.approx([0.0, G * np.sin(0.02), 0.0])


@QUICK
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), arrays(float, 2, elements=st.floats(-3.0, 3.0)))
def test_a_tilted_imu_measures_the_rotated_acceleration(roll, pitch, force):
    c, s = np.cos, np.sin
    about_x = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    about_y = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    imu_from_body = (about_y @ about_x).T
    z = Imu(tilt_rad=np.array([roll, pitch])).h(motion(nu=[0, 0, 1.5], nu_dot=[*force, 0.0]))
    assert z[:2] == pytest.approx((imu_from_body @ [force[0], force[1], G])[:2], abs=1e-12)
    assert z[2] == pytest.approx((imu_from_body @ [0.0, 0.0, 1.5])[2], abs=1e-12)


def test_imu_acceleration_is_the_second_derivative_of_its_position():
    """The path of the chip, differentiated twice and rotated into the body, equals (1) and (2)."""
    p = Planar(
        2.0,
        0.05,
        np.diag([2.0, 3.0, 0.1]),
        centre_of_mass_x_m=0.02,
        friction=Friction(linear=np.array([2.0, 6.0, 0.1])),
    )
    lever, h, effort = np.array([0.03, -0.02]), 1e-4, np.array([1.0, -0.5, 0.7])
    eta, nu = np.array([0.3, -0.2, 0.8]), np.array([0.6, -0.2, 1.9])
    places, motion_ = [], None
    for k in range(3):
        places.append(eta[:2] + (map_from_body(eta[2]) @ [*lever, 0.0])[:2])
        if k == 1:
            motion_ = motion(nu, p.nu_dot(nu, effort), eta=eta)
        eta, nu, _ = p.advance(eta, nu, constant_effort(effort), h)
    acceleration = (places[0] - 2.0 * places[1] + places[2]) / h**2
    force = map_from_body(motion_.eta[2])[:2, :2].T @ acceleration
    assert Imu(lever_arm_m=lever).h(motion_)[:2] == pytest.approx(force, abs=1e-5)


@QUICK
@given(arrays(float, 3, elements=st.floats(-3.0, 3.0)), arrays(float, 3, elements=st.floats(-3.0, 3.0)))
def test_the_paper_measurement_function_is_as_printed_for_any_mounting(nu, nu_dot):
    imu = Imu(measurement_model="paper", lever_arm_m=np.array([0.05, 0.01]), tilt_rad=np.array([0.1, 0.1]))
    z = imu.h(motion(nu, nu_dot, gravity=[1.0, 1.0]))
    assert z == pytest.approx([nu_dot[0], nu_dot[1], nu[2]])


def test_the_paper_measurement_function_omits_the_centripetal_acceleration():
    """0.3 m/s and 2 rad/s (errata 3)."""
    motion_ = motion(nu=[0.3, 0.0, 2.0])
    missing = Imu().h(motion_) - Imu(measurement_model="paper").h(motion_)
    assert missing == pytest.approx([0.0, 0.6, 0.0])


def test_a_bias_is_added_to_the_reading():
    imu = Imu(accel_bias=np.array([0.1, -0.2]), gyro_bias=0.03)
    assert reading_of(imu, motion()) == pytest.approx([0.1, -0.2, 0.03])


def test_a_scale_multiplies_the_signal_and_not_the_bias():
    imu = Imu(accel_scale=np.array([1.1, 0.9]), gyro_scale=1.03, gyro_bias=0.5)
    motion_ = motion(nu=[0.0, 0.0, 2.0], nu_dot=[1.0, 1.0, 0.0])
    assert reading_of(imu, motion_) == pytest.approx([1.1, 0.9, 2.56])


def test_the_bias_depends_on_the_temperature():
    imu = Imu(
        temperature_c=35.0,
        temperature_reference_c=25.0,
        accel_temperature_slope=np.array([0.01, -0.02]),
        gyro_temperature_slope=0.003,
    )
    assert reading_of(imu, motion()) == pytest.approx([0.1, -0.2, 0.03])


def test_noise_is_its_std_times_the_given_unit_normal():
    imu = Imu(accel_noise_std=np.array([0.1, 0.2]), gyro_noise_std=0.01)
    noise = np.array([1.0, -2.0, 3.0, 9.0, 9.0, 9.0])
    assert reading_of(imu, motion(), noise) == pytest.approx([0.1, -0.4, 0.03])


@pytest.mark.parametrize("dt_s", [0.01, 0.04])
def test_a_bias_walk_step_is_std_times_root_dt(dt_s):
    imu = Imu(accel_bias_walk=0.1, gyro_bias_walk=0.02, rate_hz=1.0 / dt_s)
    state, step = imu.init(), np.array([0.0, 0.0, 0.0, 1.0, -1.0, 2.0])
    for _ in range(2):
        state, slot = imu.step(state, motion(), dt_s, step)
    expected = 2.0 * np.sqrt(dt_s) * np.array([0.1, -0.1, 0.04])
    assert slot.z == pytest.approx(expected)
    _, slot = imu.step(state, motion(), dt_s, QUIET)
    assert slot.z == pytest.approx(expected)


def test_an_imu_saturates_beyond_its_range():
    imu = Imu(accel_limit=19.6, gyro_limit=8.7)
    assert reading_of(imu, motion(nu=[0, 0, -12.0], nu_dot=[30.0, -30.0, 0.0])) == pytest.approx(
        [19.6, -19.6, -8.7]
    )
    assert reading_of(imu, motion(nu=[0, 0, 8.0])) == pytest.approx([0.0, 0.0, 8.0])


def test_readings_are_rounded_to_the_converter_steps():
    imu = Imu(accel_step=0.1, gyro_step=0.25)
    assert reading_of(imu, motion(nu=[0, 0, 0.3], nu_dot=[0.26, -0.26, 0])) == pytest.approx(
        [0.3, -0.3, 0.25]
    )
    fine = Imu(gyro_step=0.25)
    assert reading_of(fine, motion(nu=[0, 0, 0.3], nu_dot=[0.26, 0, 0])) == pytest.approx(
        [0.26, 0.09 - 0.09, 0.25]
    )


def test_noise_is_rounded_and_saturated_too():
    imu = Imu(accel_noise_std=np.array([1.0, 1.0]), accel_limit=2.0, accel_step=0.5)
    assert reading_of(imu, motion(), np.array([9.0, 0.7, 0.0, 0.0, 0.0, 0.0])) == pytest.approx(
        [2.0, 0.5, 0.0]
    )


def test_the_covariance_q_is_the_squared_noise_or_the_fitted_matrix():
    imu = Imu(accel_noise_std=np.array([0.1, 0.2]), gyro_noise_std=0.01)
    assert imu.cov == pytest.approx(np.diag([0.01, 0.04, 1e-4]))
    Q = np.diag([1.0, 2.0, 3.0])
    assert Imu(measurement_noise_cov=Q).cov is Q


ERRORS = [
    ("imu.model", {"value": "'exact'", "valid": "physical, paper"}, lambda: Imu(measurement_model="exact")),
    (
        "field.range",
        {"field": "Imu.gyro_noise_std", "value": "-0.1", "low": 0.0, "high": 100.0},
        lambda: Imu(gyro_noise_std=-0.1),
    ),
    (
        "field.shape",
        {"field": "Imu.lever_arm_m", "value": "(3,)", "expected": "(2,)"},
        lambda: Imu(lever_arm_m=np.zeros(3)),
    ),
    (
        "field.shape",
        {"field": "Imu.measurement_noise_cov", "value": "(6, 6)", "expected": "(3, 3)"},
        lambda: Imu(measurement_noise_cov=np.eye(6)),
    ),
    ("delay.no-slots", {"name": "Imu", "delay_s": 0.005, "slots": 1}, lambda: Imu(delay_s=0.005)),
    ("delay.slots", {"name": "Imu", "value": "1.5"}, lambda: Imu(delay_slots=1.5)),
]


@pytest.mark.parametrize(("code", "figures", "make"), ERRORS)
def test_impossible_imu_parameters_are_refused(code, figures, make):
    with refused(code, ValueError, **figures):
        make()


def test_an_imu_rotated_left_by_90_degrees_measures_forward_on_minus_y():
    """The x axis of the IMU points to the left of the vehicle: it measures y there, and −x along its y axis."""
    motion_ = Motion(np.zeros(3), np.zeros(3), np.array([2.0, 0.5, 0.0]), np.zeros(2))
    assert Imu(heading_rad=np.pi / 2).h(motion_) == pytest.approx([0.5, -2.0, 0.0])
    assert Imu(heading_rad=0.0).h(motion_) == pytest.approx([2.0, 0.5, 0.0])
