"""Encoders and a camera: hand calculations."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from baqueano.geometry import wrap
from baqueano.sensors import Odometer, Pose, Wheels
from baqueano.signals import Motion
from tests.codes import refused

QUICK = settings(max_examples=30)


def motion(eta=(0.0, 0.0, 0.0), nu=(0.0, 0.0, 0.0)) -> Motion:
    return Motion(np.array(eta, dtype=float), np.array(nu, dtype=float), np.zeros(3), np.zeros(2))


def test_in_a_left_turn_the_right_wheel_is_faster():
    """0.5 m/s and 2 rad/s with a track of 0.12 m give 0.38 and 0.62 m/s."""
    assert Wheels(track_m=0.12).h(motion(nu=[0.5, 0.1, 2.0])) == pytest.approx([0.38, 0.62])


def test_a_worn_wheel_measures_a_higher_speed():
    wheels = Wheels(track_m=0.12, radius_scale=np.array([1.0, 1.02]))
    assert wheels.h(motion(nu=[0.5, 0.0, 0.0])) == pytest.approx([0.5, 0.51])


def test_an_odometer_reads_the_forward_speed_with_its_scale():
    assert Odometer(scale=1.02).h(motion(nu=[0.5, 0.3, 2.0])) == pytest.approx([0.51])


@pytest.mark.parametrize(
    "sensor",
    [
        Wheels(track_m=0.12, noise_std=0.1),
        Odometer(noise_std=0.1),
        Pose(noise_std=np.full(3, 0.1), rate_hz=100.0),
    ],
)
def test_noise_is_its_std_times_the_given_unit_normal(sensor):
    noise = np.arange(1.0, sensor.size + 1.0)
    _, slot = sensor.step(sensor.init(), motion(), 0.01, noise)
    assert slot.z == pytest.approx(0.1 * noise)
    assert sensor.cov == pytest.approx(0.01 * np.eye(sensor.size))


@pytest.mark.parametrize(("block", "fields"), [(Wheels, {"track_m": 0.12}), (Odometer, {}), (Pose, {})])
def test_a_sensor_uses_a_covariance_from_a_fit(block, fields):
    Q = 0.3 * np.eye(block(**fields).size)
    assert block(**fields, measurement_noise_cov=Q).cov is Q


@QUICK
@given(st.floats(-3.1, 3.1), st.floats(-3.0, 3.0))
def test_es10_a_measured_pose_and_pose_differences_are_wrapped(psi, noise):
    pose = Pose(noise_std=np.array([0.0, 0.0, 1.0]), rate_hz=100.0)
    _, slot = pose.step(pose.init(), motion([1.0, 2.0, psi]), 0.01, np.array([0.0, 0.0, noise]))
    assert -np.pi <= slot.z[2] < np.pi
    d = pose.difference(slot.z, np.array([1.0, 2.0, psi]))
    assert d == pytest.approx([0.0, 0.0, wrap(noise)], abs=1e-12)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_delayed_pose_is_interpolated_across_pi(side):
    """At 2 rad/s through ±π with 25 ms of delay the heading is always 0.05 rad behind, never near zero."""
    pose = Pose(rate_hz=100.0, delay_s=0.025, delay_slots=3)
    state, times = pose.init(), []
    for k in range(60):
        psi = side * (np.pi - 0.5 + 0.02 * k)
        state, slot = pose.step(state, motion([0.0, 0.0, wrap(psi)]), 0.01, np.zeros(3))
        if slot.is_new:
            times.append(wrap(psi - slot.z[2]))
            assert -np.pi <= slot.z[2] < np.pi
    assert len(times) == 57
    assert np.array(times) == pytest.approx(np.full(57, side * 0.05), abs=1e-9)


ERRORS = [
    ("field.range", {"field": "Wheels.track_m", "value": "0", "low": 0.001}, lambda: Wheels(track_m=0)),
    (
        "field.shape",
        {"field": "Pose.noise_std", "value": "(2,)", "expected": "(3,)"},
        lambda: Pose(noise_std=np.zeros(2)),
    ),
    ("field.range", {"field": "Odometer.rate_hz", "value": "0", "low": 0.001}, lambda: Odometer(rate_hz=0)),
    ("delay.no-slots", {"name": "Pose", "delay_s": 0.1, "slots": 10}, lambda: Pose(delay_s=0.1)),
]


@pytest.mark.parametrize(("code", "figures", "make"), ERRORS)
def test_impossible_sensor_parameters_are_refused(code, figures, make):
    with refused(code, ValueError, **figures):
        make()
