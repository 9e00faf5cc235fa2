"""Frames: J is a rotation; the map's origin and full turns do not change the motion of a vehicle."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from baqueano.geometry import compose, map_from_body, wrap
from baqueano.vehicles import Car, Friction, Kinematic, Planar

QUICK = settings(max_examples=30)

T = np.array([[2.0, 0.1, 0.2], [0.0, 1.0, 0.3], [-0.1, 0.2, 0.5]])
FRICTION = Friction(linear=np.array([1.0, 3.0, 0.2]), quadratic=np.array([0.5, 0.5, 0.1]))
VEHICLES = {
    "planar": Planar(2.0, 0.5, T, centre_of_mass_x_m=0.05, friction=FRICTION),
    "kinematic": Kinematic(T),
    "car": Car(wheelbase_m=0.15, throttle_gain=4.0, steering_gain=0.3, rear_axle_m=0.07, linear_drag=2.0),
}
COMMANDS = {3: np.array([0.5, 0.1, -0.8]), 2: np.array([0.5, -0.8])}
poses = arrays(float, 3, elements=st.floats(-3.0, 3.0))
names = pytest.mark.parametrize("name", VEHICLES)


def drive(vehicle, eta, ticks=12):
    state = vehicle.init(eta, np.array([0.3, 0.0, 0.4]))
    for _ in range(ticks):
        state, motion = vehicle.step(state, COMMANDS[vehicle.commands], 0.01, np.zeros(3))
    return state, motion


@QUICK
@given(st.floats(-10.0, 10.0))
def test_the_frame_transformation_is_a_rotation(psi):
    J = map_from_body(psi)
    assert pytest.approx(np.eye(3), abs=1e-15) == J @ J.T
    assert np.linalg.det(J) == pytest.approx(1.0)
    assert J[2] == pytest.approx([0.0, 0.0, 1.0])


@names
@QUICK
@given(start=poses)
def test_shifting_and_rotating_the_start_moves_the_path_equally(name, start):
    drive_at_zero, motion_here = drive(VEHICLES[name], np.zeros(3))
    drive_at_start, motion_there = drive(VEHICLES[name], start)
    expected = compose(start, drive_at_zero.eta)
    assert drive_at_start.eta[:2] == pytest.approx(expected[:2], abs=1e-9)
    assert wrap(drive_at_start.eta[2] - expected[2]) == pytest.approx(0.0, abs=1e-9)
    assert motion_there.nu == pytest.approx(motion_here.nu, abs=1e-9)
    assert motion_there.nu_dot == pytest.approx(motion_here.nu_dot, abs=1e-9)


@QUICK
@given(turn=st.floats(-3.0, 3.0))
def test_rotating_slope_and_vehicle_together_does_not_change_the_motion(turn):
    def on(heading):
        return Planar(2.0, 0.5, T, friction=FRICTION, slope_rad=0.1, slope_heading_rad=heading)

    _, flat = drive(on(0.5), np.zeros(3))
    _, turned_motion = drive(on(0.5 + turn), np.array([1.0, -2.0, turn]))
    assert turned_motion.nu == pytest.approx(flat.nu, abs=1e-9)
    assert turned_motion.gravity == pytest.approx(flat.gravity, abs=1e-9)


@names
@pytest.mark.parametrize("turns", [-2, 1])
def test_full_turns_of_the_start_heading_do_not_change_the_motion(name, turns):
    drive_at_zero, _ = drive(VEHICLES[name], np.array([0.0, 0.0, 0.3]))
    turned_motion, _ = drive(VEHICLES[name], np.array([0.0, 0.0, 0.3 + 2.0 * np.pi * turns]))
    assert turned_motion.eta == pytest.approx(drive_at_zero.eta, abs=1e-9)


@names
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_heading_wraps_when_crossing_pi(name, side):
    vehicle = VEHICLES[name]
    start = np.array([0.0, 0.0, side * (np.pi - 1e-3)])
    state = vehicle.init(start, np.array([0.0, 0.0, side * 3.0]))
    headings = [start[2]]
    for _ in range(5):
        u = np.array([0.0, 0.0, side * 6.0]) if vehicle.commands == 3 else np.array([1.0, side])
        state, _ = vehicle.step(state, u, 0.01, np.zeros(3))
        headings.append(state.eta[2])
    assert all(-np.pi <= psi < np.pi for psi in headings)
    assert np.all(side * wrap(np.diff(headings)) > 0.0)
    assert np.max(np.abs(np.diff(headings))) > 6.0  # the heading did cross ±π
